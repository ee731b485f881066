"""Client of Nav2's NavigateToPose action, with the ROS 2 that is sourced in this shell."""

from __future__ import annotations

import math
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_action_status_default
from rclpy.signals import SignalHandlerOptions
from unique_identifier_msgs.msg import UUID

from cartier.errors import BackendError, brief
from cartier.robots.common.drives import STOP_S
from cartier.robots.common.pose import FRAME, Pose, in_words, pose_of, quaternion_zw
from cartier.types import DriveProgress, Goal

TELL_S, SPIN_S = 0.5, 0.05
ASK_S = 0.5  # between two requests to cancel: a service that is not discovered yet loses them
SILENT_S = 5.0  # a server that gave feedback gives it many times a second
SUCCEEDED, CANCELED = 4, 5  # action_msgs/msg/GoalStatus
ACTIVE = {1, 2, 3}  # accepted, executing, canceling


class Nav2:
    """The action server of a robot, as a node of ours sees it. All of it runs in one thread.

    Args:
        action: The name of the action.
        domain: The ROS_DOMAIN_ID.
        timeout_s: How long the server, and its answer to a goal, are waited for.
    """

    def __init__(self, action: str, domain: int, timeout_s: float, context: Any) -> None:
        self._where, self._timeout_s = f"/{action} in domain {domain}", timeout_s
        self._node = rclpy.create_node("cartier", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._client = ActionClient(self._node, NavigateToPose, action)
        self._cancels = self._node.create_client(CancelGoal, f"{action}/_action/cancel_goal")
        self._statuses: Any = None
        self._node.create_subscription(
            GoalStatusArray, f"{action}/_action/status", self._told_statuses, qos_profile_action_status_default
        )
        self._pose: Pose | None = None
        self._left_m: float | None = None
        self._heard_s = math.inf

    def drive(self, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]:
        """The steps of a drive, as ``Drives`` wants them. Raises BackendError without a server, or if it refuses."""
        if not self._spun(self._client.server_is_ready, self._timeout_s, asked):
            if asked.is_set():
                yield DriveProgress("stopped", f"nothing was sent to {self._where}")
                return
            raise BackendError(self._nobody())
        name = UUID(uuid=list(uuid.uuid4().bytes))
        answer = self._client.send_goal_async(_message(goal), self._told_feedback, name)
        try:
            yield from self._followed(answer, name, goal, asked)
        except (BackendError, GeneratorExit):
            raise
        except BaseException:
            self._cancelled(answer, name, goal)
            raise

    def halt(self) -> DriveProgress:
        """Cancel all goals of the server, whoever sent them. Raises BackendError without a server."""
        if not self._spun(lambda: self._cancels.service_is_ready() and self._client.server_is_ready(), self._timeout_s):
            raise BackendError(self._nobody())
        answer = self._cancels.call_async(CancelGoal.Request())  # no name and no time: all of them
        end_s = time.monotonic() + STOP_S
        self._spun(answer.done, STOP_S)
        if answer.done() and not answer.result().goals_canceling:
            return DriveProgress("stopped", f"nothing was driving by {self._where}")
        over = self._spun(lambda: self._statuses is not None and not self._active(), end_s - time.monotonic())
        return DriveProgress("stopped", f"cancelled by {self._where}") if answer.done() and over else self._unknown()

    def _followed(self, answer: Any, name: Any, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]:
        """A goal that was sent, to its end. Raises BackendError if it is refused."""
        self._spun(answer.done, self._timeout_s, asked)
        if not answer.done():
            yield self._cancelled(answer, name, goal)
            return
        if not answer.result().accepted:
            raise BackendError(self._refused(goal))
        yield DriveProgress("driving", f"accepted by {self._where}: {in_words(pose_of(goal))}")
        result = answer.result().get_result_async()
        while not self._spun(result.done, TELL_S, asked):
            silent_s = time.monotonic() - self._heard_s
            gone = not self._client.server_is_ready()
            if asked.is_set() or gone or silent_s > SILENT_S:
                ended = self._cancelled(answer, name, goal)
                lost = "" if asked.is_set() else "the server is gone: " if gone else "the server went silent: "
                yield DriveProgress(ended.status, f"{lost}{ended.text}", ended.pose, ended.left_m)
                return
            left = "on the way" if self._left_m is None else f"{self._left_m:.1f} m"
            silent = f"; nothing heard for {silent_s:.0f} s" if silent_s > 1 else ""
            yield DriveProgress("driving", f"{left} to the {goal.place.label}{silent}", self._pose, self._left_m)
        yield self._ended(result.result(), goal)

    def _cancelled(self, answer: Any, name: Any, goal: Goal) -> DriveProgress:
        """Ask the server to cancel a goal, accepted or not, until it says that the drive is over, or time is."""
        request, result = CancelGoal.Request(), None
        request.goal_info.goal_id = name
        begin_s, asked_s = time.monotonic(), -math.inf
        while time.monotonic() - begin_s < STOP_S:
            if answer.done() and not answer.result().accepted:
                return DriveProgress("stopped", self._refused(goal))
            if answer.done() and result is None:
                result, asked_s = answer.result().get_result_async(), -math.inf
            if time.monotonic() - asked_s >= ASK_S:
                asked_s = time.monotonic()
                self._cancels.call_async(request)
            if result is not None and self._spun(result.done, SPIN_S):
                return self._ended(result.result(), goal)
            self._spun(answer.done, SPIN_S)
        return self._unknown()

    def _spun(self, done: Callable[[], bool], within_s: float, asked: threading.Event | None = None) -> bool:
        """Whether something is done within so long; a stop that is asked for ends the wait."""
        end_s = time.monotonic() + within_s
        while not done() and time.monotonic() < end_s and not (asked is not None and asked.is_set()):
            self._executor.spin_once(timeout_sec=SPIN_S)
        return done()

    def _told_feedback(self, told: Any) -> None:
        p, q = told.feedback.current_pose.pose.position, told.feedback.current_pose.pose.orientation
        self._pose = float(p.x), float(p.y), 2 * math.atan2(q.z, q.w)
        self._left_m = float(told.feedback.distance_remaining)
        self._heard_s = time.monotonic()

    def _told_statuses(self, told: Any) -> None:
        self._statuses = told

    def _active(self) -> bool:
        return any(each.status in ACTIVE for each in self._statuses.status_list)

    def _ended(self, told: Any, goal: Goal) -> DriveProgress:
        """The end of a drive, by the status of the action's result."""
        label = goal.place.label
        if told.status == SUCCEEDED:
            return DriveProgress("arrived", f"Nav2 says that it arrived at the {label}", pose_of(goal), 0.0)
        if told.status == CANCELED:
            return DriveProgress("stopped", f"the drive to the {label} was cancelled", self._pose, self._left_m)
        code, why = getattr(told.result, "error_code", 0), getattr(told.result, "error_msg", "")  # not in all versions
        reason = brief(why, 200) or f"error {code}"
        return DriveProgress("failed", f"Nav2 gave up the drive to the {label}: {reason}", self._pose, self._left_m)

    def _unknown(self) -> DriveProgress:
        text = f"{self._where} did not say within {STOP_S:g} s that it cancelled: it may still be driving"
        return DriveProgress("unknown", f"{text}; stop it on the robot", self._pose, self._left_m)

    def _refused(self, goal: Goal) -> str:
        return f"{self._where} refused the goal: {in_words(pose_of(goal))}; the robot's log says why"

    def _nobody(self) -> str:
        return (
            f"no robot serves the action {self._where} (waited {self._timeout_s:g} s): is Nav2 up and active, and are "
            "the action's name and the ROS_DOMAIN_ID right?"
        )


@contextmanager
def nav2(action: str, domain: int, timeout_s: float) -> Iterator[Nav2]:
    """The action server of a robot; ROS is left at the end."""
    context = Context()  # a context of its own, beside that of a program that uses ROS
    rclpy.init(args=[], context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield Nav2(action, domain, timeout_s, context)
    finally:
        rclpy.shutdown(context=context)


def _message(goal: Goal) -> Any:
    message = NavigateToPose.Goal()
    message.pose.header.frame_id = FRAME  # the stamp stays zero: the latest transform, on a real or a simulated clock
    message.pose.pose.position.x, message.pose.pose.position.y = goal.x, goal.y
    orientation = message.pose.pose.orientation
    orientation.z, orientation.w = quaternion_zw(goal.yaw)
    return message
