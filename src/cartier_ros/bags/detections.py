"""Detections in ROS 2 messages: boxes of vision_msgs and of yolo_ros as a frame's detections, and a detector of them.

Boxes are in pixels of the colour topic, as it was published: a lens's distortion is taken out of them as it is of the
image. Boxes in space are projected into the colour camera, in whose frame they have to be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Detector
from cartier.detectors.boxes import clip
from cartier.errors import InputError, brief
from cartier.labels import MAX_NAME_CHARS, display_name
from cartier.recordings.common.lens import straightened
from cartier.types import Camera, Detections, DetectorScoreModel, Frame
from cartier_ros.bags.bag import decoded
from cartier_ros.bags.topics import Choice

BOXES_2D, BOXES_3D = "vision_msgs/msg/Detection2DArray", "vision_msgs/msg/Detection3DArray"
YOLO = "yolo_msgs/msg/DetectionArray"
DETECTIONS = (BOXES_2D, BOXES_3D, YOLO)
SAME_NS = 1_000_000  # the stamp of an image's detections is the image's own
MOST = 10_000  # hypotheses of one image
OVERHANG = 0.1  # of the image's side: boxes that reach further are of images of another size
CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
Boxes = npt.NDArray[np.float64]


@dataclass
class TopicDetector(Detector):
    """Obeys the Detector contract for frames with which detections came; ``find`` gives those of a frame by number."""

    name: str
    find: Callable[[int], Detections]
    score_model: DetectorScoreModel = field(default_factory=DetectorScoreModel)
    as_recorded = True  # boxes are of the images as they were published

    def detect(self, frame: Frame) -> Detections:
        return self.find(frame.index)


def topic_detector(topic: str, find: Callable[[int], Detections] | None = None) -> TopicDetector:
    """The detector of a topic; without ``find``, frames bring their detections, and it is asked for none."""

    def none(number: int) -> Detections:
        raise InputError(f"no detections of {topic} came with frame {number}")

    return TopicDetector(f"detections of {topic}", find or none)


def read_detections(data: bytes, kind: str, encoding: str, choice: Choice, number: int, where: str) -> Detections:
    """The detections of frame ``number`` from a message's bytes: one for each hypothesis, with its label and score.

    Raises InputError for a message that is damaged, and for one that names no classes, does not fit the images of
    ``choice``, or is in another frame than they.
    """
    message = _message(data, kind, encoding, where)
    labels, scores, boxes = list[str](), list[float](), list[Boxes]()
    for found in message.detections:
        box = _projected(found, message, choice, where) if kind == BOXES_3D else _flat(found.bbox, choice, where)
        for label, score in _hypotheses(found, kind):
            if box is not None and (name := _name(label, where)):
                labels.append(name)
                scores.append(score)
                boxes.append(box)
        if len(labels) > MOST:
            raise InputError(f"{where} holds more than {MOST} hypotheses")
    given, values = np.reshape(boxes, (-1, 4)), np.array(scores)
    if not (np.isfinite(given).all() and ((values >= 0) & (values <= 1)).all()):
        raise InputError(f"{where} holds a box that is not finite, or a score that is not from 0 to 1")
    camera = choice.colour_lens.camera
    clipped, whole = clip(given, camera.width, camera.height)
    names = tuple(label for label, kept in zip(labels, whole, strict=True) if kept)
    return Detections(number, clipped[whole], values[whole], names)


def _message(data: bytes, kind: str, encoding: str, where: str) -> Any:
    if encoding != "cdr":
        raise InputError(f"{where}: detections of ROS 1 have numbers for classes; names are needed, as in ROS 2")
    try:
        return decoded(data, kind, encoding, where)
    except InputError as error:
        if kind == YOLO:
            raise
        try:
            return decoded(data, f"foxy_{kind}", encoding, where)
        except InputError:
            raise error from None


def _hypotheses(found: Any, kind: str) -> Iterator[tuple[str, float]]:
    if kind == YOLO:
        yield found.class_name, found.score
    else:
        yield from ((each.hypothesis.class_id, each.hypothesis.score) for each in found.results)


def _name(label: str, where: str) -> str:
    if label.strip().lstrip("-").isdecimal():
        raise InputError(
            f"{where}: the class {brief(label, 20)!r} is a number, and no name: let the detector publish names"
        )
    return display_name(label[: 2 * MAX_NAME_CHARS])[:MAX_NAME_CHARS]


def _flat(bbox: Any, choice: Choice, where: str) -> Boxes:
    """The box (4,) in the frame's pixels that bounds one around a middle, which may be turned."""
    middle, theta = (bbox.center.position.x, bbox.center.position.y), bbox.center.theta
    wide, high = (bbox.size.x, bbox.size.y) if hasattr(bbox, "size") else (bbox.size_x, bbox.size_y)
    if not all(map(math.isfinite, (*middle, theta, wide, high))) or min(wide, high) < 0:
        raise InputError(f"{where} holds a box that is not finite, or has a side below zero")
    cos, sin = abs(math.cos(theta)), abs(math.sin(theta))
    half = np.array([cos * wide + sin * high, sin * wide + cos * high]) / 2 if theta else np.array([wide, high]) / 2
    box = np.concatenate([np.subtract(middle, half), np.add(middle, half)])
    lens = choice.colour_lens
    size = np.array((lens.camera.width, lens.camera.height) * 2)
    if ((box < -OVERHANG * size) | (box > (1 + OVERHANG) * size)).any():
        raise InputError(
            f"{where}: a box reaches out of the {lens.camera.width}x{lens.camera.height} px of {choice.colour.name}: "
            "was it detected in images of another size?"
        )
    return straightened(box, lens)


def _projected(found: Any, message: Any, choice: Choice, where: str) -> Boxes | None:
    """The box (4,) in the frame's pixels that bounds one in space; None behind the camera."""
    from scipy.spatial.transform import Rotation

    frame = (found.header.frame_id or message.header.frame_id).lstrip("/")
    if frame != choice.colour.frame:
        raise InputError(
            f"{where}: boxes in frame {brief(frame, 60)!r}; they are taken in the colour camera's alone, "
            f"{choice.colour.frame!r}"
        )
    centre, size = found.bbox.center, found.bbox.size
    p, q = centre.position, centre.orientation
    numbers = np.array([p.x, p.y, p.z, size.x, size.y, size.z, q.x, q.y, q.z, q.w])
    if not np.isfinite(numbers).all() or not 0.99 < float(np.linalg.norm(numbers[6:])) < 1.01:
        raise InputError(f"{where} holds a box that is not finite, or whose orientation is none")
    corners = Rotation.from_quat(numbers[6:]).apply(CORNERS * numbers[3:6]) + numbers[:3]
    return _bounds(corners, choice.colour_lens.camera)


def _bounds(points: Boxes, camera: Camera) -> Boxes | None:
    if (points[:, 2] <= 0).any():
        return None
    u, v = (points[:, 0] / points[:, 2] * camera.fx + camera.cx, points[:, 1] / points[:, 2] * camera.fy + camera.cy)
    return np.array([u.min(), v.min(), u.max(), v.max()])
