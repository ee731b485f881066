"""Answers: what a reasoner chooses from, what it chose, and the answer with its whole trace."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

from cartier.errors import need
from cartier.types.looks import VisualTrace
from cartier.types.maps import Door, MapObject, Room
from cartier.types.places import Goal, Place
from cartier.types.route_rules import RouteRule

Status = Literal["found", "likely_near", "not_found", "clarify", "answered", "alarm"]
AlarmKind = Literal["self_harm", "violence", "child", "medical", "fire"]
STATUSES: tuple[str, ...] = get_args(Status)


@dataclass(frozen=True)
class Fact:
    """The answer to a question, for programs.

    Args:
        kind: What was asked: how many, whether there is one, where, which, which of two has more of something, or a
            property.
        value: For "count" a number, for "exists" a bool, for "where" the name of a room or None, for "list" names, for
            "compare" the name of the object that has more, for "tell" a word or a length in metres.
        objects: The ids of the objects that the answer is about.
    """

    kind: Literal["count", "exists", "where", "list", "compare", "tell"]
    value: Any
    objects: tuple[int, ...] = ()


@dataclass(frozen=True)
class Selection:
    """What a reasoner chose.

    Args:
        status: "found" (an object or room serves the words), "likely_near" (the object stands for one that is not in
            the map but usually near it), "not_found" (nothing serves), "clarify" (``question`` has to be answered
            first), "answered" (``text`` is the answer, and there is no goal) or "alarm" (harm or an emergency: ``text``
            says what a person should do now, and there is no goal).
        object: The name of the chosen object or room, from the inventory. Given for "found" and "likely_near"; for
            "answered" it may name what the answer is about.
        reason: Why, in one sentence.
        question: What to ask the person, for "clarify".
        candidates: Names that were considered, with their scores, best first.
        prompt, reply, model: What a language model was sent, what it returned, and which one it was; empty without one.
        next: The choices for further needs in the same words, in the order in which to serve them.
        object_id: Which object of that name, or None to leave it to the index.
        room: The id of the chosen room, or None for an object.
        door: The chosen passage between rooms, by its place among the inventory's doors, or None.
        text: The answer in words, for "answered" and "alarm".
        fact: The same answer for programs, or None.
        alarm: The kind of emergency, for "alarm": "self_harm", "violence" (to others), "child" (in danger), "medical"
            or "fire" (also gas and floods); else None.
        tentative: The id of an object that is not confirmed and that the question or the answer speaks of, or None: a
            person may be shown its photo.
        rules: What the words want of the way, in the order in which they say it. With "answered" they are rules for
            drives to come.
        lifts: Rules that the words take back.
    """

    status: Status
    object: str | None = None
    reason: str = ""
    question: str | None = None
    candidates: tuple[tuple[str, float], ...] = ()
    prompt: str = ""
    reply: str = ""
    model: str = ""
    next: tuple[Selection, ...] = ()
    object_id: int | None = None
    room: int | None = None
    text: str = ""
    fact: Fact | None = None
    alarm: AlarmKind | None = None
    tentative: int | None = None
    rules: tuple[RouteRule, ...] = ()
    lifts: tuple[RouteRule, ...] = ()
    door: int | None = None

    def __post_init__(self) -> None:
        need(self.status in STATUSES, f"selection status {self.status!r} is not one of {', '.join(STATUSES)}")
        names_one = self.status in ("found", "likely_near")
        need(
            self.status == "answered" or (self.object is not None) == names_one,
            f"a selection that is {self.status!r} must {'' if names_one else 'not '}name an object",
        )
        need((self.status == "alarm") == (self.alarm is not None), "a selection has a kind of alarm if it is 'alarm'")
        need(self.object is not None or self.object_id is None, "a selection with an object's id must name the object")


@dataclass(frozen=True)
class Inventory:
    """What a reasoner chooses from.

    Args:
        objects: The objects of a home, confirmed and tentative.
        rooms: Its rooms.
        photo: Gives the JPEG of the best view of an object by its id, or None.
        from_xy: Where the robot stands (x, y) in metres, or None if unknown.
        doors: The passages between its rooms.
        rules: The route rules that people gave and that hold.
        shut_doors: Passages that an earlier recording showed open, and the floor plan now shows shut.
        way_m: Gives the length (m) of the way that the robot drives to an object by its id; None where it knows no way.
    """

    objects: tuple[MapObject, ...]
    rooms: tuple[Room, ...] = ()
    photo: Callable[[int], bytes | None] = lambda _: None
    from_xy: tuple[float, ...] | None = None
    doors: tuple[Door, ...] = ()
    rules: tuple[RouteRule, ...] = ()
    shut_doors: tuple[Door, ...] = ()
    way_m: Callable[[int], float | None] = lambda _: None

    @property
    def names(self) -> list[str]:
        """The labels of all confirmed objects and the names that people gave them, each once, sorted."""
        return sorted({name for obj in self.objects if obj.confirmed for name in (obj.label, *obj.names)})

    def contains(self, chosen: Selection) -> bool:
        """Whether everything that a selection names is in the inventory.

        Args:
            chosen: What a reasoner chose.

        Returns:
            False if it names an unknown object, room or id.
        """
        objects = {obj.id: obj for obj in self.objects}
        if not objects.keys() >= set(chosen.fact.objects if chosen.fact else ()):
            return False
        if chosen.door is not None:
            return 0 <= chosen.door < len(self.doors)
        if chosen.room is not None:
            return any((room.id, room.name) == (chosen.room, chosen.object) for room in self.rooms)
        if chosen.object_id is not None:
            obj = objects.get(chosen.object_id)
            return obj is not None and chosen.object in (obj.label, *obj.names)
        return chosen.object is None or chosen.object in self.names

    @classmethod
    def of(cls, names: Iterable[str]) -> Inventory:
        """An inventory of bare names.

        Args:
            names: The names; duplicates count once.

        Returns:
            One confirmed object for each name, of which nothing else is known.
        """
        here, seen = (0.0, 0.0, 0.0), {"n_detected": 1, "n_observable": 1}
        every = enumerate(dict.fromkeys(names))
        return cls(tuple(MapObject.of_box(number, name, here, here, **seen) for number, name in every))


@dataclass(frozen=True)
class AsOf:
    """Of which moment of a live map an answer is.

    Args:
        age_s: How old the newest frame in it is (s).
        floor_seen: Which share of the floor was looked at, an estimate from 0 to 1.
        frame_epoch: How often the map was moved by corrected poses; a goal of an older epoch is void.
        correcting: Whether the map is being corrected, so that places may change.
        not_seen_yet: Whether what was asked for may be where nobody has looked yet.
    """

    age_s: float
    floor_seen: float
    frame_epoch: int = 0
    correcting: bool = False
    not_seen_yet: bool = False


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one request, with its whole trace.

    Args:
        query: What the person said.
        selection: What the reasoner chose.
        place: Where that is, or None.
        goal: How to get there, or None; ``notes`` say why.
        reasoner, index, detector, home: The names of what the answer comes from.
        timing_ms: How long each step took.
        notes: What a person should know about the answer, one line each.
        encoder: Which encoder the index used, or None.
        next: The answers to further needs in the same words, in order; each goal is planned from where the last one
            ends.
        look: How photographs were looked at for it, or None.
        as_of: Of which moment it is, for a home that is being mapped; else None.
    """

    query: str
    selection: Selection
    place: Place | None
    goal: Goal | None
    reasoner: str
    index: str
    detector: str
    home: str
    timing_ms: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    encoder: str | None = None
    next: tuple[Answer, ...] = ()
    look: VisualTrace | None = None
    as_of: AsOf | None = None

    def to_dict(self) -> dict[str, Any]:
        """The answer as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints.
        """
        chosen, number = self.selection, self.selection.object_id
        if number is None and self.place is not None:
            number = self.place.object_id  # the index chose among objects of one name
        return {
            "query": self.query, "status": chosen.status, "object": chosen.object, "object_id": number,
            "room": chosen.room, "reason": chosen.reason, "question": chosen.question, "text": chosen.text,
            "alarm": chosen.alarm, "answer": None if chosen.fact is None else asdict(chosen.fact),
            "tentative": chosen.tentative,
            "rules": [rule.text for rule in chosen.rules], "lifts": [rule.text for rule in chosen.lifts],
            "place": self.place.to_dict() if self.place else None, "goal": self.goal.to_dict() if self.goal else None,
            "candidates": [{"object": name, "score": score} for name, score in chosen.candidates],
            "reasoner": self.reasoner, "index": self.index, "encoder": self.encoder, "detector": self.detector,
            "home": self.home, "timing_ms": {step: round(ms, 2) for step, ms in self.timing_ms.items()},
            "notes": list(self.notes), "next": [answer.to_dict() for answer in self.next],
        } | self._extras()  # fmt: skip

    def _extras(self) -> dict[str, Any]:
        looked = {} if self.look is None else {"look": self.look.to_dict()}
        return looked | ({} if self.as_of is None else {"as_of": asdict(self.as_of)})
