"""PoseStamped publisher on a ROS 2 topic over DDS, with cyclonedds and without ROS.

Names, encoding and quality of service are ROS 2's: topic ``rt/NAME``, type ``pkg::msg::dds_::Type_``, plain CDR;
reliable, volatile, the last 10 kept. Every DDS middleware of ROS 2 understands it.
"""

from __future__ import annotations

import time
from typing import Any

from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import float64, int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cartier.errors import BackendError
from cartier.robots._pose import FRAME, in_words, quaternion_zw
from cartier.types import Goal

POLL_S = 0.02
SETTLE_S = 0.3  # a second listener, perhaps the robot, may be discovered a moment after the first
# Robots from Iron on expect it beside the topic, and log a complaint without it.
TYPE_HASH = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"


def _message(package: str, name: str, **fields: Any) -> Any:
    """A message type by its DDS name, with its fields in order."""
    return make_idl_struct(name, f"{package}::msg::dds_::{name}_", fields)


Time = _message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = _message("std_msgs", "Header", stamp=Time, frame_id=str)
Point = _message("geometry_msgs", "Point", x=float64, y=float64, z=float64)
Quaternion = _message("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose = _message("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
PoseStamped = _message("geometry_msgs", "PoseStamped", header=Header, pose=Pose)


def send_pose(goal: Goal, topic: str, domain: int, timeout_s: float) -> str:
    """Publish one pose once there is a listener, and wait until it is received. Raises BackendError on timeout."""
    header = Header(Time(0, 0), FRAME)  # time zero: the latest transform there is, on a real or a simulated clock
    pose = Pose(Point(goal.x, goal.y, 0.0), Quaternion(0.0, 0.0, *quaternion_zw(goal.yaw)))
    where = f"/{topic} in domain {domain}"
    try:
        participant = DomainParticipant(domain)  # its writer and topic are deleted with it
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=timeout_s)),
            Policy.Durability.Volatile,
            Policy.History.KeepLast(10),
            Policy.Userdata(f"typehash={TYPE_HASH};".encode()),
        )
        writer = DataWriter(participant, Topic(participant, f"rt/{topic}", PoseStamped), qos=qos)
        listeners = matched_listeners(writer, timeout_s)
        if not listeners:
            raise BackendError(
                f"no robot listens on {where} (waited {timeout_s:g} s): is Nav2 up, is its ROS_DOMAIN_ID {domain}, "
                "and do the two machines share a network?"
            )
        writer.write(PoseStamped(header, pose))
        if not _received(writer, timeout_s):
            raise BackendError(f"a robot listens on {where}, but did not take the goal within {timeout_s:g} s")
    except DDSException as error:
        hint = "check CYCLONEDDS_URI and the network"
        raise BackendError(f"DDS cannot send in domain {domain}: {error}; {hint}") from error
    others = f" by {listeners} listeners" if listeners > 1 else ""
    return f"sent on {where} over DDS, and received{others}: {in_words(goal)}"


def matched_listeners(writer: Any, timeout_s: float) -> int:
    """The number of readers, once there is one or the time is over."""
    end = time.monotonic() + timeout_s
    while not writer.get_matched_subscriptions() and time.monotonic() < end:
        time.sleep(POLL_S)
    time.sleep(SETTLE_S)
    return len(writer.get_matched_subscriptions())


def _received(writer: Any, timeout_s: float) -> bool:
    try:
        return bool(writer.wait_for_acks(duration(seconds=timeout_s)))
    except AttributeError:  # cyclonedds 11.0.1 misspells its own exception when the time is over
        return False
