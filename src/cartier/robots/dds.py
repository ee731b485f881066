"""PoseStamped on a ROS 2 topic over DDS, and where the robot is by /tf: with cyclonedds and without ROS.

Names, encoding and quality of service are ROS 2's, so every DDS middleware of ROS 2 understands it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator

from cartier.dds.topics import Offer, Publishers, Reader, Writer, participant
from cartier.dds.types import encoded, header, message
from cartier.errors import BackendError
from cartier.robots._pose import FRAME, Pose, in_words, quaternion_zw
from cartier.robots.common.transforms import TF_MESSAGE, Latest
from cartier.types import DriveProgress, Goal

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POLL_S = 0.02
SETTLE_S = 0.3  # a second listener, perhaps the robot, may be discovered a moment after the first
TELL_S = 0.5
ARRIVED_M, ARRIVED_RAD = 0.25, 0.25  # Nav2's own tolerances
STILL_M, STILL_RAD, STILL_S = 0.02, 0.03, 1.0  # who stands so still for so long has stopped
STUCK_S = 30.0  # Nav2's recoveries, such as a turn on the spot, begin long before
SILENT_S = 5.0  # transforms come ten times a second and more


def send_pose(pose: Pose, topic: str, domain: int, timeout_s: float) -> str:
    """Publish a pose once there is a listener, and wait until it is received. Raises BackendError on timeout."""
    x, y, yaw = pose
    where = f"/{topic} in domain {domain}"
    z, w = quaternion_zw(yaw)
    value = message(
        POSE_STAMPED,
        header=header(FRAME),  # time zero: the latest transform there is, on a real or a simulated clock
        pose=message(
            "geometry_msgs/msg/Pose",
            position=message("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w),
        ),
    )
    ours = participant(domain)
    writer = Writer(ours, f"/{topic}", POSE_STAMPED)
    listeners = matched_listeners(writer.listeners, timeout_s)
    if not listeners:
        raise BackendError(
            f"no robot listens on {where} (waited {timeout_s:g} s): is Nav2 up, is its ROS_DOMAIN_ID {domain}, "
            "and do the two machines share a network?"
        )
    writer.write(encoded(value))
    if not writer.received(timeout_s):
        raise BackendError(f"a robot listens on {where}, but did not take the goal within {timeout_s:g} s")
    others = f" by {listeners} listeners" if listeners > 1 else ""
    return f"sent on {where} over DDS, and received{others}: {in_words(pose)}"


def matched_listeners(count: Callable[[], int], timeout_s: float) -> int:
    """The number of readers, once there is one or the time is over."""
    end = time.monotonic() + timeout_s
    while not count() and time.monotonic() < end:
        time.sleep(POLL_S)
    time.sleep(SETTLE_S)
    return count()


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


def drive(goal: Goal, sent: str, robot: RobotPose, stopped: threading.Event) -> Iterator[DriveProgress]:
    """Watch a robot that has taken a goal, by its transforms alone: they say where it is, not what Nav2 thinks."""
    watched = _Watched(goal, time.monotonic())
    told_s = 0.0
    while True:
        pose, now_s = robot.now(), time.monotonic()
        ended = _stopped(pose) if stopped.is_set() else _ended(watched, pose, sent, robot, now_s)
        if ended is not None:
            yield ended
            return
        if now_s - told_s >= TELL_S:
            told_s = now_s
            left_m = None if pose is None else watched.left_m(pose)
            text = sent if left_m is None else f"{left_m:.1f} m to the {goal.place.label}"
            yield DriveProgress("driving", text, pose, left_m)
        stopped.wait(POLL_S * 2)


class _Watched:
    """What was seen of a drive so far."""

    def __init__(self, goal: Goal, now_s: float) -> None:
        self.goal, self.begin_s = goal, now_s
        self._mark: Pose | None = None
        self._mark_s = now_s

    def left_m(self, pose: Pose) -> float:
        return math.dist(pose[:2], (self.goal.x, self.goal.y))

    def is_there(self, pose: Pose) -> bool:
        return self.left_m(pose) <= ARRIVED_M and _turn(pose[2], self.goal.yaw) <= ARRIVED_RAD

    def still_s(self, pose: Pose, now_s: float) -> float:
        """How long the robot has not moved."""
        mark = self._mark
        if mark is None or math.dist(pose[:2], mark[:2]) > STILL_M or _turn(pose[2], mark[2]) > STILL_RAD:
            self._mark, self._mark_s = pose, now_s
        return now_s - self._mark_s


def _ended(watched: _Watched, pose: Pose | None, sent: str, robot: RobotPose, now_s: float) -> DriveProgress | None:
    if pose is None:
        if now_s - watched.begin_s < SILENT_S:
            return None
        why = f"no transforms lead from {FRAME!r} to the robot's base on /tf, so it cannot be told whether it arrives"
        return DriveProgress("unknown", f"{sent}; {why}")
    left_m, still_s = watched.left_m(pose), watched.still_s(pose, now_s)
    if robot.silent_s() > SILENT_S:
        return DriveProgress("failed", f"the robot's transforms stopped coming {left_m:.2f} m short", pose, left_m)
    if watched.is_there(pose) and still_s >= STILL_S:
        return DriveProgress("arrived", f"arrived at the {watched.goal.place.label}: {in_words(pose)}", pose, left_m)
    if still_s >= STUCK_S:
        why = f"it has not moved for {still_s:.0f} s, {left_m:.2f} m short of the goal; its own log says why"
        return DriveProgress("failed", why, pose, left_m)
    return None


def _stopped(pose: Pose | None) -> DriveProgress:
    where = "" if pose is None else f" at {in_words(pose)}"
    return DriveProgress("stopped", f"the drive was stopped{where}", pose)


def _turn(one: float, other: float) -> float:
    return abs(math.remainder(one - other, math.tau))


def stop(robot: RobotPose, topic: str, domain: int, timeout_s: float) -> str:
    """Ask a robot to stay where it is: a goal replaces the one before it. Raises BackendError if that is not known."""
    end, pose = time.monotonic() + timeout_s, robot.now()
    while pose is None and time.monotonic() < end:
        time.sleep(POLL_S)
        pose = robot.now()
    if pose is None:
        raise BackendError(
            "the robot cannot be stopped from here: over plain DDS it is sent its own pose as the goal, and no "
            "transforms say where it is; stop it on the robot"
        )
    return f"asked to stay where it is: {send_pose(pose, topic, domain, timeout_s)}"
