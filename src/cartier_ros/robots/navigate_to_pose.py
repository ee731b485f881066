"""Server of Nav2's action NavigateToPose over DDS, as bt_navigator serves it: accepted, preempted, cancelled, ended.

A goal is always accepted and may be aborted at once: so Nav2 does, too. A new goal aborts the one before it.
"""

from __future__ import annotations

import math
import secrets
import threading
import time
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np

from cartier.robots.common.pose import FRAME, Pose
from cartier_ros.dds.services import Request, Services
from cartier_ros.dds.topics import Writer
from cartier_ros.dds.types import ACTION, duration, encoded, message, pose_stamped, stamp

STATUSES = "action_msgs/msg/GoalStatusArray"
KEPT_S, KEPT = 900.0, 100  # how long an ended goal is known, and how many of them
NO_ERROR, UNKNOWN_GOAL, TERMINATED = 0, 2, 3  # of action_msgs/srv/CancelGoal
ANY = bytes(16)


class GoalState(IntEnum):
    """Of action_msgs/msg/GoalStatus."""

    UNKNOWN, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(7)


@dataclass(eq=False)
class NavGoal:
    """A goal that was accepted: where to, in which frame, and what became of it."""

    id: bytes
    stamp_ns: int
    frame: str
    pose: Pose
    behavior_tree: str
    status: GoalState = GoalState.EXECUTING
    begin_s: float = field(default_factory=time.monotonic)
    end_s: float = math.inf
    result: Any = None
    asked: list[Request] = field(default_factory=list)


class NavigateToPose:
    """The action's three services and two topics.

    Args:
        participant: Of cyclonedds, which publishes feedback and states.
        services: What serves goals, results and cancels.
        name: The action.
    """

    def __init__(self, participant: Any, services: Services, name: str = "/navigate_to_pose") -> None:
        self._lock = threading.RLock()
        self._goals: dict[bytes, NavGoal] = {}
        self._pending: NavGoal | None = None
        self._feedback = Writer(participant, f"{name}/_action/feedback", f"{ACTION}_FeedbackMessage")
        self._status = Writer(participant, f"{name}/_action/status", STATUSES, 1, latched=True)
        services.serve(f"{name}/_action/send_goal", f"{ACTION}_SendGoal", self._sent)
        services.serve(f"{name}/_action/get_result", f"{ACTION}_GetResult", self._result)
        services.serve(f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel)

    def taken(self) -> NavGoal | None:
        """The goal that came since the last call, or None."""
        with self._lock:
            goal, self._pending = self._pending, None
            return goal

    def send(self, pose: Any) -> None:
        """Take a goal of our own, as bt_navigator does with what comes on /goal_pose (a PoseStamped)."""
        with self._lock:
            self._accept(secrets.token_bytes(16), pose, "")

    def end(self, goal: NavGoal, status: GoalState, code: int = 0, text: str = "") -> None:
        """Say how a goal ended, to all who ask."""
        result = message(f"{ACTION}_Result", error_code=code, error_msg=text)
        with self._lock:
            goal.status, goal.end_s = status, time.monotonic()
            goal.result = message(f"{ACTION}_GetResult_Response", status=int(status), result=result)
            self._tell()
            for request in goal.asked:
                request.reply(goal.result)
            goal.asked.clear()

    def feedback(self, goal: NavGoal, pose: Pose, left_m: float, left_s: float, recoveries: int) -> None:
        """Say how the drive to a goal goes."""
        told = message(
            f"{ACTION}_Feedback",
            current_pose=pose_stamped(FRAME, pose, time.time_ns()),
            navigation_time=duration(time.monotonic() - goal.begin_s),
            estimated_time_remaining=duration(left_s),
            number_of_recoveries=recoveries,
            distance_remaining=left_m,
        )
        self._feedback.write(encoded(message(f"{ACTION}_FeedbackMessage", goal_id=_uuid(goal.id), feedback=told)))

    def _sent(self, request: Request) -> None:
        asked = request.value
        with self._lock:
            id, now_ns = asked.goal_id.uuid.tobytes(), time.time_ns()
            new = id not in self._goals
            request.reply(message(f"{ACTION}_SendGoal_Response", accepted=new, stamp=stamp(now_ns)))
            if new:
                self._accept(id, asked.goal.pose, asked.goal.behavior_tree)

    def _accept(self, id: bytes, pose: Any, behavior_tree: str) -> None:
        now_s = time.monotonic()
        old = [goal for goal in self._goals.values() if goal.end_s < now_s - KEPT_S]
        ended = sorted((goal for goal in self._goals.values() if goal.result), key=lambda goal: goal.end_s)
        for goal in old or ended[: max(0, len(ended) - KEPT)]:
            del self._goals[goal.id]
        p, q = pose.pose.position, pose.pose.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        goal = NavGoal(id, time.time_ns(), pose.header.frame_id.strip("/"), (p.x, p.y, yaw), behavior_tree)
        before, self._goals[id], self._pending = self._pending, goal, goal
        self._tell()
        if before is not None:
            self.end(before, GoalState.ABORTED)

    def _result(self, request: Request) -> None:
        id = request.value.goal_id.uuid.tobytes()
        with self._lock:
            goal = self._goals.get(id)
            if goal is None:
                nothing = message(f"{ACTION}_Result", error_code=0, error_msg="")
                unknown = message(f"{ACTION}_GetResult_Response", status=int(GoalState.UNKNOWN), result=nothing)
                request.reply(unknown)
            elif goal.result:
                request.reply(goal.result)
            elif len(goal.asked) < KEPT:
                goal.asked.append(request)

    def _cancel(self, request: Request) -> None:
        """By id, all that were accepted until a time, both, or all if neither is given."""
        info = request.value.goal_info
        id, until_ns = info.goal_id.uuid.tobytes(), info.stamp.sec * 10**9 + info.stamp.nanosec
        with self._lock:
            every = id == ANY and not until_ns
            meant = [g for g in self._goals.values() if every or g.id == id or g.stamp_ns <= until_ns]
            cancelled = [goal for goal in meant if not goal.result]
            code = NO_ERROR
            if not cancelled and id != ANY:
                code = TERMINATED if id in self._goals else UNKNOWN_GOAL
            for goal in cancelled:
                goal.status = GoalState.CANCELING
            infos = [_info(goal) for goal in cancelled]
            request.reply(message("action_msgs/srv/CancelGoal_Response", return_code=code, goals_canceling=infos))
            if cancelled:
                self._tell()

    def _tell(self) -> None:
        states = [
            message("action_msgs/msg/GoalStatus", goal_info=_info(goal), status=int(goal.status))
            for goal in self._goals.values()
        ]
        self._status.write(encoded(message(STATUSES, status_list=states)))


def _uuid(id: bytes) -> Any:
    return message("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(id, np.uint8))


def _info(goal: NavGoal) -> Any:
    return message("action_msgs/msg/GoalInfo", goal_id=_uuid(goal.id), stamp=stamp(goal.stamp_ns))
