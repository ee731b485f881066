"""The laws of the doctor's edges: wider when blurred, and depth found where it was moved to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from cartier.mapping.sharpness import edge_width_px
from cartier.recordings.common.edges import REACH, registration, zoomed


def tiles(seed: int, height: int = 120, width: int = 160) -> np.ndarray:
    """Overlapping rectangles of random brightness (0 to 1): an image whose edges can stand for those of depth, too."""
    random = np.random.default_rng(seed)
    image = np.full((height, width), 0.5)
    for value in random.uniform(0, 1, 25):
        top, left = random.integers(0, height - 20), random.integers(0, width - 20)
        high, wide = random.integers(10, 45, 2)
        image[top : top + high, left : left + wide] = value
    return image


@given(seed=st.integers(0, 1000), sigma=st.floats(1.0, 3.0))
@settings(max_examples=25, deadline=None)
def test_blur_widens_edges_by_as_much_as_it_should(seed: int, sigma: float) -> None:
    sharp = (tiles(seed, 240, 320) * 255).astype(np.uint8)
    soft = gaussian_filter(sharp.astype(np.float32), sigma).astype(np.uint8)
    assert edge_width_px(sharp) < 2
    assert edge_width_px(soft) == pytest.approx(2.5 * sigma, rel=0.35)


def test_a_plain_image_has_no_edges() -> None:
    assert np.isnan(edge_width_px(np.full((60, 80), 90, np.uint8)))
    assert np.isnan(edge_width_px(np.zeros((8, 8), np.uint8)))


@given(seed=st.integers(0, 1000), dx=st.integers(-REACH + 4, REACH - 4), dy=st.integers(-12, 12))
@settings(max_examples=10, deadline=None)
def test_depth_is_found_where_it_was_moved_to(seed: int, dx: int, dy: int) -> None:
    pairs = []
    for i in range(3):
        image = tiles(seed + i).astype(np.float32)
        pairs.append((image, zoomed(1 + 3 * image, 1.0, dx / 160, dy / 160)))
    found = registration(pairs)
    assert found is not None
    assert (round(found.dx * 160), round(found.dy * 160), found.zoom) == (-dx, -dy, 1.0)
    assert found.fit >= found.fit_as_given


def test_without_edges_nothing_is_said() -> None:
    plain = np.ones((60, 80), np.float32)
    assert registration([]) is None
    assert registration([(plain, plain)]) is None


def test_a_hole_in_the_depth_is_no_edge() -> None:
    grey, depth_m = np.zeros((60, 80), np.float32), np.full((60, 80), 2, np.float32)
    grey[20:40, 30:50], depth_m[20:40, 30:50] = 1, np.nan
    assert registration([(grey, depth_m)]) is None


def test_zoom_one_changes_nothing() -> None:
    image = tiles(5).astype(np.float32)
    assert np.array_equal(zoomed(image, 1.0), image)
    assert np.isnan(zoomed(image, 0.5)).mean() == pytest.approx(0.75, abs=0.02)
