"""Robot with Nav2 on ROS 2: NavigateToPose through rclpy if it is importable, else /goal_pose over DDS.

The latter needs no ROS on this machine: cyclonedds from pip speaks the wire protocol of ROS 2's topics.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Protocol

from cartier.errors import BackendError
from cartier.robots.common.drives import Drives
from cartier.types import DriveProgress, Goal
from cartier_ros.dds.domain import domain_of

if TYPE_CHECKING:
    from cartier_ros.robots.dds import RobotPose

EXTRA = "ros"
ACTION = "navigate_to_pose"


class Nav2(Protocol):
    """A robot's Nav2 for the length of a drive, by either way."""

    def drive(self, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]: ...
    def halt(self) -> DriveProgress: ...


def make(domain: int | None = None, timeout_s: float = 5.0, namespace: str = "", base_frame: str = "base_link") -> Ros2:
    """``domain`` is the robot's ROS_DOMAIN_ID, by default this shell's, else 0; ``namespace`` is the robot's, if any.

    ``timeout_s`` bounds both finding the robot and its taking the goal; ``base_frame`` is the frame of its base.
    Raises BackendError for an impossible option.
    """
    if not (math.isfinite(timeout_s) and 0 < timeout_s <= 600):
        raise BackendError(f"robot ros2: timeout_s must be above 0 and at most 600 s, got {timeout_s:g}")
    prefix = namespace.strip("/")
    if prefix and not all(part.isidentifier() and part.isascii() for part in prefix.split("/")):
        raise BackendError(f"robot ros2: namespace must be made of letters, digits, _ and /, got {namespace!r}")
    domain = domain_of(domain, "robot ros2")
    with_rclpy = _rclpy_is_here()
    if not with_rclpy:
        import cyclonedds  # noqa: F401  # fails at once if the extra is missing
        import rosbags  # noqa: F401
    return Ros2(domain, timeout_s, f"{prefix}/" if prefix else "", base_frame.strip("/"), with_rclpy)


class Ros2:
    """Obeys the contract DrivingRobot. ``go_to`` returns when the goal is accepted, ``drive`` watches the robot."""

    name = "ros2"

    def __init__(self, domain: int, timeout_s: float, prefix: str, base: str, with_rclpy: bool) -> None:
        self._domain, self._timeout_s, self._prefix, self._with_rclpy = domain, timeout_s, prefix, with_rclpy
        self._base, self._drives = base, Drives(self._steps, self._halt)
        self._pose: RobotPose | None = None
        self._last: tuple[float, float, float] | None = None

    def go_to(self, goal: Goal) -> str:
        """Raises BackendError if no robot is found in time, or if it does not take the goal."""
        return self._drives.send(goal)

    def drive(self, goal: Goal) -> Iterator[DriveProgress]:
        """By Nav2's feedback through rclpy, else by the robot's transforms. Raises BackendError as ``go_to``."""
        return self._drives.watch(goal)

    def pose(self) -> tuple[float, float, float] | None:
        """By /tf over DDS; through rclpy what Nav2 said of the latest drive. Raises BackendError as ``go_to``."""
        return self._last if self._with_rclpy else self._where().now()

    def stop(self) -> DriveProgress:
        """Cancels this robot's drive, or else every goal of Nav2's. Raises BackendError if there is no Nav2."""
        return self._drives.stop()

    def _steps(self, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]:
        with self._nav2() as robot:
            for progress in robot.drive(goal, asked):
                self._last = progress.pose or self._last
                yield progress

    def _halt(self) -> DriveProgress:
        with self._nav2() as robot:
            return robot.halt()

    def _nav2(self) -> AbstractContextManager[Nav2]:
        if self._with_rclpy:
            from cartier_ros.robots.rclpy_action import nav2

            return nav2(f"{self._prefix}{ACTION}", self._domain, self._timeout_s)
        from cartier_ros.robots.dds import nav2 as nav2_over_dds

        return nav2_over_dds(self._where(), self._prefix, self._domain, self._timeout_s)

    def _where(self) -> RobotPose:
        from cartier_ros.robots.dds import RobotPose

        if self._pose is None:
            self._pose = RobotPose(self._domain, self._prefix, self._base)
        return self._pose


def _rclpy_is_here() -> bool:
    try:
        import nav2_msgs.action  # noqa: F401
        import rclpy  # noqa: F401
    except ImportError:  # also if rclpy was built for another Python
        return False
    return True
