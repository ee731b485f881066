"""cartier check-model, against servers with each known fault, and what keeps its result."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import cartier
from cartier.errors import InputError
from cartier.llm import capabilities, structured_output
from cartier.vision.check import check_model
from vision.seeing_server import serving


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.mark.parametrize(
    ("model", "keeps", "sees", "mirrored", "thinking"),
    [
        ("sees", True, True, True, "off"),
        ("string-only", True, True, True, "off"),
        ("reasoning-field", True, True, True, "on"),
        ("no-thinking-switch", True, True, True, "off"),
        ("detail", True, True, True, "off"),
        ("blind", True, False, False, "off"),
        ("ignores-grammar", False, False, False, "off"),
        ("endless", False, False, False, "on"),
        ("refuses-images", True, None, None, "off"),
    ],
)
def test_what_a_model_can_do(model: str, keeps: bool, sees: bool | None, mirrored: bool | None, thinking: str) -> None:
    with serving() as (url, _):
        found = check_model(url, model)
    assert (found.keeps_schema, found.sees, found.knows_mirrored, found.thinking) == (keeps, sees, mirrored, thinking)
    assert (found.form == "json_schema") == (keeps or sees is True)


def test_command_keeps_what_it_finds_and_a_look_uses_it(tmp_path: Path) -> None:
    with serving() as (url, _):
        run = [sys.executable, "-m", "cartier", "check-model", url, "--model", "blind", "--json"]
        said = json.loads(subprocess.run(run, capture_output=True, text=True, check=True).stdout)
        assert said["sees"] is False and Path(said["kept_in"]).is_relative_to(tmp_path)
        permitted = cartier.make("vision", "openai", model="blind", base_url=url)
        assert permitted.sees is False  # type: ignore[attr-defined]
        assert cartier.make("vision", "openai", model="sees", base_url=url).sees is None  # type: ignore[attr-defined]


def test_text_reasoner_begins_with_the_form_found() -> None:
    url = "http://127.0.0.1:9/v1"
    found = capabilities.Capabilities(url, "m", "json_object", True, None, None, "off", 0.1, 10.0, "2026-11-25")
    capabilities.keep(found)
    cartier.make("reasoners", "openai", model="m", base_url=url)
    assert structured_output.form_of(url, "m") == "json_object"


def test_damaged_file_is_one_line() -> None:
    file = capabilities.settings_file()
    file.parent.mkdir(parents=True)
    file.write_text('{"m @ http://127.0.0.1:9/v1": {"else": 1}}')
    with pytest.raises(InputError, match="delete it"):
        capabilities.known("http://127.0.0.1:9/v1", "m")


def test_no_server_is_one_line() -> None:
    run = [sys.executable, "-m", "cartier", "check-model", "http://127.0.0.1:9/v1"]
    done = subprocess.run(run, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "cannot reach" in done.stderr
