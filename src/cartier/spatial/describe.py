"""Descriptions of objects in words: where one is, and what distinguishes several."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import nsmallest
from itertools import islice

from cartier.spatial.query import Scene
from cartier.spatial.relations import ASKED_NEAR_M
from cartier.types import MapObject, Room

MAIN_SHARE = 0.25
"""The share of its surface from which an object is said to have a colour."""
WHITE_IN_SHADE = 0.2
"""The share of white from which a grey object is a white one that is partly in shadow: the largest of 0.1, 0.2, 0.3 and
0.4 with which most answers were right in six generated homes (80101 to 80106, ``benchmarks/look_colours.py``)."""


def colours_of(obj: MapObject) -> tuple[str, ...]:
    """The one or two colours that people would say an object has, the main one first; none if none was seen."""
    shares = dict(obj.colours)
    names = [name for name, share in obj.colours if share >= MAIN_SHARE][:2] or [name for name, _ in obj.colours[:1]]
    if names[:1] == ["grey"] and shares.get("white", 0.0) >= WHITE_IN_SHADE:
        names = ["white", *(name for name in names if name not in ("white", "grey"))]
    return tuple(names)


def whereabouts(scene: Scene, obj: MapObject) -> str:
    """Where an object is, in words: "on the table in the kitchen"."""
    phrases = list(islice(_places(scene, obj), 1))
    room = scene.room_of(obj)
    if room is not None and _inside(room) not in phrases:
        phrases.append(_inside(room))
    return " ".join(phrases)


def _places(scene: Scene, obj: MapObject) -> Iterator[str]:
    """All phrases for where an object is, the most specific first."""
    held = scene.holders.get(obj.id)
    if held is not None and held.object is not None:
        yield f"{held.kind} the {scene.by_id[held.object].label}"
    least_m3 = max(obj.volume_m3 / 2, 0.02)
    marks = (
        o for o in scene.objects
        if o.label != obj.label and o.id != (held.object if held else None)
        and (o.label not in scene.several or held is None) and o.volume_m3 > least_m3
    )  # fmt: skip
    for mark in nsmallest(4, marks, key=lambda o: scene.distance_m(obj, o)):
        if scene.distance_m(obj, mark) <= ASKED_NEAR_M and mark.room == obj.room:
            yield f"by the {mark.label}"
    if (room := scene.room_of(obj)) is not None:
        yield _inside(room)


def tell_apart(scene: Scene, found: Sequence[MapObject]) -> list[str]:
    """For each object a phrase that none of the others has: room, place, colour or size; "" where there is none."""
    every = []
    for obj in found:
        room = scene.room_of(obj)
        told = [*([_inside(room)] if room is not None else []), *_places(scene, obj)]
        told += [f"the {obj.colours[0][0]} one"] if obj.colours else []
        every.append(list(dict.fromkeys(told)))
    apart = [
        next((words for words in told if not any(words in other for k, other in enumerate(every) if k != i)), "")
        for i, told in enumerate(every)
    ]
    if len(found) == 2 and not all(apart):
        big, small = (obj.volume_m3 for obj in found)
        if max(big, small) > 1.3 * min(big, small):
            apart = ["the bigger one", "the smaller one"] if big > small else ["the smaller one", "the bigger one"]
    return apart


def _inside(room: Room) -> str:
    """ "in the kitchen", "in bedroom 2"."""
    return f"in {the(room.name)}"


def the(name: str) -> str:
    """A name with its article, if it takes one: "the kitchen", "bedroom 2", "Ben's room"."""
    if "'s " in name:
        return f"{name[:1].upper()}{name[1:]}"
    return name if name[-1:].isdigit() else f"the {name}"
