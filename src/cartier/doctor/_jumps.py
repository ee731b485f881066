"""Poses that jump while the images do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.doctor._consistency import Pairs, motions, turns_deg
from cartier.doctor._sampling import Samples
from cartier.types import Array, Camera

PIXELS = 300
AROUND = 5  # steps on each side that say how fast the camera usually moves here
TIMES, LEAST_M, LEAST_DEG = 2.0, 0.12, 15.0
TYPICAL_STEPS, STRAY_FRAMES = 24, 3


@dataclass(frozen=True)
class Jump:
    """The pose leaps by ``way_m`` and ``turn_deg`` from frame ``before`` to ``after``, but the images show less.

    ``agreement`` is that of the two frames by their poses, ``without`` that by the motion of the steps around.
    """

    before: int
    after: int
    way_m: float
    turn_deg: float
    agreement: float
    without: float


def jumps(samples: Samples, poses: Array, scale: float, small: Camera) -> list[Jump]:
    """Steps between consecutive frames that are much longer than those around, and that the depth contradicts.

    A true leap (a recording of several walks) shows other things before and after, and no usual motion explains it.
    """
    known = np.isfinite(poses[:, 0, 0])
    at = np.flatnonzero((np.diff(samples.index) == 1) & known[1:] & known[:-1])
    if len(at) < 3:
        return []
    pairs = np.stack([at, at + 1], axis=1)
    motion = motions(poses, pairs)
    way, turn = np.linalg.norm(motion[:, :3, 3], axis=1), turns_deg(motion)
    long = (way > np.maximum(TIMES * _usual(way), LEAST_M)) | (turn > np.maximum(TIMES * _usual(turn), LEAST_DEG))
    found = [int(i) for i in np.flatnonzero(long)]
    if not found:
        return []
    normal = np.flatnonzero(~long)
    if not len(normal):
        return []
    by_length = normal[np.argsort(way[normal], kind="stable")]
    some = by_length[np.unique(np.linspace(0, len(normal) - 1, 100).astype(int))]
    typical = _middle(_scores(samples, pairs[some], motion[some], scale, small))
    steps = by_length[np.unique(np.linspace(0, len(normal) - 1, TYPICAL_STEPS).astype(int))]
    result = []
    for i in found:
        given = _middle(_scores(samples, pairs[i : i + 1], motion[i : i + 1], scale, small))
        others = _usual_motions(motion, [*steps, *(j for j in range(i - 3, i + 4) if j in normal)], i)
        best = float(
            np.nan_to_num(
                _scores(samples, np.repeat(pairs[i : i + 1], len(others), axis=0), others, scale, small)
            ).max()
        )
        if best > 0.6 * typical and best > 1.7 * given:
            numbers = samples.index[pairs[i]]
            result.append(Jump(int(numbers[0]), int(numbers[1]), float(way[i]), float(turn[i]), given, best))
    return result


def _usual(values: Array) -> npt.NDArray[np.float64]:
    """The median of each value's neighbours."""
    padded = np.pad(values, AROUND, mode="reflect" if len(values) > AROUND else "edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1), axis=1), dtype=np.float64
    )


def _usual_motions(motion: Array, steps: Sequence[int], i: int) -> Array:
    """What the camera may have done at step i instead: stand still, only turn, or move as in other steps."""
    still, turned = np.eye(4), motion[i].copy()
    turned[:3, 3] = 0
    options = [still, turned]
    for j in steps:
        onward = turned.copy()
        onward[:3, 3] = motion[j][:3, 3]
        options += [motion[j], onward]
    return np.array(options)


def _middle(scores: Array) -> float:
    known = scores[np.isfinite(scores)]
    return float(np.median(known)) if known.size else 0.0


def _scores(samples: Samples, pairs: Array, motion: Array, scale: float, small: Camera) -> Array:
    return Pairs(samples, pairs, PIXELS).agreement(motion, scale, small).score


def stray(found: Sequence[Jump], poses: Array, index: Array) -> tuple[frozenset[int], list[Jump]]:
    """The numbers of frames that jump away and back, and the jumps that remain without them.

    ``poses`` (M, 4, 4) are those of the frames with numbers ``index`` (M,).
    """
    left_out: set[int] = set()
    remaining: list[Jump] = []
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
