"""Keyframes: few of a dense recording, the sharp ones, and all of a sparse one."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.mapping.keyframes import Keyframes, forecast, sharpness
from cartier.pipeline import map_home
from cartier.types import Frame
from synthetic import CAMERA, SMALL, THINGS, RoomRecording, TrueBoxes, look
from synthetic import small_walk as walk


def view(index: int, x: float = 0.0, yaw: float = 0.0, depth: float = 2.0, blurred: bool = False) -> Frame:
    rgb = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    if blurred:
        rgb = ((rgb.astype(int) + np.roll(rgb, 1, 0) + np.roll(rgb, 1, 1) + np.roll(rgb, 2, 1)) // 4).astype(np.uint8)
    pose = look((x, 0, 1.5), (x + math.cos(yaw), math.sin(yaw), 1.5))
    camera = replace(CAMERA, width=64, height=48, cx=31.5, cy=23.5)
    return Frame(index, index / 30, rgb, np.full((48, 64), depth, np.float32), pose, camera)


def picked(frames: list[Frame], every: int | None = None) -> list[int]:
    keyframes = Keyframes(every)
    return [frame.index for offered in frames for frame in keyframes.push(offered)] + [
        f.index for f in keyframes.flush()
    ]


def dense(seconds: float, hz: int = 30, metres_a_second: float = 0.5, degrees_a_second: float = 20) -> RoomRecording:
    """A camera that circles in the middle of the room."""
    poses = []
    for time_s in np.arange(0, seconds, 1 / hz):
        turn, angle = time_s * metres_a_second / 0.8, math.radians(time_s * degrees_a_second)
        x, y = 2.5 + 0.8 * math.cos(turn), 2 + 0.8 * math.sin(turn)
        poses.append(look((x, y, 1.5), (x + math.cos(angle), y + math.sin(angle), 1.1)))
    return RoomRecording(poses, THINGS, SMALL)


def test_standing_still_is_one_view_and_moving_is_a_view_each_15_cm_or_10_degrees() -> None:
    assert picked([view(i) for i in range(50)]) == [0]
    for moved in ([view(i, x=0.01 * i) for i in range(151)], [view(i, yaw=math.radians(i / 2)) for i in range(201)]):
        numbers = picked(moved)
        assert numbers[0] == 0 and max(np.diff(numbers)) <= 20 and 10 <= len(numbers) <= 22
    assert len(picked([view(i, x=0.01 * i, depth=0.5) for i in range(151)])) > 1.6 * len(
        picked([view(i, x=0.01 * i) for i in range(151)])
    ), "what is near moves more in the image"


def test_frames_far_apart_are_all_taken_however_blurred() -> None:
    assert picked([view(i, x=0.07 * i, blurred=i % 2 == 0) for i in range(20)]) == list(range(20))
    assert picked([view(i, yaw=math.radians(5 * i)) for i in range(20)]) == list(range(20))
    recording = walk()
    assert picked([recording[i] for i in range(len(recording))]) == list(range(len(recording)))


def test_of_blurred_and_sharp_views_the_sharp_ones_are_taken() -> None:
    assert sharpness(view(0).rgb) > 2 * sharpness(view(0, blurred=True).rgb)
    frames = [view(i, x=0.02 * i, blurred=i % 3 != 0) for i in range(61)]
    taken = picked(frames)
    assert len(taken) > 5 and all(number % 3 == 0 for number in taken)


def test_every_nth_frame_is_taken_as_told() -> None:
    frames = [view(i) for i in range(10)]
    assert picked(frames, 1) == list(range(10)) and picked(frames, 4) == [0, 4, 8]
    with pytest.raises(InputError, match="every 0th frame cannot be taken"):
        Keyframes(0)


def test_a_quarter_of_a_dense_recording_at_most_is_looked_at_and_gives_the_same_home() -> None:
    class Counts(TrueBoxes):
        looked = 0

        def detect(self, frame: Frame):  # type: ignore[no-untyped-def]
            self.looked += 1
            return super().detect(frame)

    recording, homes, counts = dense(6), [], []
    for every in (None, 1):
        detector = Counts(THINGS)
        homes.append(map_home(recording, detector, every=every))
        counts.append(detector.looked)
        assert homes[-1].settings["recordings"][0]["looked"] == detector.looked
    assert counts[1] == len(recording) == 180 and counts[0] <= 45
    some, every_frame = ({o.label: o.position for o in home.objects if o.confirmed} for home in homes)
    assert some.keys() == every_frame.keys() and len(some) >= 2
    assert all(np.linalg.norm(np.subtract(some[name], every_frame[name])) < 0.5 for name in some)
    assert homes[0].grid is not None and homes[1].grid is not None
    assert np.array_equal(homes[0].grid.cells, homes[1].grid.cells), "the floor plan takes all frames"
    assert homes[0].id != homes[1].id


def test_the_forecast_tells_about_how_many_frames_and_how_long() -> None:
    recording = dense(6)
    looked = map_home(recording, TrueBoxes(THINGS)).settings["recordings"][0]["looked"]
    looks, seconds = forecast(recording, TrueBoxes(THINGS))
    assert looked / 2 <= looks <= 2 * looked and 0 < seconds < 60
    assert forecast(recording, TrueBoxes(THINGS), 1)[0] == len(recording)
    assert forecast(recording, TrueBoxes(THINGS), 50)[0] == 4
    one = RoomRecording(recording.poses[:1], THINGS)
    assert forecast(one, TrueBoxes(THINGS))[0] == 1
    gaps = [b - a for a, b in itertools.pairwise(picked([recording[i] for i in range(len(recording))]))]
    assert max(gaps) < 30
