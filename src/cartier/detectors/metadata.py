"""What an ONNX file says about itself in ``metadata_props``, as Ultralytics' exports do: names, task, input size."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartier.errors import InputError, brief

MAX_TEXT = 4 * 2**20
MAX_CLASSES = 100_000
NO_BOXES = {"classify": "gives no boxes", "obb": "gives turned boxes"}


@dataclass(frozen=True)
class Metadata:
    """``names`` by class number, None for a number without one; ``size`` is (w, h) in pixels, None if not said."""

    names: tuple[str | None, ...]
    task: str
    size: tuple[int, int] | None


def read_metadata(props: Mapping[str, str], path: Path) -> Metadata | None:
    """What the file at ``path`` says; None if it names no classes.

    Raises InputError for names that cannot be read, and for a task without upright boxes.
    """
    task = props.get("task", "")
    if task in NO_BOXES:
        raise InputError(f"{path} is of task {task}, which {NO_BOXES[task]}: export a model of task detect")
    if "names" not in props:
        return None
    size = _literal(props.get("imgsz", ""))
    sides = size if isinstance(size, list | tuple) else [size] * 2
    right = len(sides) == 2 and all(type(side) is int and side > 0 for side in sides)
    return Metadata(_names(_literal(props["names"]), path), task, (sides[1], sides[0]) if right else None)


def _names(value: Any, path: Path) -> tuple[str | None, ...]:
    by_number = dict(enumerate(value)) if isinstance(value, list | tuple) else value
    if isinstance(by_number, dict):
        by_number = {int(k) if isinstance(k, str) and k.isdecimal() else k: v for k, v in by_number.items()}
        numbers = all(type(k) is int and 0 <= k < MAX_CLASSES for k in by_number)
        if by_number and numbers and all(isinstance(name, str) for name in by_number.values()):
            return tuple(by_number.get(number) for number in range(max(by_number) + 1))
    lack = f"its metadata holds no names by class number, but {brief(value, 60)!r}"
    raise InputError(f"{path}: {lack}: write a sidecar with labels")


def _literal(text: str) -> Any:
    """The value of a Python or JSON literal; None if it is none. It is parsed and never run."""
    try:
        return ast.literal_eval(text) if len(text) <= MAX_TEXT else None
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None
