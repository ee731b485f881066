"""Values of the API: a goal's path is told by its corners alone, and is the same path."""

from __future__ import annotations

import numpy as np

from cartier.geometry import yaw_towards
from cartier.serving.values import pose
from cartier.types import Goal, Place


def test_a_path_is_told_by_its_corners() -> None:
    steps = [(0.05, 0.0)] * 20 + [(0.05, 0.05)] * 10 + [(0.0, 0.05)] * 15
    path = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    x, y = path[-1].tolist()
    goal = Goal(x, y, yaw_towards(0, 0, 1, 1), path, 2.0, Place("cup", (2.0, 2.0, 0.5), 1.0, 0), True)
    np.testing.assert_allclose(pose(goal)["path"], [(0, 0), (1, 0), (1.5, 0.5), (1.5, 1.25)], atol=1e-9)
