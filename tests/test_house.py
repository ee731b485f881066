"""House rules over the source: private modules, size and line length."""

from __future__ import annotations

import ast
import inspect
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import cartier

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
FILE_LINES, FUNCTION_LINES = 350, 60
LONG_FILES = {
    "cartier/home/entity.py": "the public class of a home, of which half is documentation",
    "cartier/spatial/query.py": "what a referring expression means, constraint by constraint",
    "cartier/testing.py": "the laws of all kinds of backend",
    "cartier/live/session.py": "the public class of a session, of which a third is documentation",
    "cartier/serving/mcp_server.py": "every tool, with what the model is told of it",
    "cartier/serving/operations.py": "the operations of all surfaces",
    "cartier/pipeline.py": "map_home and ask, of which half is documentation",
    "cartier/mapping/gravity.py": "how a recording lies: up, floor and turn are one measurement",
    "cartier_ros/dds/rtps.py": "one participant: what it announces, hears, matches and acknowledges",
    "cartier_ros/streams/ros_frames.py": "one class: what each kind of message on a robot means for the next frame",
    "cartier/contracts.py": "the interfaces of all eight kinds of backend, of which half is documentation",
}
LONG_FUNCTIONS = {
    "cartier/cli/_ask.py ask": "the options of one command, each with its help",
    "cartier_bench/commands.py paper": "the options of one command, each with its help",
    "cartier/cli/_live.py live": "the options of one command, each with its help",
    "cartier_fleet/commands.py map_command": "the options of one command, each with its help",
    "cartier/cli/_make.py map_command": "the options of one command, each with its help",
    "cartier/cli/_show.py show": "the options of one command, each with its help",
    "cartier/pipeline.py ask": "more than half of it is its documentation",
    "cartier/pipeline.py map_home": "more than half of it is its documentation",
    "cartier/pipeline.py serve": "half of it is its documentation",
}


@cache
def read(path: Path) -> tuple[tuple[ast.Import | ast.ImportFrom, ...], tuple[tuple[str, int], ...]]:
    """The imports of a file, and its functions with their lines: two rules read src, and to parse it takes longest."""
    imports, functions = list[ast.Import | ast.ImportFrom](), list[tuple[str, int]]()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports.append(node)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            functions.append((node.name, (node.end_lineno or 0) - node.lineno))
    return tuple(imports), tuple(functions)


def private_imports(folder: str) -> Iterator[str]:
    """Imports of what a leading underscore keeps to its own folder, by files outside of that folder."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in read(path)[0]:
            if isinstance(node, ast.ImportFrom):
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            else:
                names = [alias.name for alias in node.names]
            for name in names:
                parts = name.split(".")
                private = [k for k, part in enumerate(parts) if part.startswith("_") and not part.startswith("__")]
                ours = parts[0].startswith("cartier") or private[:1] == [0]
                if private and ours and not home_of(parts[: private[0] + 1], path):
                    yield f"{path.relative_to(ROOT)}:{node.lineno}: {name}"


def home_of(parts: list[str], path: Path) -> bool:
    """Whether a file lies in the folder to which a private module belongs. A private name belongs to its module
    alone."""
    if not parts[0].startswith("cartier"):
        return (path.parent / f"{parts[0]}.py").is_file()
    is_module = (ROOT / "src").joinpath(*parts).with_suffix(".py").is_file() or (ROOT / "src").joinpath(*parts).is_dir()
    return is_module and path.is_relative_to((ROOT / "src").joinpath(*parts[:-1]))


@pytest.mark.parametrize(
    "folder",
    ["src", "tests", "tools", "benchmarks", "examples"],
)
def test_no_private_import_across_packages(folder: str) -> None:
    found = list(private_imports(folder))
    assert not found, f"{len(found)} private imports:\n" + "\n".join(found)


def test_line_length_is_linted() -> None:
    lint = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    assert "E" in lint["select"]
    assert "E501" not in lint["ignore"]


def test_files_are_short() -> None:
    lines = {str(p.relative_to(SOURCE)): p.read_text("utf-8").count("\n") for p in SOURCE.rglob("*.py")}
    long = {name for name, count in lines.items() if count > FILE_LINES}
    assert long == LONG_FILES.keys(), "split the file, or take a name that is short again from the list"


def test_functions_are_short() -> None:
    long = {
        f"{path.relative_to(SOURCE)} {name}"
        for path in SOURCE.rglob("*.py")
        for name, lines in read(path)[1]
        if lines >= FUNCTION_LINES
    }
    assert long == LONG_FUNCTIONS.keys(), "split the function, or take a name that is short again from the list"


@pytest.mark.parametrize("name", ["types/__init__.py", "contracts.py", "pipeline.py"])
def test_story_file_is_there(name: str) -> None:
    assert ast.get_docstring(ast.parse((SOURCE / "cartier" / name).read_text("utf-8")))
    assert name.removesuffix("__init__.py") in (ROOT / "CONTRIBUTING.md").read_text("utf-8")


@pytest.mark.parametrize("name", cartier.__all__)
def test_public_name_is_documented(name: str) -> None:
    member = getattr(cartier, name)
    said = inspect.getdoc(member) or ""
    assert said
    assert not said.startswith(f"{name}("), "that is what dataclass writes by itself"
