"""What explains most of a contradiction: the mount's angles and arm, a lag, the lens, the scale of the depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cartier.doctor._consistency import FEWEST_PAIRS, Pairs, judge, near_pairs
from cartier.doctor.checks import tilt
from cartier.mapping.samples import Samples
from cartier.recordings.common.poses import interpolated
from cartier.types import Array, Camera

DEGREES = (2, 4, 6, 8, 10, 12, 15, 20, 25, 30)
SECONDS = (0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
METRES = (0.1, 0.2, 0.3, 0.5)
FACTORS = (0.67, 0.75, 0.8, 0.85, 0.9, 1.1, 1.15, 1.25, 1.33, 1.5)
GAIN = 0.08  # of the agreement, below which nothing is explained
FLOOR_M = 0.1
Changed = tuple[str, Array, float, Camera]


def explained(samples: Samples) -> str:
    """Which one change makes overlapping frames agree best, in words; empty if none helps."""
    pairs = Pairs(samples, np.concatenate(near_pairs(samples)))
    if len(pairs) < FEWEST_PAIRS:
        return ""
    now = judge(pairs, samples.poses, 1.0, samples.small)
    judged = [(words, judge(pairs, poses, scale, small)) for words, poses, scale, small in _changes(samples)]
    words, best = max(judged, key=lambda pair: pair[1].fit)
    if best.fit > now.fit + GAIN and best.score > now.score + GAIN:
        return f"{words} explains most of it (agreement {best.score:.2f} against {now.score:.2f})"
    found = tilt(samples, samples.poses, 1.0, samples.small) if samples.has_depth else None
    if found is not None and found.floor_seen and abs(found.floor_m) > FLOOR_M:
        return f"height: the floor lies at {found.floor_m:.2f} m, so the camera's mount is off by as much"
    return ""


def _changes(samples: Samples) -> Iterator[Changed]:
    poses, small = samples.poses, samples.small
    for name, axis in (("yaw", "y"), ("pitch", "x"), ("roll", "z")):
        for degrees in _both(DEGREES):
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
            yield f"{name}: a mount that is turned by {degrees:g}°", poses @ turn, 1.0, small
    for name, column in (("height", 1), ("reach", 2)):
        for metres in _both(METRES):
            moved = np.eye(4)
            moved[column, 3] = metres
            yield f"{name}: a mount that is off by {abs(metres):g} m", poses @ moved, 1.0, small
    rows = np.column_stack([samples.times_s, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])
    if len(rows) > 1 and (np.diff(samples.times_s) > 0).all():
        for seconds in _both(SECONDS):
            then = interpolated(rows, samples.times_s + seconds)
            late = then.matrices()
            late[then.outside] = np.nan
            yield f"lag: poses that are {abs(seconds):g} s {'early' if seconds > 0 else 'late'}", late, 1.0, small
    for factor in FACTORS:
        lens = replace(small, fx=small.fx * factor, fy=small.fy * factor)
        yield f"lens: a focal length that is {1 / factor:.2f} times too long", poses, 1.0, lens
        yield f"scale: a depth that is {1 / factor:.2f} times too far", poses, factor, small


def _both(values: tuple[float, ...]) -> Iterator[float]:
    for value in values:
        yield value
        yield -value
