"""Golden files of what programs read: the OpenAPI document, the results of the operations, and ``--json`` of commands.

A change that is wanted: ``WRITE_GOLDEN=1 pytest tests/serving/test_golden.py``, and a line in the changelog.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cartier.cli import app
from cartier.home import Home
from cartier.live.state import LiveState
from cartier.llm.capabilities import Capabilities
from cartier.recordings.folder import save
from cartier.serving import page
from cartier.serving.homes import Homes
from cartier.serving.operations import Operations
from cartier.types import Frame
from serving.test_operations import CALLS, Echo
from studio import studio
from synthetic import walk

GOLDEN = Path(__file__).parent / "golden"
CHANGES = {"home_id", "id_of_home", "made", "timing_ms", "seconds", "crop_sha256", "context_sha256", "version"}
"""Keys whose values are another's with each run, version or JPEG library: what is under them counts as there."""
WORDS = {
    "object": "bring me the mug",
    "two needs": "the mug, then let me sit down",
    "question": "how many chairs are there?",
    "which": "which room is the mug in?",
    "nothing": "where is the zebra?",
    "rule": "go to the chair, but keep away from the table",
    "standing rule": "never go near the table",
    "alarm": "there is a fire in the kitchen",
    "look": "is the chair clean?",
}


class Swapped:
    """The studio with red and blue swapped, for a fault to tell."""

    def __getattr__(self, name: str) -> Any:
        return getattr(studio(), name)

    def __len__(self) -> int:
        return len(studio())

    def __getitem__(self, i: int) -> Frame:
        return replace(studio()[i], rgb=studio()[i].rgb[..., ::-1].copy())


@pytest.fixture(scope="module")
def kept(mapped: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home with a name and a rule."""
    folder = tmp_path_factory.mktemp("golden") / "room"
    shutil.copytree(mapped, folder)
    Home.load(folder).correct("name", "mug", name="Ayo's mug", who="test")
    Home.load(folder).correct("rule", "avoid zone:1,1;2,1;2,2 soft standing", who="test")
    return folder


def stable(value: Any, key: str = "") -> Any:
    """A value without what changes with each run."""
    if key in CHANGES or (key == "id" and isinstance(value, str)):
        return "…"
    if isinstance(value, Mapping):
        return {name: stable(under, name) for name, under in value.items() if name != "title"}
    if isinstance(value, list | tuple):
        return [stable(each) for each in value[:12]]
    if isinstance(value, str):
        return re.sub(r"/\S*/golden\d+", "…", value)[:400]
    return round(value, 4) if isinstance(value, float) else value


def same(new: Any, old: Any) -> bool:
    """Whether two values are one: their keys and texts, and their numbers to a hundredth."""
    if isinstance(new, dict) and isinstance(old, dict):
        return new.keys() == old.keys() and all(same(new[key], old[key]) for key in new)
    if isinstance(new, list) and isinstance(old, list):
        return len(new) == len(old) and all(map(same, new, old))
    if isinstance(new, float) and isinstance(old, int | float):
        return math.isclose(new, old, rel_tol=1e-2, abs_tol=1e-2)
    return type(new) is type(old) and bool(new == old)


def compare(name: str, made: Mapping[str, Callable[[], Any]]) -> None:
    file = GOLDEN / f"{name}.json"
    new = {key: stable(json.loads(json.dumps(make()))) for key, make in made.items()}
    if "WRITE_GOLDEN" in os.environ:
        text = ",\n".join(f"{json.dumps(k)}: {json.dumps(v, ensure_ascii=False)}" for k, v in new.items())
        file.write_text(f"{{\n{text}\n}}\n", "utf-8")
    old = json.loads(file.read_text("utf-8"))
    assert new.keys() == old.keys()
    for key, value in new.items():
        assert same(value, old[key]), f"{name}, {key}:\n{json.dumps(value)}\n{json.dumps(old[key])}"


def test_openapi_is_kept(mapped: Path) -> None:
    http = pytest.importorskip("cartier.serving.http", reason="needs cartier[serve]")
    document = http.make(Operations(Homes([mapped]), Echo())).openapi()
    parts = {"paths": document["paths"], "schemas": document["components"]["schemas"]}
    compare("openapi", {f"{part} {key}": lambda v=v: v for part, of in parts.items() for key, v in of.items()})


def test_results_are_kept(kept: Path) -> None:
    def ops() -> Operations:
        return Operations(Homes([kept]), Echo())

    reading = {key: call for key, call in CALLS.items() if key not in ("correct", "undo")}
    made: dict[str, Callable[[], Any]] = {key: lambda call=call: call(ops()) for key, call in reading.items()}
    made["list_rules"] = lambda: ops().list_rules()
    made["view"] = lambda: page.view(Home.load(kept)) | {"grid": None}
    compare("results", made)


def test_json_of_commands_is_kept(kept: Path, tmp_path: Path) -> None:
    def told(*words: str) -> Any:
        result = CliRunner().invoke(app, [*words, "--json"])
        assert result.stdout, result.output
        return json.loads(result.stdout.splitlines()[-1])

    (tmp_path / "golden.jsonl").write_text("", "utf-8")
    asked = ("ask", str(kept), "--look", "ask", "--vision", f"replay:{tmp_path / 'golden.jsonl'}")
    save(walk(), tmp_path / "golden0")
    save(Swapped(), tmp_path / "golden1")
    made: dict[str, Callable[[], Any]] = {
        f"ask: {key}": lambda words=words: told(*asked, words) for key, words in WORDS.items()
    }
    made |= {
        "show": lambda: told("show", str(kept)),
        "show object": lambda: told("show", str(kept), "--object", "1"),
        "rules": lambda: told("rules", str(kept)),
        "doctor recording": lambda: told("doctor", str(tmp_path / "golden0")),
        "doctor home": lambda: told("doctor", str(kept)),
        "live --check": lambda: told("live", "--check", "--from", f"folder:{tmp_path / 'golden1'}", "--seconds", "1"),
    }
    made["live"] = lambda: LiveState().to_dict()
    made["check-model"] = lambda: Capabilities(
        "http://here/v1", "m", None, True, None, None, "off", 1.0, 2.0, "2026-11-28"
    ).to_dict()
    compare("commands", made)
