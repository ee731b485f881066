"""Resolution of referring expressions: the objects of a home are filtered by the expression, then ranked."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from cartier.labels import name_key
from cartier.spatial import relations
from cartier.spatial.colour_shares import coloured_share, share
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation, rephrased
from cartier.types import Door, Inventory, MapObject, Room

Side = Callable[[MapObject, Sequence[MapObject], relations.Point], tuple[relations.Relation, ...]]
LEAST_SHARE = 0.12  # least share of an object's surface that a colour must cover to describe it
MAIN_SHARE = 0.25  # share from which an object has a colour; others are considered if no object has
LIKELY = 0.3  # least probability of a tentative landmark, and of a relation that a person states
DOORS = frozenset(["door", "doorway", "doors", "entrance", "exit", "way out", "threshold", "passage"])
DOOR_M = 2.0  # height of a door
HERE = frozenset(["me", "you", "us", "here"])
"""Words for where the robot stands, with whoever speaks to it."""
REACH_M = 0.5  # half the width of that place
LEAST = 0.1  # least probability of a tentative object that is mentioned at all
CLEARLY = 1.3  # ratio to the next object's share of a colour from which the colour means one object alone
DEEPEST = 5  # objects that stand on each other
ALIKE = 0.9  # sizes from this share of the biggest count as equal


def is_door(phrase: ReferringExpression) -> bool:
    """Whether a phrase names a passage between rooms, or the way out."""
    return name_key(phrase.said) in DOORS or phrase.said.split()[-1:] == ["door"]


def called(obj: MapObject, names: Iterable[str]) -> bool:
    """Whether an object has one of the names, as its label or given by people."""
    return not set(names).isdisjoint((obj.label, *obj.names))


NO_WAY_M = 1000.0  # farther than all to which there is a way


class Scene:
    """The confirmed objects of an inventory, and what supports each of them."""

    def __init__(self, inventory: Inventory) -> None:
        self.rooms = {room.id: room for room in inventory.rooms}
        self.objects = [obj for obj in inventory.objects if obj.confirmed]
        maybe = [o for o in inventory.objects if not o.confirmed and o.probability >= LEAST]
        self.maybe = sorted(maybe, key=lambda o: -o.probability)  # mentioned in words, never served unasked
        self.by_id = {obj.id: obj for obj in self.objects} | {a: t for t in self.objects for a in t.aliases}
        self.from_xy, self._way_m, self._ways_m = inventory.from_xy, inventory.way_m, dict[int, float | None]()
        self.every_door, self._shut_doors = inventory.doors, inventory.shut_doors

    @property
    def known(self) -> bool:
        """Whether the inventory holds more than names."""
        return any(obj.box_max != obj.box_min for obj in self.objects)

    @cached_property
    def several(self) -> frozenset[str]:
        """The labels of more than one object."""
        counts = Counter(obj.label for obj in self.objects)
        return frozenset(label for label, count in counts.items() if count > 1)

    @cached_property
    def holders(self) -> Mapping[int, relations.Relation]:
        return relations.supports(self.objects)

    def held_by(self, obj: MapObject) -> list[MapObject]:
        """What an object stands on or in, and what that stands on, in order."""
        found: list[MapObject] = []
        while obj.id in self.holders and self.holders[obj.id].object is not None and len(found) < DEEPEST:
            obj = self.by_id[self.holders[obj.id].object or 0]
            found.append(obj)
        return found

    def room_of(self, obj: MapObject) -> Room | None:
        return self.rooms.get(-1 if obj.room is None else obj.room)

    def distance_m(self, obj: MapObject, other: MapObject | None = None) -> float:
        """Distance between two boxes; without ``other``, between the object and the robot, along the floor."""
        at = (self.from_xy or (0.0, 0.0))[:2]
        low, high = (at, at) if other is None else (other.box_min, other.box_max)
        sides = zip(obj.box_min, obj.box_max, low, high, strict=False)
        return math.sqrt(sum(max(a - d, c - b, 0.0) ** 2 for a, b, c, d in sides))

    def way_m(self, obj: MapObject) -> float:
        """How far the robot drives to an object; where no way to it is known, it comes after all others."""
        if obj.id not in self._ways_m:
            self._ways_m[obj.id] = self._way_m(obj.id)
        way_m, far_m = self._ways_m[obj.id], self.distance_m(obj)
        return NO_WAY_M + far_m if way_m is None else max(way_m, far_m)

    def meant(
        self, phrase: ReferringExpression, without: Iterable[int] = ()
    ) -> tuple[list[MapObject], SpatialRelation | None]:
        """The objects that a phrase may mean, best first; without any, also the constraint that excluded the last."""
        if phrase.obj is not None:
            return [self.by_id[phrase.obj]] if phrase.obj in self.by_id else [], None
        if phrase.similar:
            own = replace(phrase, similar=frozenset())
            found, emptied = self.meant(own, without)
            like = () if found else self.meant(replace(own, labels=phrase.similar), without)[0]
            return list(like or found), None if like else emptied
        out = set(without)
        every = [self.by_id[i] for i in phrase.among if i in self.by_id] or sorted(self.objects, key=self.distance_m)
        found = [o for o in every if (phrase.generic or called(o, phrase.labels)) and o.id not in out]
        if len(found) > 1 and not (phrase.generic or phrase.among):
            found.sort(key=self.way_m)
        if phrase.usually is not None:
            found = self._related(found, phrase.usually) or found
        for constraint in phrase.relations:
            left = self._related(found, constraint)
            if not left and found:
                return [], constraint
            found = left
        if phrase.colours and found:
            of = {o.id: coloured_share(o, phrase.colours) for o in found}
            exact = [o for o in found if share(o, phrase.colours) >= MAIN_SHARE]
            coloured = exact or [o for o in found if of[o.id] >= LEAST_SHARE]
            if phrase.also:
                coloured = [o for o in coloured if share(o, phrase.also) >= LEAST_SHARE] or coloured
                of = {o.id: min(of[o.id], coloured_share(o, phrase.also)) for o in found}
            coloured.sort(key=lambda o: -of[o.id])
            unlike = [o for o in found if o.colours and of[o.id] == 0]
            if not coloured and (len(found) > 1 or unlike):
                return [], SpatialRelation("colour")
            found = coloured or found
            if len(found) > 1 and of[found[0].id] > CLEARLY * of[found[1].id]:
                found = found[:1]
        wish = phrase.most or (phrase.size if len(found) > 1 else "")
        if wish and found and phrase.order:  # the second nearest
            found = sorted(found, key=lambda o: -self.measure(o, wish))
        elif wish and found:
            found = self.most(found, wish)
        if phrase.order and found:
            found = found[phrase.order - 1 :][:1] if phrase.order > 0 else found[phrase.order :][:1]
        return found, None

    def with_rooms(self, asked: ParsedUtterance, last: MapObject | None = None) -> ParsedUtterance:
        """The query with each room that is described replaced by the rooms that fit: "the second bedroom", "the room
        with the bed"; "the other bedroom" is not that of ``last``."""
        return rephrased(asked, lambda phrase: self._room_meant(phrase, last.room if last is not None else None))

    def _room_meant(self, phrase: ReferringExpression, here: int | None) -> ReferringExpression:
        unnamed = phrase.rooms == () and name_key(phrase.said) in ("room", "one", "place")
        if phrase.rooms is None or phrase.bare or not (phrase.rooms or unnamed):
            return phrase
        found = sorted(self.rooms if unnamed else phrase.rooms, key=lambda i: self.rooms[i].name)
        for relation in phrase.relations:
            if relation.kind in ("with", "in") and relation.target is not None and relation.target.rooms is None:
                holding = {o.room for o in self.landmarks(relation.target)}
                found = [i for i in found if i in holding]
        if phrase.other:
            found = [i for i in found if i != here]
        wish = phrase.most or phrase.size
        if wish in ("biggest", "smallest", "longest", "widest") and found:
            found = [(min if wish == "smallest" else max)(found, key=self._room_size)]
        if found and phrase.order:
            found = found[phrase.order - 1 :][:1] if phrase.order > 0 else found[phrase.order :][:1]
        return ReferringExpression(phrase.said if found else f"such {phrase.said}", rooms=tuple(found))

    def _room_size(self, room: int) -> float:
        """The number of a room's cells; where there is no floor plan, the area over which its objects stand (m²)."""
        inside = [o for o in self.objects if o.room == room]
        if len(self.rooms[room].cells) or not inside:
            return float(len(self.rooms[room].cells))
        low, high = (np.array([getattr(o, corner)[:2] for o in inside]) for corner in ("box_min", "box_max"))
        return float(np.prod(high.max(0) - low.min(0)))

    @property
    def robot(self) -> MapObject:
        """Where the robot stands, as a landmark: what is within reach of it is beside it. Its id is none."""
        x, y = (self.from_xy or (0.0, 0.0))[:2]
        low, high = (x - REACH_M, y - REACH_M, 0.0), (x + REACH_M, y + REACH_M, DOOR_M)
        return MapObject.of_box(-1, "robot", low, high, labels=())

    def landmarks(self, phrase: ReferringExpression) -> list[MapObject]:
        """The objects that a phrase may mean as a landmark: confirmed ones, else doors of the floor plan, else likely
        tentative ones."""
        if phrase.generic and phrase.said in HERE:
            return [self.robot]
        return self.meant(phrase)[0] or [_doorway(door) for door in self.doors(phrase)] or self._perhaps_there(phrase)

    def doors(self, phrase: ReferringExpression, shut: bool = False) -> list[Door]:
        """The passages that a phrase may mean: "the kitchen door" is any of the kitchen's. ``shut``: by now."""
        if name_key(phrase.said) not in DOORS:
            return []
        ends = (end for relation in phrase.relations for end in (relation.target, relation.other))
        told = [set(end.rooms) for end in ends if end is not None and end.rooms]
        asked = self._shut_doors if shut else self.every_door
        return [door for door in asked if all(rooms & set(door.rooms) for rooms in told)]

    def door_distance_m(self, door: Door) -> float:
        """The distance from the robot to the middle of a door."""
        return math.dist(door.xy, (self.from_xy or (0.0, 0.0))[:2])

    def _perhaps_there(self, landmark: ReferringExpression) -> list[MapObject]:
        """Tentative objects that may still serve as a landmark."""
        key = name_key(landmark.said)
        return [o for o in self.maybe if o.probability >= LIKELY and name_key(o.label) == key]

    def perhaps(self, phrase: ReferringExpression) -> MapObject | None:
        """The most probable tentative object that a phrase, with its relations, may mean."""
        key = name_key(phrase.said)
        found = [o for o in self.maybe if called(o, phrase.labels) or name_key(o.label) == key]
        for constraint in phrase.relations:
            found = self._related(found, constraint)
        return max(found, key=lambda o: o.probability, default=None)

    def most(self, found: Sequence[MapObject], wish: str) -> list[MapObject]:
        """The biggest, highest, nearest … of the objects, as a list of one."""
        of = {o.id: self.measure(o, wish) for o in found}
        best = max(of.values())
        if wish in ("nearest", "farthest", "leftmost", "rightmost", "highest", "lowest"):
            return [max(found, key=lambda o: of[o.id])]
        return sorted((o for o in found if of[o.id] >= best - abs(best) * (1 - ALIKE)), key=lambda o: -of[o.id])[:1]

    def measure(self, obj: MapObject, wish: str) -> float:
        """The value by which a superlative ranks an object; the largest wins."""
        low, high = np.array(obj.box_min), np.array(obj.box_max)
        size = np.maximum(high - low, 0.02)
        if wish in ("nearest", "farthest"):
            far = self.way_m(obj)
            return -far if wish == "nearest" else far
        if wish in ("leftmost", "rightmost"):
            at = np.array(self.from_xy or (0.0, 0.0))[:2]
            mean = np.mean([np.array(o.position)[:2] for o in self.objects], axis=0) - at
            way = np.array(obj.position)[:2] - at
            turn = math.atan2(mean[0] * way[1] - mean[1] * way[0], float(mean @ way))
            return turn if wish == "leftmost" else -turn
        measured = {
            "biggest": float(np.prod(size)), "smallest": -float(np.prod(size)), "tallest": float(size[2]),
            "shortest": -float(size[2]), "highest": float(high[2]), "lowest": -float(low[2]),
            "widest": float(size[:2].max()), "longest": float(size.max()),
        }  # fmt: skip
        return measured[wish]

    def _related(self, found: Sequence[MapObject], constraint: SpatialRelation) -> list[MapObject]:
        kind, target = constraint.kind, constraint.target
        if target is None:
            return self.most(found, kind) if found else []
        if kind.startswith("not "):
            there = {o.id for o in self._related(found, replace(constraint, kind=kind[4:]))}
            return [o for o in found if o.id not in there]
        if target.rooms is not None:
            rooms = set(target.rooms)
            inside = [o for o in found if o.room in rooms]
            return inside if kind != "farthest" else [o for o in found if o.room not in rooms]
        beside = self.landmarks(target)
        if not beside:
            return []
        ways: dict[str, Callable[[], list[MapObject]]] = {
            "on": lambda: self._on(found, beside),
            "in": lambda: self._on(found, beside),
            "from": lambda: self._on(found, beside),
            "under": lambda: self._under(found, beside),
            "above": lambda: self._above(found, beside),
            "with": lambda: self._with(found, beside, target.number),
            "between": lambda: self._between(found, beside, constraint),
            "next to": lambda: self._close(self._apart(found, beside), beside, relations.ASKED_NEXT_M),
            "of": lambda: self._close(found, beside, relations.ASKED_NEXT_M),
            "near": lambda: self._close(found, beside, relations.ASKED_NEAR_M),
            "nearest": lambda: self._close(found, beside, math.inf)[:1],
            "farthest": lambda: self._close(found, beside, math.inf, farthest=True)[:1],
            "left of": lambda: self._side(found, beside, relations.left_of),
            "right of": lambda: self._side(found, beside, relations.right_of),
        }
        return ways[kind]()

    def _on(self, found: Sequence[MapObject], beside: Sequence[MapObject]) -> list[MapObject]:
        ids = {o.id for o in beside}
        direct = [o for o in found if any(h.id in ids for h in self.held_by(o)[:1])]
        held = direct or [o for o in found if any(h.id in ids for h in self.held_by(o))]
        return held or [o for o in found if any(self._stands(o, b) for b in beside)]

    def _stands(self, obj: MapObject, below: MapObject) -> bool:
        """Whether an object is above or within another's outline and close to it, whatever its support was labelled."""
        x, y, _ = obj.position
        over = below.box_min[0] <= x <= below.box_max[0] and below.box_min[1] <= y <= below.box_max[1]
        return obj.id != below.id and over and self.distance_m(obj, below) <= relations.ASKED_ON_M

    def _under(self, found: Sequence[MapObject], beside: Sequence[MapObject]) -> list[MapObject]:
        below = {h.id for b in beside for h in self.held_by(b)[:1]}
        if holding := [o for o in found if o.id in below]:  # "the burner under the pot"
            return holding
        ids = {r.subject for b in beside for r in relations.under(b, self.objects) if r.probability >= LIKELY}
        low = [o for o in found if o.id in ids]
        lower = ((o, b) for o in found for b in beside if o.position[2] < b.position[2])
        return low or list({o.id: o for o, b in lower if self._flat_m(o, b) < relations.ASKED_UNDER_M}.values())

    def _above(self, found: Sequence[MapObject], beside: Sequence[MapObject]) -> list[MapObject]:
        higher = ((o, b) for o in found for b in beside if o.position[2] > b.box_max[2])
        high = {o.id: o for o, b in higher if self._flat_m(o, b) < relations.ASKED_ABOVE_M}
        return sorted(high.values(), key=lambda o: min(self._flat_m(o, b) for b in beside))

    def _flat_m(self, one: MapObject, other: MapObject) -> float:
        apart = np.maximum(np.array(one.box_min) - other.box_max, np.array(other.box_min) - one.box_max)[:2]
        return float(np.linalg.norm(np.maximum(apart, 0)))

    def _with(self, found: Sequence[MapObject], beside: Sequence[MapObject], number: int) -> list[MapObject]:
        """Those that hold any of the others, else those beside them; of several, those with the number that is said."""
        holds = Counter(h.id for b in beside for h in self.held_by(b)[:1])
        holding = [o for o in found if o.id in holds]
        told = [o for o in holding if holds[o.id] == number] or [o for o in holding if 0 < number < holds[o.id]]
        return told or holding or self._close(found, beside, relations.ASKED_NEXT_M)

    def _between(
        self, found: Sequence[MapObject], beside: Sequence[MapObject], constraint: SpatialRelation
    ) -> list[MapObject]:
        ends = self.meant(constraint.other)[0] if constraint.other is not None else list(beside[1:])
        pairs = [(a, b) for a in beside[:4] for b in ends[:4] if a.id != b.id]
        told = [r for a, b in pairs for r in relations.between(a, b, [o for o in found if o.id not in (a.id, b.id)])]
        told.sort(key=lambda r: -r.probability)
        likely = [r.subject for r in told if r.probability >= LIKELY][:1]
        return [o for o in found if o.id in likely]

    def _apart(self, found: Sequence[MapObject], beside: Sequence[MapObject]) -> Sequence[MapObject]:
        """The objects that neither stand on the others nor hold them, if there are any close by."""
        ids = {b.id for b in beside}
        below = {h.id for b in beside for h in self.held_by(b)}
        apart = [o for o in found if o.id not in below and not any(h.id in ids for h in self.held_by(o))]
        return apart if self._close(apart, beside, relations.ASKED_NEXT_M) else found

    def _close(
        self, found: Sequence[MapObject], beside: Sequence[MapObject], most_m: float, farthest: bool = False
    ) -> list[MapObject]:
        """Those close to any of the others, the closest first; those in the same room alone, if there are any."""
        others = [o for o in found if any(b.id != o.id for b in beside)]
        far = {o.id: min(self.distance_m(o, b) for b in beside if b.id != o.id) for o in others}
        if farthest:
            return sorted(others, key=lambda o: -far[o.id])
        rooms = {b.room for b in beside}
        close = [o for o in others if far[o.id] <= most_m]
        same = [o for o in close if o.room in rooms] or close
        same.sort(key=lambda o: far[o.id])
        return [o for o in same if far[o.id] <= far[same[0].id] + relations.ASKED_TIE_M]

    def _side(self, found: Sequence[MapObject], beside: Sequence[MapObject], side: Side) -> list[MapObject]:
        """The nearest object to the left or right, from the best view of the landmark."""
        told = [
            r for b in beside if b.views for r in side(b, [o for o in found if o.id != b.id], b.views[0].camera[:2])
        ]
        likely = {r.subject for r in told if r.probability >= 0.5}
        there = [o for o in found if o.id in likely]
        return sorted(there, key=lambda o: min(self.distance_m(o, b) for b in beside))[:1]


def _doorway(door: Door) -> MapObject:
    """A passage as a landmark. It is no object of the home, so its id is none."""
    (x, y), half = door.xy, door.width_m / 2
    low, high = (x - half, y - half, 0.0), (x + half, y + half, DOOR_M)
    return MapObject.of_box(-1, "door", low, high)
