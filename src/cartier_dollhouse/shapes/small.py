"""Primitives for small objects, and the shape that is made of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cartier_dollhouse.mesh import box, lathe, tilted
from cartier_dollhouse.model import Part, Shape, Surface, Vec3

Profile = Sequence[tuple[float, float]]


def made(parts: Sequence[Part], *surfaces: Surface) -> Shape:
    """Parts and surfaces as a shape; ``build`` stretches it to the size asked for."""
    return Shape(tuple(parts), surfaces)


def scaled(part: Part, by: Vec3, about: Vec3 = (0.0, 0.0, 0.0)) -> Part:
    """A part stretched along the axes, around a point."""
    return Part(
        ((part.vertices - about) * by + np.array(about)).astype(np.float32), part.faces, part.uv_m, part.material
    )


def lying(part: Part, z: float = 0.0) -> Part:
    """An upright part laid down along y: its top points to the front (-y), its axis is at height ``z``."""
    laid = tilted(part, 0, math.pi / 2)
    return Part(laid.vertices + np.array([0, 0, z], np.float32), laid.faces, laid.uv_m, laid.material)


def hollow(outside: Profile, wall: float, floor: float, material: str, sides: int = 16) -> Part:
    """A vessel: the outside as (radius, z) going up from the foot, walls and a floor of the given thickness."""
    foot = outside[0][1] + floor
    inside = [(r - wall, z) for r, z in reversed(outside) if z > foot]
    radii, heights = zip(*outside, strict=True)
    bottom = float(np.interp(foot, heights, radii)) - wall
    return lathe([(0, outside[0][1]), *outside, *inside, (bottom, foot), (0, foot)], material, sides=sides)


def inside(radius: float, z: float, name: str = "inside") -> Surface:
    """The square that fits into a round floor."""
    half = radius * math.sqrt(0.5)
    return Surface(name, z, (-half, -half), (half, half))


def washer(inner: float, outer: float, z1: float, z2: float, material: str, sides: int = 16) -> Part:
    """A flat ring about the vertical, closed all round."""
    return lathe([(inner, z1), (outer, z1), (outer, z2), (inner, z2), (inner, z1)], material, sides=sides)


def rod(path: Sequence[Vec3], radius: float, material: str, sides: int = 6) -> Part:
    """A round bar along a path that may turn any way, with closed ends: ``mesh.tube`` twists where a path turns
    back."""
    line = np.array(path, dtype=np.float64)
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], np.eye(3)[np.abs(along[0]).argmin()])
    rings = []
    for point, ahead in zip(line, along, strict=True):
        side -= ahead * (side @ ahead)  # carried along, so that the bar does not twist
        side /= np.linalg.norm(side)
        turn = np.arange(sides) * math.tau / sides
        rings.append(point + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(ahead, side))))
    vertices = np.concatenate([*rings, line[[0, -1]]]).astype(np.float32)
    first = len(vertices) - 2
    faces = []
    for k in range(sides):
        after = (k + 1) % sides
        faces += [(first, after, k), (first + 1, first - sides + k, first - sides + after)]
        for row in range(0, first - sides, sides):
            a, b = row + k, row + after
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    return Part(vertices, np.array(faces, dtype=np.int32), np.ascontiguousarray(vertices[:, :2]), material)


def wavy(part: Part, waves: int, much: float) -> Part:
    """An upright part whose radius swings ``waves`` times about its axis, by the fraction ``much``."""
    vertices = part.vertices.copy()
    swing = 1 + much * np.cos(waves * np.arctan2(vertices[:, 1], vertices[:, 0]))
    vertices[:, :2] *= swing[:, None]
    return Part(vertices, part.faces, part.uv_m, part.material)


def hoop(
    radius: float, thick: float, centre: Vec3, material: str, axis: int = 2, sides: int = 5, steps: int = 14
) -> Part:
    """A round bar bent to a full circle about an axis."""
    ring = []
    for turn in np.linspace(0, math.tau, steps + 1):
        a, b = radius * math.cos(turn), radius * math.sin(turn)
        offset = [0.0, 0.0, 0.0]
        offset[(axis + 1) % 3], offset[(axis + 2) % 3] = a, b
        ring.append((centre[0] + offset[0], centre[1] + offset[1], centre[2] + offset[2]))
    return rod(ring, thick, material, sides)


def bent(points: Sequence[tuple[float, float]], x: float = 0.0) -> list[Vec3]:
    """A path in the plane of y and z, for tubes."""
    return [(x, y, z) for y, z in points]


def strip(sections: Sequence[tuple[float, float, float]], thick: float, material: str, x: float = 0.0) -> Part:
    """A flat bar along +y through sections (y, z of its underside, half width): cutlery, blades, folded cloth."""
    vertices = np.array(
        [
            (x + sx * half, y, z + up * thick)
            for y, z, half in sections
            for sx, up in ((-1, 0), (1, 0), (1, 1), (-1, 1))
        ],
        dtype=np.float32,
    )
    faces = [(0, 1, 2), (0, 2, 3)]
    for i in range(len(sections) - 1):
        for k in range(4):
            a, b = 4 * i + k, 4 * i + (k + 1) % 4
            faces += [(a, b + 4, b), (a, a + 4, b + 4)]
    end = 4 * (len(sections) - 1)
    faces += [(end, end + 2, end + 1), (end, end + 3, end + 2)]
    return Part(vertices, np.array(faces, dtype=np.int32), np.ascontiguousarray(vertices[:, :2]), material)


def plump(width: float, depth: float, height: float, material: str, steps: int = 8) -> Part:
    """A pillow: two bellies sewn together along a rim with pointed corners; its middle lies at the origin."""
    t = np.linspace(-1, 1, steps + 1)
    u, v = np.meshgrid(t, t)
    belly = ((1 - u**2) * (1 - v**2)) ** 0.45
    x, y = u * width / 2 * (1 - 0.08 * (1 - v**2)), v * depth / 2 * (1 - 0.08 * (1 - u**2))
    top = np.stack([x, y, belly * height / 2], -1).reshape(-1, 3)
    number = np.arange((steps + 1) ** 2).reshape(steps + 1, steps + 1)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    along = (u[:-1, :-1] < 0) == (
        v[:-1, :-1] < 0
    )  # diagonals run to the corners, or these would lie flat on each other
    one = np.stack([a, b, np.where(along.ravel(), c, d)], 1)
    faces = np.concatenate([one, np.stack([np.where(along.ravel(), a, b), c, d], 1)])
    vertices = np.concatenate([top, top * (1, 1, -1)]).astype(np.float32)
    both = np.concatenate([faces, faces[:, ::-1] + len(top)]).astype(np.int32)
    return Part(vertices, both, np.ascontiguousarray(vertices[:, :2]), material)


def rows(
    xs: Sequence[float], ys: Sequence[float], wide: float, deep: float, z1: float, z2: float, m: str
) -> list[Part]:
    """A grid of small boxes: keys, buttons, holes."""
    return [box((x - wide / 2, y - deep / 2, z1), (x + wide / 2, y + deep / 2, z2), m) for x in xs for y in ys]
