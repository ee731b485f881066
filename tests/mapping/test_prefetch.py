"""Prefetching: frames in order, by as many threads as a recording allows, and batches that give the same map."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.pipeline import map_home
from cartier.types import Camera, Detections, Frame
from synthetic import THINGS, RoomRecording, TrueBoxes, walk


class Read(RoomRecording):
    """A room that notes who reads what, and how many at once."""

    readers = 4
    broken = -1

    def __init__(self) -> None:
        super().__init__(walk().poses, THINGS)
        self.lock, self.threads, self.begun, self.now, self.most = threading.Lock(), set[str](), 0, 0, 0

    def __getitem__(self, index: int) -> Frame:
        with self.lock:
            self.threads.add(threading.current_thread().name)
            self.begun, self.now = self.begun + 1, self.now + 1
            self.most = max(self.most, self.now)
        time.sleep(0.002 * (index % 3))  # so that a later frame is ready before an earlier one
        try:
            if index == self.broken:
                raise InputError(f"frame {index} is broken")
            return super().__getitem__(index)
        finally:
            with self.lock:
                self.now -= 1


def read(readers: int) -> Read:
    recording = Read()
    recording.readers = readers
    return recording


@pytest.fixture(autouse=True)
def four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 4)


@pytest.mark.parametrize("readers", [0, 1, 4])
def test_all_frames_come_in_order_from_as_many_threads_as_may(readers: int) -> None:
    recording, plain = read(readers), walk()
    for number, frame in enumerate(prefetch(recording)):
        assert frame.index == number and np.array_equal(frame.rgb, plain[number].rgb)
        assert recording.begun <= number + 1 + max(2 * readers - 1, 0), "a recording is never held whole"
    assert recording.begun == len(recording) == number + 1
    assert recording.most <= max(readers, 1)
    own = threading.current_thread().name
    assert (recording.threads == {own}) if readers == 0 else (own not in recording.threads)


def test_on_one_core_nothing_is_read_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    recording = read(4)
    next(iter(prefetch(recording)))
    assert recording.begun == 1 and recording.threads == {threading.current_thread().name}


def test_a_broken_frame_is_told_when_its_turn_comes_and_no_thread_stays() -> None:
    recording = read(4)
    recording.broken, seen = 7, list[int]()
    with pytest.raises(InputError, match="frame 7 is broken"):
        for frame in prefetch(recording):
            seen.append(frame.index)
    assert seen == list(range(7))
    stopped = prefetch(read(4))
    next(stopped)
    stopped.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("cartier reader")]


class Batches(TrueBoxes):
    """True boxes that are asked for many frames at once."""

    batch = 6

    def __init__(self) -> None:
        super().__init__(THINGS)
        self.asked: list[list[int]] = []

    def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
        self.asked.append([frame.index for frame in frames])
        return [self.detect(frame) for frame in frames]


def test_batches_make_the_same_home(tmp_path: Path) -> None:
    detector = Batches()
    alone, together = map_home(walk(), TrueBoxes(THINGS), every=1), map_home(read(4), detector, every=1)
    assert together.id == alone.id and together.to_dict() == alone.to_dict() and together.growth == alone.growth
    assert [len(of) for of in detector.asked] == [6, 6, 6, 2]
    assert [*itertools.chain(*detector.asked)] == list(range(20))


def test_a_run_that_was_killed_between_batches_asks_only_for_the_rest(tmp_path: Path) -> None:
    class Dies(Batches):
        def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
            if len(self.asked) == 2:
                raise KeyboardInterrupt
            return super().detect_batch(frames)

    resume = tmp_path / "unfinished.jsonl"
    with pytest.raises(KeyboardInterrupt):
        map_home(walk(), Dies(), every=1, resume=resume)
    again = Batches()
    home = map_home(walk(), again, every=1, resume=resume)
    assert [*itertools.chain(*again.asked)] == list(range(12, 20))
    assert home.to_dict() == map_home(walk(), TrueBoxes(THINGS), every=1).to_dict()


def test_few_large_frames_are_held_at_once() -> None:
    detector = Batches()
    detector.batch = 16
    sizes = {batch_size(detector, Camera(w, h, 500, 500, w / 2, h / 2)) for w, h in ((640, 480), (1920, 1080))}
    assert sizes == {16}
    assert batch_size(detector, Camera(3840, 2160, 500, 500, 1920, 1080)) == 4
    assert batch_size(TrueBoxes(THINGS), Camera(8000, 8000, 500, 500, 4000, 4000)) == 1
