"""Definitions of ROS 2 messages that rosbags does not have, by type: vision_msgs, and yolo_ros's own yolo_msgs.

vision_msgs of Galactic to Kilted are the same bytes: its ``geometry_msgs/Pose2D`` (x, y, theta) became
``vision_msgs/Pose2D`` (position, theta). Foxy's detections end in other fields, and have no type hash that would tell:
they are defined here as ``foxy_vision_msgs``.
"""

from __future__ import annotations

_BOX = "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox{}D bbox\n"
_FOXY = "sensor_msgs/{} source\nbool is_tracking\nstring tracking_id"
_ARRAY = "std_msgs/Header header\n{}[] detections"

DEFINITIONS = {
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection2D": _BOX.format(2) + "string id",
    "vision_msgs/msg/Detection3D": _BOX.format(3) + "string id",
    "vision_msgs/msg/Detection2DArray": _ARRAY.format("vision_msgs/Detection2D"),
    "vision_msgs/msg/Detection3DArray": _ARRAY.format("vision_msgs/Detection3D"),
    "foxy_vision_msgs/msg/Detection2D": _BOX.format(2) + _FOXY.format("Image"),
    "foxy_vision_msgs/msg/Detection3D": _BOX.format(3) + _FOXY.format("PointCloud2"),
    "foxy_vision_msgs/msg/Detection2DArray": _ARRAY.format("foxy_vision_msgs/Detection2D"),
    "foxy_vision_msgs/msg/Detection3DArray": _ARRAY.format("foxy_vision_msgs/Detection3D"),
    "yolo_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Vector2": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Pose2D": "yolo_msgs/Point2D position\nfloat64 theta",
    "yolo_msgs/msg/BoundingBox2D": "yolo_msgs/Pose2D center\nyolo_msgs/Vector2 size",
    "yolo_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id",
    "yolo_msgs/msg/Mask": "int32 height\nint32 width\nyolo_msgs/Point2D[] data",
    "yolo_msgs/msg/KeyPoint2D": "int32 id\nyolo_msgs/Point2D point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint2DArray": "yolo_msgs/KeyPoint2D[] data",
    "yolo_msgs/msg/KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint3DArray": "yolo_msgs/KeyPoint3D[] data\nstring frame_id",
    "yolo_msgs/msg/Detection": "int32 class_id\nstring class_name\nfloat64 score\nstring id\n"
    "yolo_msgs/BoundingBox2D bbox\nyolo_msgs/BoundingBox3D bbox3d\nyolo_msgs/Mask mask\n"
    "yolo_msgs/KeyPoint2DArray keypoints\nyolo_msgs/KeyPoint3DArray keypoints3d",
    "yolo_msgs/msg/DetectionArray": _ARRAY.format("yolo_msgs/Detection"),
}
