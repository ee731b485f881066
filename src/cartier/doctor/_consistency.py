"""The doctor's tool: do two overlapping frames agree when the depth of one is carried into the other?

Every pixel sample of frame a is back-projected, moved into frame b and compared with b's depth there. What is moved is
``b_from_a``, so any reading of the poses, the depth's unit or the intrinsics can be tried on the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.doctor._sampling import Samples
from cartier.types import Array, Camera

PER_PAIR, LOOK = 600, 50  # pixels of a pair that are compared, and that tell whether it overlaps at all
SPREAD, MOST_PAIRS, FEWEST_PAIRS = 36, 80, 5
CAP = 0.06  # of the distance: beyond, two depths do not agree at all
Floats64 = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well P pairs agree: ``score`` (P,) from 0 to 1, and ``off_m``, the median depth difference where both see.

    ``landed`` (P,) is the share of the pixels that fall into the other image. A pair without any reading has NaN.
    """

    score: Floats64
    off_m: float
    landed: Floats64


class Pairs:
    """P pairs (a, b) of sampled frames, with the pixels of a drawn once."""

    def __init__(self, samples: Samples, pairs: Array, pixels: int = PER_PAIR) -> None:
        self.samples = samples
        self.pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        height, width = samples.grey.shape[1:]
        step = max(1, round((height * width / pixels) ** 0.5))
        rows, cols = np.meshgrid(np.arange(step // 2, height, step), np.arange(step // 2, width, step), indexing="ij")
        self._rows, self._cols = rows.ravel(), cols.ravel()
        self._z = samples.depth_m[self.pairs[:, :1], self._rows, self._cols]

    def __len__(self) -> int:
        return len(self.pairs)

    def shares(self, b_from_a: Array, scale: float, small: Camera) -> Floats64:
        """The share (P,) of a's readings that fall into b's image."""
        inside = self._carry(b_from_a, scale, small)[3]
        read = np.isfinite(self._z).sum(axis=1)
        return np.asarray(inside.sum(axis=1) / np.maximum(read, 1), dtype=np.float64)

    def agreement(self, b_from_a: Array, scale: float = 1.0, small: Camera | None = None) -> Agreement:
        """The agreement of (P, 4, 4) motions, with the depth times ``scale``, seen by the small camera or another one."""
        camera = small or self.samples.small
        moved, u, v, inside = self._carry(b_from_a, scale, camera)
        there = self.samples.depth_m[self.pairs[:, 1:], v, u] * np.float32(scale)
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.abs(moved - there)
            fits = np.where(inside, 1 - off / (CAP * moved), 0)
        seen = np.isfinite(self._z) & ~(inside & np.isnan(there))
        fits = np.clip(np.nan_to_num(fits), 0, 1)
        count = seen.sum(axis=1)
        both = seen & inside
        enough = count >= 30
        score = np.where(enough, (fits * seen).sum(axis=1) / np.maximum(count, 1), np.nan)
        off_m = float(np.median(off[both])) if both.any() else float("nan")
        return Agreement(score, off_m, np.where(enough, both.sum(axis=1) / np.maximum(count, 1), np.nan))

    def _carry(self, b_from_a: Array, scale: float, camera: Camera) -> tuple[Array, Array, Array, Array]:
        """z in b (P, n), the pixel there, and whether it lies in the image."""
        z = self._z * np.float32(scale)
        points = np.stack(
            [z * ((self._cols - camera.cx) / camera.fx), z * ((self._rows - camera.cy) / camera.fy), z], axis=-1
        ).astype(np.float32)
        motion = np.asarray(b_from_a, dtype=np.float32)
        points = points @ motion[:, :3, :3].transpose(0, 2, 1) + motion[:, None, :3, 3]
        height, width = self.samples.grey.shape[1:]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            u = np.rint(points[..., 0] / points[..., 2] * camera.fx + camera.cx)
            v = np.rint(points[..., 1] / points[..., 2] * camera.fy + camera.cy)
            inside = (points[..., 2] > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        u, v = (np.where(inside, x, 0).astype(np.int64) for x in (u, v))
        return points[..., 2], u, v, inside


@dataclass(frozen=True, eq=False)
class Verdict:
    """How well a reading makes frames agree: the mean ``score`` (0 to 1) of ``pairs`` (P, 2), and the median ``off_m``."""

    score: float
    off_m: float
    pairs: npt.NDArray[np.int64]


def judge(samples: Samples, poses: Array, scale: float, small: Camera) -> Verdict:
    """Let pairs that overlap in this reading of poses (M, 4, 4; NaN = none), depth and camera vote on it.

    Each reading chooses its own pairs: a wrong one may bring other frames together, but they will not agree.
    """
    pairs = overlapping(samples, poses, scale, small)
    if len(pairs) < FEWEST_PAIRS:
        return Verdict(0.0, float("nan"), pairs)
    found = Pairs(samples, pairs).agreement(motions(poses, pairs), scale, small)
    there = found.landed > 0.1
    score = float(np.mean(found.score[there] / found.landed[there])) if there.sum() >= FEWEST_PAIRS else 0.0
    return Verdict(score, found.off_m, pairs)


def overlapping(samples: Samples, poses: Array, scale: float, small: Camera) -> npt.NDArray[np.int64]:
    """Pairs (P, 2) of frames that share a view, those first that turn and move most in between: they tell most."""
    usable = np.flatnonzero(np.isfinite(poses[:, 0, 0]) & (samples.read > 0.05))
    usable = usable[np.unique(np.linspace(0, len(usable) - 1, SPREAD).round().astype(int))] if len(usable) else usable
    a, b = (grid.ravel() for grid in np.meshgrid(usable, usable, indexing="ij"))
    pairs: npt.NDArray[np.int64] = np.stack([a, b], axis=1)[a != b].astype(np.int64)
    if not len(pairs):
        return pairs
    motion = motions(poses, pairs)
    turn, way = turns_deg(motion), np.linalg.norm(motion[:, :3, 3], axis=1)
    share = Pairs(samples, pairs, LOOK).shares(motion, scale, small)
    shared = (share > 0.2) & ((turn > 2) | (way > 0.02))
    pairs, turn, way, share = pairs[shared], turn[shared], way[shared], share[shared]
    far = np.minimum(way / max(float(np.median(way)), 1e-9), 1) if len(way) else way
    apart = np.abs(samples.index[pairs[:, 0]] - samples.index[pairs[:, 1]]) / samples.length
    worth = share + np.minimum(turn / 40, 1) + far / 2 - apart / 2
    best: npt.NDArray[np.int64] = pairs[np.argsort(-worth, kind="stable")[:MOST_PAIRS]]
    return best


def motions(poses: Array, pairs: Array) -> Floats64:
    """``b_from_a`` (P, 4, 4) of pairs (P, 2) of camera poses."""
    return np.asarray(np.linalg.inv(poses[pairs[:, 1]]) @ poses[pairs[:, 0]], dtype=np.float64)


def turns_deg(motion: Array) -> Floats64:
    """The angles of rotations (..., 4, 4) or (..., 3, 3)."""
    trace = np.trace(motion[..., :3, :3], axis1=-2, axis2=-1)
    return np.asarray(np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))), dtype=np.float64)
