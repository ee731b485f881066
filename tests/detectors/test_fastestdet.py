"""A real detector on a real kitchen: both lie beside the repository, or the tests are skipped."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cartier import plugins
from cartier.types import Camera, Detections, Frame


def look(shared: Path, number: int, model: Path, **options: object) -> Detections:
    photo = shared / f"recordings/kitchen_7scenes/frame-{number:06}.color.jpg"
    for path in (photo, model):
        if not path.is_file():
            pytest.skip(f"needs {path.name}")
    rgb = np.asarray(Image.open(photo).convert("RGB"))
    view = Frame(number, 0.0, rgb, None, np.eye(4), Camera(rgb.shape[1], rgb.shape[0], 585, 585, 320, 240))
    return plugins.make("detectors", "onnx", model=model, **options).detect(view)


def test_a_chair_a_cup_and_a_screen_are_where_they_are(shared: Path) -> None:
    model = shared / "models/FastestDet.onnx"
    for number, label, box in (
        (40, "chair", (222, 112, 345, 252)),
        (220, "tv", (523, 4, 640, 117)),
        (640, "cup", None),
    ):
        found = look(shared, number, model)
        assert label in found.labels
        if box:
            assert found.boxes_xyxy[found.labels.index(label)] == pytest.approx(box, abs=12)


def test_what_is_assumed_is_said_and_a_sidecar_that_says_it_changes_nothing(shared: Path, tmp_path: Path) -> None:
    model = shared / "models/FastestDet.onnx"
    assumed = look(shared, 40, model, threshold=0.3)
    copy = shutil.copy(model, tmp_path / "FastestDet.onnx")
    (tmp_path / "FastestDet.json").write_text('{"layout": "fastestdet", "labels": "coco", "input_size": [352, 352]}')
    told = look(shared, 40, Path(copy), threshold=0.3)
    assert told.labels == assumed.labels
    assert np.array_equal(told.boxes_xyxy, assumed.boxes_xyxy)
    detector = plugins.make("detectors", "onnx", model=model)
    assert detector.name == "onnx FastestDet.onnx (counts from 0.5)"
    assert detector.score_model.threshold == 0.5
    assert "no sidecar" in detector.notes[0]
