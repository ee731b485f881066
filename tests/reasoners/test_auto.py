"""Auto: the configured model while it answers in time, else the embedded reasoner, and always a line that says why."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from cartier import plugins
from cartier.errors import BackendError, InputError
from cartier.types import Inventory

OBJECTS = ["chair", "coffee machine", "dining table", "bed", "refrigerator"]


@pytest.fixture(autouse=True)
def nothing_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "OPENAI_MODEL", "CARTIER_MODEL"):
        monkeypatch.delenv(name, raising=False)


def auto(**options: Any) -> Any:
    return plugins.make("reasoners", "auto", **options)


def is_embedded(mind: Any, why: str) -> bool:
    chosen = mind.select("I am so tired, let me sleep", Inventory.of(OBJECTS))
    assert len(mind.notes) == 1 and "embedded reasoner answers" in mind.notes[0] and "\n" not in mind.notes[0]
    return chosen.object == "bed" and "embedded" in chosen.model and why in mind.notes[0]


def test_without_a_model_the_embedded_reasoner_answers_and_says_so() -> None:
    mind = auto()
    assert is_embedded(mind, "no OPENAI_API_KEY, OPENAI_BASE_URL or CARTIER_MODEL") and mind.calls == mind.tokens == 0
    assert "bed" in mind.propose("I am so tired, let me sleep")


def test_a_server_that_answers_is_the_one_that_answers(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_BASE_URL", f"{server}/v1")
    mind = auto(model="wrapped")
    chosen = mind.select("I am so tired, let me sleep", Inventory.of(OBJECTS))
    assert (chosen.object, mind.notes) == ("chair", ()) and "openai wrapped" in chosen.model and mind.calls > 0
    mind.propose("I am tired")
    assert mind.notes == ()


@pytest.mark.parametrize(
    ("behaviour", "why"), [("401", "OPENAI_API_KEY"), ("500", "answered 500"), ("html", "no chat completion")]
)
def test_a_server_that_refuses_leaves_nobody_unanswered(server: str, behaviour: str, why: str) -> None:
    mind = auto(base_url=f"{server}/v1", model=behaviour)
    assert is_embedded(mind, why) and is_embedded(mind, why)


def test_nobody_at_home_and_no_key_leave_nobody_unanswered() -> None:
    assert is_embedded(auto(base_url="http://127.0.0.1:9/v1"), "cannot reach")
    assert is_embedded(auto(model="gpt-4o"), "OPENAI_API_KEY")


def test_a_server_that_hangs_is_waited_for_once(server: str) -> None:
    mind = auto(base_url=f"{server}/v1", model="hangs", timeout_s=0.3)
    begin = time.monotonic()
    assert is_embedded(mind, "did not answer within 0.3 s") and time.monotonic() - begin < 3
    begin = time.monotonic()
    assert is_embedded(mind, "was late and is asked again in") and time.monotonic() - begin < 0.3


def test_notes_are_those_of_ones_own_latest_answer(server: str) -> None:
    mind, seen = auto(base_url=f"{server}/v1", model="wrapped"), []
    assert is_embedded(auto(), "is set")
    thread = threading.Thread(target=lambda: seen.append(mind.notes))
    mind.select("my feet hurt", Inventory.of(OBJECTS))
    thread.start()
    thread.join()
    assert seen == [()]


def test_a_model_file_comes_before_a_key_and_answers_in_this_process(tiny_model: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("CARTIER_MODEL", str(tiny_model))
    monkeypatch.setenv("OPENAI_BASE_URL", "http://127.0.0.1:9/v1")
    mind = auto(prompt="paper")
    chosen = mind.select("my feet hurt", Inventory.of(OBJECTS))
    assert chosen.model == "local tiny.gguf" and mind.notes == () and mind.calls == 1
    assert is_embedded(auto(base_url="http://127.0.0.1:9/v1"), "cannot reach")  # what is given comes first
    monkeypatch.setenv("CARTIER_MODEL", str(tiny_model.with_name("gone.gguf")))
    assert is_embedded(auto(), "gone.gguf cannot be read")


@pytest.fixture(scope="module")
def slow_model(tmp_path_factory: pytest.TempPathFactory, tiny_model: Path) -> Path:
    from llm_server import write_tiny_llama

    file = tmp_path_factory.mktemp("slow") / "slow.gguf"
    write_tiny_llama(file, layers=24, width=256, hidden=512)
    return file


def test_a_model_that_is_late_may_finish_and_answers_the_next_request(slow_model: Path) -> None:
    mind = auto(model=str(slow_model), prompt="paper", timeout_s=0.01)
    mind._embedded.select(
        "I am so tired", Inventory.of(OBJECTS)
    )  # loaded, so that it answers twice while the model is at its first
    assert is_embedded(mind, "local did not answer within 0.01 s")
    assert is_embedded(mind, "local still thinks about an earlier request")
    mind._late.join(60)
    mind._timeout_s = 60
    assert (
        mind.select("I am so tired, let me sleep", Inventory.of(OBJECTS)).model == "local slow.gguf"
        and mind.notes == ()
    )


def test_a_program_ends_while_a_late_model_still_works(slow_model: Path) -> None:
    code = (
        f"from cartier import Inventory, plugins\nmind = plugins.make('reasoners', 'auto', model={str(slow_model)!r},"
        "timeout_s=0.01)\nchosen = mind.select('I am so tired, let me sleep', Inventory.of(['chair', 'bed']))\n"
        "print(chosen.object, mind.notes)"
    )
    env = {name: value for name, value in os.environ.items() if name != "RUST_LOG"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=env)
    assert done.returncode == 0 and done.stdout.startswith("bed (") and done.stderr == ""


def test_mistakes_in_its_own_options_are_said_at_once() -> None:
    with pytest.raises(BackendError, match="the prompts are paper, rich"):
        auto(prompt="poor")
    with pytest.raises(InputError, match="timeout_s must be positive"):
        auto(timeout_s=0)
    with pytest.raises(InputError, match="empty"):
        auto().select("", Inventory.of(OBJECTS))
