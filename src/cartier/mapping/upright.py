"""Level floors and upright images: a recording of any source as the map needs it, by what ``gravity`` measures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Detector, Recording, RecordingDefaults, optional
from cartier.errors import check_pose
from cartier.geometry import transform
from cartier.mapping import gravity
from cartier.mapping.samples import Samples, few, sample
from cartier.types import Array, Camera, Frame, TrueObject

Rows = Sequence[Mapping[str, Any]]
Z_UP = (0.0, 0.0, 1.0)
FLOOR_OFF_M = 0.05  # in the built-in homes, with the faults of real sensors, a floor is measured to 1 mm
TURNED_BY = ("", "90° to the left", "180°", "90° to the right")


@dataclass(frozen=True, eq=False)
class Levelled:
    """What brings a recording into the conventions of a map: one note for each thing that is corrected.

    ``level_from_world`` (4, 4) takes its world to one with z up and the floor at z = 0; ``turns`` counts quarter turns
    of its images to the left.
    """

    level_from_world: npt.NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    turns: int = 0
    notes: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether the world is moved."""
        return not np.array_equal(self.level_from_world, np.eye(4))

    def changes(self) -> bool:
        """Whether anything is corrected."""
        return self.moves or self.turns != 0

    def row(self) -> dict[str, Any]:
        """JSON values; ``of_row`` takes them back."""
        return {"level": self.level_from_world[:3].ravel().tolist(), "turns": self.turns}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Levelled:
        """Raises InputError if ``level`` is no pose."""
        matrix = np.vstack([np.array(row["level"], np.float64).reshape(3, 4), (0, 0, 0, 1)])
        return cls(check_pose(matrix, "level"), int(row["turns"]) % 4)

    def pose(self, world_from_camera: Array) -> npt.NDArray[np.float64]:
        """The pose (4, 4) of the camera of the turned images in the level world."""
        pose = self.level_from_world @ world_from_camera if self.moves else world_from_camera
        return np.asarray(pose @ turned_camera(UNIT, self.turns)[1] if self.turns else pose)

    def frame(self, frame: Frame) -> Frame:
        """A frame of the recording, corrected."""
        if not self.changes():
            return frame
        rgb, depth_m, instances = (
            None if image is None else turned_image(image, self.turns)
            for image in (frame.rgb, frame.depth_m, frame.instances)
        )
        assert rgb is not None
        return replace(
            frame, rgb=rgb, depth_m=depth_m, instances=instances, world_from_camera=self.pose(frame.world_from_camera),
            camera=turned_camera(frame.camera, self.turns)[0],
        )  # fmt: skip


UNIT = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)


def measured(poses: Array, camera: Camera, depth_of: Callable[[int], Array | None] | None) -> Levelled:
    """How a recording lies whose world should have z up and the floor at z = 0.

    ``poses`` (N, 4, 4) of some of its frames; ``depth_of(i)`` gives their depth (h, w) by ``camera``. Without it, only
    how the images lie is measured.
    """
    if not len(poses):
        return Levelled()
    found = gravity.level(poses, camera, depth_of, documented_up=Z_UP)
    matrix, notes = np.eye(4), list[str]()
    lean_deg = float(np.degrees(np.arccos(np.clip(found.up[2], -1, 1))))
    if lean_deg > 0:
        matrix = found.level_from_world
        notes.append(
            f"the world leans by {lean_deg:.0f}°, as its horizontal surfaces show: levelled, with its floor at "
            f"{found.floor_m:.2f} m taken for z = 0"
        )
    elif found.floor_seen and abs(found.floor_m) > FLOOR_OFF_M:
        matrix[2, 3] = -found.floor_m
        notes.append(f"the floor lies at {found.floor_m:.2f} m, and is taken for z = 0")
    if found.turns:
        notes.append(f"the pictures {gravity.LYING[found.turns]}: turned by {TURNED_BY[found.turns]}")
    return Levelled(matrix, found.turns, tuple(notes))


class Upright:
    """Obeys the Recording contract: level, its images upright; its fingerprint is that of ``recording``."""

    def __init__(self, recording: Recording, levelled: Levelled) -> None:
        self._recording, self.levelled = recording, levelled
        self.camera = turned_camera(recording.camera, levelled.turns)[0]
        self.notes: Sequence[str] = (*recording.notes, *levelled.notes)
        self.truth = recording.truth
        if recording.truth is not None and levelled.moves:
            self.truth = [_moved(item, levelled.level_from_world) for item in recording.truth]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recording, name)

    def __len__(self) -> int:
        return len(self._recording)

    def __getitem__(self, index: int) -> Frame:
        return self.levelled.frame(self._recording[index])


def upright(
    recording: Recording, detector: Detector, onto: Rows | None = None, samples: Samples | None = None
) -> Upright:
    """The recording, level and upright as far as ``samples``, or else a few frames, show how it lies.

    One whose reader levels it stays so, and one that is added to recordings in the same world (``onto``, the rows that
    their home keeps of them) is levelled as they were. Images stay as they are for a detector whose boxes are of them.
    """
    samples = sample(recording, numbers=few(len(recording))) if samples is None else samples
    kept = np.eye(4) if optional(recording, RecordingDefaults, "level_from_world") is not None else None
    if onto:
        kept = next((Levelled.of_row(row).level_from_world for row in onto if row.get("level")), np.eye(4))
    if kept is None:
        found = measured(samples.poses, samples.small, samples.depth_m.__getitem__ if samples.has_depth else None)
    else:
        found = replace(measured(kept @ samples.poses, samples.small, None), level_from_world=kept)
    return Upright(recording, replace(found, turns=0) if optional(detector, Detector, "as_recorded") else found)


def images_key(recording: Recording) -> str:
    """The fingerprint of a recording's content, and how its images are turned."""
    levelled: Levelled | None = optional(recording, RecordingDefaults, "levelled")
    turned = f" turned {levelled.turns}" if levelled is not None and levelled.turns else ""
    return f"{recording.fingerprint()}{turned}"


def turned_camera(camera: Camera, turns: int) -> tuple[Camera, npt.NDArray[np.float64]]:
    """The camera of images turned to the left, and old_from_new (4, 4) of its axes."""
    old_from_new = np.eye(4)
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    for _ in range(turns):
        c = camera
        camera = Camera(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx)
        old_from_new = old_from_new @ quarter
    return camera, old_from_new


def turned_image(image: Array, turns: int) -> Array:
    """An image (H, W, ...) after quarter turns to the left."""
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def _moved(item: TrueObject, level_from_world: Array) -> TrueObject:
    corners = np.array(np.meshgrid(*zip(item.box_min, item.box_max, strict=True))).reshape(3, -1).T
    there = transform(level_from_world, corners)
    return replace(item, box_min=tuple(there.min(axis=0).tolist()), box_max=tuple(there.max(axis=0).tolist()))
