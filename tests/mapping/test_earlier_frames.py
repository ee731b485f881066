"""Earlier frames: what shows up late should have been seen before; few frames are kept, however many there were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartier.mapping.existence import MAX_EARLIER, EarlierFrames, coarse_camera, coarse_step
from cartier.mapping.object_map import ObjectMap
from cartier.types import Camera, Detections
from synthetic import THINGS, TrueBoxes, walk

CAMERA = Camera(640, 480, 500.0, 480.0, 310.5, 245.5)


def mapped(order: list[int], silent: int = 0) -> ObjectMap:
    """A walk in some order; in the first ``silent`` frames nothing is detected."""
    recording, detector, made = walk(), TrueBoxes(THINGS), ObjectMap(TrueBoxes.score_model)
    for step, number in enumerate(order):
        found = detector.detect(recording[number])
        made.add(recording[number], found.keep(np.zeros(len(found), bool)) if step < silent else found)
    return made


def test_frames_before_the_first_detection_count() -> None:
    numbers = list(range(len(walk())))
    late = mapped(numbers, silent=len(numbers) // 2)
    since = mapped(numbers[len(numbers) // 2 :])
    assert len(late) == len(since)
    tried, only_since = (made.evidence()[0] for made in (late, since))
    assert tried.sum() > 1.2 * only_since.sum()


def test_kept_frames_are_few_and_even() -> None:
    kept, frame = EarlierFrames(), walk()[0]
    for number in range(1000):
        pose = frame.world_from_camera.copy()
        pose[0, 3] = number
        kept.add(replace(frame, world_from_camera=pose))
    at = kept.state()["earlier_pose"][:, 0, 3]
    assert MAX_EARLIER / 2 <= len(at) <= MAX_EARLIER
    assert len(set(np.diff(at))) == 1 and at[0] == 0 and at[-1] > 900
    again = EarlierFrames()
    again.restore(kept.state())
    for name, array in kept.state().items():
        np.testing.assert_array_equal(again.state()[name], array)


def test_coarse_frame_shows_points_where_the_frame_does() -> None:
    camera, small, step = CAMERA, coarse_camera(CAMERA), coarse_step(CAMERA)
    assert small.width * small.height < 1500
    for x, y in ((0.21, -0.13), (0, 0), (-0.4, 0.3)):  # of rays
        full, few = ((int(x * c.fx + c.cx), int(y * c.fy + c.cy)) for c in (camera, small))
        assert abs(full[0] - few[0] * step - step // 2) <= step / 2 + 1
        assert abs(full[1] - few[1] * step - step // 2) <= step / 2 + 1


def test_no_depth_no_evidence() -> None:
    kept, frame = EarlierFrames(), walk(with_depth=False)[0]
    kept.add(frame)
    assert kept.state() == {} and isinstance(TrueBoxes(THINGS).detect(frame), Detections)
