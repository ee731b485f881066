"""Extent of a home in pictures: what was mapped and what stands in it, without strays of the occupancy grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartier.home import Home
from cartier.types import Array, OccupancyGrid

STRAY_M = 0.3  # known cells in strips narrower than this are rays through a window or a gap, not a part of the home
LEAST_SHARE = 0.05  # of the largest connected part: smaller parts are strays, too


def shown_extent(home: Home) -> tuple[float, float, float, float]:
    """x from, x to, y from, y to (m): the mapped floor, every confirmed object and the start, without a margin."""
    points = [np.array([home.start_xy])]
    points += [np.array([obj.box_min[:2], obj.box_max[:2]]) for obj in home.objects if obj.confirmed]
    if home.grid is not None:
        points.append(_mapped(home.grid))
    every = np.concatenate(points)
    (left, low), (right, high) = every.min(0), every.max(0)
    return float(left), float(right), float(low), float(high)


def _mapped(grid: OccupancyGrid) -> Array:
    """Two corners (2, 2) of the known cells, or none (0, 2); narrow strips and small islands do not count."""
    from scipy.ndimage import binary_opening, label

    known: Any = grid.cells >= 0
    side = max(1, round(STRAY_M / grid.resolution_m))
    solid = binary_opening(known, np.ones((side, side), bool))
    parts, count = label(solid)
    if count:
        sizes = np.bincount(parts.ravel())[1:]
        known = np.isin(parts, 1 + np.flatnonzero(sizes >= LEAST_SHARE * sizes.max()))
    cells = np.argwhere(known)
    if not len(cells):
        return np.empty((0, 2))
    half = grid.resolution_m / 2
    return np.stack([grid.centre(cells.min(0)) - half, grid.centre(cells.max(0)) + half])
