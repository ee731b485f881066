"""Corrections that people make to a home: an append-only log of names, moves and removals.

Each entry says who, when and what. The log is applied to the map whenever the home is loaded. An entry finds its
object by id or alias, label and position, so that it stays valid when the home grows or is mapped again.
"""

from __future__ import annotations

import json
import math
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np

from cartier.errors import MAX_FAR_M, InputError, brief
from cartier.io.files import read_bytes
from cartier.navigation.planning import room_middle
from cartier.types import MapObject, OccupancyGrid, Room, View

LOG = "corrections.jsonl"
MAX_BYTES, MAX_NAME_CHARS, MAX_WHO_CHARS, MAX_LABEL_CHARS = 2**24, 60, 60, 200
NEAR_M = 1.0  # the object of the noted label within this distance is the one meant
SAME_M = 0.3  # the object of the noted id counts as this much nearer; with another label, it must lie within it
OUTSIDE_M = 1.0  # how far beyond the floor plan an object may be moved
CorrectionKind = Literal["name", "forget", "move", "undo"]


@dataclass(frozen=True)
class Subject:
    """What an entry corrects, as it was then; ``position`` (m) is an object's middle, or a point (x, y) of a room."""

    kind: Literal["object", "room"]
    id: int
    label: str
    position: tuple[float, ...]


@dataclass(frozen=True)
class Correction:
    """One entry of the log: ``name`` for "name", ``to_xy`` (m) for "move", ``undoes`` (an entry's id) for "undo"."""

    id: str
    when: str
    who: str
    what: CorrectionKind
    subject: Subject | None = None
    name: str | None = None
    to_xy: tuple[float, float] | None = None
    undoes: str | None = None


@dataclass(frozen=True, eq=False)
class Corrected:
    """Objects and rooms with and without corrections, the log, and notes about entries that could not be applied."""

    objects: tuple[MapObject, ...]
    rooms: tuple[Room, ...]
    mapped_objects: tuple[MapObject, ...]
    mapped_rooms: tuple[Room, ...]
    log: tuple[Correction, ...]
    notes: tuple[str, ...]


def read_log(folder: Path) -> tuple[tuple[Correction, ...], tuple[str, ...]]:
    """The entries of a home's log, oldest first, and a note for each damaged line, which is left out.

    Raises InputError if the log cannot be read at all.
    """
    file = folder / LOG
    if not file.exists():
        return (), ()
    entries, notes = [], []
    for number, line in enumerate(read_bytes(file, MAX_BYTES, follow_link=False).split(b"\n"), start=1):
        if not line.strip():
            continue
        try:
            entries.append(_entry(json.loads(line)))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, InputError):
            notes.append(f"{LOG} line {number} is damaged: this correction is left out")
    return tuple(entries), tuple(notes)


def line_of(entry: Correction) -> str:
    """An entry as a line of the log."""
    return json.dumps({key: value for key, value in asdict(entry).items() if value is not None}, ensure_ascii=False)


def apply(
    log: Sequence[Correction], objects: tuple[MapObject, ...], rooms: tuple[Room, ...], grid: OccupancyGrid | None
) -> Corrected:
    """Apply all corrections in force to a map; one whose object or room is not found becomes a note."""
    objs, places = {obj.id: obj for obj in objects}, {room.id: room for room in rooms}
    notes = []
    for entry in in_force(log):
        subject = cast(Subject, entry.subject)
        number = _find_room(subject, rooms, grid) if subject.kind == "room" else _find_object(subject, objects)
        if number is None:
            notes.append(f"a correction fits nothing in this map and is left out: {in_words(entry)}")
        elif entry.what == "forget" and subject.id in next(t.aliases for t in objects if t.id == number):
            notes.append(f"{subject.label} {subject.id} was forgotten, but is part of object {number} now, which stays")
        elif subject.kind == "room":
            places[number] = replace(places[number], name=str(entry.name))
        elif number in objs:
            changed = _changed(objs.pop(number), entry, tuple(places.values()), grid)
            objs |= {} if changed is None else {number: changed}
    kept = tuple(objs[obj.id] for obj in objects if obj.id in objs)
    return Corrected(kept, tuple(places[room.id] for room in rooms), objects, rooms, tuple(log), tuple(notes))


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


def make(
    known: Corrected,
    grid: OccupancyGrid | None,
    what: CorrectionKind,
    entity: str = "",
    name: str = "",
    to_xy: Sequence[float] = (),
    who: str = "somebody",
) -> Correction:
    """A new entry for a home's log; see ``Home.correct``. Raises InputError for an invalid one."""
    about: dict[str, Any] = {}
    if what == "undo":
        holding = in_force(known.log)
        if not holding:
            raise InputError("there is no correction to undo")
        about["undoes"] = holding[-1].id
    elif what in ("name", "forget", "move"):
        found = find(entity, known.objects, known.rooms)
        if what != "name" and isinstance(found, Room):
            raise InputError(f"{found.name} is a room: it can be named, but only objects can be moved or forgotten")
        about["subject"] = _subject(found, known, grid)
        about |= {"name": _free_name(name, found, known.rooms)} if what == "name" else {}
        about |= {"to_xy": _on_the_plan(to_xy, grid)} if what == "move" else {}
    else:
        raise InputError(f"a correction is one of {', '.join(get_args(CorrectionKind))}, not {brief(what, 40)!r}")
    when = datetime.now(UTC).isoformat(timespec="milliseconds")
    return Correction(secrets.token_hex(6), when, _clean(who, MAX_WHO_CHARS, "who corrects"), what, **about)


def in_words(entry: Correction, log: Iterable[Correction] = ()) -> str:
    """What an entry does, in a few words; ``log`` holds the entry that it undoes."""
    if entry.what == "undo":
        undone = next((each for each in log if each.id == entry.undoes), None)
        return "undone" if undone is None else f"undone: {in_words(undone)}"
    assert entry.subject is not None
    about = f"{entry.subject.label} ({'room:' if entry.subject.kind == 'room' else ''}{entry.subject.id})"
    if entry.to_xy is not None:
        return f"{about} stands at x {entry.to_xy[0]:.2f} y {entry.to_xy[1]:.2f} m"
    return f"{about} is forgotten" if entry.name is None else f"{about} is called {entry.name}"


def _free_name(name: str, obj: MapObject | Room, rooms: Sequence[Room]) -> str:
    """A valid name: it does not read like an id, and no other room has it."""
    name = _clean(name, MAX_NAME_CHARS, "a name")
    if name.removeprefix("#").isdecimal() or name.casefold().startswith("room:"):
        raise InputError(f"{name!r} reads like an id: a name has a letter, and does not begin with 'room:'")
    for room in rooms:
        if room is not obj and room.name.casefold() == name.casefold():
            raise InputError(f"room:{room.id} is called {name!r}: choose another name, or rename that room first")
    return name


def _on_the_plan(to_xy: Sequence[float], grid: OccupancyGrid | None) -> tuple[float, float]:
    if len(to_xy) != 2 or not all(math.isfinite(v) and abs(v) <= MAX_FAR_M for v in to_xy):
        raise InputError(f"an object is moved to x and y in metres, not to {brief(to_xy, 60)}")
    x, y = (round(float(v), 4) for v in to_xy)
    if grid is not None:
        low = np.array(grid.origin_xy) - OUTSIDE_M
        high = np.array(grid.origin_xy) + np.array(grid.cells.shape[::-1]) * grid.resolution_m + OUTSIDE_M
        if not ((low <= (x, y)) & ((x, y) <= high)).all():
            spans = f"x {low[0]:.1f} to {high[0]:.1f} and y {low[1]:.1f} to {high[1]:.1f}"
            raise InputError(f"x {x:g} y {y:g} is outside of the floor plan, which spans {spans} m")
    return x, y


def in_force(log: Iterable[Correction]) -> list[Correction]:
    """The corrections that were not undone, oldest first."""
    entries = list(log)
    undone = {entry.undoes for entry in entries if entry.what == "undo"}
    return [entry for entry in entries if entry.what != "undo" and entry.id not in undone]


def _subject(obj: MapObject | Room, known: Corrected, grid: OccupancyGrid | None) -> Subject:
    """The object or room as it is in the map without corrections, where it will be searched again."""
    if isinstance(obj, Room):
        mapped = next(room for room in known.mapped_rooms if room.id == obj.id)
        assert grid is not None  # there are no rooms without
        x, y = room_middle(mapped, grid)
        return Subject("room", obj.id, mapped.name, (round(x, 4), round(y, 4)))
    raw = next(each for each in known.mapped_objects if each.id == obj.id)
    return Subject("object", raw.id, raw.label, raw.position)


def _find_room(subject: Subject, rooms: Sequence[Room], grid: OccupancyGrid | None) -> int | None:
    """The room that contains the noted point."""
    if grid is None:
        return None
    cell = grid.cell(subject.position[:2])
    return next((room.id for room in rooms if (room.cells == cell).all(1).any()), None)


def _find_object(subject: Subject, objects: Sequence[MapObject]) -> int | None:
    """The nearest object of the noted label, where having the noted id counts as nearer; else the one of that id."""

    def away_m(obj: MapObject) -> float:
        return math.dist(obj.position, subject.position) - SAME_M * (subject.id in (obj.id, *obj.aliases))

    called = [obj for obj in objects if subject.label in (obj.label, *(name for name, _ in obj.labels))]
    nearest = min(called, key=away_m, default=None)
    if nearest is not None and away_m(nearest) <= NEAR_M:
        return nearest.id
    return next((t.id for t in objects if subject.id in (t.id, *t.aliases) and away_m(t) <= 0), None)


def _changed(obj: MapObject, entry: Correction, rooms: Sequence[Room], grid: OccupancyGrid | None) -> MapObject | None:
    if entry.what == "forget":
        return None
    if entry.what == "name":
        return replace(obj, names=(str(entry.name),))
    x, y = cast(tuple[float, float], entry.to_xy)
    by = (x - obj.position[0], y - obj.position[1], 0.0)
    room = obj.room if grid is None else _find_room(Subject("room", -1, "", (x, y)), rooms, grid)
    return replace(
        obj, position=_shifted(obj.position, by), box_min=_shifted(obj.box_min, by), box_max=_shifted(obj.box_max, by),
        room=room, views=tuple(_shifted_view(view, by) for view in obj.views),
    )  # fmt: skip


def _shifted_view(view: View, by: Sequence[float]) -> View:
    """A view of an object that was moved: the camera moves along with the surface."""
    surface = None if view.surface is None else _shifted(view.surface, by)
    return replace(view, camera=_shifted(view.camera, by), surface=surface)


def _shifted(point: Sequence[float], by: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(value + step, 4) for value, step in zip(point, by, strict=True))


def _one(found: Sequence[MapObject | Room], text: str) -> MapObject | Room:
    if len(found) == 1:
        return found[0]
    if found:
        which = ", ".join(f"room:{t.id}" if isinstance(t, Room) else str(t.id) for t in found[:8])
        raise InputError(f"{len(found)} objects or rooms are called {brief(text, 60)!r}: say which by its id ({which})")
    mend = "take an id from the list of objects (show, list_objects)"
    raise InputError(f"nothing in this home is called {brief(text, 60)!r}: {mend}")


def _clean(text: str, most: int, what: str) -> str:
    clean = " ".join(text.split())
    if not clean or len(clean) > most or not clean.isprintable():
        raise InputError(f"{what} has 1 to {most} printable characters, got {brief(text, 40)!r}")
    return clean


def _entry(row: Mapping[str, Any]) -> Correction:
    """An entry from its line. Raises ValueError, KeyError, TypeError or InputError for an invalid one."""
    what = row["what"]
    if what not in get_args(CorrectionKind):
        raise ValueError(what)
    number, when, who = (_clean(row[key], MAX_WHO_CHARS, key) for key in ("id", "when", "who"))
    if what == "undo":
        return Correction(number, when, who, what, undoes=_clean(row["undoes"], MAX_WHO_CHARS, "undoes"))
    about = row["subject"]
    position = _floats(about["position"], {"object": 3, "room": 2}[about["kind"]])
    if (about["kind"] == "room" and what != "name") or not isinstance(about["id"], int):
        raise ValueError(about)
    subject = Subject(about["kind"], about["id"], _clean(about["label"], MAX_LABEL_CHARS, "label"), position)
    if what == "move":
        x, y = _floats(row["to_xy"], 2)
        return Correction(number, when, who, what, subject, to_xy=(x, y))
    name = _clean(row["name"], MAX_NAME_CHARS, "name") if what == "name" else None
    return Correction(number, when, who, what, subject, name)


def _floats(values: Any, size: int) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != size or not all(abs(v) <= MAX_FAR_M for v in values):
        raise ValueError(values)  # NaN, too
    return tuple(map(float, values))
