"""VLMaps with an encoder that sees colours, and with labels painted through the shipped text encoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import BackendError, InputError
from cartier.types import Detections, Frame
from cartier_bench.baselines.vlmaps import searchable
from synthetic import CHAIR, THINGS, TrueBoxes, walk

SPREAD = np.linalg.qr(np.random.default_rng(0).normal(size=(48, 3)))[0].T.astype(np.float32)  # (3, 48), orthonormal
COLOURS = {"red": (1.0, 0, 0), "green": (0, 1.0, 0), "blue": (0, 0, 1.0)}


class Colours:
    """A small encoder: images and words in the space of colours, plus one large dimension without meaning."""

    name = "colours (test)"
    text_only = False

    def __init__(self, nuisance: float = 0.0) -> None:
        self.nuisance = nuisance
        self.asked: list[str] = []

    def image(self, frame: Frame) -> np.ndarray:
        rgb = frame.rgb[::2, ::2].astype(np.float32) / 255
        return np.concatenate([rgb @ SPREAD, np.full((*rgb.shape[:2], 1), self.nuisance)], 2)

    def text(self, texts: list[str]) -> np.ndarray:
        self.asked += texts
        colours = np.array([COLOURS.get(text, (0.5, 0.5, 0.4)) for text in texts], np.float32)
        return np.hstack([colours @ SPREAD, np.full((len(texts), 1), self.nuisance, np.float32)])


def red_chair(frame: Frame) -> Frame:
    assert frame.instances is not None
    rgb = np.full((*frame.instances.shape, 3), 120, np.uint8)
    rgb[frame.instances == CHAIR.id] = (220, 30, 30)
    return Frame(frame.index, frame.time_s, rgb, frame.depth_m, frame.world_from_camera, frame.camera, frame.instances)


def mapped(encoder: object):  # type: ignore[no-untyped-def]
    index, recording = plugins.make("indexes", "vlmaps", encoder=encoder), walk()
    for number in range(len(recording)):
        frame = red_chair(recording[number])
        index.add(frame, TrueBoxes(THINGS).detect(frame))
    return index


@pytest.mark.parametrize("nuisance", [0.0, 50.0])
def test_words_find_what_the_encoder_sees(nuisance: float) -> None:
    """The huge constant dimension would make every cosine 1; it is dropped, and the red thing is found as before."""
    place = mapped(Colours(nuisance)).locate("red")
    low, high = np.array(CHAIR.box_min) - 0.05, np.array(CHAIR.box_max) + 0.05
    assert (low[:2] <= place.position[:2]).all() and (place.position[:2] <= high[:2]).all()
    assert 0 <= place.position[2] <= high[2]
    assert place.score > 0.9


def test_which_dimensions_are_dropped() -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(200, 64)).astype(np.float32)
    assert searchable(rows)[1].all(), "plain features lose nothing"
    rows[:, 7] = 40 + rng.normal(size=200)
    unit, kept = searchable(rows)
    assert np.flatnonzero(~kept).tolist() == [7]
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1, rtol=1e-5)
    rows[:100, 7] = -40
    assert searchable(rows)[1].all(), "large, but it tells one half of the map from the other"


def test_label_features_say_so_and_find_what_was_not_named() -> None:
    index = plugins.make("indexes", "vlmaps")
    recording, detector = walk(), TrueBoxes(THINGS)
    for number in range(len(recording)):
        index.add(recording[number], detector.detect(recording[number]))
    assert "from the detector's labels" in index.encoder and "MiniLM" in index.encoder
    place = index.locate("somewhere to sit")
    low, high = np.array(CHAIR.box_min[:2]) - 0.1, np.array(CHAIR.box_max[:2]) + 0.1
    assert (low <= place.position[:2]).all() and (place.position[:2] <= high).all()


def test_text_vectors_are_asked_for_once_and_those_of_names_travel_with_the_home() -> None:
    encoder = Colours()
    index = mapped(encoder)
    first = [index.locate(name) for name in (*index.names(), "red", "red")]
    assert len(encoder.asked) == len(set(encoder.asked))
    state = index.state()
    again = plugins.make("indexes", "vlmaps", encoder=None)
    again.restore(state)
    assert [again.locate(name).position for name in again.names()] == [p.position for p in first[:-2]]
    for words in ("red", "blue"):  # what people said stays with them
        with pytest.raises(InputError, match=r"only colours \(test\) can encode"):
            again.locate(words)


def test_code_that_a_home_names_is_not_run(tmp_path: Path) -> None:
    index = mapped(Colours())
    state = index.state()
    trap = tmp_path / "trap.py"
    trap.write_text("raise SystemExit('ran')")
    state["vlmaps.json"] = state["vlmaps.json"].replace(b"null", f'"{trap}"'.encode())
    again = plugins.make("indexes", "vlmaps")
    again.restore(state)
    with pytest.raises(InputError, match="is not run"):
        again.locate("something new")


def test_features_without_numbers_name_the_encoder_and_the_frame() -> None:
    with pytest.raises(BackendError, match=r"colours \(test\): frame 0"):
        mapped(Colours(np.nan))


def test_without_depth_there_is_no_map() -> None:
    index, frame = plugins.make("indexes", "vlmaps"), walk()[0]
    blind = Frame(0, 0.0, frame.rgb, None, frame.world_from_camera, frame.camera)
    index.add(blind, Detections(0, np.array([[1.0, 1, 30, 30]]), np.ones(1), ("mug",)))
    assert index.names() == [] and index.locate("mug") is None
