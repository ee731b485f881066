"""Goal poses in ROS conventions: frame ``map``, a quaternion from the yaw (REP-103)."""

from __future__ import annotations

import math

from cartier.types import Goal

FRAME = "map"
Pose = tuple[float, float, float]
"""x, y (m) and yaw (rad) in ``FRAME``."""


def quaternion_zw(yaw: float) -> tuple[float, float]:
    """The z and w of the unit quaternion that turns by ``yaw`` (rad) about z; x and y are 0."""
    return math.sin(yaw / 2), math.cos(yaw / 2)


def pose_of(goal: Goal) -> Pose:
    """Where a goal is."""
    return goal.x, goal.y, goal.yaw


def in_words(pose: Pose) -> str:
    """A pose as text."""
    x, y, yaw = pose
    return f"x {x:.3f} y {y:.3f} m yaw {yaw:.3f} rad in frame {FRAME}"
