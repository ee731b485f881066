"""Poses of a stream's frames as they were sent, and as they were corrected later.

A correction names some frames, and is of all from the first to the last of them: between two of them the corrections of
both are blended by time. Before the first frame that was ever named and after the last, the nearest holds. Where a
correction moved the newest frames, too, the frames that come after it are in the corrected world already, and what is
named before them says nothing of them.
"""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartier.geometry import invert
from cartier.mapping.poses.motions import Matrix, blended, moved
from cartier.types.streams import Stamped

MOST = 20_000  # poses that are remembered besides those of keyframes: of more, every other one


class SentPoses:
    """Remembers poses (4, 4), world_from_camera, by the frames' stamps (ns), which rise; any thread may ask and add."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._sent: dict[int, Matrix] = {}
        self._held: set[int] = set()
        self._named: dict[int, Matrix] = {}
        self._stamps: list[int] = []  # of what is named, sorted
        self._breaks: list[int] = []  # the last frames before what came in the corrected world

    def add(self, stamp_ns: int, pose: Matrix) -> None:
        """A frame was sent with a pose."""
        with self._lock:
            self._sent[stamp_ns] = pose
            if len(self._sent) - len(self._held) > MOST:
                gone = set([ns for ns in self._sent if ns not in self._held][:-1:2])
                self._sent = {ns: pose for ns, pose in self._sent.items() if ns not in gone}

    def hold(self, stamp_ns: int, pose: Matrix) -> None:
        """A frame that was sent with this pose became a keyframe: its pose is remembered for good."""
        with self._lock:
            self._sent.setdefault(stamp_ns, pose)  # it may have been forgotten while it waited
            self._held.add(stamp_ns)

    def correct(self, poses: Mapping[int, Matrix]) -> bool:
        """Take in corrected poses; returns whether one of them moved by 2 cm or half a degree.

        Poses of frames that were never sent are passed over.
        """
        with self._lock:
            known = {ns: pose for ns, pose in poses.items() if ns in self._sent}
            if not any(moved(pose, self.pose(ns, self._sent[ns])) for ns, pose in known.items()):
                return False
            first, last = min(known), max(known)
            self._named = {ns: pose for ns, pose in self._named.items() if not first <= ns <= last} | known
            self._stamps = sorted(ns for ns in self._named if ns in self._sent)
            newest = max(self._sent)
            if moved(self.pose(newest, self._sent[newest]), self._sent[newest]) and newest not in self._breaks:
                self._breaks.append(newest)
            return True

    def pose(self, stamp_ns: int, sent: Matrix) -> Matrix:
        """The pose of a frame by what is known now; ``sent`` itself where no correction is of it."""
        with self._lock:
            return self._pose(stamp_ns, sent)

    def _pose(self, stamp_ns: int, sent: Matrix) -> Matrix:
        if stamp_ns in self._named:
            return self._named[stamp_ns]
        part = bisect_left(self._breaks, stamp_ns)
        low = bisect_right(self._stamps, self._breaks[part - 1]) if part else 0
        high = bisect_right(self._stamps, self._breaks[part]) if part < len(self._breaks) else len(self._stamps)
        if low == high:
            return sent
        after = bisect_right(self._stamps, stamp_ns, low, high)
        one, two = self._stamps[max(after - 1, low)], self._stamps[min(after, high - 1)]
        before, behind = (np.asarray(self._named[ns] @ invert(self._sent[ns]) @ sent) for ns in (one, two))
        return blended(before, behind, (stamp_ns - one) / (two - one)) if one < stamp_ns < two else before

    def now(self, stamped: Stamped) -> Stamped:
        """A frame with the pose that is known now."""
        with self._lock:
            sent = self._sent.get(stamped.stamp_ns, stamped.frame.world_from_camera)
            pose = self._pose(stamped.stamp_ns, sent)
        if pose is stamped.frame.world_from_camera:
            return stamped
        return replace(stamped, frame=replace(stamped.frame, world_from_camera=pose))

    def current(self, stamp_ns: int) -> Matrix:
        """The pose of a keyframe by what is known now."""
        with self._lock:
            return self._pose(stamp_ns, self._sent[stamp_ns])
