"""Camera of a robot under ROS 2, for an environment of build.py. usage: PICTURES.npz FORM SECONDS

PICTURES has rgb (H, W, 3), depth_mm (H, W), their PNG files as bytes, and focal. FORM is raw (rgb8 and 16UC1), 32FC1
(depth in metres), compressed (with compressedDepth), region (CameraInfo of a sensor twice as large, of which a region
is read binned), odometry (nav_msgs/Odometry in place of /tf) or detections (of a cup, as yolo_ros sends them, on
/yolo/detections after each image). The k-th image is taken k tenths of a second after
START_S, and the base is 0.1 k metres ahead.
"""

import array
import struct
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

START_S, FRAME, HZ = 1_700_000_000, "camera_optical", 20
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def stamped(message, k: int, frame: str):  # type: ignore[no-untyped-def]
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = START_S + k // 10, k % 10 * 10**8
    return message


def image(k: int, pixels: np.ndarray, encoding: str) -> Image:
    message = stamped(Image(), k, FRAME)
    message.height, message.width, message.encoding = *pixels.shape[:2], encoding
    message.step, message.data = pixels.strides[0], array.array("B", pixels.tobytes())
    return message


def packed(k: int, data: bytes, form: str) -> CompressedImage:
    message = stamped(CompressedImage(), k, FRAME)
    message.format, message.data = form, array.array("B", data)
    return message


def moved(k: int, parent: str, child: str, xyz: tuple, xyzw: tuple = (0.0, 0.0, 0.0, 1.0)) -> TransformStamped:
    message = stamped(TransformStamped(), k, parent)
    message.child_frame_id, t, q = child, message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = xyz
    q.x, q.y, q.z, q.w = xyzw
    return message


def cup(k: int) -> Detection2DArray:
    found, guess = Detection2D(), ObjectHypothesisWithPose()
    guess.hypothesis.class_id, guess.hypothesis.score = "cup", 0.75
    found.results, found.id, found.header = [guess], str(k), stamped(Detection2DArray(), k, FRAME).header
    found.bbox.center.position.x, found.bbox.center.position.y = 20.0 + k % 10, 15.0
    found.bbox.size_x, found.bbox.size_y = 10.0, 8.0
    return stamped(Detection2DArray(detections=[found]), k, FRAME)


def info(pictures, form: str) -> CameraInfo:  # type: ignore[no-untyped-def]
    height, width = pictures["depth_mm"].shape
    focal, message = float(pictures["focal"]), stamped(CameraInfo(), 0, FRAME)
    times, x, y = (2, 20, 10) if form == "region" else (1, 0, 0)
    fx, cx, cy = focal * times, width / 2 * times + x, height / 2 * times + y
    message.width, message.height = width * times + 2 * x, height * times + 2 * y
    message.distortion_model, message.d, message.r = "plumb_bob", [0.0] * 5, np.eye(3).ravel()
    message.k, message.p = (
        [fx, 0.0, cx, 0.0, fx, cy, 0.0, 0.0, 1.0],
        [fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )
    if form == "region":
        message.binning_x = message.binning_y = times
        message.roi.x_offset, message.roi.y_offset = x, y
        message.roi.width, message.roi.height = width * times, height * times
    return message


def main(file: str, form: str, seconds: float) -> None:
    pictures = np.load(file)
    rclpy.init()
    node, compressed = rclpy.create_node("camera"), form == "compressed"
    kind = CompressedImage if compressed else Image
    colour = node.create_publisher(kind, "/camera/color/image_raw" + "/compressed" * compressed, BEST_EFFORT)
    depth = node.create_publisher(kind, "/camera/depth/image_raw" + "/compressedDepth" * compressed, BEST_EFFORT)
    infos = node.create_publisher(CameraInfo, "/camera/color/camera_info", LATCHED)
    tf = node.create_publisher(TFMessage, "/tf", 10) if form != "odometry" else None
    odometry = node.create_publisher(Odometry, "/odom", 10) if form == "odometry" else None
    cups = node.create_publisher(Detection2DArray, "/yolo/detections", 10) if form == "detections" else None
    static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
    fixed = [moved(0, "map", "odom", (1.0, 2.0, 0.0)), moved(0, "base", FRAME, (0.1, 0.0, 1.2), (-0.5, 0.5, -0.5, 0.5))]
    static.publish(TFMessage(transforms=fixed))
    infos.publish(info(pictures, form))
    print("ready", flush=True)
    for k in range(int(seconds * HZ)):
        if tf is not None:
            tf.publish(TFMessage(transforms=[moved(k, "odom", "base", (0.1 * k, 0.0, 0.0))]))
        if odometry is not None:
            told = stamped(Odometry(), k, "odom")
            told.child_frame_id, told.pose.pose.position.x = "base", 0.1 * k
            odometry.publish(told)
        if compressed:
            colour.publish(packed(k, pictures["rgb_png"].tobytes(), "rgb8; png compressed"))
            header = struct.pack("<i2f", 0, 0, 0)
            depth.publish(packed(k, header + pictures["depth_png"].tobytes(), "16UC1; compressedDepth png"))
        else:
            colour.publish(image(k, pictures["rgb"], "rgb8"))
            metres = form == "32FC1"
            sent = (pictures["depth_mm"] / 1000).astype(np.float32) if metres else pictures["depth_mm"]
            depth.publish(image(k, sent, "32FC1" if metres else "16UC1"))
        if cups is not None:
            cups.publish(cup(k))
        time.sleep(1 / HZ)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
