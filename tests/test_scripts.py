"""Command line of every script in benchmarks/ and tools/: help, wrong use, missing data."""

from __future__ import annotations

import ast
import os
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[1]
FOLDERS = ("benchmarks", "tools", "tools/things", "tools/understanding")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).glob("*.py"))]
SCRIPTS = [str(path.relative_to(ROOT)) for path in FILES if '__name__ == "__main__"' in path.read_text("utf-8")]
MISSING = {
    "benchmarks/ablation.py": "HERE HERE HERE",
    "benchmarks/adversarial.py": "HERE",
    "benchmarks/bag_reading.py": "--read HERE",
    "benchmarks/dollhouse.py": "atlantis",
    "benchmarks/homes.py": "atlantis",
    "benchmarks/photographs.py": "--photos HERE",
    "benchmarks/serving.py": "HERE",
    "benchmarks/straight_line.py": "HERE",
    "benchmarks/things.py": "HERE",
    "benchmarks/vlmaps.py": "HERE",
    "tools/calibrate_existence.py": "HERE",
    "tools/calibrate_on_photographs.py": "--photos HERE",
    "tools/halve_weights.py": "HERE HERE",
    "tools/build_text_encoder.py": "HERE",
    "tools/fit_decision.py": "HERE",
    "tools/train_dollhouse_detector.py": "export HERE HERE",
    "tools/train_scorer.py": "HERE",
}


@pytest.fixture(autouse=True)
def own_modules_and_paths(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Scripts bring modules and folders of their own, which no other test may see."""
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    paths, environment, before = list(sys.path), dict(os.environ), set(sys.modules)
    yield
    sys.path[:] = paths
    os.environ.clear()
    os.environ.update(environment)
    for name in set(sys.modules) - before:
        file = getattr(sys.modules[name], "__file__", None) or ""
        if Path(file).is_relative_to(ROOT) and not Path(file).is_relative_to(ROOT / "src"):
            del sys.modules[name]


def ran(script: str, *words: str) -> int | str | None:
    """What a script exits with."""
    sys.argv[:] = [script, *words]
    sys.path.insert(0, str((ROOT / script).parent))
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / script), run_name="__main__")
    return ended.value.code


def options(script: str) -> list[tuple[str, bool]]:
    """The name of each option in a script's source, and whether it has a line of help."""
    calls = [n for n in ast.walk(ast.parse((ROOT / script).read_text("utf-8"))) if isinstance(n, ast.Call)]
    added = [c for c in calls if isinstance(c.func, ast.Attribute) and c.func.attr == "add_argument"]
    return [(ast.literal_eval(c.args[0]), any(k.arg == "help" for k in c.keywords)) for c in added]


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_names_every_option(script: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(script, "--help") == 0
    told = capsys.readouterr().out
    first = ast.get_docstring(ast.parse((ROOT / script).read_text("utf-8")))
    assert first and first.splitlines()[0] in told
    if commands := re.search(r"^  \{([\w,]+)\}$", told, re.MULTILINE):
        for command in commands[1].split(","):
            assert ran(script, command, "--help") == 0
        told += capsys.readouterr().out
    for name, helped in options(script):
        assert helped, f"{name} has no help"
        assert re.search(rf"^  {re.escape(name)}\b", told, re.MULTILINE), name


@pytest.mark.parametrize("script", SCRIPTS)
def test_wrong_option_is_one_line(script: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(script, "--no-such-option") == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("script", MISSING)
def test_missing_data_is_one_line(script: str, tmp_path: Path) -> None:
    said = ran(script, *MISSING[script].replace("HERE", str(tmp_path / "nowhere")).split())
    assert isinstance(said, str) and "\n" not in said
    assert "nowhere" in said or "atlantis" in said or "needs torch" in said or "needs safetensors" in said


def test_photographs_without_boxes_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for boxes, line in ((None, "holds no labels/*.txt"), ("", "holds no box of a household name")):
        if boxes is not None:
            (tmp_path / "labels").mkdir()
            (tmp_path / "labels" / "a.txt").write_text(boxes)
            Image.new("RGB", (32, 32)).save(tmp_path / "images" / "a.jpg")
        said = ran("benchmarks/photographs.py", "--photos", str(tmp_path))
        assert isinstance(said, str) and line in said and "\n" not in said


def test_every_mutant_has_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A text that was changed since takes its mutant away without a word."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    script = runpy.run_path(str(ROOT / "benchmarks/mutants.py"))
    mutants = script["read"](ROOT)
    assert [line for mutant in mutants if (line := script["misfit"](mutant, ROOT))] == []
    tests = {test.partition("::")[0] for mutant in mutants for test in mutant.tests}
    assert [test for test in sorted(tests) if not (ROOT / test).exists()] == []
