"""Robot with Nav2 on ROS 2: NavigateToPose through rclpy if it is importable, else /goal_pose over DDS.

The latter needs no ROS on this machine: cyclonedds from pip speaks the wire protocol of ROS 2's topics.
"""

from __future__ import annotations

import math
import os

from cartier.errors import BackendError
from cartier.types import Goal

EXTRA = "ros"
LAST_DOMAIN = 232  # the last whose ports fit into 16 bits


def make(domain: int | None = None, timeout_s: float = 5.0, namespace: str = "") -> Ros2:
    """``domain`` is the robot's ROS_DOMAIN_ID, by default this shell's, else 0; ``namespace`` is the robot's, if any.

    ``timeout_s`` bounds both finding the robot and its taking the goal. Raises BackendError for an impossible option.
    """
    if not (math.isfinite(timeout_s) and 0 < timeout_s <= 600):
        raise BackendError(f"robot ros2: timeout_s must be above 0 and at most 600 s, got {timeout_s:g}")
    prefix = namespace.strip("/")
    if prefix and not all(part.isidentifier() and part.isascii() for part in prefix.split("/")):
        raise BackendError(f"robot ros2: namespace must be made of letters, digits, _ and /, got {namespace!r}")
    domain = _domain(os.environ.get("ROS_DOMAIN_ID") or 0 if domain is None else domain)
    with_rclpy = _rclpy_is_here()
    if not with_rclpy:
        import cyclonedds  # noqa: F401  # fails at once if the extra is missing
    return Ros2(domain, timeout_s, f"{prefix}/" if prefix else "", with_rclpy)


class Ros2:
    """Obeys the Robot contract. ``go_to`` returns when the goal is accepted, not when the robot arrives."""

    name = "ros2"

    def __init__(self, domain: int, timeout_s: float, prefix: str, with_rclpy: bool) -> None:
        self._domain, self._timeout_s, self._prefix, self._with_rclpy = domain, timeout_s, prefix, with_rclpy

    def go_to(self, goal: Goal) -> str:
        """Raises BackendError if no robot is found in time, or if it does not take the goal."""
        if self._with_rclpy:
            from cartier.robots.rclpy_action import send_action

            return send_action(goal, f"{self._prefix}navigate_to_pose", self._domain, self._timeout_s)
        from cartier.robots.dds import send_pose

        return send_pose(goal, f"{self._prefix}goal_pose", self._domain, self._timeout_s)


def _domain(value: int | str) -> int:
    try:
        domain = int(value)
    except ValueError:
        domain = -1
    if not 0 <= domain <= LAST_DOMAIN:
        raise BackendError(f"robot ros2: the domain (or ROS_DOMAIN_ID) must be 0 to {LAST_DOMAIN}, got {value!r}")
    return domain


def _rclpy_is_here() -> bool:
    try:
        import nav2_msgs.action  # noqa: F401
        import rclpy  # noqa: F401
    except ImportError:  # also if rclpy was built for another Python
        return False
    return True
