"""Boxes in images: clip them to a frame, and suppress the duplicates that a dense detector makes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.types import Array, Floats

MIN_SIDE_PX = 1.0


def clip(boxes_xyxy: Array, width: int, height: int) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Boxes (N, 4) cut to the image, and which (N,) still have a side of at least one pixel both ways."""
    clipped: Floats = np.clip(boxes_xyxy, 0, (width, height, width, height))
    whole: npt.NDArray[np.bool_] = np.all(clipped[:, 2:] - clipped[:, :2] >= MIN_SIDE_PX, axis=1)
    return clipped, whole


def iou(box: Array, boxes: Array) -> Floats:
    """Intersection over union (N,) of one xyxy box (4,) with boxes (N, 4); 0 where both are empty."""
    sides = np.minimum(box[2:], boxes[:, 2:]) - np.maximum(box[:2], boxes[:, :2])
    shared = np.maximum(sides, 0).prod(axis=1)
    union = (box[2:] - box[:2]).prod() + (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) - shared
    return np.asarray(shared / np.where(union > 0, union, 1))


def nms(boxes: Array, scores: Array, classes: Array, max_iou: float) -> npt.NDArray[np.intp]:
    """Indices that survive greedy non-maximum suppression within each class, best score first, ties in input order.

    A box goes if an earlier survivor of its class overlaps it by more than ``max_iou``.
    """
    order = np.argsort(-scores, kind="stable")
    kept = np.ones(len(order), bool)
    for kind in np.unique(classes[order]).tolist():
        at = np.flatnonzero(classes[order] == kind)
        of = boxes[order[at]]
        for k in range(len(at) - 1):  # per class: most boxes have few rivals
            if kept[at[k]]:
                later = at[k + 1 :][kept[at[k + 1 :]]]
                kept[later[iou(of[k], boxes[order[later]]) > max_iou]] = False
    return np.asarray(order[kept], np.intp)
