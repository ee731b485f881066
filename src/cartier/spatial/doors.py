"""Doors: the passages between the rooms of a floor plan."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from cartier.types import FREE, Door, OccupancyGrid, Room

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
    from scipy import ndimage

    shape, found = grid.cells.shape, list[Door]()
    masks = {room.id: np.zeros(shape, bool) for room in rooms}
    for room in rooms:
        masks[room.id][room.cells[:, 0], room.cells[:, 1]] = True
    steps, free = 1 + round(MAX_WALL_M / 2 / grid.resolution_m), grid.cells == FREE
    around = {number: ndimage.binary_dilation(mask, iterations=steps, mask=free) for number, mask in masks.items()}
    for one, other in combinations(sorted(masks), 2):
        touching, count = ndimage.label(around[one] & around[other], np.ones((3, 3)))
        for number in range(1, count + 1):
            cells = np.argwhere(touching == number)
            width_m = float(np.max(np.ptp(cells, axis=0) + 1) * grid.resolution_m)
            if width_m <= MAX_WIDTH_M:
                x, y = grid.centre(cells).mean(0)
                found.append(Door((float(x), float(y)), (one, other), width_m))
    return tuple(found)
