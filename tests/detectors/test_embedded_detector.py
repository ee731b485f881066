"""Embedded detector: it works in a home that it never saw, obeys the contract, and refuses changed files."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_onnx import constant_net

from cartier import plugins
from cartier.errors import BackendError, CartierError, InputError
from cartier.labels import display_name
from cartier.types import Camera, Detections, Frame
from cartier_dollhouse import shapes
from cartier_dollhouse.detector import Embedded, make
from cartier_dollhouse.network import FOLDER, load
from strange_home import strange_walk

FILES = ("detector.onnx", "words.npy", "names.json")


@pytest.fixture(scope="module")
def eyes() -> Embedded:
    return make(threads=1)


@pytest.fixture(scope="module")
def walk() -> Any:
    return strange_walk()


def seen(rgb: np.ndarray, index: int = 0) -> Frame:
    height, width = rgb.shape[:2]
    return Frame(
        index, 0.0, rgb, None, np.eye(4), Camera(width, height, max(rgb.shape), max(rgb.shape), width / 2, height / 2)
    )


def keep_the_laws(found: Detections, frame: Frame, threshold: float) -> None:
    assert found.frame == frame.index
    assert ((found.boxes_xyxy >= 0) & (found.boxes_xyxy <= [frame.camera.width, frame.camera.height] * 2)).all()
    assert (found.boxes_xyxy[:, 2:] - found.boxes_xyxy[:, :2] >= 1).all()
    assert (found.scores >= np.float32(threshold)).all()
    assert (np.diff(found.scores) <= 0).all()


def test_the_shipped_files_are_small_and_go_together() -> None:
    told = load()
    assert told.path.stat().st_size <= 12e6
    assert told.sha256 == hashlib.sha256(told.path.read_bytes()).hexdigest()
    assert list(told.names) == [display_name(kind) for kind in shapes.types()]
    assert len(set(told.names)) == len(told.names)


@pytest.mark.parametrize(("threshold", "share", "least"), [(0.3, 0.5, 12), (0.6, 0.65, 6)])
def test_it_sees_things_of_a_home_that_no_training_saw(walk: Any, threshold: float, share: float, least: int) -> None:
    """Of what it names, some is there with that name, and more of what it is sure of; by chance it would be one in
    thirty."""
    eyes = make(threshold=threshold, threads=1)
    truth = plugins.make("detectors", "ground_truth", truth=walk.truth)
    right, named = 0, 0
    for i in range(0, len(walk), 2):
        found, true = eyes.detect(walk[i]), set(truth.detect(walk[i]).labels)
        found = found.keep(found.scores >= threshold)
        right += sum(label in true for label in found.labels)
        named += len(found)
    assert named >= least
    assert right >= share * named


def test_detections_obey_and_leave_the_frame_alone(eyes: Embedded, walk: Any) -> None:
    frame = walk[1]
    before = frame.rgb.copy()
    one, two = eyes.detect(frame), make(threads=1).detect(frame)
    keep_the_laws(one, frame, load().score_model.zero_weight_score)
    assert one.labels == two.labels
    assert np.array_equal(one.boxes_xyxy, two.boxes_xyxy)
    assert np.array_equal(frame.rgb, before)


def test_a_higher_threshold_leaves_some_of_the_same_detections(walk: Any) -> None:
    strict = make(threshold=0.9, threads=1)
    low, high = make(threads=1).detect(walk[4]), strict.detect(walk[4])
    kept = low.keep(low.scores >= np.float32(strict.score_model.zero_weight_score))
    assert 0 < len(high) < len(low)
    assert high.labels == kept.labels and np.array_equal(high.boxes_xyxy, kept.boxes_xyxy)


def test_boxes_come_back_at_the_size_of_the_frame(walk: Any) -> None:
    eyes, frame = make(threshold=0.2, threads=1), walk[2]
    small = eyes.detect(frame)
    large = eyes.detect(seen(frame.rgb.repeat(3, 0).repeat(3, 1), frame.index))
    assert small.labels[0] in large.labels
    twin = large.boxes_xyxy[large.labels.index(small.labels[0])] / 3
    assert np.abs(twin - small.boxes_xyxy[0]).max() < 12


@pytest.mark.parametrize("value", [0, 114, 250])
def test_a_blank_image_shows_nothing(value: int) -> None:
    noise = np.random.default_rng(value).integers(0, 4, (480, 640, 3), np.uint8)
    for rgb in (np.full((480, 640, 3), value, np.uint8), np.uint8(value) + noise):
        assert len(eager().detect(seen(rgb))) == 0


@settings(max_examples=6, deadline=None)
@given(st.integers(1, 700), st.integers(1, 700), st.integers(0, 2**32 - 1))
def test_any_size_and_any_content_is_looked_at(width: int, height: int, seed: int) -> None:
    rgb = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    frame = seen(rgb)
    keep_the_laws(eager().detect(frame), frame, 0.001)


@cache
def eager() -> Embedded:
    """A detector that reports next to everything."""
    return make(threshold=0.01, threads=1)


def test_huge_grey_and_turned_images(walk: Any) -> None:
    rgb = walk[2].rgb
    grey = rgb.mean(2, keepdims=True).astype(np.uint8).repeat(3, 2)
    for image in (np.kron(rgb, np.ones((12, 12, 1), np.uint8)), grey, np.ascontiguousarray(np.rot90(rgb))):
        frame = seen(image)
        keep_the_laws(eager().detect(frame), frame, 0.001)


def refused(error: type[CartierError], match: str, **options: Any) -> None:
    with pytest.raises(error, match=match) as caught:
        plugins.make("detectors", "embedded", **options)
    assert "\n" not in str(caught.value)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for name in FILES:
        shutil.copy(FOLDER / name, tmp_path / name)
    return tmp_path


@pytest.mark.parametrize("name", FILES[:2])
def test_a_file_of_which_one_bit_was_changed_is_refused(copy: Path, name: str) -> None:
    make(folder=copy, threads=1)  # eyes that were open before do not hide it
    raw = bytearray((copy / name).read_bytes())
    raw[len(raw) // 2] ^= 1
    (copy / name).write_bytes(raw)
    refused(InputError, re.escape(name) + r" was changed: its sha256 is \w{12}…, not \w{12}…", folder=copy)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(copy: Path, name: str) -> None:
    (copy / name).unlink()
    refused(InputError, re.escape(name) + " is missing: install cartier again", folder=copy)


REST = '"around": ["wall"], "sha256": {"detector.onnx": "", "words.npy": ""}, "trained": ""}'
DAMAGED = {
    "[]": "damaged",
    "{": "not valid JSON",
    '{"size": [480, 360]}': "damaged .*names",
    '{"size": 3, "names": []}': "damaged",
    '{"size": [480, 360], "names": ["mug"], "around": ["wall"], "sha256": "0"}': "damaged",
    '{"size": [0, 360], "names": ["mug"], "score_model": {}, ' + REST: "damaged",
    '{"size": [480, 360], "names": ["mug"], "score_model": {"low": NaN}, ' + REST: "damaged",
    '{"size": [480, 360], "names": ["mug"], "score_model": {"low": 0.7, "high": 0.3}, ' + REST: "damaged",
    '{"size": [480, 360], "names": ["mug"], "score_model": {"there": [1]}, ' + REST: "damaged",
    '{"size": [480, 360], "names": ["mug"], "score_model": {"colour": 1}, ' + REST: "damaged",
}


@pytest.mark.parametrize("text", DAMAGED)
def test_damaged_names_are_refused(copy: Path, text: str) -> None:
    (copy / "names.json").write_text(text)
    refused(InputError, DAMAGED[text], folder=copy)


def other_make(folder: Path, outputs: dict[str, np.ndarray], size: int = 32, words: np.ndarray | None = None) -> Path:
    """Eyes with a network that always says the same, all of their files as they should be."""
    model = constant_net(folder / "detector.onnx", outputs)
    np.save(folder / "words.npy", np.eye(3, 384, dtype=np.float32) if words is None else words)
    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in (model, folder / "words.npy")}
    told = {"size": [size, size], "names": ["mug"], "around": ["wall"], "score_model": {}, "trained": ""}
    (folder / "names.json").write_text(json.dumps(told | {"sha256": digests}))
    return folder


def test_a_network_of_another_make_is_refused_at_the_first_frame(tmp_path: Path) -> None:
    boxes, one = np.zeros((1, 4), np.float32), np.ones(1, np.float32)
    blank = seen(np.zeros((48, 64, 3), np.uint8))
    for outputs, match in (
        ({"boxes": boxes, "scores": one}, "must give boxes Nx4"),
        ({"boxes": boxes[:, :3], "scores": one, "classes": np.zeros(1, np.int64)}, "must give boxes Nx4"),
        ({"boxes": boxes * np.nan, "scores": one, "classes": np.zeros(1, np.int64)}, "NaN"),
        ({"boxes": boxes, "scores": one, "classes": np.array([9])}, "no name"),
    ):
        with pytest.raises(BackendError, match=match):
            make(folder=other_make(tmp_path, outputs), threads=1).detect(blank)
    for outputs, match in (
        ({"boxes": boxes}, "must give features 1x2x8x8, but gives 0"),
        ({"features": np.zeros((1, 3, 8, 8), np.float32)}, "must give features 1x2x8x8, but gives 1x3x8x8"),
        ({"features": np.full((1, 2, 8, 8), np.inf, np.float32)}, "NaN or infinity"),
    ):
        encoder = plugins.make("encoders", "embedded", model="pixels", folder=other_make(tmp_path, outputs), threads=1)
        with pytest.raises(BackendError, match=match):
            encoder.image(blank)
    refused(InputError, "takes images of", folder=other_make(tmp_path, outputs, size=64))
    refused(InputError, "rows of 384", folder=other_make(tmp_path, outputs, words=np.eye(3, dtype=np.float32)))
    refused(InputError, "damaged", folder=other_make(tmp_path, outputs, words=np.array(["a", None], object)))


def test_wrong_options_are_told() -> None:
    refused(BackendError, "threshold must be from 0 to 1, got 2", threshold=2)
    refused(BackendError, "threads must be at least 1", threads=0)
    refused(BackendError, "no provider 'abacus' here", provider="abacus")


def test_its_name_says_the_threshold_and_its_notes_say_that_it_knows_no_photographs() -> None:
    eyes = make(threshold=0.25)
    assert "0.25" in eyes.name
    assert "no photographs" in eyes.notes[0]
    assert eyes.score_model.measured == "" and make().score_model.measured
