"""Stored inventories: mapped homes as small files, so that a test or a benchmark need not render and map them again.

``benchmarks/inventories.py`` makes them. The keys in the files are our own: a new name of an attribute changes only the
tables below.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cartier import plugins
from cartier.home import Home
from cartier.types import Camera, Inventory, MapObject, Room, View

DATA = Path(__file__).parent / "data"
FOLDER = DATA / "inventories"
DECIMALS = 3
OBJECT = {
    "id": "id", "label": "label", "labels": "labels", "at": "position", "low": "box_min", "high": "box_max",
    "p": "probability", "sure": "confirmed", "seen": "n_detected", "of": "n_observable", "first_s": "first_seen_s",
    "last_s": "last_seen_s", "looked_s": "last_looked_s", "colours": "colours", "room": "room", "aliases": "aliases",
    "names": "names",
}  # fmt: skip
"""Key of a file → attribute of MapObject; its views stand apart."""
VIEW = {
    "frame": "frame", "box": "box_xyxy", "score": "score", "label": "label", "size": "size_px2", "camera": "camera",
    "yaw": "yaw", "surface": "surface",
}  # fmt: skip
"""Key of a file → attribute of View."""


def stored(kind: str) -> list[str]:
    """The names of the homes whose inventories of a kind (``truth`` or ``pixels``) are stored."""
    ending = f".{kind}.json.gz"
    return sorted(file.name.removesuffix(ending) for file in FOLDER.glob(f"*{ending}"))


@lru_cache(maxsize=64)
def inventory(name: str, kind: str) -> Inventory:
    """A home's objects and rooms (without cells), and where the recording began."""
    kept = json.loads(gzip.decompress((FOLDER / f"{name}.{kind}.json.gz").read_bytes()))
    rooms = tuple(Room(id, name, kind, np.zeros((0, 2), np.int32)) for id, name, kind in kept["rooms"])
    return Inventory(tuple(map(_object, kept["objects"])), rooms, from_xy=tuple(kept["from_xy"]))


def home(name: str, kind: str) -> Home:
    """The same as a home that can be asked; it has no grid, so nothing is planned in it."""
    held = inventory(name, kind)
    index = plugins.make("indexes", "object_depth")
    index.set_objects(held.objects)
    x, y = held.from_xy or (0.0, 0.0)
    camera = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
    return Home(name, kind, camera, held.objects, {"object_depth": index}, None, (x, y), {}, rooms=held.rooms)


def store(name: str, kind: str, objects: Sequence[MapObject], rooms: Sequence[Room], from_xy: Sequence[float]) -> Path:
    """Write an inventory: rounded to millimetres, without photographs, and two views of an object."""
    kept = {
        "from_xy": list(from_xy),
        "rooms": [[room.id, room.name, room.kind] for room in rooms],
        "objects": [_row(obj) for obj in objects],
    }
    file = FOLDER / f"{name}.{kind}.json.gz"
    text = json.dumps(_rounded(kept), ensure_ascii=False, separators=(",", ":"))
    file.write_bytes(gzip.compress(text.encode(), mtime=0))
    return file


def _row(obj: MapObject) -> dict[str, Any]:
    shows = [view for view in obj.views if view.surface is not None]
    views = list(dict.fromkeys([*obj.views[:1], *sorted(shows, key=lambda view: -view.size_px2)[:1]]))
    row: dict[str, Any] = {key: getattr(obj, attribute) for key, attribute in OBJECT.items()}
    return row | {"views": [{key: getattr(view, attribute) for key, attribute in VIEW.items()} for view in views]}


def _object(row: dict[str, Any]) -> MapObject:
    known: dict[str, Any] = {attribute: _frozen(row[key]) for key, attribute in OBJECT.items()}
    views = (View(**{attribute: _frozen(view[key]) for key, attribute in VIEW.items()}) for view in row["views"])
    return MapObject(views=tuple(views), **known)


def _frozen(value: Any) -> Any:
    """Lists as the tuples that they were."""
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    if isinstance(value, float | np.floating):
        return round(float(value), DECIMALS)
    return int(value) if isinstance(value, np.integer) else value
