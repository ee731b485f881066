"""A map with the corrections of its log applied: what people said outweighs every score, and outlives growing.

An entry finds its object by id or alias, label and position. An object that a person spoke of and that the map no
longer holds is made anew from the entry; one that was removed does not come back under another id.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from cartier.home import room_changes
from cartier.home.correction_log import Correction, Subject, in_force, in_words, rules_of
from cartier.home.object_changes import affirmed, halves, made, merged, moved, relabelled, weighed
from cartier.types import MapObject, OccupancyGrid, Room
from cartier.types.route_rules import RouteRule

NEAR_M = 1.0  # the object of the noted label within this distance is the one meant
SAME_M = 0.3  # the object of the noted id counts as this much nearer; with another label, it must lie within it
FIRST_MADE, MAX_MADE = 1_000_000, 1000  # ids of objects that people add, to which no map counts; how many there may be


@dataclass(frozen=True, eq=False)
class Corrected:
    """Objects, rooms and the home's name with and without corrections, the log, and notes about unfit entries.

    ``made`` are the objects that people added, as they were added; ``rules`` are those for routes; ``looked_at`` are
    the ids of the objects of which a vision model said something.
    """

    objects: tuple[MapObject, ...]
    rooms: tuple[Room, ...]
    mapped_objects: tuple[MapObject, ...]
    mapped_rooms: tuple[Room, ...]
    log: tuple[Correction, ...]
    notes: tuple[str, ...]
    made: tuple[MapObject, ...] = ()
    name: str = ""
    mapped_name: str = ""
    rules: tuple[RouteRule, ...] = ()
    looked_at: frozenset[int] = frozenset()


def apply(
    log: Sequence[Correction],
    objects: tuple[MapObject, ...],
    rooms: tuple[Room, ...],
    grid: OccupancyGrid | None,
    name: str = "",
    origin: str = "",
) -> Corrected:
    """Apply all corrections in force to a map; one whose object or room is not found becomes a note.

    ``origin`` names the pose frame of the map: only in that frame is an object made anew where an entry noted it.
    """
    work = _Applying(in_force(log), objects, rooms, grid, name, origin)
    for entry in work.log:
        if entry.what in ("rule", "lift"):
            work.meant |= {entry.id: {room.name: room.id for room in work.places.values()}} if entry.rule else {}
            continue
        subject = cast(Subject, entry.subject)
        if entry.what == "evidence":
            work.weigh(entry, subject)
        elif subject.kind == "home":
            work.name = str(entry.name)
        elif subject.kind == "room":
            work.change_room(entry, subject)
        else:
            work.change(entry, subject)
    return Corrected(
        work.sorted_objects(), tuple(work.places.values()), objects, rooms, tuple(log), tuple(work.notes),
        tuple(work.made.values()), work.name, name,
        tuple(_renamed(rule, work.names_now(rule.id)) for rule in rules_of(work.log)), frozenset(work.factors),
    )  # fmt: skip


def _renamed(rule: RouteRule, names: Mapping[str, str]) -> RouteRule:
    if rule.target is None or rule.target.kind not in ("room", "door"):
        return rule
    return replace(rule, target=replace(rule.target, names=tuple(names.get(name, name) for name in rule.target.names)))


class _Applying:
    """The state of a map while corrections are applied. ``pool`` is where entries find their objects: as mapped, and
    as people added them; ``objs`` has them as corrected so far; ``into`` names what others became part of; ``factors``
    are what vision models said of objects last."""

    def __init__(
        self, log: list[Correction], objects: tuple[MapObject, ...], rooms: tuple[Room, ...],
        grid: OccupancyGrid | None, name: str, origin: str,
    ) -> None:  # fmt: skip
        self.log, self.grid, self.name, self.origin = log, grid, name, origin
        self.pool, self.objs = ({obj.id: obj for obj in objects} for _ in range(2))
        self.places = {room.id: room for room in rooms}
        self.meant = dict[str, dict[str, int]]()  # of each route rule: the rooms by the names that they had then
        self.made, self.into, self.notes = dict[int, MapObject](), dict[int, int](), list[str]()
        self.factors = dict[int, tuple[float, str]]()
        self.now_s = max((obj.last_looked_s for obj in objects), default=0.0)
        self.kept: dict[int, list[Subject]] = {}  # what people said is there, by the object of the map that it is
        for entry in log:
            for subject in _said_to_be_there(entry):
                if (number := find_object(subject, self.pool)) is not None:
                    self.kept.setdefault(number, []).append(subject)

    def sorted_objects(self) -> tuple[MapObject, ...]:
        left = (self.objs[number] for number in self.pool if number in self.objs)
        return tuple(weighed(obj, *self.factors.get(obj.id, (1.0, ""))) for obj in left)

    def weigh(self, entry: Correction, subject: Subject) -> None:
        """Note what a vision model said of an object, if the map still has that very one; the latest counts."""
        number = self._found(subject, entry, again=False)
        if number is not None and subject.id in (number, *self.pool[number].aliases):
            self.factors[number] = float(entry.factor or 1.0), entry.label or ""

    def change_room(self, entry: Correction, subject: Subject) -> None:
        """Name a room, join it with another, or cut it in two."""
        other = cast(Subject, entry.other)
        number = self._room_at(subject.position)
        second = self._room_at(other.position) if entry.what == "merge" else None
        parts = None
        if number is not None and entry.what == "split" and self.grid is not None:
            parts = room_changes.halves(self.places[number].cells, cast(Sequence[float], entry.to_xy), self.grid)
        if number is None or (entry.what != "name" and second in (None, number) and parts is None):
            self._misfit(entry)
            return
        room = self.places[number]
        if entry.what == "name":
            self.places[number] = replace(room, name=str(entry.name))
        elif second is not None:
            gone = self.places.pop(second)
            self.places[number] = room_changes.joined(room, gone)
            for meant in self.meant.values():
                meant |= {name: number for name, each in meant.items() if each == second}
            self._house({second: (number,)})
        elif parts is not None:
            made = other.id
            while made in self.places:
                made += 1
            self.places[number] = replace(room, cells=parts[0])
            self.places[made] = Room(
                made, room_changes.free_name(other.label, self.places.values()), room.kind, parts[1]
            )
            self._house({number: (number, made)})

    def _room_at(self, point: Sequence[float]) -> int | None:
        return find_room(point, tuple(self.places.values()), self.grid)

    def names_now(self, rule: str) -> dict[str, str]:
        """What rooms are called now, by what they were called when a route rule was given."""
        return {name: self.places[number].name for name, number in self.meant[rule].items()}

    def _house(self, moves: Mapping[int, tuple[int, ...]]) -> None:
        """Objects of a room are in that of some others which is nearest to them."""
        assert self.grid is not None  # there are no rooms without
        for objects in (self.pool, self.objs):
            for obj in objects.values():
                if obj.room is not None and obj.room in moves:
                    rooms = [self.places[number] for number in moves[obj.room]]
                    objects[obj.id] = replace(obj, room=room_changes.in_part(obj, rooms, self.grid))

    def change(self, entry: Correction, subject: Subject) -> None:
        if entry.what == "forget":
            self._forget(entry, subject)
            return
        number = self._add(subject, entry) if entry.what == "add" else self._found(subject, entry)
        if number is None:
            return
        obj = affirmed(self.objs[number])
        if entry.what == "name":
            obj = replace(obj, names=(str(entry.name),))
        elif entry.what == "relabel":
            obj = relabelled(obj, str(entry.label))
            for double in self._since(entry, subject, str(entry.label)):
                obj = replace(merged(obj, self._take(double, number)), labels=obj.labels)
        elif entry.what == "move":
            x, y = cast(tuple[float, float], entry.to_xy)
            obj = moved(obj, (x, y), obj.room if self.grid is None else self._room_at((x, y)))
        elif entry.what == "merge":
            other = self._found(cast(Subject, entry.other), entry, again=False)
            obj = obj if other is None or other == number else merged(obj, self._take(other, number))
        elif entry.what == "split":
            obj = self._split(obj, cast(Subject, entry.other))
        self.objs[number] = obj

    def _forget(self, entry: Correction, subject: Subject) -> None:
        number = find_object(subject, self.pool, lambda obj: not self._is_other(obj, subject))
        if number is not None and subject.id in self.pool[number].aliases:
            told = f"is part of object {number} now, which stays"
            self.notes.append(f"{subject.label} {subject.id} was forgotten, but {told}")
        elif number is not None:
            self.objs.pop(number, None)
        for comes_back in self._since(entry, subject, subject.label):
            self.objs.pop(comes_back, None)

    def _is_other(self, obj: MapObject, subject: Subject) -> bool:
        """Whether somebody said that an object is there, and meant it rather than the subject."""
        said = [each for each in self.kept.get(obj.id, ()) if each.id != subject.id]
        return any(away_m(each, obj) < away_m(subject, obj) for each in said)

    def _add(self, subject: Subject, entry: Correction) -> int | None:
        """The object of that label that the map meanwhile shows there, else a new one."""
        shown = next((obj for obj in self.objs.values() if stands_there(obj, subject)), None)
        return self._make(subject, entry) if shown is None else self._also_called(shown.id, subject.id)

    def _found(self, subject: Subject, entry: Correction, again: bool = True) -> int | None:
        """The object that an entry is about, or None; one that the map lost is made ``again``."""
        number = find_object(subject, self.pool)
        if number is None and again:
            number = self._make(subject, entry)
            if number is not None:
                self.notes.append(f"the map no longer shows {subject.label} {subject.id}; {entry.who} said it is there")
        while number in self.into:
            number = self.into[number]
        return number if number in self.objs else None

    def _make(self, subject: Subject, entry: Correction) -> int | None:
        if not subject.size or (entry.origin or "") != self.origin or len(self.made) >= MAX_MADE:
            self._misfit(entry)
            return None
        number = subject.id
        while number in self.pool:
            number = max(number, FIRST_MADE) + 1
        room = self._room_at(subject.position)
        obj = replace(made(number, subject.label, subject.position, subject.size, self.now_s), room=room)
        self.pool[number] = self.objs[number] = self.made[number] = obj
        return number

    def _split(self, obj: MapObject, other: Subject) -> MapObject:
        """The first half; the second becomes an object, unless the map meanwhile shows it as one."""
        shown = next((t for t in self.objs.values() if t.id != obj.id and stands_there(t, other)), None)
        if shown is not None:
            number = self._also_called(shown.id, other.id)
            self.objs[number] = affirmed(self.objs[number])
            return obj
        first, second = halves(obj, other.position)
        number = other.id
        while number in self.pool:
            number += 1
        second = replace(second if other.label == obj.label else relabelled(second, other.label), id=number)
        self.pool[number] = self.objs[number] = self.made[number] = second
        return first

    def _also_called(self, number: int, alias: int) -> int:
        for objects in (self.pool, self.objs):
            objects[number] = replace(objects[number], aliases=(*objects[number].aliases, alias))
        return number

    def _take(self, number: int, into: int) -> MapObject:
        self.into[number] = into
        return self.objs.pop(number)

    def _since(self, entry: Correction, subject: Subject, label: str) -> list[int]:
        """Objects of a label that came up at the noted place after an entry, and of which nobody spoke."""
        if entry.newest is None or (entry.origin or "") != self.origin:
            return []
        reach_m = max(SAME_M, min(subject.size[:2], default=0.0) / 2)
        return [
            obj.id
            for obj in self.pool.values()
            if entry.newest < obj.id < FIRST_MADE
            and obj.id in self.objs
            and obj.id not in self.kept
            and _has_label(obj, label)
            and math.dist(obj.position, subject.position) <= reach_m
        ]

    def _misfit(self, entry: Correction) -> None:
        self.notes.append(f"a correction fits nothing in this map and is left out: {in_words(entry)}")


def _said_to_be_there(entry: Correction) -> list[Subject]:
    """The objects of the map that an entry says are there."""
    if entry.what in ("forget", "evidence"):
        return []
    about = (entry.subject, entry.other if entry.what == "merge" else None)
    return [each for each in about if each is not None and each.kind == "object" and each.id < FIRST_MADE]


def find_room(point: Sequence[float], rooms: Sequence[Room], grid: OccupancyGrid | None) -> int | None:
    """The room that contains a point (m)."""
    if grid is None:
        return None
    cell = grid.cell(point[:2])
    return next((room.id for room in rooms if (room.cells == cell).all(1).any()), None)


def find_object(
    subject: Subject, objects: Mapping[int, MapObject], free: Callable[[MapObject], bool] = lambda obj: True
) -> int | None:
    """The nearest free object of the noted label, where having the noted id counts as nearer; else the one of that
    id."""
    same = objects.get(subject.id)
    if same is not None and same.position == subject.position and _has_label(same, subject.label) and free(same):
        return same.id  # none is nearer
    labelled = (obj for obj in objects.values() if _has_label(obj, subject.label) and free(obj))
    nearest = min(labelled, key=lambda obj: away_m(subject, obj), default=None)
    if nearest is not None and away_m(subject, nearest) <= NEAR_M:
        return nearest.id
    ours = (obj for obj in objects.values() if subject.id in (obj.id, *obj.aliases) and free(obj))
    return next((obj.id for obj in ours if away_m(subject, obj) <= 0), None)


def away_m(subject: Subject, obj: MapObject) -> float:
    """The distance (m) of an object from where an entry noted it, less for one of the noted id."""
    return math.dist(obj.position, subject.position) - SAME_M * (subject.id in (obj.id, *obj.aliases))


def stands_there(obj: MapObject, subject: Subject) -> bool:
    """Whether an object of the noted label stands at the noted place."""
    x, y = subject.position[:2]
    inside = obj.box_min[0] <= x <= obj.box_max[0] and obj.box_min[1] <= y <= obj.box_max[1]
    return _has_label(obj, subject.label) and (inside or math.dist(obj.position[:2], (x, y)) <= SAME_M)


def _has_label(obj: MapObject, label: str) -> bool:
    return label == obj.label or any(label == name for name, _ in obj.labels)
