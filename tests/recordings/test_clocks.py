"""Clocks that go back, run apart or are two: no frame ever has a pose of another time."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import FRAME, OPTICAL, START_NS, BagFile, opened
from hypothesis import given
from hypothesis import strategies as st

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.recordings.common.clock import restarts
from cartier.types import Camera

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")
CAMERA = Camera(16, 12, 12.0, 12.0, 7.5, 5.5)
Clock = Callable[[float], float]


def base_at(true_s: float) -> np.ndarray:
    base = np.eye(4)
    base[:2, 3] = 0.5 * true_s, np.sin(true_s)
    return base


def write(
    bag: BagFile, seconds: float, images: Clock, transforms: Clock, logged: Clock = lambda t: t, begin_s: float = 0.0
) -> None:
    """A drive: 10 images and 50 transforms a second by clocks of the true time; an image's colour is its number."""
    m = bag.messages

    def ns(time_s: float) -> int:
        return START_NS + round(time_s * 1e9)

    bag.put("/tf_static", ns(logged(begin_s)), m.transforms((0, "base_link", FRAME, OPTICAL)))
    for step in range(round(seconds * 50) + 1):
        true_s = begin_s + step / 50
        log, stamp = ns(logged(true_s)), ns(transforms(true_s))
        bag.put(
            "/tf", log, m.transforms((stamp, "odom", "base_link", base_at(true_s)), (stamp, "map", "odom", np.eye(4)))
        )
        if step % 5 == 0:
            stamp, number = ns(images(true_s)), round(true_s * 10)
            bag.put("/c/camera_info", log, m.info(stamp, FRAME, CAMERA))
            bag.put("/c/image_raw", log, m.image(stamp, FRAME, np.full((12, 16, 3), number, np.uint8), "rgb8"))
            depth = np.full((12, 16), 1000 + number, np.uint16)
            bag.put("/d/image_raw", log, m.image(stamp, FRAME, depth, "16UC1"))


def numbers_of(found: Recording) -> list[int]:
    """The images' numbers, each with its own depth and the pose of its own time."""
    numbers = []
    for frame in found:
        number = int(frame.rgb[0, 0, 0])
        assert frame.depth_m is not None and frame.depth_m[0, 0] == pytest.approx(1 + number / 1000)
        assert np.abs(frame.world_from_camera - base_at(number / 10) @ OPTICAL).max() < 0.01
        numbers.append(number)
    return numbers


def set_back(*steps: tuple[float, float]) -> Clock:
    """A clock that is set back by seconds at true times."""
    return lambda true_s: true_s - sum(back_s for at_s, back_s in steps if true_s >= at_s - 1e-9)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "ros1"])
@pytest.mark.parametrize(
    ("steps", "kept", "says"),
    [
        ([(1.0, 1.0)], range(10, 31), "time goes back by 1 s after 0.9 s"),
        ([(1.0, 0.3)], range(10, 31), "time goes back by 0.3 s after 0.9 s"),
        ([(2.0, 0.05)], range(20), "time goes back by 0.05 s after 1.98 s"),
        ([(0.5, 0.5), (2.5, 2.0)], range(5, 25), r"time goes back by 0.5 s after 0.4 s \(2 times in all\)"),
        ([(2.0, -500.0)], range(31), None),
    ],
)
def test_only_the_longest_run_is_used(
    tmp_path: Path, kind: str, steps: list[tuple[float, float]], kept: Sequence[int], says: str | None
) -> None:
    with BagFile(tmp_path / "a", kind) as bag:
        write(bag, 3.0, set_back(*steps), set_back(*steps))
    found = opened(tmp_path / "a")
    assert numbers_of(found) == list(kept)
    notes = [note for note in found.notes if "time goes back" in note]
    assert len(notes) == bool(says)
    if says:
        assert re.match(says, notes[0]) and f"{len(kept)} of 31 images" in notes[0]


def test_recorder_whose_clock_went_back_too(tmp_path: Path) -> None:
    clock = set_back((1.0, 1.0))
    with BagFile(tmp_path / "a") as bag:
        write(bag, 3.0, clock, clock, clock)
    assert numbers_of(opened(tmp_path / "a")) == list(range(10, 31))


def test_odometry_is_cut_as_transforms_are(tmp_path: Path) -> None:
    clock = set_back((1.0, 1.0))
    with BagFile(tmp_path / "a") as bag:
        write(bag, 3.0, clock, lambda true_s: true_s + 9000)
        for step in range(151):
            true_s = step / 50
            ns, log = (START_NS + round(s * 1e9) for s in (clock(true_s), true_s))
            bag.put("/odom", log, bag.messages.odometry(ns, "odom", "base_link", base_at(true_s)))
    assert numbers_of(opened(tmp_path / "a", odometry="/odom")) == list(range(10, 31))


def test_runs_that_cannot_be_told_apart(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write(bag, 3.0, set_back((1.0, 1.0)), set_back((1.0, 1.0), (2.0, 1.0)))
    with pytest.raises(InputError, match="cannot be told which poses belong to which images"):
        opened(tmp_path / "a")


def test_one_late_message_begins_no_run(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write(bag, 1.0, lambda true_s: true_s, lambda true_s: true_s - 0.15 * (abs(true_s - 0.5) < 0.001))
    found = opened(tmp_path / "a")
    assert len(found) == 11 and not [note for note in found.notes if "time goes back" in note]


def test_two_recordings_in_one_folder(tmp_path: Path) -> None:
    (tmp_path / "both").mkdir()
    for name, begin_s, seconds in (("b", 0.0, 1.0), ("a", 10.0, 2.0)):
        with BagFile(tmp_path / name) as bag:
            write(bag, seconds, lambda true_s: true_s, lambda true_s: true_s, lambda true_s: true_s * 60, begin_s)
        next((tmp_path / name).glob("*.mcap")).rename(tmp_path / "both" / f"{name}.mcap")
    found = opened(tmp_path / "both")
    assert numbers_of(found) == list(range(100, 121))
    assert any(n.startswith("2 recordings lie in one folder; only the longest of 2 runs is used") for n in found.notes)


@pytest.mark.parametrize(("apart_s", "which"), [(2.0, "behind"), (-0.8, "ahead of")])
def test_clocks_that_differ_are_said(tmp_path: Path, apart_s: float, which: str) -> None:
    with BagFile(tmp_path / "a") as bag:
        write(bag, 4.0, lambda true_s: true_s - apart_s, lambda true_s: true_s)
    says = f"the images' stamps are {abs(apart_s):g} s {which} those of the transforms"
    assert [note for note in opened(tmp_path / "a").notes if note.startswith(says)]


def test_clocks_of_other_epochs_are_said(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write(bag, 1.0, lambda true_s: true_s - START_NS / 1e9, lambda true_s: true_s)
    with pytest.raises(InputError, match=r"the images' stamps are 1.7e\+09 s behind .*: their clocks differ"):
        opened(tmp_path / "a")


def test_transforms_of_a_lost_tracker_leave_out_frames(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write(bag, 1.0, lambda true_s: true_s, lambda true_s: true_s + 9000)
        m = bag.messages
        for step in range(51):
            ns = START_NS + step * 20_000_000
            message: Any = m.odometry(ns, "odom", "base_link", base_at(step / 50))
            message.pose.pose.position.x += np.nan if step in (25, 29) else 0.0  # at an image, and before one
            bag.put("/odom", ns, message)
    found = opened(tmp_path / "a", odometry="/odom")
    assert numbers_of(found) == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    assert "1 images left out: the poses beside them are NaN (tracking was lost)" in found.notes


@given(st.lists(st.integers(3, 9), min_size=1, max_size=5), st.integers(0, 4))
def test_restarts_are_where_clocks_were_set(lengths: list[int], late: int) -> None:
    times = np.concatenate([np.arange(length, dtype=float) for length in lengths])
    ends = np.cumsum(lengths)
    assert restarts(times) == [(int(end), float(length)) for end, length in zip(ends[:-1], lengths[:-1], strict=True)]
    once = np.arange(9.0)
    once[[late, late + 1]] = once[[late + 1, late]]
    assert restarts(once) == []
