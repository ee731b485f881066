"""Pose jumps: steps between consecutive poses that the images contradict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.doctor._consistency import Pairs, motions, turns_deg
from cartier.mapping.samples import Samples
from cartier.types import Array, Camera

PIXELS = 300
AROUND = 5  # steps on each side that the usual speed is taken from
TIMES, LEAST_M, LEAST_DEG = 2.0, 0.12, 15.0
TYPICAL_STEPS, STRAY_FRAMES = 24, 3
VIDEO_AGREEMENT = 0.3  # median agreement of normal steps below which the frames are no video
FITS, TIMES_BETTER, AGREES, DISPUTED = 0.6, 1.7, 0.7, 0.2
AS_ALIKE = 0.9  # of the other motion's correlation of brightness: a pose that reaches it is taken for right
ALIKE, ALIKE_UNSEEN = 0.5, 0.8  # of the usual correlation; the second if by their poses the frames do not overlap


@dataclass(frozen=True)
class PoseJump:
    """A jump by ``way_m`` and ``turn_deg`` from frame ``before`` to ``after`` that the images do not show.

    ``agreement`` is that of the two frames by their poses, ``without`` that by a motion as in the steps around.
    """

    before: int
    after: int
    way_m: float
    turn_deg: float
    agreement: float
    without: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """How K motions explain a step in both directions: ``met``, ``agreed`` (Agreement), ``alike`` (Pairs); (K,)."""

    met: Array
    agreed: Array
    alike: Array


def pose_jumps(samples: Samples, poses: Array, scale: float, small: Camera) -> list[PoseJump]:
    """Steps between consecutive frames that are much longer than those around, and that the images contradict.

    Another motion must make the depth of the two frames agree, better than their poses do. It must also make their
    brightness agree, above all if by their poses the frames do not overlap: after a turn by 90° on the spot, one wall
    may be as far as another.
    """
    known = np.isfinite(poses[:, 0, 0])
    at = np.flatnonzero((np.diff(samples.index) == 1) & known[1:] & known[:-1])
    if len(at) < 3:
        return []
    pairs = np.stack([at, at + 1], axis=1)
    motion = motions(poses, pairs)
    way, turn = np.linalg.norm(motion[:, :3, 3], axis=1), turns_deg(motion)
    steps_m, steps_deg = (moved / _gaps(samples.times_s[pairs]) for moved in (way, turn))
    long = (steps_m > np.maximum(TIMES * _usual(steps_m), LEAST_M)) | (
        steps_deg > np.maximum(TIMES * _usual(steps_deg), LEAST_DEG)
    )
    normal = np.flatnonzero(~long)
    if not long.any() or not len(normal):
        return []
    by_length = normal[np.argsort(way[normal], kind="stable")]
    some = by_length[np.unique(np.linspace(0, len(normal) - 1, 100).astype(int))]
    typical = _fit(samples, pairs[some], motion[some], scale, small)
    if _middle(typical.met) < VIDEO_AGREEMENT:
        return []
    steps = by_length[np.unique(np.linspace(0, len(normal) - 1, TYPICAL_STEPS).astype(int))]
    result = []
    for i in np.flatnonzero(long).tolist():
        others = _usual_motions(motion, [*steps, *(j for j in range(i - 3, i + 4) if j in normal)], i)
        tried = np.concatenate([motion[i : i + 1], others])
        fit = _fit(samples, np.repeat(pairs[i : i + 1], len(tried), axis=0), tried, scale, small)
        best = 1 + int(np.nan_to_num(fit.met[1:]).argmax())
        if _contradicted(fit, best, typical):
            numbers = samples.index[pairs[i]]
            given, without = float(np.nan_to_num(fit.met[0])), float(fit.met[best])
            result.append(PoseJump(int(numbers[0]), int(numbers[1]), float(way[i]), float(turn[i]), given, without))
    return result


def _contradicted(fit: _Fit, best: int, typical: _Fit) -> bool:
    """Whether the motion ``best`` explains the images and the first one, that of the poses, does not."""
    given, without = np.nan_to_num(fit.met[[0, best]])
    agreed, agreed_without = fit.agreed[[0, best]]
    unseen = np.isnan(agreed)
    disputed = unseen or agreed < agreed_without - DISPUTED
    fits = without > FITS * _middle(typical.met) and without > TIMES_BETTER * given and agreed_without > AGREES
    alike = fit.alike[best] > (ALIKE_UNSEEN if unseen else ALIKE) * _middle(typical.alike)
    as_alike = not unseen and fit.alike[0] > AS_ALIKE * fit.alike[best]
    return bool(disputed and fits and alike and not as_alike)


def _gaps(times_s: Array) -> npt.NDArray[np.float64]:
    """The time between pairs of frames (P, 2), in usual steps, at least 1: a missing frame is no jump."""
    spans = np.diff(times_s, axis=1)[:, 0]
    usual = float(np.median(spans))
    return np.maximum(spans / usual, 1.0) if usual > 0 else np.ones(len(spans))


def _usual(values: Array) -> npt.NDArray[np.float64]:
    """The median of each value's neighbours."""
    padded = np.pad(values, AROUND, mode="reflect" if len(values) > AROUND else "edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1), axis=1), dtype=np.float64
    )


def _usual_motions(motion: Array, steps: Sequence[int], i: int) -> Array:
    """Other motions that step i may have had: none, only its turn, or those of other steps."""
    still, turned = np.eye(4), motion[i].copy()
    turned[:3, 3] = 0
    options = [still, turned]
    for j in steps:
        onward = turned.copy()
        onward[:3, 3] = motion[j][:3, 3]
        options += [motion[j], onward]
    return np.array(options)


def _middle(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


def _fit(samples: Samples, pairs: Array, motion: Array, scale: float, small: Camera) -> _Fit:
    ways = []
    for those, there in ((pairs, motion), (pairs[:, ::-1], np.linalg.inv(motion))):
        carried = Pairs(samples, those, PIXELS)
        found = carried.agreement(there, scale, small)
        ways.append((found.met, found.agreed, carried.alike(there, scale, small)))
    met, agreed, alike = (
        np.where(np.isnan(a), b, np.where(np.isnan(b), a, (a + b) / 2)) for a, b in zip(*ways, strict=True)
    )
    return _Fit(met, agreed, alike)


def split_strays(found: Sequence[PoseJump], poses: Array, index: Array) -> tuple[frozenset[int], list[PoseJump]]:
    """The numbers of stray frames, which jump away and back, and the jumps that remain without them.

    ``poses`` (M, 4, 4) are those of the frames with numbers ``index`` (M,).
    """
    left_out: set[int] = set()
    remaining: list[PoseJump] = []
    i = 0
    while i < len(found):
        away, back = found[i], found[i + 1] if i + 1 < len(found) else None
        if back is not None and back.before - away.after < STRAY_FRAMES:
            ends = poses[np.searchsorted(index, [away.before, back.after])]
            if np.linalg.norm(ends[1, :3, 3] - ends[0, :3, 3]) < 0.5 * away.way_m:
                left_out |= set(range(away.after, back.before + 1))
                i += 2
                continue
        remaining.append(away)
        i += 1
    return frozenset(left_out), remaining
