"""Doors: the passages between the rooms of a floor plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.types import FREE, OCCUPIED, Door, OccupancyGrid, Room

Mask = npt.NDArray[np.bool_]
MAX_WALL_M = 0.3  # thickness of a wall with a lintel, which is no floor of either room
AROUND_M = 0.6  # before and behind a door, what stands there makes it narrower
MAX_REMEMBERED = 500  # doors of one home
SAME_DOOR_M = 0.5  # between the middles of one door on two floor plans
LEAF_M = 1.2  # a door is seen at least so high: what is lower stands in the way
MAX_WIDTH_M = 1.6  # two rooms that meet over more are one open space, as a person sees it


def find_doors(rooms: Sequence[Room], grid: OccupancyGrid) -> tuple[Door, ...]:
    """The passages of the width of a door between any two rooms.

    Args:
        rooms: The rooms, as cells of the floor plan.
        grid: The floor plan.

    Returns:
        One door for each run of cells where two rooms touch, with its middle, its width, and the narrowest width on the
        widest way through, in metres.
    """
    shape, found = grid.cells.shape, list[Door]()
    masks = {room.id: np.zeros(shape, bool) for room in rooms}
    for room in rooms:
        masks[room.id][room.cells[:, 0], room.cells[:, 1]] = True
    steps, free = 1 + round(MAX_WALL_M / 2 / grid.resolution_m), grid.cells == FREE
    around = {number: _grown(mask, free, steps) for number, mask in masks.items()}
    for one, other in combinations(sorted(masks), 2):
        for cells in _runs(np.argwhere(around[one] & around[other])):
            width_m = float(np.max(np.ptp(cells, axis=0) + 1) * grid.resolution_m)
            if width_m <= MAX_WIDTH_M:
                x, y = grid.centre(cells).mean(0)
                narrow_m = _narrowest_m(grid, cells, masks[one], masks[other])
                found.append(Door((float(x), float(y)), (one, other), width_m, min(narrow_m, width_m)))
    return tuple(found)


def remembered(doors: Sequence[Door], settings: Mapping[str, Any]) -> dict[str, Any]:
    """A setting ``doors`` with the middle (x, y) and the width (m) of the passages that a home has, and of others that
    its settings say it had before; nothing where there are none."""
    now = [[round(value, 3) for value in (*door.xy, door.width_m)] for door in doors]
    before = settings.get("doors", ())
    gone = [[*old] for old in before if all(math.dist(old[:2], each[:2]) >= SAME_DOOR_M for each in now)]
    return {"doors": [*now, *gone][:MAX_REMEMBERED]} if now or gone else {}


def shut_doors(
    earlier: Sequence[tuple[float, float, float]], doors: Sequence[Door], rooms: Sequence[Room], grid: OccupancyGrid
) -> tuple[Door, ...]:
    """The passages that were open once, and in which something as high as a door stands now.

    Args:
        earlier: The middle (x, y) and the width (m) of passages on an earlier floor plan.
        doors: Those of this floor plan.
        rooms: Its rooms.
        grid: This floor plan.

    Returns:
        The shut ones, each between the two rooms that are nearest to it; none where fewer than two are near.
    """
    tall = (grid.cells == OCCUPIED) & (grid.height_m >= LEAF_M)
    solid = grid.centre(np.argwhere(tall))
    found = list[Door]()
    for x, y, width_m in earlier:
        open_now = any(np.hypot(door.xy[0] - x, door.xy[1] - y) < SAME_DOOR_M for door in doors)
        if open_now or not (np.hypot(*(solid - (x, y)).T) <= MAX_WALL_M).any():
            continue
        away_m = sorted((float(np.hypot(*(grid.centre(room.cells) - (x, y)).T).min()), room.id) for room in rooms)
        near = [number for distance_m, number in away_m[:2] if distance_m <= AROUND_M]
        if len(near) == 2:
            found.append(Door((x, y), (min(near), max(near)), width_m))
    return tuple(found)


def _narrowest_m(
    grid: OccupancyGrid, cells: npt.NDArray[np.intp], one: npt.NDArray[np.bool_], other: npt.NDArray[np.bool_]
) -> float:
    """The diameter of the largest disc that gets from one room to the other through the cells (N, 2) of a door."""
    near = 2 + round(AROUND_M / grid.resolution_m)
    beside = near + round(MAX_WIDTH_M / 2 / grid.resolution_m)  # obstacles that the disc may touch
    low, high = np.maximum(cells.min(0) - beside, 0), cells.max(0) + beside + 1
    window = slice(low[0], high[0]), slice(low[1], high[1])
    solid = grid.cells[window] == OCCUPIED
    clear = distance_to(solid) - 0.5  # cells
    inside = np.zeros(solid.shape, bool)
    first = np.maximum(cells.min(0) - near - low, 0)
    last = cells.max(0) + near + 1 - low
    inside[first[0] : last[0], first[1] : last[1]] = True
    edge = inside.copy()  # a way through leads from well before the door to well behind it
    edge[first[0] + 1 : last[0] - 1, first[1] + 1 : last[1] - 1] = False
    inside &= grid.cells[window] == FREE
    ends = [(mask[window] & edge if (mask[window] & edge & inside).any() else mask[window]) for mask in (one, other)]
    narrow = widest_way(np.where(inside, clear, -np.inf), *ends)
    return float(2 * narrow * grid.resolution_m) if narrow > 0 else 0.0


def distance_to(solid: Mask) -> npt.NDArray[np.float64]:
    """(rows, cols) how many cells it is to the nearest solid one, inf where there is none.

    As scipy's distance_transform_edt, whose import is most of what a request from the shell would spend on doors.
    """
    rows, cols = (np.arange(size) for size in solid.shape)
    above = np.maximum.accumulate(np.where(solid, rows[:, None], -np.inf))
    below = np.minimum.accumulate(np.where(solid, rows[:, None], np.inf)[::-1])[::-1]
    along = np.minimum(rows[:, None] - above, below - rows[:, None])  # within the column
    squared = along[:, None] ** 2 + (cols[:, None] - cols) ** 2
    return np.asarray(np.sqrt(squared.min(2)))


def widest_way(clear: npt.NDArray[np.float64], start: Mask, end: Mask) -> float:
    """The greatest value that some path of touching cells from one area into another nowhere falls below."""
    reached, before = np.where(start, clear, -np.inf), None
    while before is None or not np.array_equal(reached, before):
        before, padded = reached, np.pad(reached, 1, constant_values=-np.inf)
        across = np.maximum(np.maximum(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:])
        reached = np.minimum(clear, np.maximum(np.maximum(across[:-2], across[1:-1]), across[2:]))
    return float(reached[end].max(initial=-np.inf))


def _grown(mask: Mask, free: Mask, steps: int) -> Mask:
    """A mask (rows, cols) grown over free cells by so many steps along rows and columns."""
    mask = mask.copy()
    for _ in range(steps):
        grown = mask.copy()
        grown[1:] |= mask[:-1]
        grown[:-1] |= mask[1:]
        grown[:, 1:] |= mask[:, :-1]
        grown[:, :-1] |= mask[:, 1:]
        mask |= grown & free
    return mask


def _runs(cells: npt.NDArray[np.int64]) -> Iterator[npt.NDArray[np.int64]]:
    """The groups of cells (n, 2) that touch one another, also at corners."""
    left = dict.fromkeys(map(tuple, cells.tolist()))
    while left:
        run = [left.popitem()[0]]
        for row, col in run:  # grows as it is read
            beside = [(row + r, col + c) for r in (-1, 0, 1) for c in (-1, 0, 1)]
            run += [cell for cell in beside if left.pop(cell, cell) is None]
        yield np.array(sorted(run))
