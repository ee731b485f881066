"""Clipping and non-maximum suppression, against their definitions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cartier.detectors.boxes import clip, iou, nms

# whole numbers, so that many boxes coincide, touch, are empty, or overlap by exactly the limit
corner = st.integers(0, 12)
box = st.tuples(corner, corner, corner, corner).map(
    lambda b: (min(b[0], b[2]), min(b[1], b[3]), max(b[0], b[2]), max(b[1], b[3]))
)
candidate = st.tuples(box, st.integers(0, 10), st.integers(0, 2))
limit = st.sampled_from([0.0, 0.25, 1 / 3, 0.5, 0.9, 1.0])


def columns(candidates: list[tuple[tuple[int, ...], int, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    boxes = np.array([c[0] for c in candidates], np.float64).reshape(-1, 4)
    return boxes, np.array([c[1] / 10 for c in candidates]), np.array([c[2] for c in candidates], int)


def naive_iou(a: np.ndarray, b: np.ndarray) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    shared = width * height if width > 0 and height > 0 else 0.0
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - shared
    return shared / union if union > 0 else 0.0


@given(st.lists(candidate, max_size=40), limit)
def test_nms_is_the_naive_loop(candidates: list, max_iou: float) -> None:
    boxes, scores, classes = columns(candidates)
    kept: list[int] = []
    for i in sorted(range(len(candidates)), key=lambda i: -scores[i]):
        if all(classes[i] != classes[k] or naive_iou(boxes[k], boxes[i]) <= max_iou for k in kept):
            kept.append(i)
    assert nms(boxes, scores, classes, max_iou).tolist() == kept


@given(st.lists(candidate, max_size=30), limit)
def test_nms_again_changes_nothing(candidates: list, max_iou: float) -> None:
    boxes, scores, classes = columns(candidates)
    kept = nms(boxes, scores, classes, max_iou)
    assert nms(boxes[kept], scores[kept], classes[kept], max_iou).tolist() == list(range(len(kept)))


@given(box, st.lists(box, min_size=1, max_size=20))
def test_iou_is_between_0_and_1_and_symmetric(one: tuple[int, ...], others: list) -> None:
    a, b = np.array(one, float), np.array(others, float)
    ratios = iou(a, b)
    assert ((ratios >= 0) & (ratios <= 1)).all()
    assert ratios.tolist() == [iou(other, a[None])[0] for other in b] == [naive_iou(a, other) for other in b]


@given(hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(4)), elements=st.floats(-1e6, 1e6, width=32)))
def test_clipped_boxes_lie_in_the_image_and_the_rest_is_marked(boxes: np.ndarray) -> None:
    clipped, whole = clip(boxes, 64, 48)
    assert ((clipped >= 0) & (clipped <= [64, 48, 64, 48])).all()
    sides = clipped[:, 2:] - clipped[:, :2]
    assert (sides[whole] >= 1).all()
    assert (sides[~whole].min(axis=1, initial=1) < 1).all() if (~whole).any() else whole.all()
    inside = ((boxes >= 0) & (boxes <= [64, 48, 64, 48])).all(axis=1)
    assert np.array_equal(clipped[inside], boxes[inside])
