"""The API page: it is what the code says, and its sample handles answers without an object, a place or a goal."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import cartier

ROOT = Path(__file__).parents[1]
SAMPLE, DETECTOR = ROOT / "examples" / "map_and_ask.py", ROOT / "examples" / "red_things.py"
ENV = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("api") / "room"
    subprocess.run([sys.executable, ROOT / "examples" / "room.py", folder], check=True, env=ENV)
    return folder


def test_the_page_is_what_the_code_says() -> None:
    made = runpy.run_path(str(ROOT / "tools" / "build_api_page.py"))["page"]()
    assert (ROOT / "docs" / "api.md").read_text(encoding="utf-8") == made, "run tools/build_api_page.py"
    for name in cartier.__all__:
        assert re.search(rf"(^### {name}$|^{name}\(|^\*\*`{name}`)", made, re.MULTILINE), name


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("bring me to the red thing", r"^found red thing - .*\nplace \[.*\]\ngoal  x"),
        ("I want to play the trombone", r"^(not_found|clarify) .*\n$"),
        ("don't go to the red thing", r"^answered .*\n$"),
    ],
)
def test_the_sample_survives_what_is_not_found(
    room: Path, words: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(SAMPLE))["main"](str(room), str(DETECTOR), words)
    assert re.match(told, capsys.readouterr().out)


def test_the_sample_tells_a_mistake_in_one_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, SAMPLE, tmp_path / "none", DETECTOR, "hello"],
        capture_output=True, text=True, check=False, env=ENV,
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.startswith("cartier: ") and done.stderr.count("\n") == 1
