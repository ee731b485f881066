"""Registration of surfaces, point to plane, by a turn about z and a shift: poses are level already.

Chen and Medioni, Object modelling by registration of multiple range images, 1992. A correction (4,) of a frame is the
turn (rad) about the camera and the shift (m) of the camera. Normals tell the two sides of a wall apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
NORMAL_M = 0.5  # what it costs a pair of points, per unit, that their normals differ
ALIKE = 0.8  # least cosine of the normals of one surface
FEWEST = 30
POINT_SIGMA_M = 0.02
WORTH = 100  # points near each other are off together: more than so many determine no more
BESIDE_M, FLAT_M, SHARED = 0.1, 0.05, 0.3  # what fits in the end, and of which share of the points that is asked
APART_M, CAP_M = 0.5, 0.15


@dataclass(frozen=True, eq=False)
class Surface:
    """Points and unit normals (n, 6) that one frame shows, in the camera's frame, and the frame's pose (4, 4)."""

    world_from_camera: Floats
    points: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.points)

    def first(self, count: int) -> Surface:
        """Only so many of the points."""
        return Surface(self.world_from_camera, self.points[:count])

    def placed(self, correction: Floats, count: int | None = None) -> Floats:
        """The (first ``count``) points and normals (n, 6) in the world, by the corrected pose."""
        points = self.points[:count].astype(np.float64)
        turn = about_z(correction[0]) @ self.world_from_camera[:3, :3]
        shift = self.world_from_camera[:3, 3] + correction[1:]
        return np.hstack([points[:, :3] @ turn.T + shift, points[:, 3:] @ turn.T])


class Registered(NamedTuple):
    """The correction (4,) found, and the root (4, 4) of its information; None where too few points fit."""

    correction: Floats
    root: Floats | None


def corrected(one: Surface, correction: Floats, other: Surface) -> Floats:
    """The correction (4,) of a frame that moves along with another one, which has ``correction``."""
    way = other.world_from_camera[:3, 3] - one.world_from_camera[:3, 3]
    return np.concatenate([correction[:1], about_z(correction[0]) @ way - way + correction[1:]])


def register(
    surface: Surface, start: Floats, against: Floats, reaches_m: Sequence[float], sigma: Floats
) -> Registered | None:
    """Fit a frame to points and normals (m, 6) of the world.

    Args:
        surface: The frame.
        start: (4,) its correction to begin with.
        against: What it is fitted to.
        reaches_m: Within which points may be the same, from pass to pass.
        sigma: (4,) how far from the start it may lie; this holds where surfaces determine nothing.

    Returns:
        The correction, or None where too few points may be the same.
    """
    from scipy.spatial import cKDTree

    if len(against) < FEWEST:
        return None
    tree, found, prior = cKDTree(_in_six(against)), start, np.diag(1 / sigma**2)
    for reach_m in reaches_m:
        points = surface.placed(found)
        other, same = _same(points, against, tree, reach_m)
        if same.sum() < FEWEST:
            return None
        slopes, off = _slopes(points[same], other[same], surface.world_from_camera[:3, 3] + found[1:])
        weights = min(1.0, WORTH / len(off)) / (1 + np.square(off / (reach_m / 3))) / POINT_SIGMA_M**2
        curvature = slopes.T @ (slopes * weights[:, None]) + prior
        found = found + np.linalg.solve(curvature, slopes.T @ (weights * off) - prior @ (found - start))
    points = surface.placed(found)
    other, same = _same(points, against, tree, BESIDE_M)
    slopes, off = _slopes(points[same], other[same], surface.world_from_camera[:3, 3] + found[1:])
    flat = np.abs(off) < FLAT_M
    if flat.sum() < SHARED * len(points):
        return Registered(found, None)
    information = slopes[flat].T @ slopes[flat] / POINT_SIGMA_M**2 * min(1.0, WORTH / flat.sum())
    return Registered(found, np.linalg.cholesky(information + 1e-6 * np.eye(4)).T)


def apart_m(points: Floats, against: Floats) -> float:
    """How far points (n, 6) lie from the nearest surfaces (m, 6), each at most ``CAP_M``: their mean."""
    from scipy.spatial import cKDTree

    other, same = _same(points, against, cKDTree(_in_six(against)), APART_M)
    off = np.abs(((other[:, :3] - points[:, :3]) * other[:, 3:]).sum(axis=1))
    return float(np.where(same, np.minimum(off, CAP_M), CAP_M).mean())


def lying_on(points: Floats, against: Floats) -> tuple[float, float]:
    """The share of points (n, 6) that lie on the surfaces (m, 6), and the share that lies near them."""
    from scipy.spatial import cKDTree

    other, near = _same(points, against, cKDTree(_in_six(against)), APART_M)
    off = other[:, :3] - points[:, :3]
    on = near & (np.linalg.norm(off, axis=1) < BESIDE_M) & (np.abs((off * other[:, 3:]).sum(axis=1)) < FLAT_M)
    return float(on.mean()), float(near.mean())


def about_z(angle_rad: float) -> Floats:
    """A turn (3, 3) about z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])


def _in_six(surfaces: Floats) -> Floats:
    """Coordinates in which points of one surface are near each other."""
    return np.hstack([surfaces[:, :3], NORMAL_M * surfaces[:, 3:]])


def _same(points: Floats, against: Floats, tree: object, reach_m: float) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """The nearest of ``against`` for each point, and which of the pairs may be of one surface."""
    found = tree.query(_in_six(points), distance_upper_bound=reach_m + NORMAL_M)[1]  # type: ignore[attr-defined]
    there = found < len(against)
    other = against[np.where(there, found, 0)]
    near = np.linalg.norm(points[:, :3] - other[:, :3], axis=1) < reach_m
    return other, there & near & ((points[:, 3:] * other[:, 3:]).sum(axis=1) > ALIKE)


def _slopes(points: Floats, other: Floats, about: Floats) -> tuple[Floats, Floats]:
    """How a turn about a point and a shift move points (n, 6) across the planes of others, and how far they are off."""
    arms, normals = points[:, :3] - about, other[:, 3:]
    off = ((other[:, :3] - points[:, :3]) * normals).sum(axis=1)
    return np.column_stack([normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1], normals]), off
