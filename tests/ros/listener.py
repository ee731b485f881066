"""Program under ROS 2 that hears what cartier publishes, and asks; for an environment of build.py. usage: WORDS SECONDS

It prints the first objects, the first markers, and the answer to WORDS, each as a line of JSON after its name.
"""

import json
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import MarkerArray

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def main(words: str, seconds: float) -> None:
    rclpy.init()
    node, told = rclpy.create_node("listener"), set()

    def tell(name: str, value: object) -> None:
        if name not in told:
            told.add(name)
            print(name, json.dumps(value), flush=True)

    def objects(message: Detection3DArray) -> None:
        rows = [(one.id, one.results[0].hypothesis.class_id, one.bbox.size.z) for one in message.detections]
        tell("objects", {"frame": message.header.frame_id, "rows": rows})

    node.create_subscription(Detection3DArray, "/cartier/objects", objects, LATCHED)
    node.create_subscription(MarkerArray, "/cartier/markers", lambda m: tell("markers", len(m.markers)), LATCHED)
    node.create_subscription(String, "/cartier/answer", lambda m: tell("answer", json.loads(m.data)), 10)
    asks = node.create_publisher(String, "/cartier/ask", 10)
    print("ready", flush=True)
    end, asked_s = time.monotonic() + seconds, 0.0
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        if "answer" not in told and asks.get_subscription_count() and time.monotonic() - asked_s > 2:
            asked_s = time.monotonic()
            asks.publish(String(data=words))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
