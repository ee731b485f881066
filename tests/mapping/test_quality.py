"""What is said of pictures and poses that make a map worse than it could be, and of none that do not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cartier.mapping.quality import SAMPLES, Conditions
from cartier.pipeline import map_home
from cartier.types import Camera, Frame
from synthetic import THINGS, RoomRecording, TrueBoxes, look, walk

LARGE = Camera(320, 240, 240.0, 240.0, 159.5, 119.5)


def rounds(laps: int = 2, frames: int = 24) -> list[np.ndarray]:
    """Poses on a circle through the room, looking at its far walls, round after round."""
    angles = [2 * math.pi * i / frames for i in range(laps * frames)]
    return [
        look((2.5 + 0.8 * math.cos(a), 2 + 0.6 * math.sin(a), 1.5), (2.5 - 3 * math.cos(a), 2 - 3 * math.sin(a), 1))
        for a in angles
    ]


@cache
def frames() -> list[Frame]:
    """Good frames; nobody changes them."""
    recording = RoomRecording(rounds(), THINGS, camera=LARGE)
    return [recording[i] for i in range(len(recording))]


def notes(found: list[Frame]) -> list[str]:
    conditions = Conditions()
    for frame in found:
        conditions.add(frame)
    return conditions.notes()


def blurred(frame: Frame, i: int) -> Frame:
    smeared = np.mean([np.roll(frame.rgb.astype(float), shift, axis=1) for shift in range(15)], axis=0)
    return replace(frame, rgb=smeared.astype(np.uint8))


def flickering(frame: Frame, i: int) -> Frame:
    return replace(frame, rgb=(frame.rgb * (0.3 if i % 3 else 1.0)).astype(np.uint8))


def sideways(frame: Frame, i: int) -> Frame:
    """A picture that was turned to the left, with everything that belongs to it: it lies on its left side."""
    c = frame.camera
    old_from_new = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return replace(
        frame,
        rgb=np.ascontiguousarray(np.rot90(frame.rgb)),
        depth_m=np.ascontiguousarray(np.rot90(frame.depth_m)),
        instances=None,
        camera=Camera(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx),
        world_from_camera=frame.world_from_camera @ old_from_new,
    )


def drifting(frame: Frame, i: int) -> Frame:
    moved = frame.world_from_camera.copy()
    moved[:2, 3] += np.array([1.0, 0.6]) * i / 48
    return replace(frame, world_from_camera=moved)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (blurred, "the pictures are blurred (edges "),
        (flickering, "the exposure jumps between 31 of 48 frames"),
        (sideways, "by their poses the pictures lie on their left side"),
        (drifting, "the poses drift: a later part of the recording fits an earlier one only if it is moved by "),
    ],
)
def test_each_condition_is_one_line(change: Callable[[Frame, int], Frame], says: str) -> None:
    good = frames()
    found = notes([change(frame, i) for i, frame in enumerate(good)])
    assert len(found) == 1 and found[0].startswith(says) and "\n" not in found[0]


def test_drift_is_not_looked_for_unless_asked() -> None:
    conditions = Conditions()
    for number, frame in enumerate(frames()):
        conditions.add(drifting(frame, number))
    assert len(conditions.notes()) == 1 and conditions.notes(drift=False) == []


def test_good_frames_have_no_line() -> None:
    assert notes(frames()) == []


def test_small_pictures_are_said_and_depth_is_not_needed() -> None:
    recording = walk(with_depth=False)
    assert notes(list(recording)) == ["the pictures are small (160x120 px): small objects are missed"]
    assert notes([]) == []


def test_a_long_recording_is_not_held() -> None:
    frame, conditions = frames()[0], Conditions()
    for _ in range(20 * SAMPLES):
        conditions.add(frame)
    assert len(conditions._samples) <= SAMPLES


def test_a_map_says_it() -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    assert "the pictures are small (160x120 px): small objects are missed" in home.notes
