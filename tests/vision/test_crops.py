"""Crops: size, budget of image tokens, the drawn box, blur."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from cartier.vision.crops import MAX_TOKENS, MIN_CROP_PX, blurred, image_tokens, picture
from cartier.vision.views import MAX_PICTURES
from vision.seeing_server import colour_of, drawn_box
from vision.staged_photos import BOX, mug, photo

RED, BLUE = (200, 30, 30), (40, 70, 200)


def opened(jpeg: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))


def pixels(jpeg: bytes) -> np.ndarray:
    return opened(jpeg)


@pytest.mark.parametrize(("width", "height", "tokens"), [(28, 28, 1), (29, 28, 2), (640, 480, 414), (256, 512, 190)])
def test_tokens_are_patches_of_28_px(width: int, height: int, tokens: int) -> None:
    assert image_tokens(width, height) == tokens


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.integers(0, 500), st.integers(0, 350), st.integers(64, 400), st.integers(64, 300)),
    st.integers(1, MAX_PICTURES), st.sampled_from([(640, 480), (1280, 720), (480, 640)]),
)  # fmt: skip
def test_pictures_keep_the_budget_and_the_least_crop(
    place: tuple[int, int, int, int], count: int, size: tuple[int, int]
) -> None:
    x, y, wide, high = place
    box = (x, y, min(x + wide, size[0]), min(y + high, size[1]))
    if min(box[2] - box[0], box[3] - box[1]) < 64:
        return
    image = np.full((size[1], size[0], 3), 120, np.uint8)
    thing = mug(1, [(1, box, 0)])  # type: ignore[list-item]
    made = picture(thing, thing.views[0], image, MAX_TOKENS // count)
    crop, context = opened(made.crop_jpeg), opened(made.context_jpeg)
    assert min(crop.shape[:2]) >= MIN_CROP_PX - 3
    assert made.tokens == image_tokens(crop.shape[1], crop.shape[0]) + image_tokens(context.shape[1], context.shape[0])
    assert count * made.tokens <= MAX_TOKENS


def test_crop_shows_the_object_and_box_surrounds_it() -> None:
    image = pixels(photo((BOX, RED), ((20, 20, 200, 150), BLUE)))
    thing = mug(1, [(1, BOX, 0)])
    made = picture(thing, thing.views[0], image, MAX_TOKENS // 3)
    crop, context = opened(made.crop_jpeg), opened(made.context_jpeg)
    height, width = crop.shape[:2]
    assert colour_of(crop[height // 4 : -height // 4, width // 4 : -width // 4]) == "red"
    assert (crop[2, 2] > 120).all()  # a margin of the background
    box = drawn_box(context)
    assert box is not None
    scale = context.shape[1] / 640
    assert np.allclose(np.array(box) / scale, BOX, atol=8)


def test_blur_hides_what_is_in_the_box_alone() -> None:
    rng = np.random.default_rng(0)
    noise = Image.fromarray(rng.integers(0, 255, (480, 640, 3), np.uint8))
    after = np.asarray(blurred(noise, [(100, 100, 200, 200)])).astype(float)
    before = np.asarray(noise).astype(float)
    assert after[120:180, 120:180].std() < 20 < before[120:180, 120:180].std()
    changed = np.abs(after - before).max(2) > 0
    changed[100:200, 100:200] = False
    assert not changed.any()
