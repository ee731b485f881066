"""The direction of walls, and boxes along them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartier.mapping.walls import walls_yaw
from cartier.types import OCCUPIED, OccupancyGrid


def plan(inside: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(np.where(inside, OCCUPIED, 0).astype(np.int8), 0.05, (0.0, 0.0), np.zeros(inside.shape, "f2"))


def room(yaw_deg: float) -> OccupancyGrid:
    """The walls of a room of 4 by 3 m, 0.2 m thick, and a round table."""
    yaw, (row, col) = math.radians(yaw_deg), np.mgrid[-60:60, -60:60] * 0.05
    x, y = np.abs(col * math.cos(yaw) + row * math.sin(yaw)), np.abs(row * math.cos(yaw) - col * math.sin(yaw))
    walls = (np.maximum(x - 2, y - 1.5) < 0.2) & (np.maximum(x - 2, y - 1.5) > 0)
    return plan(walls | (np.hypot(row - 0.5, col) < 0.5))


@pytest.mark.parametrize("yaw_deg", [0, 7, 20, 33, -12, -40, 44])
def test_walls_give_their_direction(yaw_deg: float) -> None:
    yaw = walls_yaw(room(yaw_deg))
    assert yaw is not None and abs(math.degrees(yaw) - yaw_deg) <= 1


def test_round_or_tiny_plans_have_no_direction() -> None:
    row, col = np.mgrid[-60:60, -60:60]
    assert walls_yaw(plan(np.hypot(row, col) < 40)) is None
    assert walls_yaw(plan((np.abs(row) < 2) & (np.abs(col) < 2))) is None
