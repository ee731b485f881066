"""Photograph detector that ships, and the older layout whose boxes are decoded outside of the graph."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tiny_onnx import constant_net, describe
from tiny_onnx import frame as red_frame

from cartier import plugins
from cartier.detectors.boxes import iou
from cartier.errors import BackendError, InputError
from cartier.models import photos
from cartier.types import Camera, Frame

PICTURES = Path(__file__).parents[1] / "data" / "pictures"


@pytest.fixture(scope="module")
def detector() -> Any:
    """As it ships."""
    return plugins.make("detectors", "photos", threads=1)


def seen(rgb: np.ndarray, index: int = 0) -> Frame:
    return Frame(index, 0.0, rgb, None, np.eye(4), Camera(rgb.shape[1], rgb.shape[0], 585, 585, 320, 240))


def test_the_card_is_of_the_threshold_that_ships(detector: Any) -> None:
    card = (Path(__file__).parents[2] / "docs" / "photos.md").read_text("utf-8")
    threshold = detector.score_model.threshold
    assert f"at a\nscore of {threshold:g}, from which" in card and f"one in two at {threshold:g} (`threshold`)" in card


@pytest.mark.parametrize(
    ("picture", "label", "box"),
    [
        ("living_room-072", "tv", (337, 262, 400, 347)),
        ("living_room-084", "couch", (163, 335, 640, 480)),
        ("living_room-108", "chair", (466, 322, 640, 480)),
        ("studio-057", "toilet", (196, 370, 349, 480)),
        ("studio-096", "bed", (16, 303, 299, 480)),
        ("studio-096", "laptop", (386, 354, 516, 474)),
    ],
)
def test_objects_are_found_where_they_are(picture: str, label: str, box: tuple[int, ...], detector: Any) -> None:
    """In rendered pictures, whose true boxes are known; ``benchmarks/photographs.py`` has figures on photographs."""
    found = detector.detect(seen(np.asarray(Image.open(PICTURES / f"{picture}.jpg").convert("RGB"))))
    found = found.keep(found.scores >= detector.score_model.threshold)
    assert label in found.labels
    assert iou(found.boxes_xyxy[found.labels.index(label)], np.array([box]))[0] > 0.75


def test_it_keeps_the_laws_on_noise_of_any_size(detector: Any) -> None:
    low = plugins.make("detectors", "photos", threshold=0.01, threads=1)
    assert "counts from 0.41" in detector.name and detector.sha256 and not detector.notes
    for height, width in ((1, 1), (97, 33), (640, 360)):
        view = seen(np.random.default_rng(height).integers(0, 255, (height, width, 3), np.uint8))
        few, many = detector.detect(view), low.detect(view)
        assert len(few) <= len(many)
        for found in (few, many):
            assert ((found.boxes_xyxy >= 0) & (found.boxes_xyxy <= [width, height] * 2)).all()
            assert (np.diff(found.scores) <= 0).all()


def test_what_no_household_holds_has_no_name(detector: Any) -> None:
    names = set(detector.knows)
    assert len(names) == 51 and {"cup", "couch", "bed"} <= names and not {"truck", "zebra"} & names


def test_a_changed_network_and_wrong_options_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied = Path(shutil.copytree(photos.FOLDER, tmp_path / "photos"))
    monkeypatch.setattr(photos, "FOLDER", copied)
    changed = copied / "deimv2-femto.onnx"
    changed.write_bytes(changed.read_bytes() + b"!")
    with pytest.raises(InputError, match=r"femto\.onnx was changed.*install cartier again"):
        plugins.make("detectors", "photos")
    changed.unlink()
    with pytest.raises(InputError, match=r"femto\.onnx is missing: install cartier again"):
        plugins.make("detectors", "photos")
    shutil.copy(Path(photos.__file__).parent / changed.name, changed)
    (copied / "deimv2-femto-416.json").unlink()
    with pytest.raises(InputError, match=r"femto-416\.json is missing: install cartier again"):
        plugins.make("detectors", "photos")
    for wrong in ({"threshold": 2.0}, {"threads": 0}, {"provider": "abacus"}):
        monkeypatch.undo()
        with pytest.raises(BackendError):
            plugins.make("detectors", "photos", **wrong)


def test_a_nanodet_without_a_sidecar_is_recognised(tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {"o": np.zeros((1, 3598, 112), np.float32)}, size=(1, 3, 416, 416))
    assert "nanodet with the 80 COCO labels" in plugins.make("detectors", "onnx", model=model).notes[0]


@pytest.mark.parametrize("strides", [(8, 16, 32), (8, 16, 32, 64)])
def test_nanodet_and_picodet_give_an_output_a_stride(strides: tuple[int, ...], tmp_path: Path) -> None:
    """One cell of each stride tells a box: its middle, and 1, 0.5, 2 and 3.5 strides to the sides (as sums over 0 to
    7)."""
    side, scores, distances = 128, {}, {}
    for number, stride in enumerate(strides):
        cells = (side // stride) ** 2
        score, sides = np.zeros((1, cells, 2), np.float32), np.full((1, cells, 4, 8), -50, np.float32)
        score[0, -1, number % 2] = 0.9 - 0.1 * number
        for direction, bins in enumerate(((1,), (0, 1), (2,), (0, 7))):
            sides[0, :, direction, bins] = 3.0  # two equal bins: their mean
        scores[f"scores_{stride}"], distances[f"boxes_{stride}"] = score, sides.reshape(1, cells, 32)
    model = constant_net(tmp_path / "m.onnx", scores | distances, size=(1, 3, side, side))
    describe(model, layout="nanodet", labels=["cup", "chair"])
    found = plugins.make("detectors", "onnx", model=model).detect(red_frame(0, side, side))
    middles = [(side // s - 0.5) * s for s in strides]
    expected = [(m - s, m - 0.5 * s, m + 2 * s, m + 3.5 * s) for m, s in zip(middles, strides, strict=True)]
    assert found.labels == ("cup", "chair", "cup", "chair")[: len(strides)]
    assert found.boxes_xyxy == pytest.approx(np.clip(expected, 0, side), abs=1e-3)


def test_outputs_that_are_no_nanodets_are_refused(tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {"a": np.zeros((1, 22, 34)), "b": np.zeros((1, 22, 34))})
    describe(model, layout="nanodet", labels=["cup", "chair"])
    with pytest.raises(
        InputError, match="its one output, or the scores of three or four strides and then their distances"
    ):
        plugins.make("detectors", "onnx", model=model)
    model = constant_net(tmp_path / "m.onnx", {"a": np.zeros((1, 21, 34))})
    with pytest.raises(InputError, match="needs the output a to be 1x22x34, but it is 1x21x34"):
        plugins.make("detectors", "onnx", model=model)
