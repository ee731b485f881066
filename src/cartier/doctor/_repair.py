"""Repaired recording: the same frames, each repaired when it is read; ``Upright`` levels and turns them then."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.doctor._report import Repair
from cartier.errors import InputError, frame_number
from cartier.types import Camera, Frame, TrueObject


class RepairedRecording:
    """Obeys the Recording contract. ``truth`` is kept only if the reading does not move the world."""

    def __init__(self, recording: Recording, repair: Repair, notes: Sequence[str]) -> None:
        self._source, self._repair = recording, repair
        self.name, self.scale_guessed = recording.name, optional(recording, RecordingDefaults, "scale_guessed")
        self.camera = repaired_camera(recording.camera, repair)
        self.truth: Sequence[TrueObject] | None = None if repair.reading.before is not None else recording.truth
        self.notes: Sequence[str] = [*recording.notes, *notes]
        first, last = repair.kept or (0, len(recording) - 1)
        posed = range(-repair.reading.shift, len(recording) - repair.reading.shift)  # these get another frame's pose
        self._numbers = [i for i in range(first, last + 1) if i not in repair.left_out and i in posed]
        if not self._numbers:
            raise InputError(f"{recording.name}: every frame is faulty; record it again")

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: int) -> Frame:
        number = self._numbers[frame_number(index, len(self), self.name)]
        frame, repair = self._source[number], self._repair
        reading, depth_m = repair.reading, frame.depth_m
        posed = self._source[number + reading.shift] if reading.shift else frame
        pose = reading.poses(posed.world_from_camera[None])[0]
        if depth_m is not None and repair.registration is not None:
            depth_m = repair.registration.register(depth_m)
        if depth_m is not None and reading.depth_scale != 1:
            depth_m = (depth_m * np.float32(reading.depth_scale)).astype(np.float32)
        return replace(frame, index=index, depth_m=depth_m, world_from_camera=pose, camera=self.camera)

    def fingerprint(self) -> str:
        repair, reading = self._repair, self._repair.reading
        what: list[object] = [sorted(repair.left_out), repair.kept, repair.registration, repair.depth_camera]
        what += [reading.shift, repair.turns]
        what += [reading.depth_scale, reading.camera_factor, reading.positions, reading.inverted]
        matrices = (repair.level, reading.level, reading.before, reading.after)
        what += [None if m is None else np.asarray(m).tolist() for m in matrices]
        return hashlib.sha256(f"mended 2 {self._source.fingerprint()} {what}".encode()).hexdigest()


def repaired_camera(given: Camera, repair: Repair) -> Camera:
    """The intrinsics of the repaired images: for their size, and moved with the depth if they belonged to it."""
    camera, moved = repair.reading.camera(given), repair.registration
    if moved is None or not repair.depth_camera:
        return camera
    return moved.camera(camera)
