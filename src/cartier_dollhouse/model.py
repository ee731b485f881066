"""Model of a home: parts, shapes, placed furnishings, rooms, and the scene that holds them.

A shape's frame: origin in the middle of its footprint, at the bottom; z up; its front faces -y, so that x is to the
right of a person who faces it. ``size`` is (width along x, depth along y, height along z) in metres. A furnishing's
``yaw`` turns it counter-clockwise about z: yaw 0 faces south (-y), pi/2 faces east (+x).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.types import TrueObject

Vec3 = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material: vertices (N, 3) float32, faces (M, 3) int32, counter-clockwise seen from outside.

    ``uv_m`` (N, 2) float32 are texture coordinates in metres, so that planks and tiles keep their size on every
    surface.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    uv_m: npt.NDArray[np.float32]
    material: str


@dataclass(frozen=True)
class Surface:
    """A horizontal rectangle on which furnishings can stand: a top, a seat, a shelf, the bottom of a basin or of a
    fridge.

    ``low_xy`` and ``high_xy`` bound it in the shape's frame, at height ``z``; ``clear_m`` is the free height above it.
    """

    name: str
    z: float
    low_xy: tuple[float, float]
    high_xy: tuple[float, float]
    clear_m: float = 2.0


@dataclass(frozen=True, eq=False)
class Shape:
    """What a builder makes of a type: its parts, the surfaces on and in it, and the size that it really has."""

    parts: tuple[Part, ...]
    surfaces: tuple[Surface, ...] = ()

    @property
    def size(self) -> Vec3:
        points = np.concatenate([part.vertices for part in self.parts])
        width, depth, height = (points.max(0) - points.min(0)).tolist()
        return width, depth, height


@dataclass(frozen=True, eq=False)
class Thing:
    """One object of a scene. ``at`` is its shape's origin in the world; ``on`` the id of what it stands on or in, or
    0."""

    id: int
    type: str
    shape: Shape
    at: Vec3
    yaw: float
    on: int = 0

    def to_world(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Points (..., 3) of the shape's frame in the world."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return np.asarray(
            points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array(self.at), dtype=np.float64
        )

    def truth(self) -> TrueObject:
        """Its true axis-aligned box, from its triangles."""
        points = self.to_world(np.concatenate([part.vertices for part in self.shape.parts]).astype(np.float64))
        return TrueObject(self.id, self.type, tuple(points.min(0).tolist()), tuple(points.max(0).tolist()))


@dataclass(frozen=True)
class Room:
    """A rectangular room by its inner faces (x1, y1, x2, y2) in metres; ``kind`` is kitchen, bedroom, living room, ….

    ``floor`` and ``walls`` are materials.
    """

    name: str
    kind: str
    box: tuple[float, float, float, float]
    floor: str
    walls: str


@dataclass(frozen=True)
class Opening:
    """A hole in the wall between two rooms (a doorway) or to the outside (a window, a closed front door).

    ``start`` and ``end`` (x, y) lie on the wall's middle line, ``bottom_m`` and ``top_m`` are heights.
    """

    kind: str
    start: tuple[float, float]
    end: tuple[float, float]
    bottom_m: float
    top_m: float


@dataclass(frozen=True)
class Rug:
    """A rug on the floor, no furnishing: its rectangle (x1, y1, x2, y2) in metres, and its material."""

    box: tuple[float, float, float, float]
    material: str


@dataclass(frozen=True, eq=False)
class Scene:
    """A home. ``structure`` are floors, walls, ceilings and frames in world coordinates; they have instance id 0."""

    name: str
    about: str
    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]
    things: tuple[Thing, ...]
    structure: tuple[Part, ...]
    height_m: float
    start_xy: tuple[float, float]
    rugs: tuple[Rug, ...] = ()

    def truth(self) -> list[TrueObject]:
        """Every furnishing with its true box; labels are AI2-THOR's type names."""
        return [thing.truth() for thing in self.things]


@dataclass(frozen=True, eq=False)
class Triangles:
    """A scene as one mesh: vertices (N, 3) float32, faces (M, 3) int32, and per face its instance id and its part's
    number."""

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    uv_m: npt.NDArray[np.float32]
    instance: npt.NDArray[np.int32]
    part: npt.NDArray[np.int32]
    materials: tuple[str, ...]
    """The material of each part."""


def triangles(scene: Scene) -> Triangles:
    """All parts of a scene in world coordinates: first the structure, then the furnishings in their order."""
    placed = [(part, part.vertices, 0) for part in scene.structure]
    for thing in scene.things:
        placed += [(part, thing.to_world(part.vertices).astype(np.float32), thing.id) for part in thing.shape.parts]
    counts = [len(vertices) for _, vertices, _ in placed]
    offsets = np.concatenate([[0], np.cumsum(counts)[:-1]])
    faces = [len(part.faces) for part, _, _ in placed]
    return Triangles(
        np.concatenate([vertices for _, vertices, _ in placed]).astype(np.float32),
        np.concatenate([part.faces + offset for (part, _, _), offset in zip(placed, offsets, strict=True)]).astype(
            np.int32
        ),
        np.concatenate([part.uv_m for part, _, _ in placed]).astype(np.float32),
        np.repeat([instance for _, _, instance in placed], faces).astype(np.int32),
        np.repeat(np.arange(len(placed)), faces).astype(np.int32),
        tuple(part.material for part, _, _ in placed),
    )
