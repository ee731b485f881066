"""A growing folder in cartier's own format, as a phone or a program uploads it: folder:DIR.

A frame is complete once its line stands in trajectory.txt and its images can be read: so write the images first.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cartier.contracts import Source
from cartier.errors import InputError, brief
from cartier.io import images
from cartier.recordings.common.files import MAX_TABLE_BYTES
from cartier.recordings.common.poses import matrices, trajectory_row
from cartier.recordings.folder import HEAD, TRAJECTORY, image_files, read_head
from cartier.sources.common.pacing import QUIET_S
from cartier.types import Camera, Frame
from cartier.types.streams import Event, Fault, Stamped

POLL_S = 0.1
UPLOAD_S = 5.0  # how long an image may take to arrive after its line


def make(model: str, idle_s: float = 0.0) -> Source:
    """``model`` is the folder; it may still be empty. With ``idle_s`` the stream ends once nothing came for so long.

    Raises InputError if it is no folder.
    """
    root = Path(model)
    if not root.is_dir():
        raise InputError(f"{root} is no folder: make it, and let the upload write into it")
    return GrowingFolder(root, float(idle_s))


class GrowingFolder:
    """Obeys the Source contract."""

    waits = True
    recording = None

    def __init__(self, root: Path, idle_s: float) -> None:
        self.name, self.notes = root.resolve().name, list[str]()
        self._root, self._idle_s = root, idle_s
        self._closed = threading.Event()
        self._read_bytes = self._lines = 0
        self._rows: list[list[float]] = []

    def __iter__(self) -> Iterator[Event]:
        heard_s = told_s = time.monotonic()
        count, number, last_ns, head = 0, 0, -1, None
        while not self._closed.is_set():
            head = head or self._head()
            event = None if head is None else self._next(head, number, count, last_ns, heard_s)
            if isinstance(event, Stamped):
                count, last_ns = count + 1, event.stamp_ns
            if event is not None:
                number, heard_s, told_s = number + 1, time.monotonic(), time.monotonic()
                yield event
                continue
            if self._idle_s and time.monotonic() - heard_s >= self._idle_s:
                return
            if time.monotonic() - told_s >= QUIET_S - POLL_S:
                told_s = time.monotonic()
                yield Fault("silent", self._why(head))
            self._closed.wait(POLL_S)

    def close(self) -> None:
        self._closed.set()

    def _head(self) -> tuple[str, Camera, bool] | None:
        """The camera, once it is written whole."""
        try:
            return read_head(self._root)
        except InputError:
            return None

    def _why(self, head: tuple[str, Camera, bool] | None) -> str:
        if head is None:
            return f"{self._root / HEAD} is not there yet, or not whole: it says which camera took the pictures"
        return f"{self._root / TRAJECTORY} has {self._lines} poses, and no more come"

    def _next(
        self, head: tuple[str, Camera, bool], number: int, count: int, last_ns: int, heard_s: float
    ) -> Event | None:
        """The frame on line ``number``, or why it is left out; None while it is not complete."""
        try:
            if number >= len(self._rows):
                self._read_more()
            if number >= len(self._rows):
                return None
            frame = self._frame(head, number, count)
        except InputError as error:
            waits = number < len(self._rows) and time.monotonic() - heard_s < UPLOAD_S
            return None if waits else Fault("unreadable", brief(error, 300), 1)
        stamp_ns = round(frame.time_s * 1e9)
        if stamp_ns <= last_ns:
            return Fault("late", f"{self._root / TRAJECTORY}: frame {number} is older than the one before it", 1)
        return Stamped(frame, stamp_ns)

    def _frame(self, head: tuple[str, Camera, bool], number: int, count: int) -> Frame:
        _, camera, has_depth = head
        row = self._rows[number]
        colour, depth = image_files(self._root, number)
        return Frame(
            index=count,
            time_s=row[0],
            rgb=images.read_rgb(colour, camera),
            depth_m=images.read_depth(depth, camera) if has_depth else None,
            world_from_camera=matrices(np.array([row[1:]]))[0],
            camera=camera,
        )

    def _read_more(self) -> None:
        """Take in the whole lines that were added."""
        path = self._root / TRAJECTORY
        if not path.is_file() or path.stat().st_size <= self._read_bytes:
            return
        with path.open("rb") as file:
            file.seek(self._read_bytes)
            data = file.read(MAX_TABLE_BYTES)
        whole = data[: data.rfind(b"\n") + 1]
        self._read_bytes += len(whole)
        for line in whole.decode("utf-8", "replace").splitlines():
            if line.strip() and not line.startswith("#"):
                self._lines += 1
                self._rows.append(trajectory_row(line, f"{path} pose {self._lines}"))
