"""Client of Nav2's NavigateToPose action, with the ROS 2 that is sourced in this shell. Untried on a robot."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from cartier.errors import BackendError
from cartier.robots._pose import FRAME, Pose, in_words, pose_of, quaternion_zw
from cartier.types import DriveProgress, Goal

TELL_S = 0.5
SUCCEEDED, CANCELED = 4, 5  # action_msgs/msg/GoalStatus


class Drive:
    """A goal that Nav2 has accepted, and what it said of it last."""

    def __init__(self, node: Any, executor: Any, timeout_s: float) -> None:
        self._node, self._executor, self._timeout_s = node, executor, timeout_s
        self.pose: Pose | None = None
        self.left_m: float | None = None
        self.handle: Any = None

    def wait(self, future: Any, timeout_s: float | None = None) -> bool:
        """Whether a future is done within so long."""
        within_s = self._timeout_s if timeout_s is None else timeout_s
        rclpy.spin_until_future_complete(self._node, future, executor=self._executor, timeout_sec=within_s)
        return bool(future.done())

    def feedback(self, told: Any) -> None:
        """What Nav2 says of the drive: where the robot is, and how far the path still is."""
        p, q = told.feedback.current_pose.pose.position, told.feedback.current_pose.pose.orientation
        self.pose = float(p.x), float(p.y), 2 * math.atan2(q.z, q.w)
        self.left_m = float(told.feedback.distance_remaining)


def send_action(goal: Goal, action: str, domain: int, timeout_s: float) -> str:
    """Send the goal and wait until it is accepted. Raises BackendError on timeout or refusal."""
    with _accepted(goal, action, domain, timeout_s):
        return f"accepted by /{action} in domain {domain}: {in_words(pose_of(goal))}"


def drive_action(
    goal: Goal, action: str, domain: int, timeout_s: float, stopped: threading.Event
) -> Iterator[DriveProgress]:
    """Send the goal and tell Nav2's feedback until its result; ``stopped`` cancels it. Raises BackendError as above."""
    with _accepted(goal, action, domain, timeout_s) as drive:
        result = drive.handle.get_result_async()
        cancelled = False
        while not drive.wait(result, TELL_S):
            if stopped.is_set() and not cancelled:
                cancelled = True
                if not drive.wait(drive.handle.cancel_goal_async()):
                    raise BackendError(f"/{action} in domain {domain} does not answer the request to stop")
            left = "on the way" if drive.left_m is None else f"{drive.left_m:.1f} m"
            yield DriveProgress("driving", f"{left} to the {goal.place.label}", drive.pose, drive.left_m)
        yield _ended(result.result(), goal, drive)


@contextmanager
def _accepted(goal: Goal, action: str, domain: int, timeout_s: float) -> Iterator[Drive]:
    """A goal that is accepted; ROS is left at the end."""
    context = Context()  # a context of its own, beside that of a program that uses ROS
    rclpy.init(args=[], context=context, domain_id=domain)
    try:
        node = rclpy.create_node("cartier", context=context)
        client = ActionClient(node, NavigateToPose, action)
        if not client.wait_for_server(timeout_sec=timeout_s):
            raise BackendError(
                f"no robot serves the action /{action} in domain {domain} (waited {timeout_s:g} s): is Nav2 up and "
                f"active, and is its ROS_DOMAIN_ID {domain}?"
            )
        drive = Drive(node, SingleThreadedExecutor(context=context), timeout_s)
        future = client.send_goal_async(_message(goal), feedback_callback=drive.feedback)
        if not drive.wait(future):
            raise BackendError(f"/{action} in domain {domain} did not answer within {timeout_s:g} s")
        drive.handle = future.result()
        if not drive.handle.accepted:
            refused = f"/{action} in domain {domain} refused the goal: {in_words(pose_of(goal))}"
            raise BackendError(f"{refused}; the robot's log says why")
        yield drive
    finally:
        rclpy.shutdown(context=context)


def _ended(told: Any, goal: Goal, drive: Drive) -> DriveProgress:
    """The end of a drive, by the status of the action's result."""
    label = goal.place.label
    if told.status == SUCCEEDED:
        return DriveProgress("arrived", f"Nav2 says that it arrived at the {label}", pose_of(goal), 0.0)
    if told.status == CANCELED:
        return DriveProgress("stopped", f"the drive to the {label} was cancelled", drive.pose, drive.left_m)
    code, why = getattr(told.result, "error_code", 0), str(getattr(told.result, "error_msg", ""))  # from Jazzy on
    reason = " ".join(why.split())[:200] or f"error {code}"
    return DriveProgress("failed", f"Nav2 gave up the drive to the {label}: {reason}", drive.pose, drive.left_m)


def _message(goal: Goal) -> Any:
    message = NavigateToPose.Goal()
    message.pose.header.frame_id = FRAME  # the stamp stays zero: the latest transform, on a real or a simulated clock
    message.pose.pose.position.x, message.pose.pose.position.y = goal.x, goal.y
    orientation = message.pose.pose.orientation
    orientation.z, orientation.w = quaternion_zw(goal.yaw)
    return message
