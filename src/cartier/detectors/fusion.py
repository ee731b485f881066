"""Box fusion: the detections of several networks on one frame made into one list.

Weighted boxes fusion (Solovyev et al. 2021): boxes of a label that overlap are one, their mean weighted by score. Its
score is the mean over all networks, one that saw nothing counts as 0. What several see is kept, what one alone sees
sinks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartier.detectors.boxes import iou, nms
from cartier.types import Array, Detections

SAME_IOU = 0.55  # from which boxes of two networks are one
DUPLICATE_IOU = 0.65  # of fused boxes of a label, from which the weaker goes
MOST = 120  # boxes of a network, the surest


def fuse(found: Sequence[Detections]) -> Detections:
    """One list of what networks ``found`` on a frame, best score first."""
    parts = [part.keep(np.argsort(-part.scores, kind="stable")[:MOST]) for part in found]
    boxes = np.concatenate([part.boxes_xyxy for part in parts]).astype(np.float64)
    scores = np.concatenate([part.scores for part in parts]).astype(np.float64)
    labels = np.array([label for part in parts for label in part.labels], object)
    source = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    names = sorted(set(labels.tolist()))
    fused_boxes, fused_scores, kinds = [np.zeros((0, 4))], [np.zeros(0)], [np.zeros(0, np.intp)]
    for kind, name in enumerate(names):
        of = np.flatnonzero(labels == name)
        one_boxes, one_scores = _clusters(boxes[of], scores[of], source[of])
        fused_boxes.append(one_boxes)
        fused_scores.append(one_scores / len(parts))
        kinds.append(np.full(len(one_scores), kind))
    merged, worth, kind_of = np.concatenate(fused_boxes), np.concatenate(fused_scores), np.concatenate(kinds)
    order = nms(merged, worth, kind_of, DUPLICATE_IOU)
    boxes_xyxy, sure = merged[order].astype(np.float32), worth[order].astype(np.float32)
    return Detections(parts[0].frame, boxes_xyxy, sure, tuple(names[kind_of[k]] for k in order))


def _clusters(boxes: Array, scores: Array, source: Array) -> tuple[Array, Array]:
    """Boxes (k, 4) of one label, each of at most one box of each network, and the sums (k,) of their scores.

    The surest first, each box joins the cluster that it overlaps most, unless its network is in there already.
    """
    means, sums, members = np.zeros((len(boxes), 4)), np.zeros(len(boxes)), list[set[int]]()
    for k in np.argsort(-scores, kind="stable").tolist():
        overlap = iou(boxes[k], means[: len(members)])
        free = [c for c in np.argsort(-overlap).tolist() if overlap[c] > SAME_IOU and source[k] not in members[c]]
        at = free[0] if free else len(members)
        if not free:
            members.append(set())
        members[at].add(int(source[k]))
        share = scores[k] / (sums[at] + scores[k])
        means[at] += share * (boxes[k] - means[at])
        sums[at] += scores[k]
    return means[: len(members)], sums[: len(members)]
