"""A flat of two rooms and a hall, joined by doors, for tests of routes."""

from __future__ import annotations

import numpy as np

from cartier.navigation.layers import RouteMap
from cartier.types import FREE, Door, MapObject, OccupancyGrid, Place, Room
from cartier.types.route_rules import FLOOR_KINDS
from plans import Plan

ROOMS = {"study": (0.0, 0.0, 4.0, 3.0), "kitchen": (4.1, 0.0, 8.0, 3.0), "hall": (0.0, 3.1, 8.0, 4.5)}
DOORS = {
    ("study", "kitchen"): (4.0, 1.0, 4.1, 2.0), ("study", "hall"): (1.0, 3.0, 2.0, 3.1),
    ("kitchen", "hall"): (6.0, 3.0, 7.0, 3.1),
}  # fmt: skip


def thing(number: int, label: str, box: tuple[float, float, float, float], top_m: float = 0.8) -> MapObject:
    x1, y1, x2, y2 = box
    low, high = (x1, y1, 0.0), (x2, y2, top_m)
    middle = ((x1 + x2) / 2, (y1 + y2) / 2, top_m / 2)
    room = next(
        (k for k, (a, b, c, d) in enumerate(ROOMS.values()) if a <= middle[0] <= c and b <= middle[1] <= d), None
    )
    return MapObject(number, label, ((label, 1.0),), middle, low, high, 1.0, True, 9, 9, 0.0, 1.0, 1.0, (), room=room)


def flat(
    *things: MapObject, doors: tuple[tuple[str, str], ...] = tuple(DOORS),
    floors: dict[str, tuple[float, float, float, float]] | None = None,
) -> RouteMap:  # fmt: skip
    """The flat with some doors, objects (without cells of their own) and kinds of floor by box."""
    plan = Plan(8.0, 4.5).rooms(*ROOMS.values())
    for pair in doors:
        plan.draw(DOORS[pair], FREE)
    grid = plan.grid()
    kinds = None
    if floors is not None:
        kinds = np.zeros(grid.cells.shape, np.uint8)
        for kind, (x1, y1, x2, y2) in floors.items():
            a, b = grid.cell([(x1, y1), (x2, y2)])
            kinds[a[0] : b[0], a[1] : b[1]] = FLOOR_KINDS.index(kind)
    grid = OccupancyGrid(grid.cells, grid.resolution_m, grid.origin_xy, grid.height_m, kinds)
    rooms = []
    for k, (name, (x1, y1, x2, y2)) in enumerate(ROOMS.items()):
        (top, left), (bottom, right) = grid.cell([(x1 + 0.01, y1 + 0.01), (x2 - 0.01, y2 - 0.01)])
        cells = np.argwhere(np.ones((bottom - top + 1, right - left + 1))) + np.array([top, left])
        rooms.append(Room(k, name, name, cells.astype(np.int32)))
    ids = {name: k for k, name in enumerate(ROOMS)}
    passages = [
        Door(((x1 + x2) / 2, (y1 + y2) / 2), (ids[one], ids[other]), max(x2 - x1, y2 - y1))
        for (one, other), (x1, y1, x2, y2) in DOORS.items() if (one, other) in doors
    ]  # fmt: skip
    return RouteMap(grid, rooms, things, passages)


def at(x: float, y: float, label: str = "cup") -> Place:
    return Place(label, (x, y, 0.5), 1.0, 0)
