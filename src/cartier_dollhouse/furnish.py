"""Furnishing of generated homes: groups against walls with room to use them, and small objects on surfaces."""

from __future__ import annotations

import math
import random
from collections import defaultdict
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from cartier_dollhouse import shapes
from cartier_dollhouse.groups import COMMON, GROUPS, HUNG, PLANS, Group
from cartier_dollhouse.model import Surface

CELL_M = 0.05
ROBOT_M = 0.26  # a robot of 0.2 m and two cells' half diagonals
POCKET_M2 = 0.1  # what is cut off from the rest of a room may be at most this large
GAP_M = 0.02  # from furniture to the wall (skirting boards) and between furnishings
TALL_M = 0.9  # what is higher stands in front of no window
LOW_M = 1.2  # what hangs lower hangs above no furniture
BEFORE_M = 0.2
TRIES = 30
NEEDED_TRIES = 10
LAY_TRIES = 8
SHELVED = ("Fridge", "ShelvingUnit")  # furnishings lie on all their surfaces, elsewhere on the first alone
FACING = {"north": 0.0, "south": 180.0, "west": 90.0, "east": 270.0}  # degrees of what stands with its back to a wall
OPPOSITE = {"north": "south", "south": "north", "west": "east", "east": "west"}

Rect = tuple[float, float, float, float]
Spot = tuple[float, float, float]  # x, y of the middle of a group's back, degrees


@dataclass
class Place:
    """A room while it is being furnished."""

    name: str
    kind: str
    box: Rect
    taken: list[Rect] = field(default_factory=list)
    clear: list[Rect] = field(default_factory=list)
    """Floor that must stay empty: in front of doors and of what people use."""
    seat: tuple[str, float] | None = None
    """The wall that the sofa stands at, and where along it."""
    _marks: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))

    def add_door(self, xy: tuple[float, float], width: float) -> None:
        """Keeps the floor on this side of a door empty and nothing on its wall."""
        x, y = xy
        reach = width / 2 + 0.05
        self.clear.append((x - reach, y - reach - 0.3, x + reach, y + reach + 0.3))
        for side in FACING:
            low, high = self.span(side)
            along, across = (x, y) if side in ("north", "south") else (y, x)
            if abs(across - self._face(side)) < 0.2 and low < along < high:
                self.mark(side, along, width + 0.2)

    def span(self, side: str) -> tuple[float, float]:
        """From where to where a wall runs."""
        k = 0 if side in ("north", "south") else 1
        return self.box[k], self.box[k + 2]

    def mark(self, side: str, at: float, width: float) -> None:
        """Notes that a stretch of wall is in use: by a door, a window, a picture or something tall before it."""
        self._marks[side].append((at - width / 2, at + width / 2))

    def unmarked(self, side: str, at: float, width: float) -> bool:
        """Whether a stretch of wall is bare."""
        low, high = self.span(side)
        inside = low <= at - width / 2 and at + width / 2 <= high
        return inside and all(at + width / 2 <= a or b <= at - width / 2 for a, b in self._marks[side])

    def bare(self, side: str, at: float, width: float) -> bool:
        """Whether nothing stands before a stretch of wall."""
        x1, y1, x2, y2 = self.box
        low, high = at - width / 2, at + width / 2
        before = {
            "south": (low, y1, high, y1 + BEFORE_M), "north": (low, y2 - BEFORE_M, high, y2),
            "west": (x1, low, x1 + BEFORE_M, high), "east": (x2 - BEFORE_M, low, x2, high),
        }[side]  # fmt: skip
        return not any(_overlap(before, other) for other in self.taken)

    def fits(self, footprint: Rect, front: Rect) -> bool:
        """Whether furniture may stand there: apart from all else, with room before it, and the floor stays in one
        piece."""
        x1, y1, x2, y2 = self.box
        inside = footprint[0] >= x1 and footprint[1] >= y1 and footprint[2] <= x2 and footprint[3] <= y2
        usable = front[0] >= x1 - 0.3 and front[1] >= y1 - 0.3 and front[2] <= x2 + 0.3 and front[3] <= y2 + 0.3
        if not inside or not usable or any(_overlap(footprint, other) for other in [*self.taken, *self.clear]):
            return False
        if any(_overlap(front, other) for other in self.taken):
            return False
        parts, count = ndimage.label(self._floor([*self.taken, footprint]))
        sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
        return int((sizes > POCKET_M2 / CELL_M**2).sum()) == 1

    def open_spot(self) -> tuple[float, float]:
        """The middle of the largest open floor."""
        distance = ndimage.distance_transform_edt(np.pad(self._floor(self.taken), 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(distance.argmax()), distance.shape)
        return round(self.box[0] + (column + 0.5) * CELL_M, 3), round(self.box[1] + (row + 0.5) * CELL_M, 3)

    def _floor(self, taken: list[Rect]) -> npt.NDArray[np.bool_]:
        """Cells on which the robot's middle can be, rows from the south."""
        x1, y1, x2, y2 = self.box
        free = np.zeros((round((y2 - y1) / CELL_M), round((x2 - x1) / CELL_M)), bool)
        rim = math.ceil(ROBOT_M / CELL_M)
        free[rim:-rim, rim:-rim] = True
        for a1, b1, a2, b2 in taken:
            rows = slice(max(0, math.floor((b1 - ROBOT_M - y1) / CELL_M)), math.ceil((b2 + ROBOT_M - y1) / CELL_M))
            free[rows, max(0, math.floor((a1 - ROBOT_M - x1) / CELL_M)) : math.ceil((a2 + ROBOT_M - x1) / CELL_M)] = (
                False
            )
        return free

    def _face(self, side: str) -> float:
        return self.box[{"west": 0, "south": 1, "east": 2, "north": 3}[side]]


class Furnisher:
    """Chooses and places what stands in the rooms of one home."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng

    def furnish(self, place: Place, plan: str) -> list[dict[str, Any]]:
        """The furnishings of a room, in the form of home files; ``plan`` is one of ``PLANS``."""
        things: list[dict[str, Any]] = []
        for name, chance in PLANS[plan]:
            # What a room cannot do without is tried in other sizes and places.
            for _ in range(NEEDED_TRIES if chance == 1 else self._rng.random() < chance):
                placed = self._placed(place, GROUPS[name](self._rng))
                if placed:
                    things += placed
                    break
        for kind, chance, size, bottom in HUNG.get(place.kind, ()):
            if self._rng.random() < chance:
                things += self._hung(place, kind, size, bottom)
        return things

    def _placed(self, place: Place, group: Group) -> list[dict[str, Any]]:
        """A group in the first spot that suits it, or nothing."""
        for _ in range(TRIES):
            side, along, spot = self._spot(place, group, place.seat if group.faces_seat else None)
            footprint = _rect(spot, -group.width / 2, -group.depth, group.width / 2, 0.0)
            front = _rect(spot, -group.width / 2, -group.depth - group.front_m, group.width / 2, 0.0)
            if group.free:
                front = (front[0] - 0.6, front[1] - 0.6, front[2] + 0.6, front[3] + 0.6)
            elif group.height > TALL_M and not place.unmarked(side, along, group.width):
                continue
            if place.fits(footprint, front):
                break
        else:
            return []
        place.taken.append(footprint)
        place.clear.append(front)
        if group.is_seat:
            place.seat = side, along
        if not group.free and group.height > TALL_M:
            place.mark(side, along, group.width)
        things = [self._item(item, spot) for item in group.items]
        for kind, x, size, bottom in group.hung:
            at = round(along + x * (1 if side in ("north", "west") else -1), 3)
            if place.unmarked(side, at, size[0]):
                place.mark(side, at, size[0])
                things.append(_on_wall(kind, place, side, at, size, bottom))
        return things

    def _spot(self, place: Place, group: Group, opposite: tuple[str, float] | None) -> tuple[str, float, Spot]:
        """A random place for a group, or one across from a seat: a wall, where along it, the middle of the group's
        back."""
        side = OPPOSITE[opposite[0]] if opposite else self._rng.choice(list(FACING))
        (low, high), half = place.span(side), group.width / 2 + GAP_M
        x1, y1, x2, y2 = place.box
        if group.free:
            x = round(self._rng.uniform(x1 + 0.6, x2 - 0.6), 2)
            y = round(self._rng.uniform(y1 + 0.6, y2 - 0.6), 2)
            return side, x, (x, y, FACING[side])
        anywhere = self._rng.uniform(low + half, max(low + half, high - half))
        along = round(self._rng.choice((low + half, high - half, anywhere)), 3)
        if opposite:
            along = round(min(max(opposite[1] + self._rng.uniform(-0.8, 0.8), low + half), high - half), 3)
        back = {"west": x1 + GAP_M, "south": y1 + GAP_M, "east": x2 - GAP_M, "north": y2 - GAP_M}[side]
        x, y = (along, back) if side in ("north", "south") else (back, along)
        return side, along, (x, y, FACING[side])

    def _item(self, item: dict[str, Any], spot: Spot) -> dict[str, Any]:
        """One furnishing of a group in the world, with what stands on it."""
        thing = dict(item)
        stock = thing.pop("stock", 0.0)
        x, y = _world(spot, *thing["at"])
        thing["at"] = [round(x, 3), round(y, 3)]
        thing["face"] = round((spot[2] + thing.get("face", 0.0)) % 360, 1)
        if stock:
            held = self._stocked(thing, stock)
            if held:
                thing["things"] = held
        return thing

    def _stocked(self, parent: dict[str, Any], stock: float) -> list[dict[str, Any]]:
        """What stands on the surfaces of a furnishing, by how often AI2-THOR's homes have it there."""
        held: list[dict[str, Any]] = list(parent.get("things", ()))
        surfaces = _surfaces(parent["type"], tuple(parent["size"]), parent.get("variant", 0))
        if not surfaces:
            return held
        taken: dict[str, list[Rect]] = defaultdict(list)
        for thing in held:
            taken[thing.get("on", surfaces[0].name)].append(_span(thing["at"], _size(thing), thing.get("face", 0.0)))
        for kind, chance in COMMON[parent["type"]].items():
            if self._rng.random() < min(1.0, chance * stock):
                surface = self._rng.choice(surfaces if parent["type"] in SHELVED else surfaces[:1])
                laid = self._laid(kind, surface, taken[surface.name])
                if laid:
                    held.append(laid)
        return held

    def _laid(self, kind: str, surface: Surface, taken: list[Rect]) -> dict[str, Any] | None:
        """A small furnishing where a surface is free, or None."""
        size, face = shapes.info(kind).size, round(self._rng.uniform(-25, 25))
        if size[2] > surface.clear_m - 0.01:
            return None
        half_x, half_y = ((high - low) / 2 for low, high in zip(surface.low_xy, surface.high_xy, strict=True))
        for _ in range(LAY_TRIES):
            wide, deep = _turned(size, face)
            if wide > 2 * half_x or deep > 2 * half_y:
                face = 0
                continue
            x = round(self._rng.uniform(wide / 2 - half_x, half_x - wide / 2), 3)
            y = round(self._rng.uniform(deep / 2 - half_y, half_y - deep / 2), 3)
            span = _span((x, y), size, face)
            if not any(_overlap(span, other) for other in taken):
                taken.append(span)
                return {"type": kind, "on": surface.name, "at": [x, y], "face": face, "variant": self._rng.randrange(8)}
        return None

    def _hung(self, place: Place, kind: str, size: tuple[float, float, float], bottom: float) -> list[dict[str, Any]]:
        """A furnishing on a bare stretch of a wall, or nothing."""
        for _ in range(TRIES):
            side = self._rng.choice(list(FACING))
            low, high = place.span(side)
            at = round(self._rng.uniform(low + size[0] / 2, high - size[0] / 2), 2)
            if place.unmarked(side, at, size[0] + 0.2) and (bottom > LOW_M or place.bare(side, at, size[0])):
                place.mark(side, at, size[0])
                return [_on_wall(kind, place, side, at, size, bottom) | {"variant": self._rng.randrange(20)}]
        return []


def _on_wall(
    kind: str, place: Place, side: str, at: float, size: tuple[float, float, float], bottom: float
) -> dict[str, Any]:
    return {"type": kind, "room": place.name, "wall": side, "at": at, "height": bottom, "size": size}


@lru_cache(maxsize=4096)
def _surfaces(kind: str, size: tuple[float, float, float], variant: int) -> tuple[Surface, ...]:
    return shapes.build(kind, size, None, variant).surfaces


def _size(thing: dict[str, Any]) -> tuple[float, float, float]:
    width, depth, height = thing.get("size") or shapes.info(thing["type"]).size
    return width, depth, height


def _turned(size: tuple[float, float, float], degrees: float) -> tuple[float, float]:
    """Width and depth of the upright box round a turned footprint, with a gap."""
    c, s = abs(math.cos(math.radians(degrees))), abs(math.sin(math.radians(degrees)))
    return size[0] * c + size[1] * s + GAP_M, size[0] * s + size[1] * c + GAP_M


def _span(at: Any, size: tuple[float, float, float], degrees: float) -> Rect:
    wide, deep = _turned(size, degrees)
    return at[0] - wide / 2, at[1] - deep / 2, at[0] + wide / 2, at[1] + deep / 2


def _world(spot: Spot, x: float, y: float) -> tuple[float, float]:
    c, s = math.cos(math.radians(spot[2])), math.sin(math.radians(spot[2]))
    return spot[0] + x * c - y * s, spot[1] + x * s + y * c


def _rect(spot: Spot, x1: float, y1: float, x2: float, y2: float) -> Rect:
    """A rectangle of a group's frame in the world; groups are turned by right angles only."""
    (ax, ay), (bx, by) = _world(spot, x1, y1), _world(spot, x2, y2)
    return min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)


def _overlap(a: Rect, b: Rect) -> bool:
    return a[0] < b[2] - 1e-9 and b[0] < a[2] - 1e-9 and a[1] < b[3] - 1e-9 and b[1] < a[3] - 1e-9
