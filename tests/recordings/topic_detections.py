"""Bags with the detections of another program in them: every layout of vision_msgs, and yolo_ros's own messages.

The definitions are those of the packages' releases, written down here apart from cartier's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bags import FRAME, START_NS, BagFile, write_images, write_transforms

from cartier.contracts import Detector, Recording
from cartier.types import Detections

TOPIC = "/yolo/detections"
POINT, YOLO_POSE = "float64 x\nfloat64 y", "yolo_msgs/Point2D position\nfloat64 theta"
HYPOTHESIS = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
}
NAMED = {"Detection{}D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox{}D bbox\nstring id"}
SIDES = "float64 size_x\nfloat64 size_y"
LAYOUTS = {
    "humble": HYPOTHESIS | {"Point2D": POINT, "Pose2D": "Point2D position\nfloat64 theta",
                            "BoundingBox2D": f"Pose2D center\n{SIDES}"},
    "galactic": HYPOTHESIS | {"BoundingBox2D": f"geometry_msgs/Pose2D center\n{SIDES}"},
    "foxy": {
        "ObjectHypothesisWithPose": "string id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose",
        "BoundingBox2D": f"geometry_msgs/Pose2D center\n{SIDES}",
        "Detection{}D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox{}D bbox\n"
        "sensor_msgs/Image source_img\nbool is_tracking\nstring tracking_id",
    },
}  # fmt: skip
YOLO = {
    "Point2D": POINT, "Vector2": POINT, "Pose2D": YOLO_POSE, "BoundingBox2D": "Pose2D center\nVector2 size",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id",
    "Mask": "int32 height\nint32 width\nPoint2D[] data", "KeyPoint2D": "int32 id\nPoint2D point\nfloat64 score",
    "KeyPoint2DArray": "KeyPoint2D[] data", "KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
    "KeyPoint3DArray": "KeyPoint3D[] data\nstring frame_id",
    "Detection": "int32 class_id\nstring class_name\nfloat64 score\nstring id\nBoundingBox2D bbox\n"
    "BoundingBox3D bbox3d\nMask mask\nKeyPoint2DArray keypoints\nKeyPoint3DArray keypoints3d",
    "DetectionArray": "std_msgs/Header header\nDetection[] detections",
}  # fmt: skip


class Writer:
    """Detections as messages of one layout: one of ``LAYOUTS``, ``yolo``, or ``3d`` (Humble's Detection3DArray)."""

    def __init__(self, messages: Any, layout: str) -> None:
        self.m, self.layout = messages, layout
        from rosbags.typesys import get_types_from_msg

        vision = NAMED | LAYOUTS.get(layout, LAYOUTS["humble"])
        vision |= {"BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size"}
        package, given = ("yolo_msgs", YOLO) if layout == "yolo" else ("vision_msgs", vision)
        size = "3" if layout == "3d" else "2"
        given = {name.format(size): text.replace("{}", size) for name, text in given.items()}
        if package == "vision_msgs":
            given[f"Detection{size}DArray"] = f"std_msgs/Header header\nDetection{size}D[] detections"
        for name, text in given.items():
            for own in given:
                text = "\n".join(
                    f"{package}/{line}" if line.split()[0].removesuffix("[]") == own else line
                    for line in text.split("\n")
                )
            self.m.store.register(get_types_from_msg(text, f"{package}/msg/{name}"))
        self.package, self.size = package, size

    def array(self, ns: int, found: Detections, boxes_3d: Sequence[Any] = (), frame: str = FRAME) -> Any:
        """The message of a frame's detections."""
        rows = zip(found.boxes_xyxy.astype(float), found.scores.tolist(), found.labels, strict=True)
        made = [self._one(ns, k, *row, boxes_3d, frame) for k, row in enumerate(rows)]
        kind = "DetectionArray" if self.layout == "yolo" else f"Detection{self.size}DArray"
        return self(kind, header=self.m.header(ns, frame), detections=made)

    def __call__(self, kind: str, **fields: Any) -> Any:
        return self.m(f"{self.package}/msg/{kind}", **fields)

    def _one(self, ns: int, k: int, box: Any, score: float, label: str, boxes_3d: Sequence[Any], frame: str) -> Any:
        still = self.m.pose(np.eye(4))
        (x, y), (w, h) = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
        x, y, w, h = map(float, (x, y, w, h))
        if self.layout == "yolo":
            nowhere = self(
                "BoundingBox3D", center=still, size=self.m("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0), frame_id=""
            )
            centre = self("Pose2D", position=self("Point2D", x=x, y=y), theta=0.0)
            return self(
                "Detection", class_id=k, class_name=label, score=score, id="", bbox3d=nowhere,
                bbox=self("BoundingBox2D", center=centre, size=self("Vector2", x=w, y=h)),
                mask=self("Mask", height=0, width=0, data=[]), keypoints=self("KeyPoint2DArray", data=[]),
                keypoints3d=self("KeyPoint3DArray", data=[], frame_id=""),
            )  # fmt: skip
        pose = self.m("geometry_msgs/msg/PoseWithCovariance", still, np.zeros(36))
        if self.layout == "foxy":
            image = self.m.image(ns, frame, np.zeros((0, 0, 3), np.uint8), "rgb8")
            ends: dict[str, Any] = {"source_img": image, "is_tracking": False, "tracking_id": "7"}
            results = [self("ObjectHypothesisWithPose", id=label, score=score, pose=pose)]
        else:
            hypothesis = self("ObjectHypothesis", class_id=label, score=score)
            results, ends = [self("ObjectHypothesisWithPose", hypothesis=hypothesis, pose=pose)], {"id": "7"}
        if self.layout == "3d":
            middle, size = boxes_3d[k]
            bbox = self("BoundingBox3D", center=self.m.pose(middle), size=self.m("geometry_msgs/msg/Vector3", *size))
        elif self.layout == "humble":
            centre = self("Pose2D", position=self("Point2D", x=x, y=y), theta=0.0)
            bbox = self("BoundingBox2D", center=centre, size_x=w, size_y=h)
        else:
            bbox = self("BoundingBox2D", center=self.m("geometry_msgs/msg/Pose2D", x, y, 0.0), size_x=w, size_y=h)
        return self(f"Detection{self.size}D", header=self.m.header(ns, frame), results=results, bbox=bbox, **ends)


def write(path: Path, recording: Recording, detector: Detector, layout: str = "humble", every: int = 1) -> None:
    """A robot's bag of a recording with what a detector on it found in each ``every``-th image, 30 ms later."""
    with BagFile(path) as bag:
        write_images(bag, recording)
        write_transforms(bag, [recording[i].world_from_camera for i in range(len(recording))])
        writer = Writer(bag.messages, layout)
        for i in range(0, len(recording), every):
            ns = START_NS + i * 10**8
            bag.put(TOPIC, ns + 3 * 10**7, writer.array(ns, detector.detect(recording[i])))
