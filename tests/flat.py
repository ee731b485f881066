"""Made-up flat for tests of answers about it: a kitchen and two bedrooms, three cups, and tentative objects."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cartier.types import Inventory, MapObject, Room, View


def obj(
    number: int,
    label: str,
    middle: tuple[float, float, float],
    size: tuple[float, float, float],
    room: int | None = None,
    colours: Iterable[str] = (),
    probability: float = 0.97,
) -> MapObject:
    low, high = (tuple(m + s * side / 2 for m, side in zip(middle, size, strict=True)) for s in (-1, 1))
    view = View(number, (0.0, 0.0, 9.0, 9.0), 0.9, label, 81.0, (0.0, 0.0, 1.5), 0.0, middle)
    return MapObject(
        number, label, ((label, 1.0),), middle, low, high, probability, probability >= 0.7, 5, 6, 0.0, 9.0, 9.0,
        (view,), tuple((colour, 0.5) for colour in colours), room,
    )  # fmt: skip


def cells() -> np.ndarray:
    return np.zeros((1, 2), np.int32)


OBJECTS = (
    obj(3, "table", (1.0, 1.0, 0.375), (1.2, 0.8, 0.75), 0, ["brown"]),
    obj(5, "sink", (3.0, 0.3, 0.8), (0.5, 0.4, 0.2), 0, ["grey"]),
    obj(12, "cup", (1.1, 1.0, 0.8), (0.08, 0.08, 0.1), 0, ["white", "blue"]),
    obj(14, "cup", (3.0, 0.6, 0.95), (0.08, 0.08, 0.1), 0, ["red"]),
    obj(15, "cup", (8.0, 5.0, 0.55), (0.08, 0.08, 0.1), 2),
    obj(20, "bed", (8.0, 3.0, 0.25), (2.0, 1.6, 0.5), 2, ["blue"]),
    obj(31, "cup", (4.0, 4.0, 0.9), (0.1, 0.1, 0.1), 1, probability=0.3),
)
ROOMS = (
    Room(0, "kitchen", "kitchen", cells()),
    Room(1, "bedroom", "bedroom", cells()),
    Room(2, "bedroom", "bedroom", cells()),
)
FLAT = Inventory(OBJECTS, ROOMS, from_xy=(0.0, 0.0))
UNSURE = (
    obj(32, "vase", (4.0, 4.5, 0.9), (0.1, 0.1, 0.1), 1, probability=0.15),
    obj(33, "key chain", (4.2, 4.5, 0.9), (0.1, 0.1, 0.1), 1, probability=0.3),
)
UNSURE_FLAT = Inventory((*OBJECTS, *UNSURE), ROOMS, from_xy=(0.0, 0.0))
"""The same with objects that were seen too seldom."""
