"""Goal poses in ROS conventions: frame ``map``, a quaternion from the yaw (REP-103)."""

from __future__ import annotations

import math

from cartier.types import Goal

FRAME = "map"


def quaternion_zw(yaw: float) -> tuple[float, float]:
    """The z and w of the unit quaternion that turns by ``yaw`` (rad) about z; x and y are 0."""
    return math.sin(yaw / 2), math.cos(yaw / 2)


def in_words(goal: Goal) -> str:
    """A goal pose as text."""
    return f"x {goal.x:.3f} y {goal.y:.3f} m yaw {goal.yaw:.3f} rad in frame {FRAME}"
