"""Tiny recordings of a room of boxes with their truth, for fleets that are mapped in a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from cartier.blob_stores import BlobStore
from cartier.recordings import folder as own_format
from cartier_fleet.jobs import MapSettings, Task, find_tasks
from cartier_fleet.worker import Outcome, Worker
from synthetic import THINGS, RoomRecording, walk

SETTINGS = MapSettings("ground_truth", every=1)


def make_recordings(root: Path, count: int = 3, frames: int = 4) -> list[Task]:
    """Recordings of one room, each from another part of a walk; the first lies in a folder of its own."""
    poses = walk().poses
    for number in range(count):
        name = f"flat-{number}" if number else "nested/flat-0"
        begin = number * 2 % (len(poses) - frames)
        own_format.save(RoomRecording(poses[begin : begin + frames], THINGS, name=name), root / name)
    return find_tasks(root)


def broken(root: Path, name: str = "broken") -> Task:
    """A recording of which a frame is damaged."""
    own_format.save(RoomRecording(walk().poses[:2], THINGS, name=name), root / name)
    min((root / name / "rgb").iterdir()).write_bytes(b"no picture")
    return Task(str(root / name), name)


def worker(store: BlobStore, owner: str = "one", lease_s: float = 60.0) -> Worker:
    return Worker(store, SETTINGS, owner, lease_s)


def work(store: BlobStore, tasks: Sequence[Task], owner: str = "one") -> list[str]:
    """The states of tasks after one worker had each once."""
    one = worker(store, owner)
    return [one.map(task).state for task in tasks]


def wait_for(condition: Callable[[], object], seconds: float = 20.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.01)


def content_of(folder: Path) -> dict[str, bytes]:
    """All files below a folder by their names."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


__all__ = ["SETTINGS", "Outcome", "broken", "content_of", "make_recordings", "wait_for", "work", "worker"]
