"""Data association: which detections of a frame are duplicates, and which object each of the others is of.

Pairs are scored by overlap in the image and in space, by distance relative to size, and by label, which is evidence
and never a gate; the assignment is one to one, of least total cost. All functions are pure but for
``add_label_vote``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.mapping.config import AssociationConfig
from cartier.mapping.observation import LiftedDetections
from cartier.types import Array

Indices = npt.NDArray[np.intp]

NESTED_IN_SPACE, NESTED_IN_IMAGE = 0.4, 0.5  # shares of the smaller box from which two of one label are nested
CONTAINED_WEIGHT = 0.5  # of a box that lies within an object of its label: a sliver of a sofa is that sofa
NESTED_WEIGHT = 0.6  # of overlap relative to the smaller box, where the labels agree
MIN_TOUCHING_SHARE = 0.1  # of one object within another, from which the two touch
PAD_M = 0.02  # boxes in space are grown by this, so that flat ones overlap


def suppress_duplicates(
    boxes_xyxy: Array, lifted: LiftedDetections, label_ids: Indices, config: AssociationConfig, exact: bool = False
) -> Indices:
    """The representative (N,) of each detection: a more confident one of the same object, or itself; -1 if not valid.

    Detections come most confident first. Two labels for one box are one object, and so are a sofa and half of it.
    ``exact`` detections, which have masks, are all of different objects.
    """
    n = len(boxes_xyxy)
    if exact:
        return np.where(lifted.valid, np.arange(n), -1)
    iou, nested_in_image, _ = box_overlaps(boxes_xyxy[:, :2], boxes_xyxy[:, 2:], boxes_xyxy[:, :2], boxes_xyxy[:, 2:])
    own = lifted.extent_min, lifted.extent_max
    nested = (box_overlaps(*own, *own, PAD_M)[1] > NESTED_IN_SPACE) & (nested_in_image > NESTED_IN_IMAGE)
    same = (iou > config.duplicate_iou) | ((label_ids[:, None] == label_ids) & nested)
    representative = np.full(n, -1)
    for k in range(n):
        if lifted.valid[k] and representative[k] < 0:
            representative[same[k] & lifted.valid & (representative < 0)] = k
    return representative


def label_agreement(
    label_ids: Indices, representative: Indices, detections: Indices, votes: Indices, weights: Array
) -> Array:
    """Agreement of labels (n, m), 0 to 1, of n ``detections`` and m objects with ``votes`` and ``weights`` (m, L).

    The labels of a detection are its own and those of its duplicates; the best one counts.
    """
    agreement = np.zeros((len(representative), len(votes)))
    agreement[detections] = np.einsum("ms,nms->nm", weights, votes == label_ids[detections, None, None])
    duplicates = np.flatnonzero((representative >= 0) & (representative != np.arange(len(representative))))
    of_duplicates = np.einsum("ms,nms->nm", weights, votes == label_ids[duplicates, None, None])
    np.maximum.at(agreement, representative[duplicates], of_duplicates)
    return np.asarray(np.minimum(1, 1.5 * agreement[detections] / (weights.sum(1) + 1e-9)))


def cost_matrix(
    boxes_xyxy: Array,
    box_min: Array,
    box_max: Array,
    expected_xyxy: Array,
    object_min: Array,
    object_max: Array,
    agreement: Array,
    label_weight: float,
) -> Array:
    """Cost (n, m) of matching n detections with m objects: 0 for nothing in common, -1 - ``label_weight`` at best.

    ``boxes_xyxy`` (n, 4) are the detections in the image and ``box_min``, ``box_max`` (n, 3) in space;
    ``expected_xyxy`` (m, 4) is where the objects should appear and ``object_min``, ``object_max`` (m, 3) their boxes.
    ``agreement`` (n, m) is that of labels.
    """
    iou, nested, contained = box_overlaps(box_min, box_max, object_min, object_max, PAD_M)
    size_m = np.linalg.norm(box_max - box_min, axis=1)[:, None] + np.linalg.norm(object_max - object_min, axis=1)
    apart_m = np.linalg.norm((box_min + box_max)[:, None] - (object_min + object_max), axis=2) / 2
    distance = apart_m / (0.1 + 0.5 * (size_m / 2))
    in_image = box_overlaps(boxes_xyxy[:, :2], boxes_xyxy[:, 2:], expected_xyxy[:, :2], expected_xyxy[:, 2:])[0]
    fit = (in_image + np.maximum(iou, NESTED_WEIGHT * nested * agreement) + np.exp(-2 * distance**2)) / 3
    return np.asarray(-(np.maximum(fit, CONTAINED_WEIGHT * contained * agreement) + label_weight * agreement))


def assign(cost: Array, max_cost: float) -> tuple[Indices, Indices, Indices]:
    """One-to-one assignment of least total cost: matches (k, 2), unmatched detections and unmatched objects.

    ``cost`` (n, m) is negative for what fits; no pair that costs more than ``max_cost`` is matched.
    """
    from scipy.optimize import linear_sum_assignment

    rows, cols = linear_sum_assignment(np.where(cost <= max_cost, cost, 0))
    good = cost[rows, cols] <= max_cost
    matches = np.stack([rows[good], cols[good]], axis=1)
    unmatched = tuple(np.ones(size, bool) for size in cost.shape)
    for free, matched in zip(unmatched, matches.T, strict=True):
        free[matched] = False
    return matches, np.flatnonzero(unmatched[0]), np.flatnonzero(unmatched[1])


def add_label_vote(votes: npt.NDArray[Any], weights: npt.NDArray[Any], label: int, weight: float) -> None:
    """Add a vote to one object's labels (L,) and their weights (L,), in place; a new label replaces the weakest."""
    at = int((votes == label).argmax() if label in votes else weights.argmin())
    votes[at], weights[at] = label, weight + (weights[at] if votes[at] == label else 0)


def touching_pairs(extent_min: Array, extent_max: Array, ids: npt.NDArray[np.int64]) -> list[tuple[int, int]]:
    """The pairs of ids, in the given order, of boxes (n, 3) that touch: if a frame shows both, they are two objects."""
    contained = box_overlaps(extent_min, extent_max, extent_min, extent_max, PAD_M)[2]
    pairs = np.argwhere(np.triu(np.maximum(contained, contained.T) > MIN_TOUCHING_SHARE, 1))
    return [(int(ids[i]), int(ids[j])) for i, j in pairs]


def box_overlaps(
    low: Array, high: Array, other_low: Array, other_high: Array, pad: float = 0.0
) -> tuple[Array, Array, Array]:
    """Overlaps (N, M) of axis-aligned boxes (N, D) and (M, D), each grown by ``pad``.

    The intersection over the union, over the smaller box, and the share of each of the N boxes that lies in each of
    the M or within a tenth of that one's size.
    """
    volume, other_volume, shared, contained = 1.0, 1.0, 1.0, 1.0
    slack = 0.1 * (other_high - other_low).max(1, initial=0)
    for a, b, c, d in zip(low.T, high.T, other_low.T, other_high.T, strict=True):
        side, own = np.minimum(b[:, None], d) - np.maximum(a[:, None], c) + 2 * pad, (b - a + 2 * pad)[:, None]
        volume, other_volume = volume * own, other_volume * (d - c + 2 * pad)
        shared = shared * np.maximum(side, 0)
        contained = contained * np.clip(side + slack, 0, own) / np.maximum(own, 1e-9)
    union = np.maximum(volume + other_volume - shared, 1e-9)
    return shared / union, shared / np.maximum(np.minimum(volume, other_volume), 1e-9), np.asarray(contained)
