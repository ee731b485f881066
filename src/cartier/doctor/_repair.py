"""Repaired recording: the same frames, each repaired when it is read."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.doctor._report import Repair
from cartier.errors import InputError, frame_number
from cartier.recordings.common.posed import turned_camera, turned_image
from cartier.types import Camera, Frame, TrueObject


class RepairedRecording:
    """Obeys the Recording contract. ``truth`` is kept only if the repair does not move the world."""

    def __init__(self, recording: Recording, repair: Repair, notes: Sequence[str]) -> None:
        self._source, self._repair = recording, repair
        self.name, self.scale_guessed = recording.name, optional(recording, RecordingDefaults, "scale_guessed")
        self.camera, self._old_from_new = turned_camera(repaired_camera(recording.camera, repair), repair.turns)
        moved = repair.level is not None or repair.reading.before is not None
        self.truth: Sequence[TrueObject] | None = None if moved else recording.truth
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
        if repair.level is not None:
            pose = repair.level @ pose
        if depth_m is not None and repair.registration is not None:
            depth_m = repair.registration.register(depth_m)
        if depth_m is not None and reading.depth_scale != 1:
            depth_m = (depth_m * np.float32(reading.depth_scale)).astype(np.float32)
        rgb, depth_m, instances = (
            None if image is None else turned_image(image, repair.turns)
            for image in (frame.rgb, depth_m, frame.instances)
        )
        assert rgb is not None
        return replace(
            frame, index=index, rgb=rgb, depth_m=depth_m, instances=instances,
            world_from_camera=pose @ self._old_from_new, camera=self.camera,
        )  # fmt: skip

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
