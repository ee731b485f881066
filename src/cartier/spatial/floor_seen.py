"""Share of the floor that was looked at, estimated from the open ends of the floor plan."""

from __future__ import annotations

import numpy as np

from cartier.types import FREE, UNKNOWN, OccupancyGrid

OPENING_M = 0.5  # an open end that a robot fits through
BEHIND_M = 1.0  # how far the floor goes on behind an open end: fits walks through generated homes
WHOLE = 0.9
"""From here on "not here" is said instead of "not seen yet", and a home of a fleet "has none"."""


def floor_seen(grid: OccupancyGrid | None) -> float:
    """Which share of the floor was looked at, from 0 to 1.

    What is free is seen. Where free floor borders on the unknown over half a metre or more, the unknown that is reached
    from there within a metre, past no wall, is taken for floor. 0 without a floor plan.
    """
    from scipy import ndimage

    if grid is None:
        return 0.0
    steps = round(BEHIND_M / grid.resolution_m)
    free = np.pad(grid.cells == FREE, steps + 1)
    if not free.any():
        return 0.0
    unknown = np.pad(grid.cells == UNKNOWN, steps + 1, constant_values=True)
    ends, count = ndimage.label(free & ndimage.binary_dilation(unknown), np.ones((3, 3)))
    wide_m = np.bincount(ends.ravel(), minlength=count + 1) * grid.resolution_m
    wide_m[0] = 0.0  # what is no end
    open_ends = (wide_m >= OPENING_M)[ends]
    behind = ndimage.binary_dilation(open_ends, iterations=steps, mask=unknown | open_ends) & unknown
    return float(free.sum() / (free.sum() + behind.sum()))
