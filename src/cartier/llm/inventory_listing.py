"""Inventory listings for prompts: names only, or for ``rich`` also objects, rooms and distances from the robot.

A listing is data in JSON, so that no name can pass for a line of the prompt. For a home with very many objects, it
describes those named in the words and those nearest to the robot, and counts the others.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from math import dist
from typing import NamedTuple

from cartier.labels import object_ref, room_ref
from cartier.llm.lookup import names_of, tentative
from cartier.spatial import relations
from cartier.types import Inventory, MapObject, Room

MOST_DESCRIBED = 150
BESIDE = 2  # neighbours listed for each object
TENTATIVE = """
Possibly there, of names that are not listed above: number, room, and in how many of the frames that could show it it \
was seen. Choose one of these, with its number, only if it is asked for by name, and say that it may be there:
"""


class Listing(NamedTuple):
    """A list as it stands in a prompt, and what a reply may choose from it."""

    text: str
    choices: Sequence[str]


def names_only(inventory: Inventory, words: str) -> Listing:
    """Each name once, separated by commas: the paper's list."""
    names = inventory.names
    return Listing(", ".join(names), names)


def described(inventory: Inventory, words: str) -> Listing:
    """Each name once with its objects, the rooms, and the metres from the robot; ``words`` are the person's."""
    names = inventory.names
    seen = [obj for obj in inventory.objects if obj.confirmed and obj.views]
    if not seen:
        return Listing(f"Objects in this home, by their exact names: {_json(names)}", names)
    told = _first(seen, words, inventory.from_xy)
    several = Counter(obj.label for obj in seen)
    lines = _lines(tuple(told), inventory.rooms)
    rows = []
    for name in names:
        row = [lines[obj.id] for obj in told if obj.label == name]
        left = several[name] - len(row)
        rows.append(f"{_json(name)}: {_json([*row, f'{left} more'] if left else row)}")
    rooms = [room_ref(room.name, room.id) for room in inventory.rooms]
    most = "" if len(told) == len(seen) else f"; {len(seen) - len(told)} of them, farther away, are only counted"
    text = (
        "Objects in this home: each name once, and of its objects the number, the room, what it stands on or is in, "
        f"what it is beside, its colours, and its width, depth and height in centimetres{most}:\n"
        "{" + ",\n".join(rows) + "}"
    )
    if rooms:
        text += f"\nRooms: {_json(rooms)}"
    if inventory.from_xy is not None:
        far = sorted((dist(obj.position[:2], inventory.from_xy), obj.id) for obj in told)
        text += "\nMetres from the robot, nearest first: " + ", ".join(f"#{number} {m:.1f}" for m, number in far)
    which = [object_ref(obj.label, obj.id) for obj in told if several[obj.label] > 1]
    if maybe := tentative(inventory):
        text += TENTATIVE + _json([_seldom(obj, inventory.rooms) for obj in maybe])
    return Listing(text, [*names, *which, *(object_ref(obj.label, obj.id) for obj in maybe), *rooms])


def _seldom(obj: MapObject, rooms: Sequence[Room]) -> str:
    room = next((f" {room.name};" for room in rooms if room.id == obj.room), "")
    return f"{object_ref(obj.label, obj.id)}:{room} {obj.n_detected} of {obj.n_observable}"


def _first(seen: Sequence[MapObject], words: str, from_xy: Sequence[float] | None) -> list[MapObject]:
    """The objects to describe, by name and number: first those that the words name, then the nearest."""
    if len(seen) > MOST_DESCRIBED:
        said = {name for name, _ in names_of(tuple(sorted({obj.label for obj in seen}))).mentions(words)}
        here = from_xy or seen[0].position[:2]
        seen = sorted(seen, key=lambda obj: (obj.label not in said, dist(obj.position[:2], here)))
    return sorted(seen[:MOST_DESCRIBED], key=lambda obj: (obj.label, obj.id))


@lru_cache(maxsize=8)  # the same home serves many requests
def _lines(told: tuple[MapObject, ...], rooms: tuple[Room, ...]) -> dict[int, str]:
    """Each object in a few words, by its id: ``#12: kitchen; on counter top #5; by sink #8; white; 8x8x10``."""
    refs = {obj.id: object_ref(obj.label, obj.id) for obj in told}
    called = {room.id: room.name for room in rooms}
    twice = {name for name, count in Counter(called.values()).items() if count > 1}
    held = relations.supports(told)
    lines = {}
    for obj in told:
        parts = []
        if obj.room in called:
            name = called[obj.room]
            parts.append(room_ref(name, obj.room) if name in twice else name)
        if (holder := held.get(obj.id)) is not None and holder.object is not None:
            parts.append(f"{holder.kind} {refs[holder.object]}")
        near = [r for r in relations.next_to(obj, told) if r.probability >= relations.LIKELY][:BESIDE]
        if near:
            parts.append("by " + " and ".join(refs[relation.subject] for relation in near))
        if obj.colours:
            parts.append(" and ".join(colour for colour, _ in obj.colours[:2]))
        size = (100 * (high - low) for low, high in zip(obj.box_min, obj.box_max, strict=True))
        parts.append("x".join(f"{side:.0f}" for side in size))
        lines[obj.id] = f"#{obj.id}: " + "; ".join(parts)
    return lines


def _json(value: object) -> str:
    """In letters of any language; what is no printable character, such as an exotic end of a line, is escaped."""
    text = json.dumps(value, ensure_ascii=False)
    return text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)
