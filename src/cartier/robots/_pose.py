"""A goal as ROS writes a pose: frame ``map``, a quaternion from the yaw (REP-103)."""

from __future__ import annotations

import math

from cartier.types import Goal

FRAME = "map"


def quaternion_zw(yaw: float) -> tuple[float, float]:
    """The z and w of the unit quaternion that turns by ``yaw`` (rad) about z; x and y are 0."""
    return math.sin(yaw / 2), math.cos(yaw / 2)


def in_words(goal: Goal) -> str:
    return f"x {goal.x:.3f} y {goal.y:.3f} m yaw {goal.yaw:.3f} rad in frame {FRAME}"


def send_goal_command(goal: Goal) -> str:
    """The shell line that sends a goal to Nav2."""
    # Fixed point: YAML 1.1 reads 1e-05 as a string.
    x, y, z, w = (f"{value:.6f}" for value in (goal.x, goal.y, *quaternion_zw(goal.yaw)))
    return (
        "ros2 action send_goal /navigate_to_pose nav2_msgs/action/NavigateToPose "
        f'"{{pose: {{header: {{frame_id: {FRAME}}}, pose: {{position: {{x: {x}, y: {y}, z: 0.0}}, '
        f'orientation: {{x: 0.0, y: 0.0, z: {z}, w: {w}}}}}}}}}"'
    )
