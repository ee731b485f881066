"""Contracts: cartier reads only members that ``contracts.py`` names, and optional members have defaults."""

from __future__ import annotations

import ast
import inspect
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cartier
from cartier import contracts
from cartier.contracts import (
    Detector,
    EncoderDefaults,
    IndexDefaults,
    ReasonerDefaults,
    RecordingDefaults,
    SourceDefaults,
    VisionModelDefaults,
    optional,
)  # fmt: skip
from cartier.mapping.detection_cache import detecting
from synthetic import THINGS, TrueBoxes, walk

SOURCE = Path(cartier.__file__).parent
READERS = ("getattr", "hasattr", "optional")
BACKENDS = {
    "recording", "detector", "encoder", "index", "spatial_index", "reasoner", "robot", "world", "source", "model",
    "inner", "held", "searched", "backend",
}  # fmt: skip
"""Names of variables and attributes (without leading underscore) that hold backends."""
DEFAULTS = (
    Detector,
    RecordingDefaults,
    EncoderDefaults,
    IndexDefaults,
    ReasonerDefaults,
    SourceDefaults,
    VisionModelDefaults,
)


def members(contract: type) -> set[str]:
    return {name for name in (*vars(contract), *inspect.get_annotations(contract)) if not name.startswith("_")}


CONTRACTS = [kind for kind in vars(contracts).values() if getattr(kind, "__module__", "") == contracts.__name__]
NAMED = set().union(*(members(kind) for kind in CONTRACTS if isinstance(kind, type)))


@cache
def calls() -> tuple[tuple[Path, str, ast.Call], ...]:
    """Every call of src that reads a member by its name: the file, the function, the call."""
    return tuple(
        (file, node.func.id, node)
        for file in sorted(SOURCE.rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in READERS
    )


def reads(function: str) -> list[tuple[str, ast.Call]]:
    """Every call of ``function`` in src, with its place; ``contracts.optional`` itself apart."""
    found = [(f"{file.relative_to(SOURCE)}:{node.lineno}", node) for file, name, node in calls() if name == function]
    return [(where, call) for where, call in found if not where.startswith("contracts.py")]


def holder(node: ast.expr) -> str:
    """The last name of an expression: ``self._detector`` gives ``detector``."""
    name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
    return name.lstrip("_")


def test_no_backend_is_read_by_getattr() -> None:
    faults = [
        f"{where}: {ast.unparse(call)}"
        for function in ("getattr", "hasattr")
        for where, call in reads(function)
        if isinstance(call.args[1], ast.Constant)
        and (holder(call.args[0]) in BACKENDS or (call.args[1].value in NAMED and len(call.args) == 3))
        and not where.startswith("worlds/thor_build.py")  # AI2-THOR's own objects
        and ast.unparse(call) != "getattr(self._here, 'notes', ())"  # a threading.local
    ]
    assert not faults, faults


def test_every_optional_read_names_a_member_with_a_default() -> None:
    found = reads("optional")
    assert len(found) > 20
    for where, call in found:
        contract = getattr(contracts, ast.unparse(call.args[1]))
        assert contract in DEFAULTS, where
        if isinstance(call.args[2], ast.Constant):
            assert hasattr(contract, call.args[2].value), f"{where}: {ast.unparse(call)}"


@pytest.mark.parametrize("contract", DEFAULTS, ids=lambda kind: kind.__name__)
def test_a_bare_backend_has_every_default(contract: type) -> None:
    bare = object()
    for name in sorted(members(contract) - {"name", "detect"}):
        if callable(getattr(contract, name)):
            continue
        value = optional(bare, contract, name)
        assert value == getattr(contract, name)
        assert not isinstance(value, list | dict | set), f"{name}: a default that can be changed"


def test_a_backend_own_value_wins() -> None:
    class Own:
        readers = 3
        level_from_world = np.eye(4)

    assert optional(Own(), RecordingDefaults, "readers") == 3
    assert optional(Own(), RecordingDefaults, "level_from_world") is Own.level_from_world
    assert optional(Own(), RecordingDefaults, "scale_guessed") is False


def test_a_detector_without_detect_batch_detects_one_by_one() -> None:
    frames = [walk()[number] for number in (0, 5)]
    detector = TrueBoxes(THINGS)
    assert not hasattr(detector, "detect_batch")
    assert [found.labels for found in detecting(detector)(frames)] == [detector.detect(f).labels for f in frames]
