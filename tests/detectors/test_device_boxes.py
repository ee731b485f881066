"""Boxes chosen in torch, for a batch: what numpy's greedy suppression chooses for each image by itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier.detectors.boxes import clip, nms
from cartier.detectors.device_boxes import (
    ANY_NAME_IOU,
    CANDIDATES,
    SAME_NAME_IOU,
    best_first,
    to_pixels,
    without_duplicates,
)

torch = pytest.importorskip("torch", reason="needs the extra [detect]: torch")


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 60), st.integers(1, 4), st.booleans())
def test_a_batch_keeps_what_numpy_keeps_of_each_image(
    seed: int, images: int, count: int, names: int, crowded: bool
) -> None:
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0.3, 0.4, (images, count, 2)) if crowded else rng.uniform(-0.1, 1.1, (images, count, 2))
    shares = np.concatenate([centres, rng.uniform(0, 0.3, (images, count, 2))], axis=-1).astype(np.float32)
    scores = rng.choice(np.linspace(0.05, 0.95, 12, dtype=np.float32), (images, count))  # with ties
    classes = rng.integers(0, names, (images, count))
    width, height, square = 64, 48, bool(rng.integers(2))
    boxes = to_pixels(torch.from_numpy(shares), width, height, square)
    best, stays = best_first(torch.from_numpy(scores), torch.from_numpy(scores >= 0.2), boxes)
    chosen = boxes.gather(1, best[..., None].expand(-1, -1, 4))
    stays = without_duplicates(chosen, torch.from_numpy(classes).gather(1, best), stays)
    for i in range(images):
        middles, halves = shares[i, :, :2], shares[i, :, 2:] / 2
        scale = np.array([max(width, height)] * 4 if square else [width, height] * 2, np.float32)
        clipped = clip(np.hstack([middles - halves, middles + halves]) * scale, width, height)[0]
        plain = boxes[i].numpy()
        assert np.allclose(plain, clipped, atol=1e-4)
        kept = np.flatnonzero((scores[i] >= 0.2) & ((plain[:, 2:] - plain[:, :2]) >= 1).all(axis=1))
        kept = kept[np.argsort(-scores[i][kept], kind="stable")]
        kept = kept[nms(plain[kept], scores[i][kept], classes[i][kept], SAME_NAME_IOU)]
        kept = kept[nms(plain[kept], scores[i][kept], np.zeros(len(kept)), ANY_NAME_IOU)]
        assert best[i][stays[i]].tolist() == kept.tolist()


def test_of_very_many_boxes_the_best_are_judged() -> None:
    scores = torch.linspace(0, 1, 3 * CANDIDATES)[None]
    boxes = torch.tensor([[0.0, 0.0, 9.0, 9.0]]).expand(1, 3 * CANDIDATES, 4)
    best, stays = best_first(scores, scores > 0.1, boxes)
    assert best.shape == (1, CANDIDATES) and bool(stays.all()) and int(best[0, 0]) == 3 * CANDIDATES - 1
    none, stays = best_first(scores, scores > 2, boxes)
    assert none.shape == (1, 1) and not bool(stays.any())
