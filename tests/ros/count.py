"""Strange program that hears a camera as sensor data; for an environment of build.py. usage: SECONDS

It prints how many images, depth images and CameraInfos it got, and how many there were by all of their stamps.
"""

import sys
import time

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

SETTLED_S = 3.0
TOPICS = {"/camera/color/image_raw": Image, "/camera/aligned_depth_to_color/image_raw": Image,
          "/camera/color/camera_info": CameraInfo}  # fmt: skip

if __name__ == "__main__":
    rclpy.init()
    node, stamps = rclpy.create_node("counter"), {name: set() for name in TOPICS}
    for name, kind in TOPICS.items():
        node.create_subscription(
            kind, name, lambda told, name=name: stamps[name].add((told.header.stamp.sec, told.header.stamp.nanosec)),
            qos_profile_sensor_data,
        )  # fmt: skip
    begin_s = time.monotonic()
    while time.monotonic() - begin_s < SETTLED_S + float(sys.argv[1]):
        rclpy.spin_once(node, timeout_sec=0.1)
        if time.monotonic() - begin_s < SETTLED_S:
            for each in stamps.values():
                each.clear()
    print(*(len(each) for each in stamps.values()), len(set().union(*stamps.values())), flush=True)
