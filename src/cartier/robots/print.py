"""Robot that only prints: the goal pose, and the ros2 command that would send it to Nav2.

The goal of ``/navigate_to_pose`` is the same in Humble, Iron, Jazzy and Kilted.
"""

from __future__ import annotations

from cartier.robots.common.pose import FRAME, in_words, pose_of, quaternion_zw
from cartier.types import Goal


def make() -> Print:
    return Print()


class Print:
    """Obeys the Robot contract."""

    name = "print"

    def go_to(self, goal: Goal) -> str:
        # Fixed point: YAML 1.1 reads 1e-05 as a string.
        x, y, z, w = (f"{value:.6f}" for value in (goal.x, goal.y, *quaternion_zw(goal.yaw)))
        command = (
            "ros2 action send_goal /navigate_to_pose nav2_msgs/action/NavigateToPose "
            f'"{{pose: {{header: {{frame_id: {FRAME}}}, pose: {{position: {{x: {x}, y: {y}, z: 0.0}}, '
            f'orientation: {{x: 0.0, y: 0.0, z: {z}, w: {w}}}}}}}}}"'
        )
        return f"{goal.place.label}: {in_words(pose_of(goal))}: {command}"
