"""Keyframes: which of a few frames the detector sees, row by row."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartier.mapping.keyframes import Keyframes
from cartier.types import Camera, Frame
from synthetic import look

CAMERA = Camera(32, 24, 24.0, 24.0, 15.5, 11.5)
SHARP, SOFT, GREY = 90, 30, 0  # how much neighbouring pixels differ


def view(index: int, x_m: float, degrees: float = 0.0, depth_m: float = 2.0, contrast: int = SHARP) -> Frame:
    yaw = math.radians(degrees)
    checks = (np.indices((24, 32)) // 2).sum(0) % 2
    rgb = np.repeat((128 + contrast * checks)[..., None], 3, 2).astype(np.uint8)
    pose = look((x_m, 0, 1.5), (x_m + math.cos(yaw), math.sin(yaw), 1.5))
    return Frame(index, index / 30, rgb, np.full((24, 32), depth_m, np.float32), pose, CAMERA)


def along(step_m: float = 0.0, step_deg: float = 0.0, depth_m: float = 2.0, count: int = 21) -> list[Frame]:
    return [view(k, k * step_m, k * step_deg, depth_m) for k in range(count)]


def offered(frames: list[Frame], every: int | None = None) -> tuple[list[int], list[int]]:
    """What was chosen while frames came, and what was waiting at the end."""
    keyframes = Keyframes(every)
    chosen = [frame.index for given in frames for frame in keyframes.push(given)]
    return chosen, [frame.index for frame in keyframes.flush()]


ROWS: dict[str, tuple[list[Frame], list[int], list[int]]] = {
    "nothing moves": (along(), [0], []),
    "3 cm a frame": (along(0.03), [0, 3, 6, 9, 12, 15, 18], []),
    "2 cm a frame, all within half a metre": (along(0.02, depth_m=0.5, count=9), [0, 2, 4, 6], [8]),
    "3 cm a frame, all far away": (along(0.03, depth_m=8.0), [0, 3, 6, 9, 12, 15, 18], []),
    "2 degrees a frame": (along(0.0, 2.0, count=14), [0, 3, 6, 9], [12]),
    "7 cm a frame: no video": (along(0.07, count=6), [0, 1, 2, 3, 4, 5], []),
    "5 degrees a frame: no video": (along(0.0, 5.0, count=6), [0, 1, 2, 3, 4, 5], []),
    "the last of a short way waits": (along(0.03, count=5), [0], [3]),
}


@pytest.mark.parametrize(("frames", "chosen", "waiting"), ROWS.values(), ids=ROWS.keys())
def test_frames_chosen(frames: list[Frame], chosen: list[int], waiting: list[int]) -> None:
    assert offered(frames) == (chosen, waiting)


SHARPNESS: dict[str, tuple[list[int], int]] = {
    "the sharp one of the second half": ([SOFT, GREY, GREY, GREY, SHARP, SOFT], 4),
    "the first half is too near": ([SOFT, SHARP, SHARP, GREY, SOFT, GREY], 4),
    "of equals the first": ([SOFT, SOFT, SOFT, SOFT, SOFT, SOFT], 3),
    "the one that is far enough may be the sharpest": ([SOFT, GREY, GREY, GREY, GREY, SHARP], 5),
}


@pytest.mark.parametrize(("contrasts", "second"), SHARPNESS.values(), ids=SHARPNESS.keys())
def test_sharpest_of_a_way_is_chosen(contrasts: list[int], second: int) -> None:
    """Five steps of 3 cm to another view: from 8 cm on a frame may stand for it."""
    frames = [view(k, 0.031 * k, contrast=contrast) for k, contrast in enumerate(contrasts)]
    assert offered(frames) == ([0, second], [])


def test_order_is_that_of_the_recording() -> None:
    """A frame still waits when a jump comes: both are given, the older one first."""
    frames = [view(0, 0.0), view(1, 0.05), view(2, 0.10), view(3, 1.0)]
    assert offered(frames) == ([0, 2, 3], [])


@pytest.mark.parametrize(("every", "chosen"), [(1, [0, 1, 2, 3, 4]), (2, [0, 2, 4]), (3, [0, 3])])
def test_every_nth_frame(every: int, chosen: list[int]) -> None:
    assert offered(along(count=5), every) == (chosen, [])


def test_frame_without_depth_counts_as_far() -> None:
    frames = [replace(frame, depth_m=None) for frame in along(0.03, depth_m=0.5)]
    assert offered(frames)[0] == [0, 3, 6, 9, 12, 15, 18]
