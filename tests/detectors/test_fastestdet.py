"""FastestDet: what each cell of its output means, and how a model without a sidecar is known by its shapes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tiny_onnx import constant_net, describe, frame

from cartier import plugins
from cartier.detectors.sidecar import coco80

SIDE, CELLS = 352, 22
WIDTH, HEIGHT = 640, 480
OBJECTS = {"chair": (0.8, (215, 112, 345, 448)), "tv": (0.7, (523, 4, 639, 117)), "cup": (0.6, (300, 200, 324, 230))}
"""Name → score and box (px of the picture) of what the output tells."""


def output() -> np.ndarray:
    """1×85×22×22: objectness, the middle from the cell as tanh, width and height as sigmoids, and 80 class scores."""
    told = np.zeros((1, 85, CELLS, CELLS), np.float32)
    told[0, 3:5] = -20  # of an empty cell: no width, no height
    for name, (score, (x1, y1, x2, y2)) in OBJECTS.items():
        x, y = (x1 + x2) / 2 / WIDTH * CELLS, (y1 + y2) / 2 / HEIGHT * CELLS
        row, col = math.floor(y), math.floor(x)
        sides = [(x2 - x1) / WIDTH, (y2 - y1) / HEIGHT]
        logits = [math.log(side / (1 - side)) for side in sides]
        told[0, :5, row, col] = [0.9, math.atanh(x - col), math.atanh(y - row), *logits]
        told[0, 5 + coco80().index(name), row, col] = score / 0.9
    return told


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return constant_net(tmp_path / "FastestDet.onnx", {"out": output()}, size=(1, 3, SIDE, SIDE))


def test_each_cell_tells_a_box(model: Path) -> None:
    found = plugins.make("detectors", "onnx", model=model, threshold=0.3).detect(frame(0, WIDTH, HEIGHT))
    assert set(found.labels) == OBJECTS.keys() and len(found) == 3
    for label, score, box in zip(found.labels, found.scores, found.boxes_xyxy, strict=True):
        assert score == pytest.approx(OBJECTS[label][0], abs=1e-3)
        assert box == pytest.approx(OBJECTS[label][1], abs=0.1)


def test_sidecar_with_the_assumed_layout_changes_nothing(model: Path, tmp_path: Path) -> None:
    assumed = plugins.make("detectors", "onnx", model=model)
    assert assumed.name == "onnx FastestDet.onnx (counts from 0.5)"
    assert assumed.score_model.threshold == 0.5
    assert "no sidecar" in assumed.notes[0]
    without = assumed.detect(frame(0, WIDTH, HEIGHT))
    describe(model, layout="fastestdet", labels="coco", input_size=[SIDE, SIDE])
    told = plugins.make("detectors", "onnx", model=model)
    assert not told.notes
    found = told.detect(frame(0, WIDTH, HEIGHT))
    assert found.labels == without.labels and len(found) == 3
    assert np.array_equal(found.boxes_xyxy, without.boxes_xyxy)
