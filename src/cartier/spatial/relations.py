"""Spatial relations between objects: on, in, under, next to, between, nearest, left of …, in metres with a probability.

All are pure functions over ``MapObject``s; distances are between axis-aligned boxes. The boxes come from observed
surfaces, so they do not fit exactly: a table's box contains part of what stands on it, and a fridge's box may begin
where the counter before it ends. Each relation therefore has a probability, with constants fitted to generated homes
with known contacts. ``benchmarks/spatial.py`` measures them in other homes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from operator import is_
from typing import Literal, NamedTuple

import numpy as np

from cartier.types import Array, MapObject

Kind = Literal[
    "on", "in", "under", "next to", "between", "nearest", "farthest", "left of", "right of", "in room", "bigger"
]
Point = Sequence[float]
"""(x, y) or (x, y, z) in metres."""

PAD_M = 0.03  # largest gap between the boxes of objects that touch
THIN_M = 0.02  # least side of a box
FLOATS_M, SINKS_M = 0.3, 0.15  # no support ends farther below an object's bottom, or begins farther above it
FLOOR_M = 0.08  # an object whose bottom is lower mostly stands on the floor
NEXT_M, LEVEL_M = 0.5, 0.3  # "next to": largest distance, and largest height of one's bottom above the other's top
BESIDE_M = 0.3  # "between": largest offset from the straight line

# A query accepts more than the map would state: people use these words loosely, and the best match of few is wanted.
ASKED_NEXT_M, ASKED_NEAR_M = 0.8, 1.0  # "next to" and "near"
ASKED_TIE_M = 0.25  # distance behind the nearest object within which others count as near too
ASKED_ON_M = 0.12  # "on" and "in", from the boxes alone, where no support is known
ASKED_UNDER_M, ASKED_ABOVE_M = 0.1, 0.3  # "under" and "above": largest gap between the outlines on the floor plan

BLUR_M, BLUR = 0.05, 0.08  # standard deviation of distances between boxes: at least, and per metre of the larger one
AWRY_M = 0.07  # standard deviation of the centres of boxes
BLUR_SIZE = 0.15  # standard deviation of the logarithms of sizes
NEARER = 10.0  # log-odds of being the nearest, per metre
UNDER = 0.6  # share of the objects below an object and within its outline that people call under it
LIKELY, LEAST = 0.5, 0.05  # least probability of a reported support, and of most other reported relations


@dataclass(frozen=True)
class Relation:
    """``subject`` is ``kind`` ``object``: ids of objects, for "in room" that of the room; None for a point.

    ``metres`` is the distance between the boxes; for left and right, the distance to that side; for bigger, the
    difference of the longest sides. ``probability`` is from 0 to 1. ``other`` is the second of the two that the subject
    is between.
    """

    kind: Kind
    subject: int
    object: int | None
    metres: float
    probability: float
    other: int | None = None


class _Holder(NamedTuple):
    """How well a kind of object supports others, as log-odds.

    ``per_metre`` is lost per metre that the other begins below its top; ``snug`` is gained if the other fits snugly.
    Above the share ``on_from`` of its height, the other is on it, else in it.
    """

    bias: float
    per_metre: float
    snug: float
    on_from: float


_TABLE = _Holder(2.9, -5.5, 0.0, 0.5)
_SEAT = _Holder(0.4, -1.9, 0.0, -math.inf)  # its back is higher than its seat
_STORE = _Holder(0.6, 0.0, 0.0, 0.85)
_VESSEL = _Holder(1.4, -15.6, 3.3, math.inf)  # stands on something itself
_PLATE = _VESSEL._replace(on_from=-math.inf)
_OTHER = _Holder(-1.9, -4.8, 0.0, 0.5)
_HOLDERS = {
    name: holder
    for holder, names in (
        (_TABLE, "table, counter top, countertop, dining table, coffee table, side table, desk, dresser"),
        (_TABLE, "tv stand, nightstand, shelf, washing machine"),
        (_SEAT, "bed, sofa, couch, chair, arm chair, armchair, bench, toilet, stool, ottoman, footstool"),
        (_STORE, "fridge, refrigerator, oven, cabinet, cupboard, bookcase, bookshelf, wardrobe, closet, safe"),
        (_STORE, "shelving unit, dishwasher, bathtub, garbage can, trash can, bin, laundry hamper, dog bed, microwave"),
        (_STORE, "box, basket, cart"),
        (_VESSEL, "sink, bowl, pot, pan, mug, cup, vase"),
        (_PLATE, "plate, tray, stove burner, stove"),
    )
    for name in names.split(", ")
}  # fmt: skip
_PORTABLE = frozenset({"shelf", "microwave", "box", "basket"})
"""Tables and stores that may stand on others; all other furniture stands on the floor."""
_LEGGED = frozenset({"table", "dining table", "coffee table", "side table", "desk"})
"""Tables that hold nothing between their legs: what stands there on the floor is under them."""
_FIXED = frozenset({
    "mirror", "painting", "poster", "picture", "window", "curtain", "curtains", "blinds", "door", "clock",
    "light switch", "faucet", "tap", "towel", "hand towel", "towel holder", "hand towel holder", "toilet paper hanger",
    "shower head", "shower curtain", "shower door",
})  # fmt: skip
"""Objects that hang on walls."""
_BUILT_IN = frozenset({"sink", "faucet", "tap", "stove", "stove burner"})  # into a table


class _Same(tuple[MapObject, ...]):
    """Objects as a key: the very same ones in the same order, for comparing all that they hold takes long."""

    def __hash__(self) -> int:
        return hash(tuple(map(id, self)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and len(self) == len(other) and all(map(is_, self, other))


def supports(objects: Iterable[MapObject]) -> Mapping[int, Relation]:
    """What each object stands on or in, by its id; objects on the floor or on a wall have no entry.

    All possible supports and none at all compete (a conditional logit). There are no cycles of objects that support
    each other.
    """
    return _supports(_Same(objects))


@lru_cache(maxsize=64)  # every request to a home asks of the same objects
def _supports(objects: _Same) -> Mapping[int, Relation]:
    if len(objects) < 2:
        return {}
    low, high = _boxes(objects)
    odds, alone = _holding(objects, low, high), _standing_alone(objects, low)
    most = np.maximum(odds.max(1), alone)
    weights = np.exp(odds - most[:, None])
    shares = weights / (weights.sum(1) + np.exp(alone - most))[:, None]
    holder, likely, metres = shares.argmax(1), shares.max(1), _apart(low, high, low, high)
    held_by: dict[int, int] = {}
    for s in np.argsort(-likely, kind="stable").tolist():
        o = int(holder[s])
        below = o
        while below in held_by:
            below = held_by[below]
        if likely[s] >= LIKELY and below != s:
            held_by[s] = o
    found = {}
    for s, o in sorted(held_by.items()):
        share = (low[s, 2] - low[o, 2]) / max(high[o, 2] - low[o, 2], THIN_M)
        kind: Kind = "on" if share >= _HOLDERS.get(objects[o].label, _OTHER).on_from else "in"
        found[objects[s].id] = Relation(kind, objects[s].id, objects[o].id, float(metres[s, o]), float(likely[s]))
    return found


def under(obj: MapObject, objects: Sequence[MapObject]) -> tuple[Relation, ...]:
    """Objects below an object and within its outline, the most probable first, without its support and its contents."""
    held = supports(objects if any(other is obj for other in objects) else (obj, *objects))
    objects, low, high, own_low, own_high, apart = _around(obj, objects)
    own = _HOLDERS.get(obj.label)
    fits = [own == _TABLE or (own == _SEAT and not _is_furniture(other)) for other in objects]  # between the legs
    between_legs = np.array(fits, bool) & (low[:, 2] < own_low[2] + FLOOR_M) & (high[:, 2] <= own_high[2])
    below = (high[:, 2] <= own_low[2] - PAD_M) | between_legs
    holder = {i: relation.object for i, relation in held.items()}
    # an object with the same support is beside it, or a shelf lower
    free = [holder.get(o.id) is None or holder[o.id] not in (obj.id, holder.get(obj.id)) for o in objects]
    share = _within(low, high, own_low[None], own_high[None])[:, 0]
    return _told("under", obj, objects, apart, UNDER * (below & np.array(free, bool)) * _chance((share - 0.5) / 0.2))


def next_to(obj: MapObject, objects: Sequence[MapObject]) -> tuple[Relation, ...]:
    """Objects beside an object in the same room, the most probable first; not those over, under, on or in it."""
    objects, low, high, own_low, own_high, apart = _around(obj, objects)
    share = np.maximum(
        _within(low, high, own_low[None], own_high[None])[:, 0], _within(own_low[None], own_high[None], low, high)[0]
    )
    level = np.maximum(low[:, 2] - own_high[2], own_low[2] - high[:, 2]) < LEVEL_M
    same_room = np.array([None in (obj.room, other.room) or obj.room == other.room for other in objects], bool)
    larger = np.maximum((high - low)[:, :2].max(1), (own_high - own_low)[:2].max())
    close = _chance((NEXT_M - apart) / np.hypot(BLUR_M, BLUR * larger))
    return _told("next to", obj, objects, apart, level * same_room * close * _chance((0.5 - share) / 0.2))


def between(a: MapObject, b: MapObject, objects: Sequence[MapObject]) -> tuple[Relation, ...]:
    """Objects between two others on the floor plan, the most probable first; ``metres`` is the offset from the line."""
    objects = [other for other in objects if other.id not in (a.id, b.id)]
    low, high = _boxes(objects)
    (start, end), middles = ((np.add(t.box_min, t.box_max) / 2)[:2] for t in (a, b)), (low + high)[:, :2] / 2
    length = max(float(np.linalg.norm(end - start)), THIN_M)
    along, across = _components(middles - start, (end - start) / length)
    inside = np.minimum(along, length - along)
    likely = _chance(inside / AWRY_M) * _chance((max(BESIDE_M, length / 4) - np.abs(across)) / AWRY_M)
    return _told("between", a, objects, np.abs(across), likely, b.id)


def nearest(obj: MapObject | Point, objects: Sequence[MapObject]) -> tuple[Relation, ...]:
    """All objects by the probability that each is the nearest to an object or a point; equally near ones share it."""
    return _ranked("nearest", obj, objects, -NEARER)


def farthest(obj: MapObject | Point, objects: Sequence[MapObject]) -> tuple[Relation, ...]:
    """All objects by the probability that each is the farthest from an object or a point."""
    return _ranked("farthest", obj, objects, NEARER)


def left_of(obj: MapObject, objects: Sequence[MapObject], seen_from: Point) -> tuple[Relation, ...]:
    """Objects to the left of an object, the most probable first.

    ``seen_from`` is the viewpoint (x, y), which faces the object, or the pose (x, y, yaw), which faces along its yaw.
    """
    return _sideways("left of", obj, objects, seen_from)


def right_of(obj: MapObject, objects: Sequence[MapObject], seen_from: Point) -> tuple[Relation, ...]:
    """Objects to the right of an object; see ``left_of``."""
    return _sideways("right of", obj, objects, seen_from)


def bigger(one: MapObject, other: MapObject) -> Relation:
    """The probability that one object is bigger than another, by its longest side and its volume."""
    low, high = _boxes((one, other))
    sides = np.maximum(high - low, THIN_M)
    longest, volume = sides.max(1), sides.prod(1)
    log_ratio = math.log(longest[0] / longest[1]) / 2 + math.log(volume[0] / volume[1]) / 6
    likely = float(_chance(np.array(log_ratio / BLUR_SIZE)))
    return Relation("bigger", one.id, other.id, float(longest[0] - longest[1]), likely)


def _holding(objects: Sequence[MapObject], low: Array, high: Array) -> Array:
    """Log-odds (n, n) that the second of each pair supports the first; -inf where that is impossible."""
    holders = [_HOLDERS.get(obj.label, _OTHER) for obj in objects]
    bias, per_metre, snug = np.array([holder[:3] for holder in holders]).T
    above = low[:, None, 2] - high[None, :, 2]
    rise = low[:, None, 2] - low[None, :, 2]
    share = _within(low, high, low, high)
    middles = (low + high)[:, None, :2] / 2
    outside = np.linalg.norm(np.maximum(0, np.maximum(low[:, :2] - middles, middles - high[:, :2])), axis=2)
    fit = np.maximum(share, share.T) * np.exp(-((np.maximum(0, np.maximum(-rise, above)) / PAD_M) ** 2))
    odds = (
        bias + per_metre * np.clip(-above - PAD_M, 0, 1) + snug * fit
        + 4.1 * share - 8.9 * np.minimum(outside, 1) - 16.9 * np.maximum(above, 0)
        - 15.8 * np.maximum(-rise - THIN_M, 0)
    )  # fmt: skip
    built_in = np.array([obj.label in _BUILT_IN for obj in objects])
    furniture = np.array([_is_furniture(obj) for obj in objects])
    table = np.array([holder == _TABLE for holder in holders])
    never = (np.maximum(share, share.T) == 0) | (above > FLOATS_M) | (rise < -SINKS_M)
    never |= built_in[:, None] & (snug > 0)
    legged = np.array([obj.label in _LEGGED for obj in objects])
    never |= legged & (low[:, None, 2] < FLOOR_M) & (high[:, None, 2] < high[None, :, 2] - PAD_M)
    never |= furniture[:, None] & table  # the visible box of a chair behind a table begins at the table's top
    np.fill_diagonal(never, True)
    return np.where(never, -np.inf, odds)


def _standing_alone(objects: Sequence[MapObject], low: Array) -> Array:
    """Log-odds (n,) that only the floor or a wall supports an object."""
    fixed = np.array([obj.label in _FIXED for obj in objects])
    furniture = np.array([_is_furniture(obj) for obj in objects])
    return np.asarray(3.7 * (low[:, 2] < FLOOR_M) + 4.1 * fixed + 3.9 * furniture)


def _is_furniture(obj: MapObject) -> bool:
    return _HOLDERS.get(obj.label) in (_TABLE, _SEAT, _STORE) and obj.label not in _PORTABLE


def _ranked(kind: Kind, obj: MapObject | Point, objects: Sequence[MapObject], per_metre: float) -> tuple[Relation, ...]:
    if isinstance(obj, MapObject):
        objects, *_, apart = _around(obj, objects)
    else:
        low, high = _boxes(objects)
        point = np.array([obj], dtype=np.float64)
        axes = point.shape[1]
        apart = _apart(point, point, low[:, :axes], high[:, :axes])[0]
    odds = per_metre * apart + np.log([max(other.probability, 1e-6) for other in objects])
    weights = np.exp(odds - odds.max(initial=-np.inf))
    here = obj if isinstance(obj, MapObject) else None
    return _told(kind, here, objects, apart, weights / weights.sum(), least=0.0)


def _sideways(kind: Kind, obj: MapObject, objects: Sequence[MapObject], seen_from: Point) -> tuple[Relation, ...]:
    objects = [other for other in objects if other.id != obj.id]
    low, high = _boxes(objects)
    here, place = np.array(seen_from[:2], np.float64), (np.add(obj.box_min, obj.box_max) / 2)[:2]
    way = place - here if len(seen_from) < 3 else np.array([math.cos(seen_from[2]), math.sin(seen_from[2])])
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    middles = (low + high)[:, :2] / 2
    ahead = _components(middles - here, way)[0] > 0
    left = _components(middles - place, way)[1] * (1 if kind == "left of" else -1)
    return _told(kind, obj, objects, left, ahead * _chance(left / AWRY_M))


def _told(
    kind: Kind, obj: MapObject | None, objects: Sequence[MapObject], metres: Array, likely: Array,
    other: int | None = None, least: float = LEAST,
) -> tuple[Relation, ...]:  # fmt: skip
    """The relations that are probable enough, the most probable first."""
    order = [k for k in np.argsort(-likely, kind="stable").tolist() if likely[k] >= least]
    own = None if obj is None else obj.id
    return tuple(Relation(kind, objects[k].id, own, float(metres[k]), float(likely[k]), other) for k in order)


def _around(obj: MapObject, objects: Sequence[MapObject]) -> tuple[list[MapObject], Array, Array, Array, Array, Array]:
    """All other objects, their boxes, the object's own box, and their distances from it."""
    others = [other for other in objects if other.id != obj.id]
    low, high = _boxes(others)
    own_low, own_high = np.array(obj.box_min), np.array(obj.box_max)
    return others, low, high, own_low, own_high, _apart(own_low[None], own_high[None], low, high)[0]


def _boxes(objects: Sequence[MapObject]) -> tuple[Array, Array]:
    corners = np.array([(obj.box_min, obj.box_max) for obj in objects], np.float64).reshape(-1, 2, 3)
    return corners[:, 0], corners[:, 1]


def _apart(low: Array, high: Array, other_low: Array, other_high: Array) -> Array:
    """Distances (n, m) between boxes (n, D) and (m, D)."""
    gaps = np.maximum(low[:, None] - other_high, other_low - high[:, None])
    return np.asarray(np.linalg.norm(np.maximum(gaps, 0), axis=2))


def _within(low: Array, high: Array, other_low: Array, other_high: Array) -> Array:
    """Shares (n, m) of each outline on the floor plan that lie within each other one or 3 cm beside it."""
    low, high = low[:, None, :2], high[:, None, :2]
    own = np.maximum(high - low, THIN_M)
    shared = np.minimum(high, other_high[:, :2] + PAD_M) - np.maximum(low, other_low[:, :2] - PAD_M)
    return np.asarray((np.clip(shared, 0, own) / own).prod(2))


def _components(vectors: Array, way: Array) -> tuple[Array, Array]:
    """Components of vectors (n, 2) along a direction (2,), and to the left of it."""
    return vectors @ way, vectors @ np.array([-way[1], way[0]])


def _chance(z: Array) -> Array:
    """The standard normal distribution function."""
    from scipy.special import ndtr

    return np.asarray(ndtr(z))
