"""Robot on a DDS domain that drives to goal poses and says by /tf where it is. usage: DOMAIN FORM SECONDS [SPEED]

FORM is drives, stuck (it stops halfway), mute (it sends no transforms) or dies (its transforms end halfway). Message
types are those of ros_listener.py and ros_camera.py, written down by hand. Each goal that comes is printed.
"""

import math
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from ros_camera import Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3
from ros_listener import PoseStamped

STEP_S = 0.05


def moved(parent: str, child: str, x: float, y: float, yaw: float) -> TransformStamped:
    now_s = time.time()
    header = Header(Time(int(now_s), int(now_s % 1 * 1e9)), parent)
    turn = Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return TransformStamped(header, child, Transform(Vector3(x, y, 0.0), turn))


def main(domain: int, form: str, seconds: float, speed: float = 2.0) -> None:
    participant = DomainParticipant(domain)
    reliable = Policy.Reliability.Reliable(duration(seconds=1))
    goals = DataReader(
        participant, Topic(participant, "rt/goal_pose", PoseStamped), qos=Qos(reliable, Policy.History.KeepLast(10))
    )
    tf = DataWriter(participant, Topic(participant, "rt/tf", TFMessage), qos=Qos(reliable))
    latched = Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    static = DataWriter(participant, Topic(participant, "rt/tf_static", TFMessage), qos=latched)
    static.write(TFMessage([moved("base_footprint", "base_link", 0.0, 0.0, 0.0)]))
    print("ready", flush=True)
    x, y, yaw, driven_m, target = 0.0, 0.0, 0.0, 0.0, None
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for goal in goals.take(10):
            if goal.sample_info.valid_data:
                p, q = goal.pose.position, goal.pose.orientation
                target = p.x, p.y, 2 * math.atan2(q.z, q.w)
                print("goal", *target, flush=True)
        if target is not None:
            left_m = math.dist((x, y), target[:2])
            step_m = 0.0 if form == "stuck" and driven_m >= 0.5 else min(left_m, speed * STEP_S)
            if step_m > 0:
                x, y = (a + (b - a) * step_m / left_m for a, b in ((x, target[0]), (y, target[1])))
                driven_m += step_m
            else:
                yaw = target[2] if left_m < 1e-6 else yaw
        if form != "mute" and not (form == "dies" and driven_m >= 0.5):
            # the robot's odometry lies a quarter of a turn and a metre off the map, as that of a real one does
            tf.write(TFMessage([moved("map", "odom", 1.0, 0.0, math.pi / 2)]))
            tf.write(TFMessage([moved("odom", "base_footprint", y, 1.0 - x, yaw - math.pi / 2)]))
        time.sleep(STEP_S)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], *map(float, sys.argv[3:]))
