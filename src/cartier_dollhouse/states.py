"""States of furnishings: switched on or off, open or closed, full or empty, clean or dirty, as changes of a shape."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Literal

import numpy as np

from cartier.errors import InputError
from cartier_dollhouse.mesh import slab, sphere
from cartier_dollhouse.model import Part, Scene, Shape

State = Literal["on", "off", "open", "closed", "full", "empty", "clean", "dirty"]
LIT, DARK = {"screen": "screen:on"}, {"screen:on": "screen", "light": "paper"}
"""The material of a part when it is switched on, or off, by what it is otherwise."""
SPOTS, SPOT_SHARE = 14, 0.055
"""How many spots make something dirty, and the radius of the largest by the object's longest side."""
SPOT_MATERIALS = ("food:saddlebrown", "soil")
OFF_SURFACE_M = 0.002
FILLED = 0.8
"""The share of its height up to which a container is full."""
WALLS_OF_BOX = 5
"""Of a cardboard box's parts, those that are no flap; the flaps follow."""
FLAPS = 4


def with_states(scene: Scene, states: dict[int, State]) -> Scene:
    """The scene with furnishings, by their ids, in other states. Raises InputError for a state that one cannot have."""
    changed = (replace(t, shape=in_state(t.type, t.shape, states[t.id])) if t.id in states else t for t in scene.things)
    return replace(scene, things=tuple(changed))


def in_state(type: str, shape: Shape, state: State) -> Shape:
    """A type's shape in a state: closed, empty, clean and off where nothing is to be changed."""
    if state in ("on", "off"):
        return _switched(type, shape, LIT if state == "on" else DARK)
    if state == "dirty":
        return replace(shape, parts=(*shape.parts, *_spots(shape, zlib.crc32(type.encode()))))
    if state == "full":
        return _filled(type, shape)
    if state == "closed" and type == "Box":
        return _shut(shape)
    return shape


def _switched(type: str, shape: Shape, materials: dict[str, str]) -> Shape:
    if not any(part.material in LIT | DARK for part in shape.parts):
        raise InputError(f"a {type} has nothing that could shine")
    parts = (replace(part, material=materials.get(part.material, part.material)) for part in shape.parts)
    return replace(shape, parts=tuple(parts))


def _filled(type: str, shape: Shape) -> Shape:
    """A basin with water, another container with a heap of oranges."""
    inside = next((s for s in shape.surfaces if s.name in ("inside", "basin")), None)
    if inside is None:
        raise InputError(f"a {type} has no inside that could be full")
    low, high, top = np.array(inside.low_xy), np.array(inside.high_xy), FILLED * shape.size[2]
    if inside.name == "basin":
        wide, deep = (high - low) * 1.1
        middle = (low + high) / 2
        return replace(shape, parts=(*shape.parts, slab(wide, deep, inside.z, top, "water", *middle)))
    radius = float((high - low).min()) / 4
    across, along = (np.linspace(a + radius, b - radius, 3) for a, b in zip(low, high, strict=True))
    heap = [
        sphere(radius, (float(x), float(y), float(z)), "food:orange", sides=10)
        for z in np.arange(inside.z + radius, top, 1.5 * radius) for x in across for y in along
    ]  # fmt: skip
    return replace(shape, parts=(*shape.parts, *heap))


def _shut(shape: Shape) -> Shape:
    """A cardboard box with its flaps folded over it."""
    walls, rest = shape.parts[:WALLS_OF_BOX], shape.parts[WALLS_OF_BOX + FLAPS :]
    points = np.concatenate([part.vertices for part in walls])
    (x1, y1, _), (x2, y2, top) = points.min(0).tolist(), points.max(0).tolist()
    lid = slab(x2 - x1, y2 - y1, top, top + 0.006, walls[0].material, (x1 + x2) / 2, (y1 + y2) / 2)
    return Shape((*walls, lid, *rest))


def _spots(shape: Shape, seed: int) -> list[Part]:
    """Flat spots on all sides of a shape, by the area of its faces; the same for the same type."""
    rng = np.random.default_rng(seed)
    triangles = np.concatenate([part.vertices[part.faces] for part in shape.parts]).astype(np.float64)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-12)[:, None]
    areas[normals[:, 2] < -0.5] = 0  # nobody sees it from below
    largest = SPOT_SHARE * max(shape.size)
    spots = []
    for k, face in enumerate(rng.choice(len(areas), SPOTS, p=areas / areas.sum())):
        a, b = sorted(rng.random(2))
        middle = triangles[face].T @ (a, b - a, 1 - b) + OFF_SURFACE_M * normals[face]
        spots.append(_spot(middle, normals[face], largest * rng.uniform(0.5, 1), SPOT_MATERIALS[k % 2]))
    return spots


def _spot(middle: np.ndarray, normal: np.ndarray, radius: float, material: str) -> Part:
    """A disc that faces along a normal."""
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(normal, side))
    points = np.concatenate([[middle], middle + radius * ring])
    faces = [(0, k, k % 12 + 1) for k in range(1, 13)]
    uv = np.concatenate([[[0.0, 0.0]], radius * np.stack([np.cos(turn), np.sin(turn)], 1)])
    return Part(points.astype(np.float32), np.array(faces, np.int32), uv.astype(np.float32), material)
