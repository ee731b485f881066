"""What the doctor says, and what he would do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.doctor._edges import Registration
from cartier.doctor._readings import Reading

FAULTS = (
    "inverted_poses", "opengl_axes", "left_handed", "pose_scale", "depth_scale", "depth_not_registered",
    "intrinsics_resolution", "time_offset", "no_depth", "bad_rotation", "not_level", "rotated_images", "pose_jump", "blur", "too_few_views",
)  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong: its id (one of FAULTS; ``damaged_file`` in a home), what shows it, and how it is mended."""

    fault: str
    evidence: str
    mend: str


@dataclass(frozen=True, eq=False)
class Cure:
    """What ``mend`` does, in this order: leave frames out, read the poses anew, move the depth, level the world, turn the images.

    ``level`` (4, 4) or None takes the world of the mended poses to one with z up and z = 0 on the floor. ``depth_camera``
    tells whether the intrinsics given belong to the depth as it was, so that they are zoomed and moved with it. ``turns`` are quarter turns of the images to the left.
    """

    reading: Reading
    level: npt.NDArray[np.float64] | None = None
    registration: Registration | None = None
    depth_camera: bool = False
    left_out: frozenset[int] = frozenset()
    kept: tuple[int, int] | None = None
    turns: int = 0

    def changes(self) -> bool:
        """Whether there is anything to do."""
        reading = self.reading
        poses = reading.inverted or reading.before is not None or reading.after is not None or reading.shift != 0
        numbers = (
            reading.depth_scale != 1 or reading.camera_factor != (1.0, 1.0) or reading.positions != (1.0, 1.0, 1.0)
        )
        rest = (
            self.level is not None
            or self.registration is not None
            or self.left_out
            or self.kept is not None
            or self.turns
        )
        return bool(poses or numbers or rest)


@dataclass(frozen=True, eq=False)
class Exhibit:
    """Two frames for the picture: the numbers of ``a`` and ``b``, and how far a's depth, carried into b, is off there (m).

    ``given`` and ``mended`` are (h, w) images at b's pixels, NaN where nothing of a falls.
    """

    a: int
    b: int
    given: npt.NDArray[np.float32]
    mended: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Report:
    """The doctor's findings on ``name``, of so many ``frames`` (a home has none). ``notes`` say what was looked at and what could not be judged.

    ``contradictory`` tells that overlapping frames disagree and nothing was found that explains it: then ``ok`` is False
    although there may be no fault that has a name.
    """

    name: str
    frames: int
    faults: tuple[Fault, ...]
    notes: tuple[str, ...] = ()
    cure: Cure | None = None
    exhibit: Exhibit | None = None
    contradictory: bool = False

    @property
    def ok(self) -> bool:
        return not self.faults and not self.contradictory

    def to_dict(self) -> dict[str, Any]:
        """The object that ``cartier doctor --json`` prints."""
        faults = [{"fault": f.fault, "evidence": f.evidence, "mend": f.mend} for f in self.faults]
        return {"ok": self.ok, "faults": faults}
