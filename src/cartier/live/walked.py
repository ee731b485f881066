"""What a live session walked, as the recording that the mapper ends with."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from cartier.contracts import Recording, Source, SourceDefaults, optional
from cartier.mapping.upright import Levelled
from cartier.types import Camera, Frame, TrueObject

KEPT = 16  # frames by which the domain of the pictures is judged
KEPT_EVERY = 25


class Walked:
    """Obeys what ``Mapper.finish`` reads of a Recording: it counts the frames and hashes them as they pass.

    Some frames are kept, without depth; a number stands for the nearest of them.
    """

    camera: Camera

    def __init__(self, source: Source) -> None:
        played: Recording | None = optional(source, SourceDefaults, "recording")
        self.name = source.name
        self.truth: Sequence[TrueObject] | None = None if played is None else played.truth
        self.notes: Sequence[str] = ()
        self.levelled: Levelled | None = None
        self._hash, self._count = hashlib.sha256(b"cartier live 1"), 0
        self._kept: list[Frame] = []

    def add(self, frame: Frame, stamp_ns: int) -> None:
        """Count a frame."""
        self._hash.update(stamp_ns.to_bytes(8, "big", signed=True))
        self._hash.update(frame.world_from_camera.tobytes() + np.ascontiguousarray(frame.rgb[::16, ::16]).tobytes())
        if not self._count:
            self.camera = frame.camera
        if self._count % KEPT_EVERY == 0 and len(self._kept) < KEPT:
            self._kept.append(frame)
        self._count += 1

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Frame:
        return self._kept[min(index // KEPT_EVERY, len(self._kept) - 1)]

    def fingerprint(self) -> str:
        return self._hash.copy().hexdigest()
