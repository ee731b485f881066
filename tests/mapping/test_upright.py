"""Whatever world a recording is in and however its camera was held, its home is the same."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cartier
from cartier.contracts import Detector
from cartier.detectors import file
from cartier.geometry import backproject, transform
from cartier.home import Home
from cartier.live.level import FIRST, Level
from cartier.mapping.upright import Levelled, measured, upright
from cartier.render.mapped_frames import as_mapped
from cartier.types import Frame
from cartier.types.streams import Event, PoseUpdate, Stamped
from lying import lying, world
from synthetic import THINGS, TrueBoxes, look, walk

DETECTOR: Detector = TrueBoxes(THINGS)  # type: ignore[assignment]
angle = st.floats(-3, 3)


def mapped(recording: object, onto: Home | None = None) -> Home:
    return cartier.map_home(recording, DETECTOR, every=3, onto=onto)  # type: ignore[arg-type]


@cache
def sound() -> Home:
    return mapped(lying(np.eye(4)))


def heights(home: Home) -> np.ndarray:
    return np.array([(o.box_min[2], o.box_max[2]) for o in home.objects])


def apart(home: Home) -> np.ndarray:
    at = np.array([o.position for o in home.objects])
    return np.asarray(np.linalg.norm(at[:, None] - at, axis=-1))


def same(home: Home) -> bool:
    """Whether it holds the same things as the sound one, as high and as far apart; boxes lie otherwise in cells."""
    assert [o.label for o in home.objects] == [o.label for o in sound().objects]
    assert np.abs(heights(home) - heights(sound())).max() < 0.1
    return bool(np.abs(apart(home) - apart(sound())).max() < 0.25)


@settings(max_examples=2, deadline=None)
@given(st.tuples(angle, angle, angle), st.tuples(angle, angle, angle), st.integers(0, 3))
@example((0.0, 0.0, 0.0), (0.0, 0.0, -0.8), 1)  # a table's top at the height of 0
@example((np.pi / 2, 0.0, 0.0), (0.0, 0.0, 0.0), 2)
def test_any_world_and_any_hold_give_the_same_home(
    rotation: tuple[float, ...], shift: tuple[float, ...], turns: int
) -> None:
    assert same(mapped(lying(world(rotation, shift), turns)))


def test_each_correction_is_said_in_one_line() -> None:
    assert not upright(lying(np.eye(4)), DETECTOR).levelled.notes
    for turns, shift, rotation in ((0, -0.93, 0), (1, 0, 0), (2, 2, 0), (3, 0.5, 1.2)):
        recording = upright(lying(world((rotation, 0, 0), (0, 0, shift)), turns), DETECTOR)
        notes = recording.levelled.notes
        assert len(notes) == bool(turns) + bool(shift or rotation)
        assert [note for note in notes if note not in recording.notes] == []


def test_a_sound_recording_is_left_alone_to_the_bit() -> None:
    recording = lying(np.eye(4))
    kept = upright(recording, DETECTOR)
    assert not kept.levelled.changes() and np.array_equal(kept[3].world_from_camera, recording[3].world_from_camera)
    aside = upright(lying(world((0.01, 0, 0), (0, 0, 0.01))), DETECTOR)  # within what a sensor and a driver are off
    assert not aside.levelled.changes()


def test_the_floor_of_another_storey_is_no_floor_here() -> None:
    """A stairwell shows the storey below, three metres down: half of the frames look into it."""
    walked = lying(np.eye(4))
    frames = [walked[i] for i in range(0, len(walked), 3)]
    deep = [replace(f, depth_m=np.where(above_floor_m(f) < 0.05, f.depth_m * 3, f.depth_m)) for f in frames[::2]]
    seen = [frame.depth_m for frame in (*frames, *deep)]
    poses = np.array([frame.world_from_camera for frame in (*frames, *deep)])
    found = measured(poses, walked.camera, seen.__getitem__)
    assert not found.changes()


def test_what_is_added_to_a_home_lies_as_its_first_recording() -> None:
    other = world((0, 0, 0), (0, 0, -0.93))
    first = mapped(lying(other, frames=14))
    onto = first.settings["recordings"]
    assert onto[0]["level"][11] == pytest.approx(0.93, abs=0.02)
    desk = lying(other, 1, frames=3, first=12)
    told = [{**onto[0], "level": [*onto[0]["level"][:11], 0.9]}]  # not what the desk itself would show
    added = upright(desk, DETECTOR, told).levelled
    assert np.array_equal(added.level_from_world, Levelled.of_row(told[0]).level_from_world) and added.turns == 3
    assert same(mapped(lying(other, 1, first=14), onto=first))


def test_a_mapped_recording_is_read_again_as_it_was_mapped(tmp_path: Path) -> None:
    recording = lying(world((1.5, 0, 0), (0, 0, 1)), 1)
    mapped(recording).save(tmp_path)
    home, levelled = Home.load(tmp_path), upright(recording, DETECTOR)
    again = as_mapped(home, recording)
    assert again.camera == home.camera == levelled.camera
    assert np.allclose(again[5].world_from_camera, levelled[5].world_from_camera, atol=1e-12)
    assert np.array_equal(again[5].rgb, levelled[5].rgb)


def test_images_stay_as_their_detections_were_made(tmp_path: Path) -> None:
    rows = {"frame": 0, "label": "cup", "score": 0.9, "xyxy": [1, 2, 30, 40]}
    (tmp_path / "found.json").write_text(json.dumps([rows]))
    turned = upright(lying(world((0, 0, 0), (0, 0, 2)), 2), file.make(tmp_path / "found.json"))
    assert turned.levelled.turns == 0 and turned.levelled.moves


class Stream:
    """A source of frames."""

    name, recording, notes = "stream", None, ()

    def __init__(self, frames: list[Frame]) -> None:
        self.frames = frames

    def __iter__(self) -> Iterator[Event]:
        yield from (Stamped(frame, round(frame.time_s * 1e9)) for frame in self.frames)

    def close(self) -> None:
        pass


@pytest.mark.parametrize("turns", [0, 1, 2])
def test_a_stream_is_level_and_upright(turns: int) -> None:
    there = lying(world((0.3, 0, 0), (0, 0, -0.93)), turns)
    events = list(Level(Stream([there[i] for i in range(len(there))]), DETECTOR, ()))  # type: ignore[arg-type]
    frames = [event.frame for event in events if isinstance(event, Stamped)]
    assert len(frames) == len(there) and frames[0].rgb.shape == walk()[0].rgb.shape
    assert all(abs(frame.world_from_camera[2, 3] - 1.5) < 0.05 for frame in frames)


def test_a_floor_that_comes_into_view_later_corrects_what_came_before() -> None:
    low = world((0, 0, 0), (0, 0, -0.93))
    ahead = replace(lying(low), poses=[look((1, 1 + i / 20, 1.5), (4, 2, 1.7 + i / 20)) for i in range(2 * FIRST)])
    frames = [ahead[i] for i in range(len(ahead))]
    frames = [replace(f, depth_m=np.where(above_floor_m(f, -0.93) < 0.1, np.nan, f.depth_m)) for f in frames]
    whole = lying(low)
    frames += [replace(whole[i], index=len(frames) + i, time_s=2 + i / 10) for i in range(len(whole))]
    events = list(Level(Stream(frames), DETECTOR, ()))  # type: ignore[arg-type]
    updates = [event for event in events if isinstance(event, PoseUpdate)]
    assert len(updates) == 1
    assert updates[0].poses[0][2, 3] == pytest.approx(1.5, abs=0.03)
    last = [event for event in events if isinstance(event, Stamped)][-1].frame
    assert last.world_from_camera[2, 3] == pytest.approx(1.5, abs=0.03)


def above_floor_m(frame: Frame, floor_m: float = 0.0) -> np.ndarray:
    """The height above the room's floor of what each pixel shows (H, W)."""
    assert frame.depth_m is not None
    points = backproject(frame.depth_m, frame.camera)
    heights_m = transform(frame.world_from_camera, points.reshape(-1, 3))[:, 2] - floor_m
    return np.asarray(heights_m.reshape(frame.depth_m.shape))
