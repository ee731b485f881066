"""The names of category ids, and which image is which frame: from COCO or LVIS annotations, or a list of names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

from cartier.errors import InputError, brief
from cartier.io.files import read_json
from cartier.labels import MAX_NAME_CHARS, display_name


class Annotations(NamedTuple):
    """``frames`` gives the frame of each image id; it is empty where image ids are frame numbers themselves."""

    path: Path
    names: dict[int, str]
    frames: dict[int, int]
    sizes: tuple[tuple[int, int] | None, ...]
    """(width, height) in pixels of each frame's image, where the file tells it."""
    notes: tuple[str, ...]


def read_annotations(path: Path) -> Annotations:
    """Categories and images of a JSON file: COCO or LVIS annotations, a list of {id, name}, or of names from id 1.

    Raises InputError for anything else, for ids that come twice, and for images not in the order of their names.
    """
    value = read_json(path)
    categories = value.get("categories") if isinstance(value, dict) else value
    if not isinstance(categories, list) or not categories:
        raise InputError(f'{path} must hold "categories" as COCO and LVIS annotations do, or be a list of names')
    notes: list[str] = []
    if all(isinstance(item, str) for item in categories):
        categories = [{"id": i, "name": name} for i, name in enumerate(categories, start=1)]
        notes.append(
            f"{path.name} is a list of names: the first one, {brief(categories[0]['name'])!r}, is taken for category 1"
        )
    names = {}
    for number, item in _by_id(path, "categories", categories):
        given = item.get("name")
        name = display_name(given) if isinstance(given, str) and len(given) <= MAX_NAME_CHARS else ""
        if not name:
            raise InputError(f"{path}: category {brief(number, 40)} has no name of {MAX_NAME_CHARS} characters at most")
        names[number] = name
    images = value.get("images", []) if isinstance(value, dict) else []
    if not isinstance(images, list):
        raise InputError(f'{path}: "images" must be a list')
    numbered = _by_id(path, "images", images)
    _check_order(path, [item.get("file_name") for _, item in numbered])
    if images:
        notes.append(f"{path.name} lists {len(images)} images: the first one is taken for frame 0, and so on")
    frames = {number: frame for frame, (number, _) in enumerate(numbered)}
    return Annotations(path, names, frames, tuple(_size(item) for _, item in numbered), tuple(notes))


def _by_id(path: Path, what: str, items: list[Any]) -> list[tuple[int, dict[str, Any]]]:
    seen: dict[int, dict[str, Any]] = {}
    for position, item in enumerate(items):
        number = item.get("id") if isinstance(item, dict) else None
        if type(number) is not int or number in seen:
            fault = "comes twice" if type(number) is int else "is no whole number"
            raise InputError(f'{path}: "{what}" entry {position}: its id {brief(number, 40)} {fault}')
        seen[number] = item
    return list(seen.items())


def _check_order(path: Path, names: list[Any]) -> None:
    if not all(isinstance(name, str) for name in names):
        return
    keys = [[part.zfill(20) if part.isdigit() else part for part in re.split(r"(\d+)", name)] for name in names]
    for before, after, name in zip(keys, keys[1:], names[1:], strict=False):
        if after < before:
            raise InputError(
                f'{path}: "images" must be in the order of the recording, but {brief(name)!r} comes too late'
            )


def _size(item: dict[str, Any]) -> tuple[int, int] | None:
    width, height = item.get("width"), item.get("height")
    return (width, height) if type(width) is int and type(height) is int else None
