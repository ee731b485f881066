"""What the readers share: poses between samples, and one camera's pixels on another's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from cartier.errors import InputError
from cartier.mapping.gravity import quarter_turns
from cartier.mapping.upright import turned_camera, turned_image
from cartier.recordings.common.lens import Lens, camera_of, off_centre_notes, registered, resampled
from cartier.recordings.common.poses import interpolated
from cartier.types import Camera
from synthetic import THINGS, look, render

turn = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(turn, turn, st.floats(0, 1), st.booleans())
def test_rotations_between_samples_are_scipys_slerp(
    a: tuple[float, ...], b: tuple[float, ...], share: float, sign: bool
) -> None:
    qa, qb = np.array(a) / np.linalg.norm(a), np.array(b) / np.linalg.norm(b)
    table = np.array([[0.0, 1, 2, 3, *qa], [2.0, 3, 2, 1, *(-qb if sign else qb)]])
    found = interpolated(table, np.array([2 * share])).matrices()[0]
    expected = Slerp([0, 2], Rotation.from_quat([qa, qb]))([2 * share]).as_matrix()[0]
    if abs(qa @ qb) > 1e-6:  # half a turn has two shortest ways
        assert np.abs(found[:3, :3] - expected).max() < 1e-6
    assert np.allclose(found[:3, 3], [1 + 2 * share, 2, 3 - 2 * share])


@given(st.lists(st.floats(0, 10), min_size=1, max_size=6, unique=True), st.floats(-5, 15))
def test_nothing_is_extrapolated(times: list[float], time: float) -> None:
    table = np.array([[t, 0, 0, 0, 0, 0, 0, 1] for t in sorted(times)])
    found = interpolated(table, np.array([time]))
    assert bool(found.outside[0]) == (not min(times) <= time <= max(times))
    assert np.isfinite(found.rows).all()


@pytest.mark.parametrize("turns", range(4))
def test_turned_images_are_those_of_the_turned_camera(turns: int) -> None:
    camera = Camera(80, 60, 70.0, 65.0, 41.0, 28.0)
    pose = look((1, 1, 1.5), (3, 3, 1))
    new_camera, old_from_new = turned_camera(camera, turns)
    expected = render(pose @ old_from_new, new_camera, THINGS)[0]
    assert np.abs(turned_image(render(pose, camera, THINGS)[0], turns) - expected).max() < 1e-5
    assert quarter_turns((pose @ np.linalg.inv(old_from_new))[2, :2]) == turns


@given(st.integers(1, 4), st.integers(1, 4))
def test_whole_factors_repeat_and_pick_pixels(across: int, down: int) -> None:
    small = Camera(12, 9, 10.0, 11.0, 5.5, 4.5)
    large = small.scaled(12 * across, 9 * down)
    image = np.arange(12 * 9, dtype=np.float32).reshape(9, 12)
    upscaled = resampled(image, Lens(small), large, np.nan)
    assert np.array_equal(upscaled, image.repeat(across, 1).repeat(down, 0))


def test_outside_of_the_image_there_is_nothing() -> None:
    camera = Camera(10, 10, 10.0, 10.0, 4.5, 4.5)
    wider = Camera(20, 10, 10.0, 10.0, 9.5, 4.5)
    depth = resampled(np.ones((10, 10), np.float32), Lens(camera), wider, np.nan)
    assert np.isnan(depth[:, :5]).all() and np.isnan(depth[:, 15:]).all() and (depth[:, 5:15] == 1).all()


def test_depth_of_a_lens_that_sees_everything_is_refused_and_not_smeared() -> None:
    """Each of its pixels would cover a million of the colour camera's."""
    depth, target = np.ones((120, 160), np.float32), Camera(160, 120, 120_000.0, 120_000.0, 79.5, 59.5)
    with pytest.raises(InputError, match="are the depth camera's intrinsics right"):
        registered(depth, Camera(160, 120, 2.0, 2.0, 79.5, 59.5), target, np.diag([1e-6, 1e-6, 1.0, 1.0]))


@pytest.mark.parametrize(
    ("model", "numbers"),
    [("plumb_bob", (1e9,) * 4), ("plumb_bob", (1.0,)), ("equidistant", (0.0,) * 5), ("plumb_bob", (np.nan,) * 4)],
)
def test_a_senseless_distortion_is_refused(model: str, numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="distortion needs"):
        Lens(Camera(10, 10, 1, 1, 0, 0), model, numbers)  # type: ignore[arg-type]


@given(st.floats(0.5, 2), st.floats(-0.03, 0.03), st.floats(-0.03, 0.03))
def test_intrinsics_of_images_of_another_size_never_pass(scale: float, across: float, down: float) -> None:
    """Those of a real camera, off by 3 % at most, pass as they are, and not for images of 1/0.87 times the size or
    more."""
    right = Camera(640, 480, 500.0, 500.0, 319.5 + 640 * across, 239.5 + 480 * down)
    assert camera_of(640, 480, (500.0, 500.0, right.cx, right.cy), "a") == right
    assert off_centre_notes(right) == []
    wrong = [value * scale for value in (right.fx, right.fy, right.cx, right.cy)]
    if abs(across - down) < 0.01 and not 0.82 < scale < 1.18:
        with pytest.raises(InputError, match=r"^a: the principal point .* but these have 640x480: scale fx"):
            camera_of(640, 480, wrong, "a")


@pytest.mark.parametrize(
    ("width", "height", "noted"), [(640, 480, False), (608, 480, False), (480, 480, True), (640, 360, True)]
)
def test_a_strip_cut_off_is_noted_and_not_refused(width: int, height: int, noted: bool) -> None:
    """Its principal point is off in one direction, where one of resized images is off in both."""
    notes = off_centre_notes(camera_of(width, height, (500.0, 500.0, 319.5, 239.5), "a"))
    assert bool(notes) == noted
    assert all("px): right if they were cropped, wrong if they were resized" in note for note in notes)
