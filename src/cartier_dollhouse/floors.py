"""Floors of a home: its options (rugs, narrow doors), and the true kind of floor at any point."""

from __future__ import annotations

import random
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cartier.types.route_rules import FLOOR_KINDS
from cartier_dollhouse.mesh import box, panel
from cartier_dollhouse.model import Opening, Part, Room, Rug, Scene
from cartier_dollhouse.walls import structure

RUGS, NARROW = "rugs", "narrow"
OPTIONS = (RUGS, NARROW)
NARROW_M = (0.6, 0.65, 0.7, 0.75)
RUG_M = 0.012  # how thick a rug is: a robot drives over it
EDGE_M = 0.25  # from a rug to the walls
DOORWAY_M = 0.45  # from a rug to the middle of a doorway
COLOURS = ("crimson", "navy", "sage", "mustard", "charcoal", "ivory", "terracotta", "petrol", "slategrey", "peru")
TRIED = 40

Box2 = tuple[float, float, float, float]


def split_name(name: str) -> tuple[str, tuple[str, ...]]:
    """A home's name without its options, and the options: ``studio+rugs+narrow``."""
    found: list[str] = []
    while name.rpartition("+")[2] in OPTIONS and "+" in name:
        name, _, option = name.rpartition("+")
        found.insert(0, option)
    return name, tuple(found)


def with_options(scene: Scene, options: Sequence[str], rng: random.Random | None = None) -> Scene:
    """The home with rugs or with narrow doors; without an ``rng``, the same home and options give the same scene."""
    rng = random.Random(zlib.crc32(scene.name.encode())) if rng is None else rng
    if NARROW in options:
        openings = tuple(_narrower(each, rng) if each.kind == "door" else each for each in scene.openings)
        shell = structure(scene.rooms, openings, scene.height_m)
        scene = replace(scene, openings=openings, structure=shell)
    if RUGS in options:
        rugs = tuple(rug for room in scene.rooms for rug in _rugs(room, scene, rng))
        parts = tuple(part for rug in rugs for part in _parts(rug))
        scene = replace(scene, rugs=rugs, structure=(*scene.structure, *parts))
    return replace(scene, name="+".join((scene.name, *options)))


def kinds_at(scene: Scene, xy: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """The true kinds of floor (...,) at points (..., 2), indices into ``FLOOR_KINDS``; 0 on thresholds and outside."""
    x, y = np.moveaxis(np.asarray(xy, np.float64), -1, 0)
    kinds = np.zeros(x.shape, np.uint8)
    for room in scene.rooms:
        name = room.floor.partition(":")[0]
        kinds[_inside(room.box, x, y)] = FLOOR_KINDS.index(name) if name in FLOOR_KINDS else 0
    for rug in scene.rugs:
        kinds[_inside(rug.box, x, y)] = FLOOR_KINDS.index("rug")
    return kinds


def _inside(area: Box2, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    return np.asarray((x >= area[0]) & (x <= area[2]) & (y >= area[1]) & (y <= area[3]))


def _narrower(door: Opening, rng: random.Random) -> Opening:
    (x1, y1), (x2, y2) = door.start, door.end
    x, y, width = (x1 + x2) / 2, (y1 + y2) / 2, abs(x2 - x1) + abs(y2 - y1)
    half = min(rng.choice(NARROW_M), width) / 2
    along = (half, 0.0) if abs(x2 - x1) > abs(y2 - y1) else (0.0, half)
    return replace(door, start=(x - along[0], y - along[1]), end=(x + along[0], y + along[1]))


def _rugs(room: Room, scene: Scene, rng: random.Random) -> Iterator[Rug]:
    """One rug, in large rooms two, where most of it is free floor."""
    x1, y1, x2, y2 = (room.box[0] + EDGE_M, room.box[1] + EDGE_M, room.box[2] - EDGE_M, room.box[3] - EDGE_M)
    doors = [
        ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
        for a, b in ((o.start, o.end) for o in scene.openings if o.kind == "door")
    ]
    things = [truth for truth in scene.truth() if truth.box_min[2] < 0.3]
    taken: list[Box2] = []
    for _ in range(2 if (x2 - x1) * (y2 - y1) > 9 else 1):
        found: list[tuple[float, Box2]] = []
        for _ in range(TRIED):
            wide, deep = rng.choice(((1.6, 1.1), (1.1, 1.6), (0.9, 0.6), (0.6, 0.9), (2.0, 0.7), (0.7, 2.0)))
            if wide > x2 - x1 or deep > y2 - y1:
                continue
            left, low = rng.uniform(x1, x2 - wide), rng.uniform(y1, y2 - deep)
            area = (round(left, 2), round(low, 2), round(left + wide, 2), round(low + deep, 2))
            if any(_distance(area, door) < DOORWAY_M for door in doors) or any(_shared(area, o) > 0 for o in taken):
                continue
            under = sum(_shared(area, (*t.box_min[:2], *t.box_max[:2])) for t in things)
            found.append((wide * deep - under, area))
        if found:
            best = max(found)[1]
            taken.append(best)
            yield Rug(best, f"rug:{rng.choice(COLOURS)}")


def _distance(area: Box2, xy: tuple[float, float]) -> float:
    dx = max(area[0] - xy[0], 0.0, xy[0] - area[2])
    dy = max(area[1] - xy[1], 0.0, xy[1] - area[3])
    return float(np.hypot(dx, dy))


def _shared(a: Sequence[float], b: Sequence[float]) -> float:
    """The area (m²) that two rectangles have in common."""
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def _parts(rug: Rug) -> tuple[Part, Part]:
    x1, y1, x2, y2 = rug.box
    top = RUG_M + 0.001
    body = box((x1, y1, 0.001), (x2, y2, RUG_M), rug.material.replace("rug", "fabric"))
    return body, panel((x1, y1, top), (x2, y1, top), (x2, y2, top), (x1, y2, top), rug.material)
