"""Corrections that people make to a home: new entries for its log, checked before they are written.

The log is applied to the map whenever the home is loaded (``corrected.py``).
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, get_args

import numpy as np

from cartier.errors import MAX_FAR_M, InputError, brief
from cartier.home.corrected import FIRST_MADE, MAX_MADE, Corrected, stands_there
from cartier.home.correction_log import (
    MAX_NAME_CHARS,
    MAX_SAID_CHARS,
    MAX_WHO_CHARS,
    Correction,
    CorrectionKind,
    Subject,
    clean,
    in_force,
)
from cartier.home.room_changes import free_name, halves
from cartier.labels import display_name
from cartier.navigation.planning import room_middle
from cartier.types import MapObject, OccupancyGrid, Room
from cartier.types.route_rules import RouteRule

THE_HOME = "home"
"""What the home itself is called where an object or a room could be meant."""
OUTSIDE_M = 1.0  # how far beyond the floor plan an object may be put
NEW_SIZE_M = 0.3  # of an added object, where no other of its label says more
HIGHEST_M = 2.0  # what an added object stands on
MAX_PLAN_CHANGES = 200  # rooms that people merged or split; each takes milliseconds whenever the home is loaded
MAX_RULES = 200  # route rules of a home; each costs time at every drive


@dataclass(frozen=True)
class Wish:
    """What a person wants corrected; see ``Home.correct``."""

    what: CorrectionKind
    entity: str = ""
    name: str = ""
    to_xy: tuple[float, ...] = ()
    other: str = ""
    who: str = "somebody"


def find(text: str, objects: Sequence[MapObject], rooms: Sequence[Room] = ()) -> MapObject | Room:
    """The object or room that a person means by an object's id, ``room:ID``, a name, or the label of only one object.

    Raises InputError, with the ids to choose from, if there is none or more than one.
    """
    wanted = " ".join(text.split()).casefold()
    if wanted.removeprefix("#").isdecimal():
        number = int(wanted.removeprefix("#")[:18])
        by_id: list[MapObject | Room] = [obj for obj in objects if number in (obj.id, *obj.aliases)]
        return _one(by_id, text)
    if wanted.startswith("room:"):
        return _one([room for room in rooms if str(room.id) == wanted[5:].strip()], text)
    called: list[MapObject | Room] = [room for room in rooms if room.name.casefold() == wanted]
    called += [obj for obj in objects if wanted in (name.casefold() for name in obj.names)]
    labelled = [obj for obj in objects if obj.label.casefold() == wanted]
    return _one(called or [obj for obj in labelled if obj.confirmed] or labelled, text)


def make(known: Corrected, grid: OccupancyGrid | None, wish: Wish, origin: str = "") -> Correction:
    """A new entry for a home's log; see ``Home.correct``. Raises InputError for an invalid one."""
    if wish.what not in get_args(CorrectionKind):
        kinds = ", ".join(get_args(CorrectionKind))
        raise InputError(f"a correction is one of {kinds}, not {brief(wish.what, 40)!r}")
    makers: dict[str, Callable[[Corrected, OccupancyGrid | None, Wish], dict[str, Any]]] = {
        "undo": _undo, "name": _name, "relabel": _relabel, "add": _add, "merge": _merge, "split": _split, "move": _move,
        "rule": _rule, "lift": _lift,
    }  # fmt: skip
    about: dict[str, Any] = {"what": wish.what} | makers.get(wish.what, _confirm_or_forget)(known, grid, wish)
    if wish.what not in ("undo", "rule", "lift"):
        about["newest"] = max((obj.id for obj in known.mapped_objects), default=0)
        about["origin"] = origin or None
    when = datetime.now(UTC).isoformat(timespec="milliseconds")
    return Correction(secrets.token_hex(6), when, clean(wish.who, MAX_WHO_CHARS, "who corrects"), **about)


def evidence(
    obj: MapObject, known: Corrected, said: str, factor: float, who: str, origin: str, label: str = ""
) -> Correction:
    """An entry that multiplies the odds that an object exists, because a vision model (``who``) said something, and the
    evidence for a ``label`` of it, if it chose one."""
    when, by = datetime.now(UTC).isoformat(timespec="milliseconds"), brief(" ".join(who.split()), MAX_WHO_CHARS)
    return Correction(
        secrets.token_hex(6), when, clean(by, MAX_WHO_CHARS, "who looked"), "evidence", _subject(obj, known),
        name=clean(said, MAX_NAME_CHARS, "what was said"), factor=factor, origin=origin or None,
        label=clean(label, MAX_NAME_CHARS, "label") if label else None,
    )  # fmt: skip


def _undo(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    holding = in_force(known.log)
    if not holding:
        raise InputError("there is no correction to undo")
    return {"undoes": holding[-1].id}


def _rule(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    """A route rule in its text form, with the sentence that made it; what it names must be in the home."""
    rule = RouteRule.parse(wish.entity)
    if not rule.stays:
        raise InputError(f"{rule.text}: a rule for one drive is said with the request, and not kept")
    target = rule.target
    if target is not None and target.kind == "none":
        raise InputError(f"{rule.text}: a rule about what the home does not have cannot be kept")
    if target is not None and target.kind == "object":
        for number in target.ids:
            find(str(number), known.objects)
    if target is not None and target.kind in ("room", "door"):
        rooms = {room.name.casefold() for room in known.rooms}
        if wrong := [name for name in target.names if name.casefold() not in rooms]:
            raise InputError(f"{rule.text}: no room is called {brief(wrong[0], 40)!r}")
    if rule in known.rules:
        raise InputError(f"{rule.text}: this rule holds already")
    if len(known.rules) >= MAX_RULES:
        raise InputError(f"{MAX_RULES} rules hold in this home, and it keeps no more: take one back first")
    said = clean(wish.name, MAX_SAID_CHARS, "the sentence of a rule") if wish.name else None
    return {"rule": rule.text, "name": said}


def _lift(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    """The end of a route rule, named by its id or its text form."""
    meant = wish.entity.strip()
    rule = next((rule for rule in known.rules if meant in (rule.id, rule.text)), None)
    if rule is None:
        rules = "; ".join(f"{rule.id}: {rule.text}" for rule in known.rules) or "none"
        raise InputError(f"no rule {brief(meant, 60)!r} holds: there is {brief(rules, 400)}")
    return {"rule": rule.text, "undoes": rule.id}


def _name(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    if wish.entity.strip().casefold() == THE_HOME:
        subject = Subject("home", 0, brief(known.mapped_name, MAX_NAME_CHARS) or THE_HOME, ())
        return {"subject": subject, "name": _free_name(wish.name, None, ())}
    found = find(wish.entity, known.objects, known.rooms)
    subject = _room_subject(found, grid) if isinstance(found, Room) else _subject(found, known)
    return {"subject": subject, "name": _free_name(wish.name, found, known.rooms)}


def _confirm_or_forget(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    return {"subject": _subject(_object(wish.entity, known), known)}


def _relabel(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    return {"subject": _subject(_object(wish.entity, known), known), "label": _label(wish.name)}


def _move(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    return {"subject": _subject(_object(wish.entity, known), known), "to_xy": _on_the_plan(wish.to_xy, grid)}


def _add(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    """A new object on the floor or on what is there, or the tentative one of that label at that place, confirmed."""
    label = _label(wish.name)
    x, y, floor_z = _place(known, grid, wish)
    like = [obj for obj in known.objects if obj.label == label and obj.confirmed]
    sizes = [np.subtract(obj.box_max, obj.box_min) for obj in like] or [np.full(3, NEW_SIZE_M)]
    size = tuple(round(float(side), 4) for side in np.median(sizes, axis=0))
    subject = Subject("object", _new_id(known), label, (x, y, round(floor_z + size[2] / 2, 4)), size)
    there = [obj for obj in known.objects if obj.label == label and stands_there(obj, subject)]
    if sure := [obj for obj in there if obj.confirmed]:
        raise InputError(f"{label} {sure[0].id} is there already: choose another place, or move that one")
    if there:
        best = max(there, key=lambda obj: obj.probability)
        return {"what": "confirm", "subject": _subject(best, known)}
    _check_room_for_one_more(known)
    return {"subject": subject}


def _check_room_for_one_more(known: Corrected) -> None:
    if len(known.made) >= MAX_MADE:
        raise InputError(f"people added {MAX_MADE} objects to this home, and it holds no more: map it again")


def _check_plan_changes(known: Corrected) -> None:
    done = [entry for entry in known.log if entry.what in ("merge", "split") and entry.subject is not None]
    if sum(entry.subject.kind == "room" for entry in done if entry.subject is not None) >= MAX_PLAN_CHANGES:
        raise InputError(f"people merged and split rooms {MAX_PLAN_CHANGES} times, which is all that a home keeps")


def _place(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> tuple[float, float, float]:
    """Where an added object stands: at x and y, on an object, or in the middle of a room."""
    if not wish.to_xy and not wish.entity:
        raise InputError("an object is added at x and y, on an object, or in a room: say which")
    on: MapObject | None = None
    xy: Sequence[float] = wish.to_xy
    if wish.entity:
        found = find(wish.entity, known.objects, known.rooms)
        if isinstance(found, Room):
            assert grid is not None  # there are no rooms without
            xy = xy or room_middle(found, grid)
        else:
            on, xy = found, xy or found.position[:2]
    x, y = _on_the_plan(xy, grid)
    if on is None and wish.to_xy:
        below = [obj for obj in known.objects if obj.confirmed and _spans(obj, x, y) and obj.box_max[2] <= HIGHEST_M]
        on = max(below, key=lambda obj: obj.box_max[2], default=None)
    return x, y, 0.0 if on is None else on.box_max[2]


def _merge(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    one, other = (find(entity, known.objects, known.rooms) for entity in (wish.entity, wish.other))
    if isinstance(one, Room) != isinstance(other, Room):
        raise InputError("an object and a room cannot be one: merge two objects, or two rooms")
    if one.id == other.id:
        kind = "room" if isinstance(one, Room) else "object"
        raise InputError(f"{brief(wish.entity, 40)} and {brief(wish.other, 40)} are one {kind} {one.id} already")
    if isinstance(one, Room) and isinstance(other, Room):
        _check_plan_changes(known)
        return {"subject": _room_subject(one, grid), "other": _room_subject(other, grid)}
    assert isinstance(one, MapObject) and isinstance(other, MapObject)
    return {"subject": _subject(one, known), "other": _subject(other, known)}


def _split(known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    """The halves of an object; the second is the one with the given point, else that of larger x or y."""
    obj = find(wish.entity, known.objects, known.rooms)
    if isinstance(obj, Room):
        return _split_room(obj, known, grid, wish)
    _check_room_for_one_more(known)
    label = _label(wish.name) if wish.name else obj.label
    sides = [high - low for low, high in zip(obj.box_min, obj.box_max, strict=True)]
    middle = [*obj.position]
    if wish.to_xy:
        x, y = _on_the_plan(wish.to_xy, grid)
        if not _spans(obj, x, y):
            raise InputError(f"x {x:g} y {y:g} is outside of {obj.label} {obj.id}: point at one of the two")
        off = (x - middle[0], y - middle[1])
        axis, sign = int(abs(off[1]) > abs(off[0])), 1.0
        sign = -1.0 if off[axis] < 0 else 1.0
    else:
        axis, sign = int(sides[1] > sides[0]), 1.0
    middle[axis] += sign * sides[axis] / 4
    sides[axis] /= 2
    position, size = (tuple(round(v, 4) for v in values) for values in (middle, sides))
    return {"subject": _subject(obj, known), "other": Subject("object", _new_id(known), label, position, size)}


def _split_room(room: Room, known: Corrected, grid: OccupancyGrid | None, wish: Wish) -> dict[str, Any]:
    """A room, cut at the given point; the smaller part is the second room."""
    assert grid is not None  # there are no rooms without
    _check_plan_changes(known)
    if not wish.to_xy:
        raise InputError(f"say where {room.name} ends: x and y of a point of the border, as between two door posts")
    x, y = _on_the_plan(wish.to_xy, grid)
    parts = halves(room.cells, (x, y), grid)
    if parts is None:
        raise InputError(f"no straight cut through x {x:g} y {y:g} divides {room.name}: point at its border inside")
    first = _room_subject(replace(room, cells=parts[0]), grid)
    name = _free_name(wish.name, None, known.rooms) if wish.name else free_name(room.name, known.rooms)
    ids = [*(each.id for each in (*known.rooms, *known.mapped_rooms)), *_noted(known, "room")]
    second = _room_subject(Room(max(ids) + 1, name, room.kind, parts[1]), grid)
    return {"subject": first, "other": second, "to_xy": (x, y)}


def _object(entity: str, known: Corrected) -> MapObject:
    found = find(entity, known.objects, known.rooms)
    if isinstance(found, Room):
        raise InputError(
            f"{found.name} is a room: it is named, merged or split, but only objects can be moved and so on"
        )
    return found


def _label(text: str) -> str:
    """A valid label, written as detectors' are."""
    return _free_name(display_name(text), None, ())


def _free_name(name: str, found: MapObject | Room | None, rooms: Sequence[Room]) -> str:
    """A valid name: it does not read like an id, and no other room has it."""
    name = clean(name, MAX_NAME_CHARS, "a name")
    if name.removeprefix("#").isdecimal() or name.casefold().startswith("room:") or name.casefold() == THE_HOME:
        raise InputError(f"{name!r} reads like an id: a name has a letter, is not 'home', and begins not with 'room:'")
    for room in rooms:
        if room is not found and room.name.casefold() == name.casefold():
            raise InputError(f"room:{room.id} is called {name!r}: choose another name, or rename that room first")
    return name


def _on_the_plan(to_xy: Sequence[float], grid: OccupancyGrid | None) -> tuple[float, float]:
    if len(to_xy) != 2 or not all(math.isfinite(v) and abs(v) <= MAX_FAR_M for v in to_xy):
        raise InputError(f"a place is x and y in metres, not {brief(to_xy, 60)}")
    x, y = (round(float(v), 4) for v in to_xy)
    if grid is not None:
        low = np.array(grid.origin_xy) - OUTSIDE_M
        high = np.array(grid.origin_xy) + np.array(grid.cells.shape[::-1]) * grid.resolution_m + OUTSIDE_M
        if not ((low <= (x, y)) & ((x, y) <= high)).all():
            spans = f"x {low[0]:.1f} to {high[0]:.1f} and y {low[1]:.1f} to {high[1]:.1f}"
            raise InputError(f"x {x:g} y {y:g} is outside of the floor plan, which spans {spans} m")
    return x, y


def _subject(obj: MapObject, known: Corrected) -> Subject:
    """The object as it is in the map without corrections, or as it was added: where it will be searched again."""
    raw = next(each for each in (*known.mapped_objects, *known.made) if each.id == obj.id)
    size = (round(high - low, 4) for low, high in zip(raw.box_min, raw.box_max, strict=True))
    return Subject("object", raw.id, raw.label, raw.position, tuple(size))


def _room_subject(room: Room, grid: OccupancyGrid | None) -> Subject:
    assert grid is not None  # there are no rooms without
    x, y = room_middle(room, grid)
    return Subject("room", room.id, room.name, (round(x, 4), round(y, 4)))


def _new_id(known: Corrected) -> int:
    """An id that no object of this home has, or had: undone entries keep theirs."""
    ids = [*_noted(known, "object"), *(obj.id for obj in known.objects)]
    return max([FIRST_MADE, *(number for number in ids if number < 2 * FIRST_MADE)]) + 1


def _noted(known: Corrected, kind: str) -> list[int]:
    """The ids of all objects, or rooms, of which the log speaks."""
    about = (subject for entry in known.log for subject in (entry.subject, entry.other) if subject is not None)
    return [subject.id for subject in about if subject.kind == kind]


def _spans(obj: MapObject, x: float, y: float) -> bool:
    return obj.box_min[0] <= x <= obj.box_max[0] and obj.box_min[1] <= y <= obj.box_max[1]


def _one(found: Sequence[MapObject | Room], text: str) -> MapObject | Room:
    if len(found) == 1:
        return found[0]
    if found:
        which = ", ".join(f"room:{t.id}" if isinstance(t, Room) else str(t.id) for t in found[:8])
        raise InputError(f"{len(found)} objects or rooms are called {brief(text, 60)!r}: say which by its id ({which})")
    mend = "take an id from the list of objects (show, list_objects)"
    raise InputError(f"nothing in this home is called {brief(text, 60)!r}: {mend}")
