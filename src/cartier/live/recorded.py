"""Keyframes of a live session on the disk, from before they are looked at; their poses there follow all corrections."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cartier.errors import InputError
from cartier.io.spool import MAGIC, SUFFIX, Keyframe, Place, Spool, SpoolWriter
from cartier.live.sent_poses import SentPoses
from cartier.mapping.poses.motions import Matrix
from cartier.types import Detections
from cartier.types.streams import Stamped

SAME = ("detector", "detector_sha256", "onto")  # what a session that goes on must have in common with its beginning


class Recorded:
    """Keyframes by their stamps (ns); any thread may add to them.

    Args:
        path: The spool, or None for one that is removed in the end.
        about: What the session is.
        sent: The poses of its frames.

    Raises:
        InputError: The spool cannot be written, or a session with another detector or home was cut off in it.
    """

    def __init__(self, path: Path | None, about: Mapping[str, Any], sent: SentPoses) -> None:
        self._own_folder = None if path is not None else TemporaryDirectory(prefix="cartier-")
        self.path = path or Path(str(self._own_folder and self._own_folder.name)) / f"keyframes{SUFFIX}"
        self._sent, self._lock = sent, threading.Lock()
        self._places: dict[int, tuple[Place, Place | None]] = {}  # of a keyframe and of its detections
        self._written: dict[int, Matrix] = {}  # the poses that the spool has of them
        _check_goes_on(self.path, about)
        self._writer = SpoolWriter(self.path, about)
        self._spool = Spool(self.path)
        self._cut_off = self._spool.unsaved()
        self.cut_off_count = len(self._cut_off)
        """How many keyframes a session that was cut off left."""

    def cut_off(self) -> Iterator[Keyframe]:
        """The keyframes of a session that was cut off, numbered from 0; they are of this one from now on."""
        for number, place in enumerate(self._cut_off):
            kept = self._spool.keyframe(place, number)
            self._hold(place, self._spool.seen.get(place.start), kept.stamp_ns, kept.frame.world_from_camera)
            yield kept

    def _hold(self, place: Place, seen: Place | None, stamp_ns: int, pose: Matrix) -> None:
        self._sent.hold(stamp_ns, pose)
        self._places[stamp_ns], self._written[stamp_ns] = (place, seen), pose

    def add(self, stamped: Stamped) -> None:
        """Write a keyframe, so that no kill loses it."""
        self._sent.hold(stamped.stamp_ns, stamped.frame.world_from_camera)
        told = self._sent.now(stamped).frame
        place = self._writer.keyframe(Keyframe(told, stamped.stamp_ns, None, stamped.odom_from_camera))
        with self._lock:
            self._hold(place, None, stamped.stamp_ns, told.world_from_camera)
            self._correct("", [stamped.stamp_ns])  # by what came while it was written

    def seen(self, stamp_ns: int, found: Detections) -> None:
        """Write the detections of a keyframe."""
        with self._lock:
            place, _ = self._places[stamp_ns]
            self._places[stamp_ns] = place, self._writer.seen(place, found)

    def read(self, stamp_ns: int, index: int | None = None) -> Keyframe:
        """A keyframe, as frame ``index`` or as its own. Raises InputError if it is damaged."""
        place, seen = self._places[stamp_ns]
        return self._spool.keyframe(place, index, seen)

    def correct(self, origin: str) -> None:
        """Write the poses that have changed."""
        with self._lock:
            self._correct(origin, list(self._written))

    def _correct(self, origin: str, stamps_ns: list[int]) -> None:
        now = {ns: self._sent.current(ns) for ns in stamps_ns}
        changed = {ns: pose for ns, pose in now.items() if not np.array_equal(pose, self._written[ns])}
        if changed:
            self._writer.poses(origin, changed)
            self._written |= changed

    def ended(self, home_id: str) -> None:
        """The home is saved."""
        self._writer.ended(home_id)

    def close(self) -> None:
        self._writer.close()
        if self._own_folder is not None:
            self._own_folder.cleanup()


def _check_goes_on(path: Path, about: Mapping[str, Any]) -> None:
    if not path.exists() or path.stat().st_size < len(MAGIC):
        return
    spool = Spool(path)
    begun = spool.begin()
    lost = [name for name in SAME if begun.get(name) != about[name]] if begun and not spool.ended else []
    if lost:
        was = "another home" if lost == ["onto"] else f"the detector {begun.get('detector')}"
        raise InputError(f"{path} was begun with {was}, and was cut off: go on with that, or move the file away")
