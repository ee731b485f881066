"""The embedded encoder's eyes: one look for two, features that cover the image and stand nearest to the right words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import BackendError
from cartier.labels import display_name
from cartier.types import Camera, Frame
from cartier_dollhouse.network import load
from cartier_dollhouse.network.inference import Inference, open_inference
from strange_home import strange_walk


@pytest.fixture(scope="module")
def walk() -> Any:
    return strange_walk()


@pytest.fixture
def pixels() -> Any:
    return plugins.make_from_spec("encoders", "embedded:pixels", threads=1)


def seen(rgb: np.ndarray) -> Frame:
    height, width = rgb.shape[:2]
    return Frame(
        0, 0.0, rgb, None, np.eye(4), Camera(width, height, max(rgb.shape), max(rgb.shape), width / 2, height / 2)
    )


def test_words_and_images_are_unit_vectors_of_one_space(pixels: Any, walk: Any) -> None:
    features, words = pixels.image(walk[0]), pixels.text(["mug", "a thing to lie down on"])
    assert not pixels.text_only and features.dtype == words.dtype == np.float32
    assert features.shape[2] == words.shape[1] == len(load().words) - 1
    np.testing.assert_allclose(np.linalg.norm(features, axis=2), 1, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(words, axis=1), 1, atol=1e-5)


def test_names_are_nearest_to_themselves(pixels: Any) -> None:
    vectors = pixels.text(load().names)
    assert (vectors @ vectors.T).argmax(1).tolist() == list(range(len(vectors)))


def test_cells_show_what_is_there(pixels: Any, walk: Any) -> None:
    """In a home that no training saw, most cells of the larger things are nearest to their own name among 125 and the
    wall."""
    names = [*load().names, *load().around]
    vectors, of_id = pixels.text(names), {obj.id: display_name(obj.label) for obj in walk.truth}
    right = [0, 0]
    for number in range(0, len(walk), 3):
        frame = walk[number]
        features = pixels.image(frame)
        ys, xs = (
            ((np.arange(n) + 0.5) * side / n).astype(int)
            for n, side in zip(features.shape[:2], (240, 320), strict=True)
        )
        nearest = (features @ vectors.T).argmax(2)
        ids = frame.instances[np.ix_(ys, xs)]
        for number_of, name in of_id.items():
            mine = ids == number_of
            if mine.sum() >= 60:
                right[0] += int((nearest[mine] == names.index(name)).sum())
                right[1] += int(mine.sum())
        wall = ids == 0
        assert (nearest[wall] == len(names) - 1).mean() > 0.8
    assert right[1] > 500 and right[0] > 0.4 * right[1]


@pytest.mark.parametrize("shape", [(480, 640), (1, 1), (7, 900), (900, 7), (241, 319), (3000, 4000)])
def test_features_cover_the_image_and_nothing_else(pixels: Any, shape: tuple[int, int]) -> None:
    (width, height), rgb = load().size, np.full((*shape, 3), 90, np.uint8)
    features = pixels.image(seen(rgb))
    scale = min(width / shape[1], height / shape[0])
    for got, side in zip(features.shape[:2], shape, strict=True):
        assert abs(got - max(1.0, side * scale / 4)) <= 0.5
    assert np.isfinite(features).all()


def test_grey_black_and_turned_images_give_features(pixels: Any, walk: Any) -> None:
    rgb = walk[0].rgb
    grey = rgb.mean(2, keepdims=True).astype(np.uint8).repeat(3, 2)
    for image in (grey, np.zeros_like(rgb), np.ascontiguousarray(np.rot90(rgb))):
        assert np.isfinite(pixels.image(seen(image))).all()


def test_detector_and_encoder_share_one_look(monkeypatch: pytest.MonkeyPatch, walk: Any) -> None:
    inference = open_inference(load().path.parent, threads=1)
    looks: list[str] = []
    run = inference._session.run
    monkeypatch.setattr(inference._session, "run", lambda tensor, what: looks.append(what) or run(tensor, what))
    detector = plugins.make("detectors", "embedded", threads=1)
    encoder = plugins.make("encoders", "embedded", model="pixels", threads=1)
    for frame in (walk[0], walk[1]):
        found = detector.detect(frame)
        encoder.image(frame)
        assert detector.detect(frame).labels == found.labels
    assert looks == ["frame 0", "frame 1"]


def test_another_image_is_never_answered_from_the_last_one(walk: Any) -> None:
    inference = Inference(load(), open_inference(load().path.parent, threads=1)._session)
    first = inference.features(walk[0])
    for number in range(3):  # images that are gone may leave their place in memory to the next
        assert not np.array_equal(inference.features(walk[3 + number]), first)
    assert np.array_equal(inference.features(walk[0]), first)


def test_vlmaps_finds_words_in_pixels_and_remembers_how(walk: Any) -> None:
    index = plugins.make("indexes", "vlmaps", encoder="embedded:pixels")
    detector = plugins.make("detectors", "embedded", threads=1)
    for number in range(3):
        index.add(walk[number], detector.detect(walk[number]))
    state = index.state()
    again = plugins.make("indexes", "vlmaps")
    again.restore(state)
    assert "from pixels" in again.encoder and "labels" not in again.encoder
    np.testing.assert_allclose(
        again.similarity("somewhere to sit")[1], index.similarity("somewhere to sit")[1], atol=5e-3
    )


def test_another_model_is_refused_in_one_line() -> None:
    with pytest.raises(BackendError, match=r"from words or from pixels .*, not from 'clip'"):
        plugins.make_from_spec("encoders", "embedded:clip")
    with pytest.raises(BackendError, match="no provider 'abacus' here"):
        plugins.make("encoders", "embedded", model="pixels", provider="abacus")
