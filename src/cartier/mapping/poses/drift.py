"""Pose drift: surfaces of an early and a late part of a recording that coincide only after one part is moved.

Oriented surface points are registered, point to plane (Chen and Medioni, Object modelling by registration of multiple
range images, 1992), by a turn about z and a shift: the poses are level already. Normals tell the two sides of a wall
apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartier.types import Array, Floats

POINTS, AGAINST = 1500, 7500  # that are moved, and that they are compared with
# Within which points may be the same, from pass to pass.
REACHES_M = (1.0, 1.0, 0.7, 0.7, 0.5, 0.5, 0.35, 0.35, 0.25, 0.25, 0.2, 0.15, 0.15)
NORMAL_M = 0.5  # what it costs a pair of points, per unit, that their normals differ
ALIKE = 0.8  # least cosine of the normals of one surface
FAR_NORMALS = (2 - 2 * ALIKE) ** 0.5 + 1e-6  # the greatest distance of two such normals
BESIDE_M, APART_M = 0.15, 0.05  # two points lie on one surface: so near, and so flat
DAMPING = 1e-2  # of the mean curvature: along a bare wall the shift is not determined
FEWEST = 100
SHARED, TIMES_MORE = 0.4, 1.25  # of the points that must come to lie on the others, and against how many before
TWICE_M = 0.1  # two cells of the floor plan, across the surfaces (root mean square): surfaces appear twice in the map


class Drift(NamedTuple):
    """How a later part must be moved to lie on an earlier one, and which shares of it do before and after."""

    shift_m: float
    turn_deg: float
    before: float
    after: float


def find_drift(parts: Sequence[Floats]) -> Drift | None:
    """The largest drift between parts of a recording, points and unit normals (N, 6) in m, z up; None without one."""
    found = [_between(late, early) for i, early in enumerate(parts) for late in parts[i + 1 :]]
    return max(
        (drift for drift in found if drift is not None), key=lambda drift: drift.after - drift.before, default=None
    )


def _between(late: Floats, early: Floats) -> Drift | None:
    from scipy.spatial import cKDTree

    if min(len(late), len(early)) < FEWEST:
        return None
    order = np.random.default_rng(0)
    late, early = order.permutation(late)[:POINTS], order.permutation(early)[:AGAINST]
    tree = cKDTree(np.hstack([early[:, :3], NORMAL_M * early[:, 3:]]))
    middle, motion = late[:, :3].mean(axis=0), np.zeros(4)

    def pairs(reach_m: float) -> tuple[Array, Array, Array]:
        """The moved late points, the early points nearest to them, and which of the pairs are of one surface."""
        turn = _about_z(motion[0])
        points, normals = (late[:, :3] - middle) @ turn.T + middle + motion[1:], late[:, 3:] @ turn.T
        bound_m = np.hypot(reach_m, NORMAL_M * FAR_NORMALS)  # what is farther is not of one surface
        nearest = tree.query(np.hstack([points, NORMAL_M * normals]), distance_upper_bound=bound_m)[1]
        other = early[np.minimum(nearest, len(early) - 1)]
        same = (nearest < len(early)) & (np.linalg.norm(points - other[:, :3], axis=1) < reach_m)
        return points, other, same & ((normals * other[:, 3:]).sum(axis=1) > ALIKE)

    def share() -> float:
        points, other, same = pairs(BESIDE_M)
        return float((same & (np.abs(((points - other[:, :3]) * other[:, 3:]).sum(axis=1)) < APART_M)).mean())

    before = share()
    least = max(SHARED, TIMES_MORE * before)
    if least > 1:
        return None  # no better fit would tell
    for reach_m in REACHES_M:
        points, other, same = pairs(reach_m)
        if same.sum() < FEWEST:
            return None
        motion = motion + _step(points[same] - middle - motion[1:], points[same], other[same], reach_m)
    after = share()
    across_m = float(np.sqrt(np.square(((pairs(BESIDE_M)[0] - late[:, :3]) * late[:, 3:]).sum(axis=1)).mean()))
    if after < least or across_m < TWICE_M:
        return None
    return Drift(float(np.linalg.norm(motion[1:])), abs(float(np.degrees(motion[0]))), before, after)


def _step(arms: Floats, points: Floats, other: Floats, reach_m: float) -> Floats:
    """The turn about z (rad) and shift (m) that bring points (N, 3) onto the planes of others (N, 6), robustly."""
    normals = other[:, 3:]
    off = ((other[:, :3] - points) * normals).sum(axis=1)
    slopes = np.column_stack([normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1], normals])
    weights = 1 / (1 + np.square(off / (reach_m / 3)))
    curvature = slopes.T @ (slopes * weights[:, None])
    curvature += DAMPING * np.trace(curvature) / 4 * np.eye(4)
    return np.asarray(np.linalg.solve(curvature, slopes.T @ (weights * off)), dtype=np.float64)


def _about_z(angle_rad: float) -> Floats:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
