"""Doors: the passages between the rooms of a floor plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from cartier.types import FREE, Door, OccupancyGrid, Room

Mask = npt.NDArray[np.bool_]
MAX_WALL_M = 0.3  # thickness of a wall with a lintel, which is no floor of either room
MAX_WIDTH_M = 1.6  # two rooms that meet over more are one open space, as a person sees it


def find_doors(rooms: Sequence[Room], grid: OccupancyGrid) -> tuple[Door, ...]:
    """The passages of the width of a door between any two rooms.

    Args:
        rooms: The rooms, as cells of the floor plan.
        grid: The floor plan.

    Returns:
        One door for each run of cells where two rooms touch, with its middle and its width in metres.
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
                found.append(Door((float(x), float(y)), (one, other), width_m))
    return tuple(found)


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
