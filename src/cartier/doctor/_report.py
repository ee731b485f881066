"""Findings of an examination: faults, the repair that corrects them, and the two frames that serve as evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.doctor.hypotheses import Reading
from cartier.recordings.common.edges import Registration

FAULTS = (
    "inverted_poses", "opengl_axes", "left_handed", "pose_scale", "depth_scale", "depth_not_registered",
    "intrinsics_resolution", "time_offset", "no_depth", "bad_rotation", "not_level", "rotated_images", "pose_jump",
    "blur", "too_few_views",
)  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """One fault: its id (one of FAULTS; ``damaged_file`` in a home), the evidence, and how to repair it.

    ``fix`` is what ``cartier doctor --fix`` does about it, if it can: of a stream nobody can ask for that.
    """

    fault: str
    evidence: str
    repair: str
    fix: str = ""

    @property
    def how(self) -> str:
        """How to repair it in a recording."""
        return f"{self.repair}; --fix {self.fix}" if self.fix else self.repair

    def to_dict(self) -> dict[str, str]:
        """Plain JSON values, with how to repair it as ``repair``."""
        return {"fault": self.fault, "evidence": self.evidence, "repair": self.how}


@dataclass(frozen=True, eq=False)
class Repair:
    """Leave frames out, reinterpret poses and depth, move the depth, level the world, turn the images: in this order.

    ``level`` (4, 4) takes the world of the repaired poses to one with z up and the floor at z = 0; None leaves it.
    With ``depth_camera`` the given intrinsics belong to the unregistered depth and move with it. ``kept`` is the first
    and the last frame to keep. ``turns`` counts quarter turns of the images to the left.
    """

    reading: Reading
    level: npt.NDArray[np.float64] | None = None
    registration: Registration | None = None
    depth_camera: bool = False
    left_out: frozenset[int] = frozenset()
    kept: tuple[int, int] | None = None
    turns: int = 0

    def changes(self) -> bool:
        """Whether anything is to be changed."""
        others = self.registration or self.left_out or self.kept or self.turns
        return bool(others or self.level is not None or self.reading.changes())


@dataclass(frozen=True, eq=False)
class EvidencePair:
    """Two overlapping frames, and how far (m) the depth of ``a``, carried into ``b``, differs from b's own depth.

    ``given`` and ``repaired`` are (h, w) images at b's pixels, NaN where no point of a falls.
    """

    a: int
    b: int
    given: npt.NDArray[np.float32]
    repaired: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Report:
    """Findings on the recording or home ``name``; ``frames`` is 0 for a home.

    ``notes`` say how much was examined and what could not be judged. ``contradictory``: overlapping frames disagree
    and no fault explains it; then ``ok`` is False although ``faults`` may be empty.
    """

    name: str
    frames: int
    faults: tuple[Fault, ...]
    notes: tuple[str, ...] = ()
    repair: Repair | None = None
    pair: EvidencePair | None = None
    contradictory: bool = False

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults and not self.contradictory

    def to_dict(self) -> dict[str, Any]:
        """The object that ``cartier doctor --json`` prints."""
        return {"ok": self.ok, "faults": [fault.to_dict() for fault in self.faults]}
