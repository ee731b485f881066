"""The output layouts of ONNX detectors: which shapes each one has, and how its numbers become boxes.

A decoder turns the outputs, in the order of ``Layout.outputs``, into candidates: xyxy boxes in input pixels (N, 4),
scores (N,) and class numbers (N,). It neither filters nor clips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expit, softmax

from cartier.detectors.sidecar import Sidecar
from cartier.types import Array, Floats

Size = tuple[int, int]
"""Width and height of the network's input in pixels."""
Shape = tuple[int | None, ...]
"""None stands for any number."""
ANY_NAME: tuple[str, ...] = ()
STRIDES = (8, 16, 32)
NANODET_STRIDES: tuple[int, ...] = (8, 16, 32, 64)
DISTANCES = 8
"""NanoDet and PicoDet give the distance to each side as a distribution over 0 to 7 strides (their reg_max is 7)."""
FASTESTDET_STRIDE = 16
EXTRA_COLUMNS = ("segment", "pose")  # tasks with columns of masks or key points after the classes
MOST_COLUMNS = 1024
MAX_LOG_SIDE = 12.0  # YOLOX sides beyond e^12 strides would overflow float32, and are clipped to the image anyhow


class Candidates(NamedTuple):
    boxes: Floats
    scores: Floats
    classes: Array


@dataclass(frozen=True)
class Layout:
    outputs: tuple[tuple[str, ...], ...]
    """Names of each output; ANY_NAME is a model's only output. Empty: all that the model has, in its order."""
    shapes: Callable[[Sidecar, Size, int], list[Shape]]
    """Shapes of the outputs, given their number."""
    decode: Callable[[Sequence[Array], Sidecar, Size], Candidates]
    nms: bool
    """Whether it gives many boxes per object, to be suppressed."""
    numbers: tuple[int, ...] = ()
    """How many outputs there may be, where ``outputs`` does not say it."""


def cells(size: Size, strides: Sequence[int] = STRIDES) -> int:
    """How many grid cells an input has at these strides together."""
    return sum(math.ceil(size[0] / stride) * math.ceil(size[1] / stride) for stride in strides)


def _grid(size: Size, strides: Sequence[int] = STRIDES) -> tuple[Array, Array, Array]:
    """Column, row and stride (N,) of each of these cells."""
    grids = [np.mgrid[: math.ceil(size[1] / s), : math.ceil(size[0] / s)].reshape(2, -1) for s in strides]
    y, x = np.concatenate(grids, axis=1)
    return x, y, np.repeat(strides, [grid.shape[1] for grid in grids]).astype(np.float32)


def _corners(cx: Array, cy: Array, w: Array, h: Array) -> Floats:
    return np.stack([cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2], axis=-1)


def _best(class_scores: Array, axis: int) -> tuple[Floats, Array]:
    return class_scores.max(axis=axis), class_scores.argmax(axis=axis)


def _fastestdet(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    grid = outputs[0][0]
    rows, columns = grid.shape[1:]
    y, x = np.mgrid[:rows, :columns]
    objectness, dx, dy, w, h = grid[:5]
    scores, classes = _best(grid[5:], 0)
    boxes = _corners((x + np.tanh(dx)) / columns, (y + np.tanh(dy)) / rows, expit(w), expit(h)) * (size + size)
    return Candidates(boxes.reshape(-1, 4), (objectness * scores).ravel(), classes.ravel())


def _yolov8(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    table = outputs[0][0]
    return Candidates(_corners(*table[:4]), *_best(table[4 : 4 + len(sidecar.labels)], 0))


def _end_to_end(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    table = outputs[0][0]
    return Candidates(table[:, :4], table[:, 4], table[:, 5])


def _yolox(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    table = outputs[0][0]
    x, y, stride = _grid(size)
    w, h = np.exp(np.minimum(table[:, 2:4], MAX_LOG_SIDE)).T * stride
    scores, classes = _best(table[:, 5:], 1)
    boxes = _corners((table[:, 0] + x) * stride, (table[:, 1] + y) * stride, w, h)
    return Candidates(boxes, table[:, 4] * scores, classes)


def _nanodet(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    """Generalized Focal Loss (Li et al. 2020): each side of a box is the mean of a distribution of distances.

    NanoDet-Plus gives scores and distributions in one table, from the corners of its cells; NanoDet and PicoDet give
    those of each stride, all scores first, seen from the middles.
    """
    if len(outputs) == 1:
        strides, middle = NANODET_STRIDES, 0.0
        scores, sides = np.split(outputs[0][0], [len(sidecar.labels)], axis=1)
    else:
        strides, middle = NANODET_STRIDES[: len(outputs) // 2], 0.5
        scores, sides = (
            np.concatenate([o[0] for o in half]) for half in (outputs[: len(strides)], outputs[len(strides) :])
        )
    x, y, stride = _grid(size, strides)
    distances = softmax(sides.reshape(len(sides), 4, DISTANCES), axis=2) @ np.arange(DISTANCES, dtype=np.float32)
    left, top, right, bottom = distances.T
    boxes = np.stack([x + middle - left, y + middle - top, x + middle + right, y + middle + bottom], axis=1)
    return Candidates(boxes * stride[:, None], *_best(scores, 1))


def _nanodet_shapes(sidecar: Sidecar, size: Size, count: int) -> list[Shape]:
    names, sides = len(sidecar.labels), 4 * DISTANCES
    if count == 1:
        return [(1, cells(size, NANODET_STRIDES), names + sides)]
    rows = [cells(size, [stride]) for stride in NANODET_STRIDES[: count // 2]]
    return [(1, n, width) for width in (names, sides) for n in rows]


def _detr(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    logits, boxes = outputs[0][0], outputs[1][0]
    scores = softmax(logits, axis=1)[:, :-1] if sidecar.activation == "softmax" else expit(logits)
    return Candidates(_corners(*boxes.T) * (size + size), *_best(scores, 1))


def _exported(outputs: Sequence[Array], sidecar: Sidecar, size: Size) -> Candidates:
    labels, boxes, scores = (output[0] for output in outputs)
    return Candidates(boxes * (size + size) if sidecar.box_units == "normalised" else boxes, scores, labels)


def _detr_shapes(sidecar: Sidecar, size: Size, count: int) -> list[Shape]:
    return [(1, None, len(sidecar.labels) + (sidecar.activation == "softmax")), (1, None, 4)]


LAYOUTS = {
    "fastestdet": Layout(
        (ANY_NAME,),
        lambda sidecar, size, count: [
            (1, 5 + len(sidecar.labels), size[1] // FASTESTDET_STRIDE, size[0] // FASTESTDET_STRIDE)
        ],
        _fastestdet,
        nms=True,
    ),
    "yolov8": Layout(
        (ANY_NAME,),
        lambda sidecar, size, count: [(1, 4 + len(sidecar.labels) + sidecar.more_columns, None)],
        _yolov8,
        nms=True,
    ),
    "end_to_end": Layout(
        (ANY_NAME,), lambda sidecar, size, count: [(1, None, 6 + sidecar.more_columns)], _end_to_end, nms=False
    ),
    "yolox": Layout(
        (ANY_NAME,), lambda sidecar, size, count: [(1, cells(size), 5 + len(sidecar.labels))], _yolox, nms=True
    ),
    "nanodet": Layout((), _nanodet_shapes, _nanodet, nms=True, numbers=(1, 6, 8)),
    "detr": Layout((("logits", "pred_logits"), ("boxes", "pred_boxes")), _detr_shapes, _detr, nms=False),
    "exported": Layout(
        (("labels",), ("boxes",), ("scores",)),
        lambda sidecar, size, count: [(1, None), (1, None, 4), (1, None)],
        _exported,
        nms=False,
    ),
}


def recognised(shapes: Sequence[tuple[int, ...]], size: Size, classes: int = 80) -> str | None:
    """The layout that the output shapes prove for a model of so many classes, COCO's by default, or None.

    Only what no other detector looks like: 1xNx85 is not among them: YOLOX gives raw and YOLOv6 decoded boxes in it.
    """
    proofs: dict[tuple[int, ...], str] = {
        (1, 5 + classes, size[1] // FASTESTDET_STRIDE, size[0] // FASTESTDET_STRIDE): "fastestdet",
        (1, 4 + classes, cells(size)): "yolov8",
        (1, cells(size, NANODET_STRIDES), classes + 4 * DISTANCES): "nanodet",
    }
    return proofs.get(shapes[0]) if len(shapes) == 1 else None


def recognised_task(shapes: Sequence[tuple[int, ...]], size: Size, task: str, classes: int) -> tuple[str, int] | None:
    """The layout of the first output of a model of an Ultralytics task, and how many columns it has more, or None.

    Masks and key points stand in columns after the classes, and in further outputs.
    """
    fewest, most = (0, 0) if task not in EXTRA_COLUMNS else (1, MOST_COLUMNS)
    shape = shapes[0]
    if len(shape) != 3 or shape[0] != 1 or (len(shapes) > 1 and not most):
        return None
    more, more_end = shape[1] - 4 - classes, shape[2] - 6
    if fewest <= more <= most and (shape[2] == cells(size) or shape[2] > shape[1]):
        return "yolov8", more
    return ("end_to_end", more_end) if fewest <= more_end <= most else None
