"""Viewpoints: the nearest pose from which an object looks large enough, and first one on a side that no view shows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cartier.types import FREE, OccupancyGrid, RobotModel
from cartier.vision.viewpoint import pose_to_see
from vision.staged_photos import mug

GRID = OccupancyGrid(np.full((120, 120), FREE, np.int8), 0.05, (-3.0, -3.0), np.zeros((120, 120), np.float16))
EAST = (2.0, 0.0)  # where the robot stands


def test_an_unseen_side_comes_first() -> None:
    thing = replace(mug(1, [(1, (100.0, 100.0, 200.0, 200.0), 0)]), position=(0.0, 0.0, 0.8), side_views=())
    thing = replace(thing, box_min=(-0.1, -0.1, 0.7), box_max=(0.1, 0.1, 0.9))
    seen = replace(thing.views[0], camera=(2.0, 0.0, 1.2), yaw=math.pi)
    thing = replace(thing, views=(seen,))

    def side(new_side: bool) -> float:
        goal = pose_to_see(thing, 100.0, GRID, EAST, RobotModel(), new_side)
        assert goal is not None
        return math.degrees(math.atan2(goal.y, goal.x))

    assert abs(side(False)) < 5, "the nearest pose, on the side that is known"
    assert abs(side(True)) > 30, "one that looks from elsewhere"
