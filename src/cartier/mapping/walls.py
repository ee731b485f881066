"""Direction of walls: how a home's rooms are turned in the map, from the obstacles of its floor plan."""

from __future__ import annotations

import numpy as np

from cartier.types import OCCUPIED, OccupancyGrid

SMOOTHING_CELLS = 2.0  # so that a slanted edge is no staircase
MIN_EDGE_CELLS = 30  # with less length of edges nothing is known
MIN_AGREEMENT = 0.25  # 1 if all edges lie along two directions at right angles, 0 for a round plan


def walls_yaw(grid: OccupancyGrid) -> float | None:
    """The direction of walls (rad), from -45° to 45° about the x axis of the map; None if there is no clear one.

    Rooms are taken to have right angles: four times the direction of every edge of an obstacle is the same angle.
    """
    from scipy.ndimage import gaussian_filter

    solid = gaussian_filter(np.pad((grid.cells == OCCUPIED).astype(np.float64), 8), SMOOTHING_CELLS)
    down, across = np.gradient(solid)
    edge = across + 1j * down
    length = np.abs(edge)
    turned = (length * np.exp(4j * np.angle(edge))).sum()
    if length.sum() < MIN_EDGE_CELLS or abs(turned) < MIN_AGREEMENT * length.sum():
        return None
    return float(np.radians(np.rint(np.degrees(np.angle(turned) / 4))))  # whole degrees: frame after frame the same
