"""The inventories of ``tests/data``: hand-made homes, small enough that every answer is known by construction."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cartier.types import Inventory, MapObject, Room, View

DATA = Path(__file__).parents[1] / "data"
SEEN_FROM_M = (0.0, 0.0)  # where a thing of which no row asks for the left or right was seen from


@cache
def inventory(name: str) -> Inventory:
    """A stored home as a reasoner sees it; an object that has a ``probability`` of its own is a tentative one."""
    told = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    rooms = tuple(Room(r["id"], r["name"], r["kind"], np.zeros((1, 2), np.int32)) for r in told["rooms"])
    return Inventory(tuple(map(_object, told["objects"])), rooms, from_xy=tuple(told["start_m"]))


def _object(told: dict[str, Any]) -> MapObject:
    low, high = map(tuple, told["box_m"])
    middle = tuple((np.add(low, high) / 2).tolist())
    camera = (*told.get("seen_from_m", SEEN_FROM_M), 1.5)
    view = View(told["id"], (0.0, 0.0, 9.0, 9.0), 0.9, told["label"], 81.0, camera, 0.0, middle)
    sure = told.get("probability", 0.97)
    return MapObject(
        told["id"], told["label"], ((told["label"], 1.0),), middle, low, high, sure, "probability" not in told,
        5, 6, 0.0, 9.0, 9.0, (view,), tuple(told["colours"].items()), told["room"],
    )  # fmt: skip
