"""Poses between samples of a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.recordings.common.poses import matrices
from cartier.types import Array

MAX_GAP_S = 1.0
STILL_M, STILL_RAD = 0.1, 0.1  # two poses as near as this on both sides of a gap: it stood still in between


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Rows (N, 7) ``x y z qx qy qz qw``; which of them lie outside of the samples' time, and which in gaps."""

    rows: npt.NDArray[np.float64]
    outside: npt.NDArray[np.bool_]
    in_gaps: npt.NDArray[np.bool_]

    def matrices(self) -> npt.NDArray[np.float64]:
        """(N, 4, 4)."""
        return matrices(self.rows)


def interpolated(table: Array, times_s: Array) -> Interpolated:
    """Straight lines between positions and slerp between rotations of samples (M, 8), at each time."""
    times = np.asarray(times_s, dtype=np.float64)
    known = table[:, 0]
    outside = (times < known[0]) | (times > known[-1])
    after = np.clip(np.searchsorted(known, times), 1, max(1, len(known) - 1))
    a, b = table[after - 1], table[np.minimum(after, len(known) - 1)]
    span = b[:, 0] - a[:, 0]
    with np.errstate(over="ignore"):  # times outside of two samples that all but coincide: cut to 0 or 1
        share = np.clip(np.divide(times - a[:, 0], span, out=np.zeros_like(times), where=span > 0), 0, 1)
    rotation, angle = _slerp(a[:, 4:], b[:, 4:], share)
    position = a[:, 1:4] + share[:, None] * (b[:, 1:4] - a[:, 1:4])
    moved = (np.linalg.norm(b[:, 1:4] - a[:, 1:4], axis=1) > STILL_M) | (angle > STILL_RAD)
    between = (share > 0) & (share < 1)
    return Interpolated(np.hstack([position, rotation]), outside, (span > MAX_GAP_S) & moved & between)


def _slerp(a: Array, b: Array, share: Array) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Unit quaternions (N, 4) between two, on the shorter way, and the whole angle of the rotation in radians."""
    cosine = np.einsum("ij,ij->i", a, b)
    b = b * np.copysign(1, cosine)[:, None]
    half = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(half)
    flat = sine < 1e-6
    safe = np.where(flat, 1, sine)
    weight_a = np.where(flat, 1 - share, np.sin((1 - share) * half) / safe)
    weight_b = np.where(flat, share, np.sin(share * half) / safe)
    mixed = weight_a[:, None] * a + weight_b[:, None] * b
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True), 2 * half
