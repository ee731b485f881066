"""Objects of a home as ROS 2 messages: vision_msgs/Detection3DArray for programs, a MarkerArray for RViz."""

from __future__ import annotations

import colorsys
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cartier.types import MapObject, OrientedBox
from cartier_ros.dds.types import header, message, pose_of

DETECTIONS, MARKERS = "vision_msgs/msg/Detection3DArray", "visualization_msgs/msg/MarkerArray"
CUBE, TEXT, ADD, DELETE_ALL = 1, 9, 0, 3  # of visualization_msgs/msg/Marker
CLEAR, TEXT_M = 0.45, 0.12  # how opaque a box is, and how high its label
LEAST_M = 0.01  # RViz complains of a box without height


def detections(objects: Sequence[MapObject], frame: str) -> Any:
    """The confirmed objects; ``id`` is the object's number, ``class_id`` its label, ``score`` its probability."""
    found = []
    for obj in _sure(objects):
        box = _box(obj)
        kind = message("vision_msgs/msg/ObjectHypothesis", class_id=obj.label, score=obj.probability)
        placed = message("geometry_msgs/msg/PoseWithCovariance", pose=_pose(box), covariance=np.zeros(36))
        result = message("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=kind, pose=placed)
        bounds = message("vision_msgs/msg/BoundingBox3D", center=_pose(box), size=_vector(box.size))
        found.append(
            message("vision_msgs/msg/Detection3D", header=header(frame), results=[result], bbox=bounds, id=str(obj.id))
        )
    return message(DETECTIONS, header=header(frame), detections=found)


def markers(objects: Sequence[MapObject], frame: str) -> Any:
    """A coloured box and its label for each confirmed object; those that were shown before are taken away first."""
    shown = [_marker(frame, 0, CUBE, DELETE_ALL, OrientedBox((0, 0, 0), (1, 1, 1), 0.0), "", (0.0, 0.0, 0.0, 0.0))]
    for obj in _sure(objects):
        box, colour = _box(obj), colorsys.hsv_to_rgb(zlib.crc32(obj.label.encode()) % 360 / 360, 0.8, 1.0)
        top = OrientedBox((*box.middle[:2], box.middle[2] + box.size[2] / 2 + TEXT_M), (TEXT_M,) * 3, 0.0)
        shown.append(_marker(frame, 2 * obj.id, CUBE, ADD, box, "", (*colour, CLEAR)))
        shown.append(_marker(frame, 2 * obj.id + 1, TEXT, ADD, top, obj.label, (1.0, 1.0, 1.0, 1.0)))
    return message(MARKERS, markers=shown)


def _sure(objects: Sequence[MapObject]) -> list[MapObject]:
    return [obj for obj in objects if obj.confirmed and obj.located]


def _box(obj: MapObject) -> OrientedBox:
    """Its box along the walls, else along the axes of the map."""
    low, high = obj.box_min, obj.box_max
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    return obj.oriented or OrientedBox(middle, tuple(b - a for a, b in zip(low, high, strict=True)), 0.0)


def _pose(box: OrientedBox) -> Any:
    return pose_of(box.middle, box.yaw)


def _vector(size: Sequence[float]) -> Any:
    x, y, z = (max(float(side), LEAST_M) for side in size)
    return message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _marker(
    frame: str, number: int, kind: int, action: int, box: OrientedBox, text: str, rgba: tuple[float, ...]
) -> Any:
    r, g, b, a = rgba
    empty = np.empty(0, np.uint8)
    return message(
        "visualization_msgs/msg/Marker",
        header=header(frame), ns="cartier", id=number, type=kind, action=action, pose=_pose(box),
        scale=_vector(box.size), color=message("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a),
        lifetime=message("builtin_interfaces/msg/Duration", sec=0, nanosec=0), frame_locked=False, points=[],
        colors=[], texture_resource="", uv_coordinates=[], text=text, mesh_resource="",
        texture=message("sensor_msgs/msg/CompressedImage", header=header(""), format="", data=empty),
        mesh_file=message("visualization_msgs/msg/MeshFile", filename="", data=empty),
        mesh_use_embedded_materials=False,
    )  # fmt: skip
