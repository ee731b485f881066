"""Components of furniture: upholstery, carcasses, legs, handles, basins and hanging cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.mesh import box, cylinder, moved, tilted
from cartier_dollhouse.model import Part, Surface, Vec3

Ring = npt.NDArray[np.float64]
_CORNER = np.array([0.0, math.pi / 4, math.pi / 2])


def rectangle(low: Sequence[float], high: Sequence[float], z: float, radius: float = 0.0) -> Ring:
    """A rectangle with rounded corners at height z, counter-clockwise from above: (12, 3) points, or (4, 3) if
    sharp."""
    (x1, y1), (x2, y2) = low[:2], high[:2]
    if radius <= 0:
        return np.array([(x1, y1, z), (x2, y1, z), (x2, y2, z), (x1, y2, z)])
    r = min(radius, (x2 - x1) / 2, (y2 - y1) / 2)
    centres = [(x1 + r, y1 + r), (x2 - r, y1 + r), (x2 - r, y2 - r), (x1 + r, y2 - r)]
    return np.array(
        [
            (x + r * math.cos(a), y + r * math.sin(a), z)
            for quarter, (x, y) in enumerate(centres)
            for a in math.pi + quarter * math.pi / 2 + _CORNER
        ]
    )


def oval(width: float, depth: float, z: float, y: float = 0.0, sides: int = 20) -> Ring:
    """An ellipse at height z with its middle at (0, y): (sides, 3) points, counter-clockwise from above."""
    turn = np.linspace(0, math.tau, sides, endpoint=False)
    return np.column_stack([width / 2 * np.cos(turn), y + depth / 2 * np.sin(turn), np.full(sides, z)])


def loft(rings: Sequence[Ring], material: str, ends: bool = True) -> Part:
    """A closed skin over rings of equally many points, with flat ends.

    Rings that go up outside and come down inside make a basin. Without ``ends`` the last ring meets the first: a hoop.
    """
    if not ends:
        rings = [*rings, rings[0]]
    stack = np.stack([np.concatenate([ring, ring[:1]]) for ring in rings])
    rows, columns = stack.shape[:2]
    along = np.linalg.norm(np.diff(stack, axis=1), axis=2).max(0)
    u = np.concatenate([[0.0], np.cumsum(along)])
    v = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stack, axis=0), axis=2).mean(1))])
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    skin = [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    points, uv = [stack.reshape(-1, 3)], [np.stack(np.broadcast_arrays(u, v[:, None]), -1).reshape(-1, 2)]
    if ends:
        fan = np.array([[0, i, i + 1] for i in range(1, columns - 2)])
        skin += [rows * columns + fan[:, ::-1], rows * columns + columns - 1 + fan]
        points += [rings[0], rings[-1]]
        uv += [rings[0][:, :2], rings[-1][:, :2]]
    return Part(
        np.concatenate(points).astype(np.float32),
        np.concatenate(skin).astype(np.int32),
        np.concatenate(uv).astype(np.float32),
        material,
    )


def pipe(path: Sequence[Vec3], radius: float, material: str, sides: int = 8) -> Part:
    """A round bar along a path, with flat ends; its rings follow the bends without a twist. A closed path makes a
    ring."""
    line = np.array(path, dtype=np.float64)
    closed = len(line) > 2 and bool(np.allclose(line[0], line[-1]))
    along = np.gradient(line, axis=0)
    if closed:
        along[0] = along[-1] = line[1] - line[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], np.eye(3)[np.argmin(np.abs(along[0]))])
    turn = np.linspace(0, math.tau, sides, endpoint=False)
    rings = []
    for centre, forward in zip(line, along, strict=True):
        side = side - forward * (side @ forward)
        if np.linalg.norm(side) < 1e-6:  # a bend by 90 degrees within its plane
            side = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
        side /= np.linalg.norm(side)
        rings.append(centre + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(forward, side))))
    return loft(rings[:-1] if closed else rings, material, ends=not closed)


def padded(low: Sequence[float], high: Sequence[float], material: str, soft: float = 0.04) -> Part:
    """A box with rounded edges: seats, mattresses, the housings of machines."""
    b = min(soft, *((top - bottom) / 2.1 for bottom, top in zip(low, high, strict=True)))
    (x1, y1, z1), (x2, y2, z2) = low, high

    def ring(inset: float, z: float) -> Ring:
        return rectangle((x1 + inset, y1 + inset), (x2 - inset, y2 - inset), z, max(b - inset / 2, 1e-3))

    return loft([ring(b, z1), ring(0, z1 + b), ring(0, z2 - b), ring(0.3 * b, z2 - 0.3 * b), ring(b, z2)], material)


def basin(
    low: Sequence[float], high: Sequence[float], wall: float, floor: float, material: str, radius: float = 0.05
) -> Part:
    """A box with rounded corners, hollow and open at the top: walls and floor of the given thickness."""
    (x1, y1, z1), (x2, y2, z2) = low, high
    inner, lower = (x1 + wall, y1 + wall), (x2 - wall, y2 - wall)
    tight = max(radius - wall / 2, 0.005)
    return loft(
        [
            rectangle((x1, y1), (x2, y2), z1, radius),
            rectangle((x1, y1), (x2, y2), z2, radius),
            rectangle(inner, lower, z2, tight),
            rectangle(inner, lower, z1 + floor, tight),
        ],
        material,
    )


def case(low: Sequence[float], high: Sequence[float], thick: float, material: str, back: str = "") -> list[Part]:
    """A carcass that is open at the front: two sides, bottom, top and a back (of another material if named)."""
    (x1, y1, z1), (x2, y2, z2) = low, high
    t = thick
    return [
        box((x1, y1, z1), (x1 + t, y2, z2), material),
        box((x2 - t, y1, z1), (x2, y2, z2), material),
        box((x1 + t, y1, z1), (x2 - t, y2, z1 + t), material),
        box((x1 + t, y1, z2 - t), (x2 - t, y2, z2), material),
        box((x1 + t, y2 - t / 2, z1 + t), (x2 - t, y2, z2 - t), back or material),
    ]


def legs(
    width: float, depth: float, top: float, thick: float, material: str, taper: float = 1.0, splay: float = 0.0
) -> list[Part]:
    """Four legs whose feet stand in the corners of the footprint; ``taper`` thins the foot, ``splay`` sets tops
    inwards."""
    half, foot = thick / 2, thick * taper / 2
    made = []
    for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        x, y = sx * (width / 2 - half), sy * (depth / 2 - half)
        a, b = x - sx * splay, y - sy * splay
        made.append(
            loft(
                [
                    rectangle((x - foot, y - foot), (x + foot, y + foot), 0),
                    rectangle((a - half, b - half), (a + half, b + half), top),
                ],
                material,
            )
        )
    return made


def front(low: Sequence[float], high: Sequence[float], material: str, metal: str, handle: str) -> list[Part]:
    """A door or drawer front in a plane y = constant: (x1, z1) to (x2, z2) at y, 2 cm thick, with its handle.

    ``low`` and ``high`` are (x, y, z); the front fills them with a seam around. ``handle`` is "bar" (across, near the
    top), "left" or "right" (upright), "knob" or "none".
    """
    (x1, y1, z1), (x2, y2, z2) = low, high
    seam = 0.004
    parts = [box((x1 + seam, y1, z1 + seam), (x2 - seam, y2, z2 - seam), material)]
    middle, wide, tall = (x1 + x2) / 2, x2 - x1, z2 - z1
    out = y1 - 0.022
    if handle == "bar":
        reach, z = min(0.09, wide * 0.3), z2 - min(0.06, tall * 0.4)
        parts.append(box((middle - reach, out, z - 0.008), (middle + reach, y1, z + 0.008), metal))
    elif handle in ("left", "right"):
        x = x1 + 0.045 if handle == "left" else x2 - 0.045
        reach, z = min(0.09, tall * 0.2), (z1 + 2 * z2) / 3
        parts.append(box((x - 0.008, out, z - reach), (x + 0.008, y1, z + reach), metal))
    elif handle == "knob":
        parts.append(facing(cylinder(0.016, 0, 0.022, metal, sides=10), (middle, y1, (z1 + z2) / 2)))
    return parts


def facing(part: Part, at: Vec3) -> Part:
    """An upright part laid so that what was up points to the front (-y), its origin moved to ``at``."""
    return moved(tilted(part, 0, math.pi / 2), at)


def drape(width: float, depth: float, z1: float, z2: float, material: str, folds: int, x: float = 0.0) -> Part:
    """Hanging cloth in folds: a wavy sheet of 1.5 cm within ``depth``, around the plane y = 0."""
    n = 6 * folds
    thick = min(0.015, depth * 0.4)
    across = np.linspace(-width / 2, width / 2, n + 1) + x
    wave = (depth - thick) / 2 * np.sin(np.linspace(0, folds * math.tau, n + 1))
    front_line = np.column_stack([across, wave - thick / 2])
    back_line = np.column_stack([across, wave + thick / 2])
    outline = np.concatenate([front_line, back_line[::-1]])
    bottom, top = (np.column_stack([outline, np.full(len(outline), z)]) for z in (z1, z2))
    skin = loft([bottom, top], material)
    return Part(skin.vertices, _without_fans(skin.faces, n, len(outline)), skin.uv_m, material)


def _without_fans(faces: npt.NDArray[np.int32], n: int, around: int) -> npt.NDArray[np.int32]:
    """The ends of a wavy sheet as strips between its two sides: a fan would leave the outline, which is not convex."""
    sides = faces[: 2 * around]
    first = 2 * (around + 1)
    i = np.arange(n)
    j = around - 1 - i
    strip = np.concatenate([np.stack([i, i + 1, j - 1], 1), np.stack([i, j - 1, j], 1)])
    return np.concatenate([sides, first + strip[:, ::-1], first + around + strip]).astype(np.int32)


def top_surface(name: str, width: float, depth: float, z: float, clear: float = 2.0, edge: float = 0.01) -> Surface:
    """A surface around the middle of the footprint, ``edge`` inside a top of this width and depth."""
    x, y = width / 2 - edge, depth / 2 - edge
    return Surface(name, z, (-x, -y), (x, y), clear)
