"""Answers in words to questions about a home: how many, is there, where, what is on it, which is bigger."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cartier.spatial.describe import colours_of, the, whereabouts
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation
from cartier.spatial.query import HERE, Scene, called
from cartier.types import Door, Fact, MapObject, Selection
from cartier.understanding.reference_words import STANDS_FOR

MOST_TOLD = 5  # objects of which a sentence tells something each
NUMBERS = {1: "one", 2: "two", 3: "three"}
PLURALS = (
    ("ss", "sses"), ("s", "s"), ("ch", "ches"), ("sh", "shes"), ("x", "xes"), ("ato", "atoes"), ("fe", "ves"),
    ("lf", "lves"),
)  # fmt: skip

COMPARATIVES = {
    "biggest": "bigger", "smallest": "smaller", "nearest": "nearer", "farthest": "farther", "tallest": "taller",
    "highest": "higher", "lowest": "lower", "shortest": "shorter", "widest": "wider", "longest": "longer",
}  # fmt: skip


OURSELVES = re.compile(r"\b(?:am i|are (?:you|we|u)|(?:i am|i'm|you are|you're|we are|we're))\b")
"""Who asks where the robot is, with whoever speaks to it."""


def answer(asked: ParsedUtterance, scene: Scene, last: MapObject | None, model: str) -> Selection | None:
    """The answer to a question; None if it is about nothing known here. ``last`` is the object mentioned before."""
    head = asked.head
    if asked.kind == "rooms" and not OURSELVES.search(asked.need):
        rooms = [room.name for room in scene.rooms.values()]
        return _told(
            f"I know {listing([the(name) for name in rooms]) if rooms else 'no rooms'}.", Fact("list", rooms), model
        )
    if asked.kind == "compare":
        return _compared(asked, scene, model)
    if asked.kind in ("where", "rooms") and head is None and OURSELVES.search(asked.need):
        return _here(scene, model)
    if (head is None or head.said in ("are", "is", "")) and last is not None and asked.kind != "list":
        head = ReferringExpression(last.label, frozenset({last.label}), plural=True)
    if head is None:
        return _inventory(scene, model) if asked.kind == "list" else None
    if head.said in STANDS_FOR and head.bare and last is None:
        return None
    if head.generic and head.bare and not head.among and last is not None and asked.kind != "list":
        found: list[MapObject] = [last]
    else:
        out = {obj.id for noun in asked.rejected for obj in scene.meant(noun)[0]}
        found, _ = scene.meant(head, out)
    if not found and asked.kind in ("count", "exists", "where", "far") and (doors := scene.doors(head)):
        return _doors(asked, doors, scene, model)
    if asked.kind == "count":
        return _counted(head, found, scene, model)
    if asked.kind == "list" and found and not head.generic and _is_one(head):
        return _about(replace(asked, kind="which"), found, scene, model)
    if asked.kind == "list":
        return _listed(head, asked.rejected, scene, model)
    if asked.kind == "exists":
        return _exists(head, found, scene, model)
    if asked.others and asked.kind == "far" and (gone := _gone(asked.others, scene)) is not None:
        return _told(f"I have not seen {_unseen(gone, scene)}", Fact("tell", None), model)
    if head.rooms is not None and asked.kind in ("where", "far"):
        return _room(asked, head, scene, model)
    if not found:
        return _told(f"I have not seen {_unseen(head, scene)}", Fact("where", None), model)
    return _about(asked, found, scene, model)


def _gone(phrases: Sequence[ReferringExpression], scene: Scene) -> ReferringExpression | None:
    """The first phrase that means nothing here."""
    return next((phrase for phrase in phrases if phrase.rooms is None and not scene.landmarks(phrase)), None)


def _room(asked: ParsedUtterance, head: ReferringExpression, scene: Scene, model: str) -> Selection | None:
    """Where a room is: how far its nearest object is from here, or from what is said."""
    inside = [obj for obj in scene.objects if obj.room in (head.rooms or ())]
    if not head.rooms:
        return _told(f"I know no {head.said}.", Fact("where", None), model)
    if not inside:
        return None
    other = next(iter(scene.landmarks(asked.others[0])), None) if asked.others else None
    near = min(inside, key=lambda o: scene.distance_m(o, other))
    name, far = scene.rooms[near.room or 0].name, scene.distance_m(near, other)
    begins = f"{the(name)[:1].upper()}{the(name)[1:]} begins {far:.1f} m from"
    say = f"{begins} {f'the {other.label}' if other else 'here'}, by the {near.label}."
    return _told(say, Fact("where", name), model)


def _here(scene: Scene, model: str) -> Selection | None:
    """Where the robot stands, by the nearest object."""
    near = min(scene.objects, key=scene.distance_m, default=None)
    if near is None or not scene.known:
        return None
    room = scene.room_of(near)
    inside = f" in {the(room.name)}," if room is not None else ""
    say = f"I am{inside} {scene.distance_m(near):.1f} m from the {near.label}."
    return _told(say, Fact("where", room.name if room is not None else None, (near.id,)), model, near)


def _is_one(head: ReferringExpression) -> bool:
    """Whether a phrase means one object of several: "the book that is closest to the bed"."""
    return bool(head.most or head.order) or any(r.kind in ("nearest", "farthest") for r in head.relations)


def listed_in(asked: ParsedUtterance | None, scene: Scene, last: MapObject | None) -> tuple[int, ...]:
    """The ids of the objects that the answer to a question told of, in the order of its words."""
    if asked is None or asked.kind not in ("count", "exists", "where", "list"):
        return ()
    told = answer(asked, scene, last, "")
    return told.fact.objects if told is not None and told.fact is not None else ()


def spoken_of(asked: ParsedUtterance | None, scene: Scene, listed: Sequence[int]) -> list[MapObject]:
    """What "it" is after a list: the one object that lists what is on or by it, else the first that was listed."""
    ends = (relation.target for relation in asked.head.relations) if asked is not None and asked.head else ()
    places = [scene.landmarks(end)[:1] for end in ends if end is not None and end.rooms is None]
    held = [obj for found in places for obj in found if obj.id in scene.by_id]
    return held[:1] or [scene.by_id[i] for i in listed[:1] if i in scene.by_id]


def between(scene: Scene, door: Door) -> str:
    """The rooms that a passage joins: "the kitchen and the hall"."""
    return listing([the(scene.rooms[number].name) for number in door.rooms])


def passages(scene: Scene, doors: Sequence[Door]) -> str:
    """The rest of "There …" for passages between rooms."""
    joined = "; ".join(between(scene, door) for door in doors)
    return f"{'is one passage' if len(doors) == 1 else f'are {len(doors)} passages'}: between {joined}"


def _doors(asked: ParsedUtterance, doors: Sequence[Door], scene: Scene, model: str) -> Selection:
    """What the floor plan tells of passages between rooms, which are no objects."""
    say = f"There {passages(scene, doors)}."
    if asked.kind == "far":
        near = min(doors, key=scene.door_distance_m)
        far = scene.door_distance_m(near)
        say = f"The passage between {between(scene, near)} is {far:.1f} m from here."
        return _told(say, Fact("tell", round(far, 2)), model)
    told = {"count": Fact("count", len(doors)), "exists": Fact("exists", True)}
    return _told(say, told.get(asked.kind, Fact("where", None)), model)


def _about(asked: ParsedUtterance, found: Sequence[MapObject], scene: Scene, model: str) -> Selection:
    """The answer about one object, the nearest of those that the question may mean."""
    obj = found[0]
    it = next((name for name in obj.names if asked.head and name in asked.head.labels), f"the {obj.label}")
    where = whereabouts(scene, obj) or "where I saw it"
    if asked.kind == "colour" and len(found) > 1 and asked.head is not None and asked.head.plural:
        each = (f"the one {whereabouts(scene, o) or 'there'} is {_colours(o)}" for o in found[:MOST_TOLD])
        say = "; ".join(each)
        names = colours_of(obj)
        fact = Fact("tell", names[0] if names else None, tuple(o.id for o in found))
        return _told(f"{say[:1].upper()}{say[1:]}.", fact, model, obj)
    if asked.kind != "where":
        say, value = _known(asked, obj, it, where, scene)
        return _told(f"{say[:1].upper()}{say[1:]}.", Fact("tell", value, (obj.id,)), model, obj)
    room = scene.room_of(obj)
    if len(found) > 1 and not (asked.head and asked.head.most):
        places = Counter(whereabouts(scene, o) or "somewhere" for o in found).most_common()
        told = "; ".join(f"{NUMBERS.get(n, n)} {place}" for place, n in places[:5])
        say = f"I know {len(found)}: {told}{' and more' if len(places) > 5 else ''}."
    else:
        say = f"{it[:1].upper()}{it[1:]} is {where}, {scene.distance_m(obj):.1f} m from here."
    return _told(say, Fact("where", room.name if room else None, tuple(o.id for o in found)), model, obj)


def _known(asked: ParsedUtterance, obj: MapObject, it: str, where: str, scene: Scene) -> tuple[str, Any]:
    """A sentence about one object, without its full stop, and the same as a fact for programs."""
    if asked.kind == "far":
        other = scene.landmarks(asked.others[0]) if asked.others else []
        far = scene.distance_m(obj, other[0] if other else None)
        return f"{it} is {far:.1f} m from {f'the {other[0].label}' if other else 'here'}", round(far, 2)
    if asked.kind == "which":
        return f"{it} {where}", obj.label
    if asked.kind == "sure":
        looks = f"I saw {it} in {obj.n_detected} of {obj.n_observable} frames that could show it"
        return f"{looks}, and am {obj.probability:.0%} sure of it: it is {where}", obj.probability
    if asked.kind == "when":
        looked = f"and looked there last at {obj.last_looked_s:.0f} s"
        return f"I saw {it} last {obj.last_seen_s:.0f} s into the recording, {looked}", obj.last_seen_s
    if asked.kind == "colour":
        names = colours_of(obj)
        return f"{it} is {_colours(obj)}", names[0] if names else None
    size = [round(high - low, 2) for low, high in zip(obj.box_min, obj.box_max, strict=True)]
    return f"{it} is about {size[0]:.2f} m by {size[1]:.2f} m, and {size[2]:.2f} m high", size


def _colours(obj: MapObject) -> str:
    return " and ".join(colours_of(obj)) or "of no colour that I could tell"


def _counted(head: ReferringExpression, found: Sequence[MapObject], scene: Scene, model: str) -> Selection:
    maybe = [o for o in scene.maybe if called(o, head.labels) and o.probability >= 0.3] if head.bare else []
    unsure = f" {'One' if len(maybe) == 1 else len(maybe)} more may be there, hardly seen." if maybe else ""
    names = Counter(o.label for o in found)
    if not found:
        say = f"I have not seen {_unseen(replace(head, plural=True), scene)}{unsure}"
    else:
        what = listing([_many(name, count) for name, count in names.items()])
        say = f"I have seen {what}{where(head)}.{unsure}"
    return _told(
        say, Fact("count", len(found), tuple(o.id for o in found)), model, found[0] if len(names) == 1 else None
    )


def _exists(head: ReferringExpression, found: Sequence[MapObject], scene: Scene, model: str) -> Selection | None:
    if head.rooms is not None:
        names = [scene.rooms[i].name for i in head.rooms]
        return _told(
            f"Yes, I know the {names[0]}." if names else f"I know no {head.said}.", Fact("exists", bool(names)), model
        )
    ids = tuple(o.id for o in found)
    if found:
        what = _many(found[0].label, len(found)) if len({o.label for o in found}) == 1 else f"{len(found)} of them"
        where = whereabouts(scene, found[0])
        return _told(f"Yes: {what}{f', {where}' if where else ''}.", Fact("exists", True, ids), model, found[0])
    return _told(f"No, I have not seen {_unseen(head, scene)}", Fact("exists", False), model)


def _listed(
    head: ReferringExpression, rejected: Sequence[ReferringExpression], scene: Scene, model: str
) -> Selection | None:
    """What is on, in, under or near something; or in a room."""
    out = {obj.id for noun in rejected for obj in scene.meant(noun)[0]}
    if head.rooms is not None:
        found = [o for o in scene.objects if o.room in head.rooms and o.id not in out]
        there = f"in {the(head.said)}"
    elif head.generic and head.bare:
        return _inventory(scene, model)
    else:
        found, there = scene.meant(head, out)[0], where(head).strip() or "here"
    if not found and not head.generic and head.rooms is None:
        return _told(f"I have not seen {_unseen(replace(head, plural=True), scene)}", Fact("list", []), model)
    if not found and any(r.target is not None and r.target.said in HERE for r in head.relations):
        near = min(scene.objects, key=scene.distance_m)
        say = f"Nothing is within reach; the nearest is the {near.label}, {scene.distance_m(near):.1f} m from here."
        return _told(say, Fact("list", []), model)
    if not found:
        return _told(f"Nothing {'else ' if out else ''}that I have seen is {there}.", Fact("list", []), model)
    names = Counter(o.label for o in found)
    order = [name for name, _ in names.most_common()]
    found = sorted(found, key=lambda o: order.index(o.label))  # "the second of them" is that of these words
    what = listing([_many(name, count) for name, count in names.most_common(12)]) + (
        " and more" if len(names) > 12 else ""
    )
    ids = tuple(o.id for o in found)
    return _told(f"I have seen {what} {there}.", Fact("list", sorted(names), ids), model)


def _inventory(scene: Scene, model: str) -> Selection:
    names = Counter(o.label for o in scene.objects)
    what = listing([_many(name, count) for name, count in names.most_common(15)])
    say = f"I know {len(scene.objects)} objects of {len(names)} kinds: {what}{' and more' if len(names) > 15 else ''}."
    return _told(say, Fact("list", sorted(names), tuple(o.id for o in scene.objects)), model)


def _compared(asked: ParsedUtterance, scene: Scene, model: str) -> Selection | None:
    """Which of two or more objects has more of a measure, each object counted once."""
    phrases = [phrase for phrase in (asked.head, *asked.others) if phrase is not None]
    found = [scene.meant(phrase)[0] for phrase in phrases]
    if len(phrases) == 1 and phrases[0].among:  # "which of them is bigger"
        found = [[obj] for obj in scene.meant(replace(phrases[0], most="", size=""))[0]]
        phrases = phrases * len(found)
    gone = [phrase for phrase, objects in zip(phrases, found, strict=True) if not objects]
    if gone:
        return _told(f"I have not seen {_unseen(gone[0], scene)}", Fact("compare", None), model)
    first = list({objects[0].id: objects[0] for objects in found}.values())
    if len(first) < len(found):  # "is the bed in the study bigger than the bed": another bed than that
        rest = [o for objects in reversed(found) for o in objects if o.id not in {obj.id for obj in first}]
        first += rest[: len(found) - len(first)]
    if len(first) < 2:
        return None
    by = asked.by or "biggest"
    to = next(iter(scene.landmarks(asked.to)), None) if asked.to is not None else None
    if to is not None and by in ("nearest", "farthest"):
        more = (min if by == "nearest" else max)(first, key=lambda o: scene.distance_m(o, to))
    else:
        more = max(first, key=lambda o: scene.measure(o, by))
    alike = sum(obj.label == more.label for obj in first) > 1
    where = f" {whereabouts(scene, more)}" if alike else ""
    say = f"The {more.label}{where} is {COMPARATIVES.get(by, by) if len(first) == 2 else f'the {by}'}."
    return _told(say, Fact("compare", more.label, (more.id,)), model, more)


def _told(say: str, fact: Fact, model: str, obj: MapObject | None = None) -> Selection:
    name, number = (obj.label, obj.id) if obj is not None else (None, None)
    return Selection("answered", name, reason=say, text=say, fact=fact, model=model, object_id=number)


def _unseen(head: ReferringExpression, scene: Scene) -> str:
    """The rest of "I have not seen …" for a phrase that nothing fits, and what of its name there is instead.

    Where something has the name, the words say in what it differs: never "I have not seen a mug. There is a mug".
    """
    elsewhere = next((obj for obj in scene.objects if called(obj, head.labels)), None)
    if elsewhere is None:
        return f"{_a(head)}{where(head)}."
    described = head.relations or any(colour in head.said for colour in head.colours)
    there = f"There is {one(elsewhere.label)} {whereabouts(scene, elsewhere)}".rstrip()
    return f"{_a(head)}{where(head)}{'' if described else ' as you say'}. {there}."


def where(phrase: ReferringExpression) -> str:
    """The relations of a phrase in words again: " on the table in the kitchen"."""
    return "".join(f" {_preposition(c)}" for c in phrase.relations)


def _preposition(constraint: SpatialRelation) -> str:
    if constraint.target is None:
        return constraint.kind
    if constraint.target.said in HERE:
        return f"{constraint.kind.removesuffix('next to') or 'near'} here"
    if constraint.other is not None:
        return f"{constraint.kind} {the(constraint.target.said)} and {the(constraint.other.said)}"
    return f"{'nearest to' if constraint.kind == 'nearest' else constraint.kind} {the(constraint.target.said)}"


def _name(phrase: ReferringExpression) -> str:
    return phrase.said if not phrase.generic else "such thing"


def _a(phrase: ReferringExpression) -> str:
    return f"any {_name(phrase)}" if phrase.plural else one(_name(phrase))


def one(name: str) -> str:
    return f"{'an' if name[:1] in 'aeiou' else 'a'} {name}"


def _many(name: str, count: int) -> str:
    if count == 1:
        return one(name)
    for end, plural in PLURALS:
        if name.endswith(end):
            return f"{count} {name[: len(name) - len(end)]}{plural}"
    return f"{count} {name}s"


def listing(parts: Sequence[str]) -> str:
    """The parts as a sentence lists them: "a cup, a mug and a bowl"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
