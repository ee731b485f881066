"""Rulers of the shape of the source: circles, floors, private attributes, and a budget of lines a package."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
PACKAGES = ("cartier", "cartier_dollhouse", "cartier_bench", "cartier_fleet", "cartier_ros")
FLOORS = 13  # how many packages of the core stand on one another
BUDGET = {  # lines of Python; a commit that needs more says here why
    "cartier": 44_000,
    "cartier/mapping": 6_090,
    "cartier/understanding": 4_730,
    "cartier/recordings": 3_650,
    "cartier/home": 3_000,
    "cartier/serving": 2_890,
    "cartier/detectors": 2_260,
    "cartier/cli": 2_140,
    "cartier/doctor": 2_190,
    "cartier/llm": 2_050,
    "cartier/vision": 1_930,
    "cartier/navigation": 1_470,
    "cartier/io": 1_380,
    "cartier/live": 1_390,
    "cartier/spatial": 1_140,
    "cartier/render": 1_130,
    "cartier/exports": 450,
    "cartier_dollhouse": 9_750,
    "cartier_bench": 7_340,
    "cartier_fleet": 2_640,
    "cartier_ros": 7_080,  # a writer of large samples at a pace: cyclonedds has none
}
CIRCLES = set[frozenset[str]]()
READS_PRIVATE = set[str]()


@cache
def parsed() -> dict[str, ast.Module]:
    """Every module of the source by its dotted name."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text("utf-8"))
    return found


@cache
def imports() -> dict[str, set[str]]:
    """What each module imports of ours, wherever the import stands, under TYPE_CHECKING, too."""
    modules, found = parsed(), dict[str, set[str]]()
    for module, tree in modules.items():
        named = set[str]()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    deeper = f"{node.module}.{alias.name}"
                    named.add(deeper if deeper in modules else node.module)
        found[module] = {name for name in named if name in modules and name != module}
    return found


def circles(graph: dict[str, set[str]]) -> set[frozenset[str]]:
    """The circles of a graph, one after the other: each is reported and then cut."""
    left, found = {name: set(others) for name, others in graph.items()}, set[frozenset[str]]()
    while True:
        try:
            TopologicalSorter(left).prepare()
        except CycleError as error:
            around = error.args[1]
            found.add(frozenset(around))
            left[around[1]].discard(around[0])
        else:
            return found


def test_no_module_imports_itself_around() -> None:
    assert circles(imports()) == CIRCLES


def test_a_circle_is_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == {frozenset("abc")}


def test_packages_stand_on_few_floors() -> None:
    rooms = dict[str, set[str]]()
    for module, others in imports().items():
        mine = room_of(module)
        rooms.setdefault(mine, set()).update(room_of(other) for other in others)
    core = {
        room: {other for other in others if other not in ("cartier", room)}
        for room, others in rooms.items()
        if room.startswith("cartier.") and room != "cartier.__main__"
    }

    def floor(room: str) -> int:
        return 1 + max((floor(other) for other in core[room]), default=0)

    assert max(map(floor, core)) <= FLOORS


def room_of(module: str) -> str:
    """The package of the core, or the module that stands beside its packages, in which a module lies."""
    return ".".join(module.split(".")[:2])


def private_reads(module: str, tree: ast.Module) -> Iterator[str]:
    """Private attributes of what another module defines."""
    own = {"_replace", "_asdict", "_fields", "_make", "_exit"}  # of namedtuples and os
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            own |= set(_attributes(node))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
            mine = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
            if not mine and node.attr not in own:
                yield f"{module} line {node.lineno}: {ast.unparse(node)}"


def _attributes(made: ast.ClassDef) -> Iterator[str]:
    for node in ast.walk(made):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"):
            yield node.attr
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.AnnAssign | ast.Assign):
            targets = [node.target] if isinstance(node, ast.AnnAssign) else node.targets
            yield from (target.id for target in targets if isinstance(target, ast.Name))


def test_no_private_attribute_is_read_elsewhere() -> None:
    found = {
        f"{module.replace('.', '/')}.py": lines
        for module, tree in parsed().items()
        if (lines := list(private_reads(module, tree)))
    }
    assert found.keys() == READS_PRIVATE, found


@pytest.mark.parametrize("package", BUDGET)
def test_package_keeps_its_budget(package: str) -> None:
    lines = sum(path.read_text("utf-8").count("\n") for path in (SOURCE / package).rglob("*.py"))
    assert lines <= BUDGET[package], f"{package} has {lines} lines: let something go, or raise its budget with a reason"
    assert lines > 0.85 * BUDGET[package], f"{package} has {lines} lines only: lower its budget"


def test_every_package_has_a_budget() -> None:
    assert {path.name for path in SOURCE.iterdir() if path.is_dir() and path.name.startswith("cartier")} == set(
        PACKAGES
    )
    assert set(PACKAGES) <= BUDGET.keys()
