"""Keyframes that came faster than the detector works: on the disk until the stream has ended."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cartier.io.spool import SUFFIX, Keyframe, Spool, SpoolWriter
from cartier.mapping.repose import frame_key
from cartier.streams import Stamped
from cartier.types import Detections

MOST = 5000  # some 150 kB each


class Postponed:
    """Frames in, and out again in the order in which they came; a kill loses them."""

    def __init__(self) -> None:
        self._folder: TemporaryDirectory[str] | None = None
        self._writer: SpoolWriter | None = None
        self._keys: list[int] = []

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, stamped: Stamped) -> bool:
        """Keep a keyframe; returns whether there was room."""
        if len(self) == MOST:
            return False
        if self._folder is None or self._writer is None:
            self._folder = TemporaryDirectory(prefix="cartier-")
            self._writer = SpoolWriter(self._path, {})
        nothing = Detections(stamped.frame.index, np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
        self._writer.keyframe(Keyframe(stamped.frame, stamped.stamp_ns, nothing, stamped.odom_from_camera))
        self._keys.append(frame_key(stamped.frame))
        return True

    def __iter__(self) -> Iterator[tuple[Stamped, int]]:
        """Each frame, its colours as a JPEG has them, with the ``frame_key`` that it came with."""
        spool = Spool(self._path) if self._keys else None
        for place, key in zip(() if spool is None else spool.keyframes(), self._keys, strict=True):
            assert spool is not None
            kept = spool.keyframe(place)
            yield Stamped(kept.frame, kept.stamp_ns, odom_from_camera=kept.odom_from_camera), key

    def close(self) -> None:
        """Drop them."""
        if self._folder is not None and self._writer is not None:
            self._writer.close()
            self._folder.cleanup()
        self._folder, self._writer, self._keys = None, None, []

    @property
    def _path(self) -> Path:
        assert self._folder is not None
        return Path(self._folder.name) / f"postponed{SUFFIX}"
