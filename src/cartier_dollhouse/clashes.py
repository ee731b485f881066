"""Clash tests of a home: furnishings inside each other, in walls, off their surface, too tall, or in a doorway."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import compress

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cartier.geometry import box_distance
from cartier_dollhouse import shapes
from cartier_dollhouse.model import Part, Room, Scene, Shape, Surface, Thing
from cartier_dollhouse.openings import NORMALS, face_of, hole_box
from cartier_dollhouse.place import BAND_M, Plan

SLACK_M = 0.0101  # 1 cm, and the rounding of float32
FLAT_M = 0.03  # what is flatter is a rug or a mat: anything may stand on it
OPEN_M = 1.5  # free height above a surface that nothing encloses
MAX_TOUCHING = 2000  # pairs whose outlines overlap, some ms each; a furnished home has 20
DOORWAY_M = 0.3  # from the middle of the wall, to both sides, a doorway must be clear

Points = npt.NDArray[np.float64]


def of_things(scene: Scene) -> Iterator[tuple[Thing, str]]:
    """(furnishing, fault) for every furnishing in a wall, outside, in a doorway or in another furnishing."""
    solids = {thing.id: _Solid(thing) for thing in scene.things}
    for solid in solids.values():
        for reason in (_outside(solid, scene), _in_doorway(solid, scene)):
            if reason:
                yield solid.thing, reason
    lows, highs = (
        np.array([getattr(solid, end) for solid in solids.values()]).reshape(-1, 3) for end in ("low", "high")
    )
    touching = np.triu(((np.minimum(highs[:, None], highs) - np.maximum(lows[:, None], lows)) > SLACK_M).all(2), 1)
    ordered = list(solids.values())
    if touching.sum() > MAX_TOUCHING:
        beside = touching.sum(0) + touching.sum(1)
        crowded = ordered[int(beside.argmax())].thing
        yield crowded, f"this {crowded.type} at {_at(crowded)} and {beside.max()} more things are in one place"
        return
    for i, j in np.argwhere(touching).tolist():
        a, b = ordered[i], ordered[j]
        if not _may_share(a, b) and a.overlaps(b):
            yield b.thing, f"this {b.thing.type} and the {a.thing.type} at {_at(a.thing)} are in one place"


def fit(shape: Shape, yaw: float, at: tuple[float, float], surface: Surface, parent: Thing) -> str:
    """Why a shape cannot stand on a surface (in its owner's frame) at an offset from its middle; empty if it can."""
    points = Thing(0, "", shape, (*at, 0.0), yaw).to_world(_points(shape))
    # A lamp's shade may reach over the edge of a table; its foot may not.
    foot = points[points[:, 2] < points[:, 2].min() + 0.01, :2]
    half = (np.array(surface.high_xy) - surface.low_xy) / 2
    reach = np.ptp(foot, axis=0) / 2
    if surface.clear_m >= OPEN_M:
        reach = np.minimum(reach, half)  # in the open, what is larger than its stand stands well in the middle: a pan
    over = float((np.abs(foot.min(0) + foot.max(0)) / 2 + reach - half).max())
    if over > SLACK_M:
        return (
            f"reaches {100 * over:.0f} cm over the edge of the {surface.name} of the {parent.type} "
            f"({2 * half[0]:.2f} x {2 * half[1]:.2f} m)"
        )
    tall = float(np.ptp(points[:, 2]))
    if tall > surface.clear_m + SLACK_M:
        return f"is {tall:.2f} m tall: the {surface.name} of the {parent.type} has {surface.clear_m:.2f} m"
    return ""


def start_is_free(scene: Scene, radius_m: float) -> bool:
    """Whether a robot can stand at the scene's start."""
    boxes = [thing.truth() for thing in scene.things]
    near = [
        box_distance(np.array(scene.start_xy), np.array(box.box_min[:2]), np.array(box.box_max[:2])) < radius_m + 0.1
        for box in boxes
    ]
    around = replace(scene, things=tuple(compress(scene.things, near)))  # a plan of the whole home would take longer
    return Plan(around, radius_m).free(scene.start_xy)


class _Solid:
    """A furnishing as oriented boxes: those of its parts, and where these overlap another's, those of their pieces."""

    def __init__(self, thing: Thing) -> None:
        self.thing = thing
        self.points = thing.to_world(_points(thing.shape))
        self.low, self.high = self.points.min(0), self.points.max(0)
        self.axes = thing.to_world(np.eye(3)[:2])[:, :2] - np.array(thing.at[:2])
        self._coarse = [self._box(part.vertices) for part in thing.shape.parts]
        self._fine: dict[int, list[Points]] = {}

    def overlaps(self, other: _Solid) -> bool:
        pairs = _pairs(self._coarse, self.axes, other._coarse, other.axes)
        return any(_pairs(self._pieces(i), self.axes, other._pieces(j), other.axes) for i, j in pairs)

    def touches(self, low: Points, high: Points) -> bool:
        """Whether a piece of it lies in an axis-aligned box."""
        box = [np.stack([low, high])]
        return any(
            _pairs(self._pieces(i), self.axes, box, np.eye(2))
            for i, _ in _pairs(self._coarse, self.axes, box, np.eye(2))
        )

    def _box(self, vertices: npt.NDArray[np.floating]) -> Points:
        """(2, 3): the low and high ends of local points, along its own axes through the world's origin."""
        points = vertices.astype(np.float64)
        ends = np.stack([points.min(0), points.max(0)])
        ends[:, :2] += self.axes @ np.array(self.thing.at[:2])
        ends[:, 2] += self.thing.at[2]
        return ends

    def _pieces(self, part: int) -> list[Points]:
        if part not in self._fine:
            self._fine[part] = [self._box(piece) for piece in _pieces(self.thing.shape.parts[part])]
        return self._fine[part]


def _pairs(first: list[Points], axes: Points, second: list[Points], others: Points) -> list[tuple[int, int]]:
    """Which boxes of two lists overlap by more than the slack, each list along its own two axes in the plan."""
    found = []
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            if min(a[1, 2], b[1, 2]) - max(a[0, 2], b[0, 2]) > SLACK_M and _depth(a, axes, b, others) > SLACK_M:
                found.append((i, j))
    return found


def _depth(a: Points, axes: Points, b: Points, others: Points) -> float:
    """How deep two rectangles lie in each other (separating axes); negative if they are apart."""
    first, second = _corners(a, axes), _corners(b, others)
    along = np.concatenate([axes, others])
    p, q = first @ along.T, second @ along.T
    return float((np.minimum(p.max(0), q.max(0)) - np.maximum(p.min(0), q.min(0))).min())


def _corners(box: Points, axes: Points) -> Points:
    (x1, y1), (x2, y2) = box[:, :2]
    return np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]]) @ axes


def _pieces(part: Part) -> list[npt.NDArray[np.float32]]:
    """The points of each connected piece of a part: builders may put all legs of a table into one part."""
    _, point = np.unique(np.round(part.vertices, 4), axis=0, return_inverse=True)
    faces = point.ravel()[part.faces]
    n = int(point.max()) + 1
    links = coo_array((np.ones(2 * len(faces)), (faces[:, [0, 1]].ravel("F"), faces[:, [1, 2]].ravel("F"))), (n, n))
    count, piece = connected_components(links, directed=False)
    return [part.vertices[piece[point.ravel()] == k] for k in range(count)]


def _may_share(a: _Solid, b: _Solid) -> bool:
    if b.thing.on == a.thing.id or a.thing.on == b.thing.id:
        return True
    if a.thing.on == b.thing.on != 0 and all(shapes.info(s.thing.type).stands == "counter" for s in (a, b)):
        return True  # a tap reaches over its basin
    return any(s.thing.on == 0 and s.thing.at[2] == 0 and s.thing.shape.size[2] <= FLAT_M for s in (a, b))


def _outside(solid: _Solid, scene: Scene) -> str:
    """Why a furnishing is not within a room."""
    x, y = solid.thing.at[:2]
    room = _room_at(scene, x, y)
    if room is None:
        return f"this {solid.thing.type} at {_at(solid.thing)} is in a wall or outside of every room"
    for side, (axis, sign) in NORMALS.items():
        end = solid.high[axis] if sign > 0 else -solid.low[axis]
        into = end - sign * face_of(room, side)
        if into > SLACK_M:
            return f"this {solid.thing.type} reaches {100 * into:.0f} cm into the {side} wall of {room.name!r}"
    if solid.high[2] > scene.height_m + SLACK_M:
        return f"this {solid.thing.type} reaches up to {solid.high[2]:.2f} m: the rooms are {scene.height_m:g} m high"
    return ""


def _room_at(scene: Scene, x: float, y: float) -> Room | None:
    return next((r for r in scene.rooms if r.box[0] <= x <= r.box[2] and r.box[1] <= y <= r.box[3]), None)


def _in_doorway(solid: _Solid, scene: Scene) -> str:
    for opening in scene.openings:
        if opening.kind == "door":
            x1, y1, x2, y2 = hole_box(opening, DOORWAY_M)
            low, high = np.array([x1, y1, BAND_M[0]]), np.array([x2, y2, opening.top_m])
            apart = (solid.low > high) | (solid.high < low)
            if not apart.any() and solid.touches(low, high):
                x, y = (np.array(opening.start) + opening.end) / 2
                return f"this {solid.thing.type} stands in the doorway at [{x:.2f}, {y:.2f}]"
    return ""


def _points(shape: Shape) -> Points:
    return np.concatenate([part.vertices for part in shape.parts]).astype(np.float64)


def _at(thing: Thing) -> str:
    return "[" + ", ".join(f"{value:.2f}" for value in thing.at) + "]"
