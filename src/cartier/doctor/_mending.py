"""The recording as it should have been: the same frames, mended one by one when they are asked for."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.doctor._edges import zoomed
from cartier.doctor._report import Cure
from cartier.errors import InputError, frame_number
from cartier.recordings.common.posed import turned_camera, turned_image
from cartier.types import Camera, Frame, TrueObject


class Mended:
    """Obeys the Recording contract. ``truth`` is kept only while the world stays where it was."""

    def __init__(self, recording: Recording, cure: Cure, notes: Sequence[str]) -> None:
        self._source, self._cure = recording, cure
        self.name, self.scale_guessed = recording.name, optional(recording, RecordingDefaults, "scale_guessed")
        self.camera, self._old_from_new = turned_camera(mended_camera(recording.camera, cure), cure.turns)
        moved = cure.level is not None or cure.reading.before is not None
        self.truth: Sequence[TrueObject] | None = None if moved else recording.truth
        self.notes: Sequence[str] = [*recording.notes, *notes]
        first, last = cure.kept or (0, len(recording) - 1)
        shift = cure.reading.shift
        self._numbers = [
            i for i in range(first, last + 1) if i not in cure.left_out and 0 <= i + shift < len(recording)
        ]
        if not self._numbers:
            raise InputError(f"{recording.name}: no frame is left once the faulty ones are taken out; record it again")

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: int) -> Frame:
        number = self._numbers[frame_number(index, len(self), self.name)]
        frame, cure = self._source[number], self._cure
        reading = cure.reading
        posed = self._source[number + reading.shift] if reading.shift else frame
        pose = reading.poses(posed.world_from_camera[None])[0]
        depth_m = frame.depth_m
        if depth_m is not None and cure.registration is not None:
            depth_m = zoomed(depth_m, cure.registration.zoom, cure.registration.dx, cure.registration.dy)
        if depth_m is not None and reading.depth_scale != 1:
            depth_m = (depth_m * np.float32(reading.depth_scale)).astype(np.float32)
        pose = pose if cure.level is None else cure.level @ pose
        rgb, depth_m, instances = (
            None if image is None else turned_image(image, cure.turns)
            for image in (frame.rgb, depth_m, frame.instances)
        )
        assert rgb is not None
        return replace(
            frame,
            index=index,
            rgb=rgb,
            depth_m=depth_m,
            instances=instances,
            world_from_camera=pose @ self._old_from_new,
            camera=self.camera,
        )

    def fingerprint(self) -> str:
        cure = self._cure
        what: list[object] = [
            sorted(cure.left_out),
            cure.kept,
            cure.registration,
            cure.depth_camera,
            cure.reading.shift,
            cure.turns,
        ]
        what += [cure.reading.depth_scale, cure.reading.camera_factor, cure.reading.positions, cure.reading.inverted]
        matrices = (cure.level, cure.reading.level, cure.reading.before, cure.reading.after)
        what += [None if m is None else np.asarray(m).tolist() for m in matrices]
        return hashlib.sha256(f"mended 2 {self._source.fingerprint()} {what}".encode()).hexdigest()


def mended_camera(given: Camera, cure: Cure) -> Camera:
    """The camera of the mended images: read at the right size, and moved with the depth where it was the depth's."""
    camera, moved = cure.reading.camera(given), cure.registration
    if moved is None or not cure.depth_camera:
        return camera
    middle_x, middle_y = (camera.width - 1) / 2, (camera.height - 1) / 2
    return replace(
        camera,
        fx=camera.fx * moved.zoom,
        fy=camera.fy * moved.zoom,
        cx=(camera.cx - middle_x) * moved.zoom + middle_x + moved.dx * camera.width,
        cy=(camera.cy - middle_y) * moved.zoom + middle_y + moved.dy * camera.width,
    )
