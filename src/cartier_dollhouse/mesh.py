"""Mesh primitives: boxes, prisms, lathes, tubes and cushions, each one part with texture coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.model import Part, Vec3

Points = npt.NDArray[np.float64]


def box(low: Sequence[float], high: Sequence[float], material: str) -> Part:
    """An axis-aligned box with flat faces."""
    (x1, y1, z1), (x2, y2, z2) = low, high
    corners = [(x1, y1), (x2, y1), (x2, y2), (x1, y2)]
    return prism(corners, z1, z2, material)


def slab(width: float, depth: float, z1: float, z2: float, material: str, x: float = 0.0, y: float = 0.0) -> Part:
    """A box by its footprint's middle (x, y) and its heights."""
    return box((x - width / 2, y - depth / 2, z1), (x + width / 2, y + depth / 2, z2), material)


def prism(outline: Sequence[tuple[float, float]], z1: float, z2: float, material: str) -> Part:
    """A convex outline (x, y), counter-clockwise seen from above, pulled up from z1 to z2."""
    ring = np.array(outline, dtype=np.float64)
    pieces = [_cap(ring, z1, up=False), _cap(ring, z2, up=True)]
    for (ax, ay), (bx, by) in zip(outline, [*outline[1:], outline[0]], strict=True):
        pieces.append(_quad((ax, ay, z1), (bx, by, z1), (bx, by, z2), (ax, ay, z2)))
    return _joined(pieces, material)


def panel(a: Vec3, b: Vec3, c: Vec3, d: Vec3, material: str) -> Part:
    """One flat quadrilateral, counter-clockwise seen from its visible side; u runs from a to b, v from a to d."""
    return _joined([_quad(a, b, c, d)], material)


def lathe(
    profile: Sequence[tuple[float, float]], material: str, x: float = 0.0, y: float = 0.0, sides: int = 20
) -> Part:
    """A profile of (radius, z), turned about the vertical through (x, y). Going up, it is seen from outside.

    A profile that goes up outside and comes down inside makes a bowl, a cup or a basin.
    """
    turn = np.linspace(0, math.tau, sides + 1)
    radii, heights = np.array(profile, dtype=np.float64).T
    length = np.concatenate([[0], np.cumsum(np.hypot(np.diff(radii), np.diff(heights)))])
    points = np.stack(
        [
            x + np.outer(radii, np.cos(turn)),
            y + np.outer(radii, np.sin(turn)),
            np.repeat(heights[:, None], sides + 1, 1),
        ],
        -1,
    )
    uv = np.stack([np.outer(np.full(len(radii), radii.max()), turn), np.repeat(length[:, None], sides + 1, 1)], -1)
    return _grid(points, uv, material)


def cylinder(
    radius: float, z1: float, z2: float, material: str, x: float = 0.0, y: float = 0.0, sides: int = 20
) -> Part:
    """An upright cylinder with both ends closed."""
    return lathe([(0, z1), (radius, z1), (radius, z2), (0, z2)], material, x, y, sides)


def sphere(radius: float, centre: Vec3, material: str, squash: float = 1.0, sides: int = 20) -> Part:
    """A ball, flattened along z by ``squash``."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, sides // 2 + 1)
    profile = [(radius * math.cos(a), centre[2] + squash * radius * math.sin(a)) for a in angles]
    return lathe(profile, material, centre[0], centre[1], sides)


def tube(path: Sequence[Vec3], radius: float, material: str, sides: int = 8) -> Part:
    """A round bar along a path, with closed ends: handles, faucets, legs that lean, rails."""
    line = np.array(path, dtype=np.float64)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.empty_like(line)
    last = np.cross(along[0], np.eye(3)[np.argmin(np.abs(along[0]))])
    for i, forward in enumerate(along):  # carried along, so that the bar does not twist in a bend
        last = last - forward * (last @ forward)
        last /= np.linalg.norm(last)
        side[i] = last
    other = np.cross(along, side)
    turn = np.linspace(0, math.tau, sides + 1)
    ring = np.cos(turn)[None, :, None] * side[:, None] + np.sin(turn)[None, :, None] * other[:, None]
    points = line[:, None] + radius * ring
    points = np.concatenate([np.repeat(line[:1, None], sides + 1, 1), points, np.repeat(line[-1:, None], sides + 1, 1)])
    length = np.concatenate([[0, 0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)), [0]])
    length[-1] = length[-2]
    uv = np.stack([np.repeat(radius * turn[None], len(points), 0), np.repeat(length[:, None], sides + 1, 1)], -1)
    return _grid(points, uv, material)


def cushion(low: Sequence[float], high: Sequence[float], material: str, round_m: float = 0.05, steps: int = 4) -> Part:
    """A box with soft edges: pillows, mattresses, upholstery, loaves. A superellipsoid that fills low to high."""
    centre, half = (np.array(low) + high) / 2, (np.array(high, dtype=np.float64) - low) / 2
    power = min(1.0, 2.0 * round_m / float(half.min())) if half.min() > 0 else 1.0
    lat = np.linspace(-math.pi / 2, math.pi / 2, 2 * steps + 1)
    lon = np.linspace(0, math.tau, 8 * steps + 1)

    def bent(values: Points) -> Points:
        return np.asarray(np.sign(values) * np.abs(values) ** power)

    x = np.outer(bent(np.cos(lat)), bent(np.cos(lon)))
    y = np.outer(bent(np.cos(lat)), bent(np.sin(lon)))
    z = np.repeat(bent(np.sin(lat))[:, None], len(lon), 1)
    points = centre + half * np.stack([x, y, z], -1)
    return _grid(points, points[..., :2] + points[..., 2:], material)


def moved(part: Part, offset: Sequence[float] = (0.0, 0.0, 0.0), yaw: float = 0.0) -> Part:
    """A part turned about the vertical through the origin, then shifted."""
    c, s = math.cos(yaw), math.sin(yaw)
    turned = part.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float32)
    return Part((turned + np.array(offset)).astype(np.float32), part.faces, part.uv_m, part.material)


def tilted(part: Part, axis: int, angle: float, about: Vec3 = (0.0, 0.0, 0.0)) -> Part:
    """A part turned about the axis 0 (x), 1 (y) or 2 (z) through a point, counter-clockwise seen from the axis' tip."""
    c, s = math.cos(angle), math.sin(angle)
    a, b = ((1, 2), (2, 0), (0, 1))[axis]
    turn = np.eye(3)
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return Part(((part.vertices - about) @ turn.T + about).astype(np.float32), part.faces, part.uv_m, part.material)


_Piece = tuple[Points, npt.NDArray[np.int64], Points]


def _quad(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> _Piece:
    corners = np.array([a, b, c, d], dtype=np.float64)
    wide, high = float(np.linalg.norm(corners[1] - corners[0])), float(np.linalg.norm(corners[3] - corners[0]))
    return corners, np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 0], [wide, 0], [wide, high], [0, high]])


def _cap(ring: Points, z: float, up: bool) -> _Piece:
    points = np.column_stack([ring, np.full(len(ring), z)])
    fan = np.array([[0, i, i + 1] for i in range(1, len(ring) - 1)])
    return points, fan if up else fan[:, ::-1], ring - ring.min(0)


def _joined(pieces: Sequence[_Piece], material: str) -> Part:
    offsets = np.concatenate([[0], np.cumsum([len(points) for points, _, _ in pieces])[:-1]])
    return Part(
        np.concatenate([points for points, _, _ in pieces]).astype(np.float32),
        np.concatenate([faces + offset for (_, faces, _), offset in zip(pieces, offsets, strict=True)]).astype(
            np.int32
        ),
        np.concatenate([uv for _, _, uv in pieces]).astype(np.float32),
        material,
    )


def _grid(points: Points, uv: Points, material: str) -> Part:
    """A net of (rows, columns, 3) points; seen from outside where columns turn counter-clockwise and rows go up."""
    rows, columns = points.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    flat = points.reshape(-1, 3)
    span = np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]])
    faces = faces[np.linalg.norm(span, axis=1) > 1e-12]  # poles make triangles of no area
    return Part(flat.astype(np.float32), faces.astype(np.int32), uv.reshape(-1, 2).astype(np.float32), material)
