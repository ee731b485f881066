"""Small frames for tables of data association, existence and merging: a flat surface, and boxes in its image.

On a surface that faces the camera at ``FAR_M`` = 2 m a pixel is 1/60 m wide, so that what a box is worth is known in
closed form. ``looks`` renders boxes in space instead, for what hides what.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from cartier.mapping.object_map import ObjectMap
from cartier.types import Camera, Detections, DetectorScoreModel, Frame, TrueObject
from synthetic import look, render

CAMERA = Camera(160, 120, 120.0, 120.0, 79.5, 59.5)
FAR_M = 2.0
SURE, WEAK = 0.9, 0.35  # a detection that counts in full, and one that starts an object but shows nothing for sure
Box = tuple[float, float, float, float]
Row = tuple[str, float, Box]

AHEAD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1.0], [0, 0, 0, 1]])
"""A camera one metre up that looks along y: its x is the world's x, its y points down."""


def square(shift_x: float = 0, shift_y: float = 0, width: float = 40, height: float = 40) -> Box:
    """A box (xyxy, pixels) about the middle of the image."""
    x, y = CAMERA.cx + shift_x, CAMERA.cy + shift_y
    return (x - width / 2, y - height / 2, x + width / 2, y + height / 2)


def flat(
    index: int = 0, x_m: float = 0.0, depth_m: np.ndarray | float = FAR_M, grey: int = 128, y_m: float = 0.0
) -> Frame:
    """A frame of a camera at x_m, y_m that looks at a surface; ``depth_m`` is one number or a whole image."""
    depth = np.broadcast_to(np.float32(depth_m), (CAMERA.height, CAMERA.width)).astype(np.float32)
    pose = AHEAD.copy()
    pose[:2, 3] = x_m, y_m
    rgb = np.full((CAMERA.height, CAMERA.width, 3), grey, np.uint8)
    return Frame(index, float(index), rgb, depth, pose, CAMERA)


def looks(
    eye: Sequence[float], target: Sequence[float], objs: Sequence[TrueObject], index: int = 0, camera: Camera = CAMERA
) -> Frame:
    """A rendered frame with its true instances."""
    pose = look(eye, target)
    depth, ids = render(pose, camera, objs)
    return Frame(index, float(index), np.full((camera.height, camera.width, 3), 90, np.uint8), depth, pose, camera, ids)


def found(frame: Frame, *rows: Row, masks: np.ndarray | None = None) -> Detections:
    """Detections of a frame: (label, score, box)."""
    boxes = np.array([box for _, _, box in rows], np.float32)
    return Detections(frame.index, boxes, np.array([s for _, s, _ in rows]), tuple(name for name, _, _ in rows), masks)


def all_of(frame: Frame, *rows: Row) -> Detections:
    """The same with masks that leave the whole image open: what a segmenter gives is never taken for a duplicate."""
    return found(frame, *rows, masks=np.ones((len(rows), CAMERA.height, CAMERA.width), bool))


def true_box(frame: Frame, number: int) -> Box:
    """The image box of one instance."""
    assert frame.instances is not None
    rows, cols = np.nonzero(frame.instances == number)
    return (float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))


def fresh(**changed: float | tuple[float, float]) -> ObjectMap:
    return ObjectMap(DetectorScoreModel(**changed))  # type: ignore[arg-type]


def about(made: ObjectMap) -> dict[str, list[list[int]]]:
    """What a saved map says of aliases and of objects seen side by side."""
    values = json.loads(made.state()["object_map.json"])
    return {name: values[name] for name in ("aliases", "covisible")}
