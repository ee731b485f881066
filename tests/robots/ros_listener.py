"""Listener on a DDS domain: prints each goal on a topic as one line of JSON. usage: DOMAIN TOPIC GOALS SECONDS

The message types are written down here once more, from the ROS 2 interface files: a slip in cartier's own cannot hide.
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


def main(domain: int, topic: str, goals: int, seconds: float) -> None:
    participant = DomainParticipant(domain)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10), Policy.Durability.Volatile)
    reader = DataReader(participant, Topic(participant, f"rt/{topic}", PoseStamped), qos=qos)
    writers = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    print("ready", flush=True)
    user_data, end = b"", time.monotonic() + seconds
    while goals and time.monotonic() < end:
        for writer in writers.take(10):
            if writer.sample_info.valid_data and writer.topic_name == f"rt/{topic}":
                user_data = bytes(writer.qos[Policy.Userdata].data)
        for goal in reader.take(10):
            if goal.sample_info.valid_data:  # type: ignore[attr-defined]  # a writer that leaves delivers a sample without data
                p, q = goal.pose.position, goal.pose.orientation
                stamp = [goal.header.stamp.sec, goal.header.stamp.nanosec]
                told = {"frame": goal.header.frame_id, "stamp": stamp, "user_data": user_data.decode()}
                told |= {"position": [p.x, p.y, p.z], "orientation": [q.x, q.y, q.z, q.w]}
                print(json.dumps(told), flush=True)
                goals -= 1
        time.sleep(0.01)
    time.sleep(0.3)  # the receipt must still go out


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
