"""PoseStamped on a ROS 2 topic over DDS, and where the robot is by /tf: with cyclonedds and without ROS.

Names, encoding and quality of service are ROS 2's, so every DDS middleware of ROS 2 understands it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from cartier.errors import BackendError, InputError
from cartier.robots.common.drives import STOP_S
from cartier.robots.common.pose import FRAME, Pose, in_words, pose_of
from cartier.types import DriveProgress, Goal
from cartier_ros.bags.bag import decoded
from cartier_ros.dds.topics import Offer, Publishers, Reader, Writer, participant
from cartier_ros.dds.types import CANCEL_GOAL, encoded, pose_stamped
from cartier_ros.robots.transforms import TF_MESSAGE, Latest

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
STATUS_ARRAY = "action_msgs/msg/GoalStatusArray"
CANCEL_ALL = b"\0\1\0\0" + bytes(24)  # no name and no time: every goal
ACTIVE, SUCCEEDED = {1, 2, 3}, 4  # action_msgs/msg/GoalStatus; active: accepted, executing, canceling
MOST_GOALS = 1000
POLL_S, ACK_S = 0.02, 0.1
ASK_S, CONFIRM_S = 0.25, 1.0  # between two requests to cancel; until the robot is sent its own pose, too
SETTLE_S = 0.3  # a second listener, perhaps the robot, may be discovered a moment after the first
TELL_S = 0.5
ARRIVED_M, ARRIVED_RAD = 0.25, 0.25  # Nav2's own tolerances
STILL_M, STILL_RAD, STILL_S = 0.02, 0.03, 1.0  # who stands so still for so long has stopped
STUCK_S = 30.0  # Nav2's recoveries, such as a turn on the spot, begin long before
SILENT_S = 5.0  # transforms come ten times a second and more


class RobotPose:
    """Where a robot is in the map, by the latest transforms from ``map`` to its base.

    Args:
        domain: The DDS domain.
        prefix: The robot's namespace with a slash after it, or nothing. Its own /tf is taken if it has one.
        base: The frame of its base.
    """

    def __init__(self, domain: int, prefix: str, base: str) -> None:
        self._participant, self._base, self._prefix = participant(domain), base, prefix
        self._publishers = Publishers(self._participant)
        self._readers: dict[str, Reader] = {}
        self._transforms = Latest()
        self._heard_s = time.monotonic()

    def now(self) -> Pose | None:
        """x, y (m) and yaw (rad), or None if no transforms lead to it."""
        self._listen()
        for reader in self._readers.values():
            for data in reader.take():
                if self._transforms.add(data) and not reader.offer.name.endswith("static"):
                    self._heard_s = time.monotonic()
        matrix = self._transforms.lookup(FRAME, self._base)
        if matrix is None:
            return None
        return float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0])

    def silent_s(self) -> float:
        """How long no moving transform has come."""
        return time.monotonic() - self._heard_s

    def _listen(self) -> None:
        offers = self._publishers.offers()
        for name in ("tf", "tf_static"):
            offer: Offer | None = offers.get(f"/{self._prefix}{name}") or offers.get(f"/{name}")
            if offer is not None and offer.kind == TF_MESSAGE and name not in self._readers:
                self._readers[name] = Reader(self._participant, offer, 100)


class Nav2:
    """A robot's Nav2 by its topics: they say where it is and whether a goal is active, not what Nav2 thinks of a path.

    Args:
        robot: Where the robot is.
        prefix: Its namespace with a slash after it, or nothing.
        domain: The DDS domain.
        timeout_s: How long a listener, and its taking the goal, are waited for.
    """

    def __init__(self, robot: RobotPose, prefix: str, domain: int, timeout_s: float) -> None:
        self._robot, self._where, self._timeout_s = robot, f"/{prefix}goal_pose in domain {domain}", timeout_s
        ours, self._begin_s = participant(domain), time.monotonic()
        action = f"/{prefix}navigate_to_pose/_action"
        self._goals = Writer(ours, f"/{prefix}goal_pose", POSE_STAMPED)
        self._cancels = Writer(ours, f"{action}/cancel_goalRequest", CANCEL_GOAL, prefix="rq")
        self._status = GoalStatus(ours, f"{action}/status")

    def drive(self, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]:
        """The steps of a drive, as ``Drives`` wants them. Raises BackendError if no robot takes the goal."""
        listeners = matched_listeners(self._goals.listeners, self._timeout_s, asked)
        self._status.begin()
        if asked.is_set():
            yield DriveProgress("stopped", f"nothing was sent on {self._where}")
            return
        if not listeners:
            raise BackendError(
                f"no robot listens on {self._where} (waited {self._timeout_s:g} s): is Nav2 up, is this its "
                "ROS_DOMAIN_ID, and do the two machines share a network?"
            )
        try:
            self._goals.write(_message(pose_of(goal)))
            if not self._received(asked):
                raise BackendError(
                    f"a robot listens on {self._where}, but did not take the goal within {self._timeout_s:g} s; it may "
                    "still take it"
                )
            others = f" by {listeners} listeners" if listeners > 1 else ""
            sent = f"sent on {self._where} over DDS, and received{others}: {in_words(pose_of(goal))}"
            yield from self._followed(goal, sent, asked)
        except (BackendError, GeneratorExit):
            raise
        except BaseException:
            self.halt()
            raise

    def halt(self) -> DriveProgress:
        """Cancel every goal of the action; where that is not confirmed, send the robot its own pose as the goal."""
        begin_s, asked_s, home_s, still, pose = time.monotonic(), -math.inf, math.inf, _Still(), self._robot.now()
        while (now_s := time.monotonic()) - begin_s < STOP_S:
            if now_s - asked_s >= ASK_S and self._cancels.listeners():
                asked_s = now_s  # again and again: what the robot has just received is no goal of the action yet
                self._cancels.write(CANCEL_ALL)
            if math.isfinite(asked_s) and self._status.over():
                if self._status.arrived and math.isinf(home_s):  # just before it was asked to stop
                    return DriveProgress("arrived", f"Nav2 says that it arrived{_at(pose)}", pose)
                return DriveProgress("stopped", f"the drive was cancelled{_at(pose)}", pose)
            pose = self._robot.now() or pose
            due_s = begin_s + CONFIRM_S if math.isfinite(asked_s) else self._begin_s + SETTLE_S
            if pose is not None and math.isinf(home_s) and now_s >= due_s and self._goals.listeners():
                home_s = now_s
                self._goals.write(_message(pose))
            stands = pose is not None and now_s >= home_s and still.for_s(pose, now_s) >= STILL_S / 2
            if stands and self._robot.silent_s() < STILL_S / 2 and self._goals.received(POLL_S):
                return DriveProgress("stopped", f"asked to stay where it is, and stands{_at(pose)}", pose)
            time.sleep(POLL_S)
        why = "" if pose is not None else f" (no transforms lead from {FRAME!r} to its base on /tf)"
        text = f"the robot is not known to have stopped within {STOP_S:g} s{why}: it may still be driving"
        return DriveProgress("unknown", f"{text}; stop it on the robot", pose)

    def _received(self, asked: threading.Event) -> bool:
        """Whether the goal is received; true, too, once a stop is asked for."""
        end_s = time.monotonic() + self._timeout_s
        while not (got := self._goals.received(ACK_S)) and time.monotonic() < end_s and not asked.is_set():
            pass
        return got or asked.is_set()

    def _followed(self, goal: Goal, sent: str, asked: threading.Event) -> Iterator[DriveProgress]:
        told = DriveProgress("driving", sent)
        yield told
        for told in follow(goal, sent, self._robot, asked):
            self._status.over()
            yield told
        if not told.ended:
            yield self.halt()


@contextmanager
def nav2(robot: RobotPose, prefix: str, domain: int, timeout_s: float) -> Iterator[Nav2]:
    """A robot's Nav2, as long as it is needed: a goal that was not received is not sent on afterwards."""
    yield Nav2(robot, prefix, domain, timeout_s)


class GoalStatus:
    """Whether goals of an action are active, by what its server says of them."""

    def __init__(self, ours: Any, name: str) -> None:
        self._participant, self._publishers, self._name = ours, Publishers(ours), name
        self._reader: Reader | None = None
        self._states, self._old = dict[bytes, int](), set[bytes]()
        self._seen = self._active = False

    def begin(self) -> None:
        """What is known by now is not of the drive that begins."""
        self._hear()
        self._old |= self._states.keys()
        self._seen = self._active = False

    @property
    def arrived(self) -> bool:
        """Whether a goal since the beginning has succeeded."""
        return any(state == SUCCEEDED for name, state in self._states.items() if name not in self._old)

    def over(self) -> bool:
        """Whether a goal was seen since the beginning, and none is active any more."""
        self._hear()
        return self._seen and not self._active

    def _hear(self) -> None:
        offer = self._publishers.offers().get(self._name) if self._reader is None else None
        if offer is not None and offer.kind == STATUS_ARRAY:
            self._reader = Reader(self._participant, offer, 10)
        for data in self._reader.take() if self._reader is not None else []:
            try:
                told = decoded(data, STATUS_ARRAY, "cdr", "a goal's status").status_list[:MOST_GOALS]
            except InputError:
                continue
            self._states = {bytes(each.goal_info.goal_id.uuid): each.status for each in told}
            self._active = not ACTIVE.isdisjoint(self._states.values())
            self._seen |= self._active or bool(self._states.keys() - self._old)


def matched_listeners(count: Callable[[], int], timeout_s: float, asked: threading.Event | None = None) -> int:
    """The number of readers, once there is one or the time is over; a stop that is asked for ends the wait."""
    end = time.monotonic() + timeout_s
    while not count() and time.monotonic() < end and not (asked is not None and asked.is_set()):
        time.sleep(POLL_S)
    time.sleep(SETTLE_S)
    return count()


def _message(pose: Pose) -> bytes:
    return encoded(
        pose_stamped(FRAME, pose)
    )  # time zero: the latest transform there is, on a real or a simulated clock


def follow(goal: Goal, sent: str, robot: RobotPose, asked: threading.Event) -> Iterator[DriveProgress]:
    """Watch a robot that has taken a goal by its transforms, to the end of its drive or until a stop is asked for."""
    watched, told_s = _Watched(goal, time.monotonic()), -math.inf
    while not asked.is_set():
        pose, now_s = robot.now(), time.monotonic()
        ended = _ended(watched, pose, sent, robot, now_s)
        if ended is not None:
            yield ended
            return
        if now_s - told_s >= TELL_S:
            told_s = now_s
            left_m = None if pose is None else watched.left_m(pose)
            text = sent if left_m is None else f"{left_m:.1f} m to the {goal.place.label}"
            yield DriveProgress("driving", text, pose, left_m)
        asked.wait(POLL_S * 2)


class _Still:
    """How long a robot has not moved."""

    def __init__(self) -> None:
        self._mark: Pose | None = None
        self._mark_s = 0.0

    def for_s(self, pose: Pose, now_s: float) -> float:
        mark = self._mark
        if mark is None or math.dist(pose[:2], mark[:2]) > STILL_M or _turn(pose[2], mark[2]) > STILL_RAD:
            self._mark, self._mark_s = pose, now_s
        return now_s - self._mark_s


class _Watched:
    """What was seen of a drive so far."""

    def __init__(self, goal: Goal, now_s: float) -> None:
        self.goal, self.begin_s, self.still = goal, now_s, _Still()

    def left_m(self, pose: Pose) -> float:
        return math.dist(pose[:2], (self.goal.x, self.goal.y))

    def is_there(self, pose: Pose) -> bool:
        return self.left_m(pose) <= ARRIVED_M and _turn(pose[2], self.goal.yaw) <= ARRIVED_RAD


def _ended(watched: _Watched, pose: Pose | None, sent: str, robot: RobotPose, now_s: float) -> DriveProgress | None:
    if pose is None:
        if now_s - watched.begin_s < SILENT_S:
            return None
        why = f"no transforms lead from {FRAME!r} to the robot's base on /tf, so it cannot be told whether it arrives"
        return DriveProgress("unknown", f"{sent}; {why}")
    left_m, still_s = watched.left_m(pose), watched.still.for_s(pose, now_s)
    if robot.silent_s() > SILENT_S:
        return DriveProgress("failed", f"the robot's transforms stopped coming {left_m:.2f} m short", pose, left_m)
    if watched.is_there(pose) and still_s >= STILL_S:
        return DriveProgress("arrived", f"arrived at the {watched.goal.place.label}: {in_words(pose)}", pose, left_m)
    if still_s >= STUCK_S:
        why = f"it has not moved for {still_s:.0f} s, {left_m:.2f} m short of the goal; its own log says why"
        return DriveProgress("failed", why, pose, left_m)
    return None


def _at(pose: Pose | None) -> str:
    return "" if pose is None else f" at {in_words(pose)}"


def _turn(one: float, other: float) -> float:
    return abs(math.remainder(one - other, math.tau))
