"""Requests and questions about particular objects with their ground truth, and the score of an answer.

``docs/things.md`` has both file formats: that of requests, and that in which any system's answers are scored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.llm.prompts import check_query
from cartier.types import STATUSES, TrueObject
from cartier_bench.lines import Line, Name, Text, read_lines
from cartier_bench.metrics import canonical

FIND = ("relation", "room", "attribute", "superlative", "need", "follow_up")
ASK = ("count", "exists", "where", "list", "compare")
KINDS = (*FIND, "bare", *ASK, "nothing")
WITHIN_M = 0.3  # of the box of an accepted object
WRITTEN = Path(__file__).parent / "thing_texts" / "written.jsonl"
ITEM_FORM = (
    '{"id": "…", "home": "80001", "kind": "relation", "text": "the cup by the sink", "accept_ids": [3], "answer": null}'
)
ANSWER_FORM = '{"id": "…", "status": "found", "xy": [1.2, 3.4]} or {"id": "…", "status": "answered", "answer": 2}'
MAX_LINES, MAX_TURNS, MAX_IDS = 20_000, 8, 500
ANSWERS = {
    "count": "a whole number", "exists": "true or false", "where": "names that are right", "list": "a list of names",
    "compare": "the name that is right",
}  # fmt: skip


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]+|\d+", text.lower()))


TELLING = _words("""
    kitchen bedroom bathroom living hall hallway study office room lounge left right nearest closest nearer closer
    farther farthest near window door wall corner big bigger biggest large larger largest small smaller smallest tall
    taller low lower high higher black grey gray white red
    orange yellow green blue purple pink brown first second third metre metres meters m
""")
"""Words of a question that tell objects apart, besides the names of other objects."""
WHICH = frozenset({"which", "one", "ones"})
NEAREST = frozenset({"nearest", "closest", "nearer", "closer", "several"})
"""What says of one of several that it was taken because it is near."""
Words = Annotated[Text, Field(max_length=4000)]
Names = Annotated[tuple[Name, ...], Field(strict=False, max_length=MAX_IDS)]


@dataclass(frozen=True)
class Item:
    """One request: what a person says, in one turn or several, in a home; and what is true.

    ``accept_ids`` are the simulator's ids of the objects that serve it. ``answer`` is a number for ``count``, true or
    false for ``exists``, names for ``where`` (each is right), ``list`` (all are meant) and ``compare``, None for the
    others; ``maybe`` are names that a list may hold or not. ``rejects``: the last turn turns down what the one before
    it led to.
    """

    id: str
    home: str
    kind: str
    turns: tuple[str, ...]
    accept_ids: tuple[int, ...] = ()
    answer: int | bool | tuple[str, ...] | None = None
    maybe: tuple[str, ...] = ()
    rejects: bool = False

    def to_dict(self) -> dict[str, Any]:
        """The line of a file."""
        row: dict[str, Any] = {"id": self.id, "home": self.home, "kind": self.kind}
        row |= {"text": self.turns[0]} if len(self.turns) == 1 else {"turns": list(self.turns)}
        answer = list(self.answer) if isinstance(self.answer, tuple) else self.answer
        row |= {"accept_ids": list(self.accept_ids), "answer": answer}
        return row | ({"maybe": list(self.maybe)} if self.maybe else {}) | ({"rejects": True} if self.rejects else {})


@dataclass(frozen=True)
class Given:
    """A system's answer. ``at`` is the place it leads to, (x, y) or (x, y, z) in metres, or the id of a true object;
    ``before`` the same for the turn before the last one, where there is one."""

    id: str
    status: str
    at: tuple[float, ...] | int | None = None
    answer: Any = None
    question: str = ""
    text: str = ""
    before: tuple[float, ...] | int | None = None


@dataclass(frozen=True)
class Score:
    """``distance_m`` is that to the nearest accepted box; ``f1`` that of a list's names."""

    right: bool
    distance_m: float | None = None
    f1: float | None = None


def score(item: Item, given: Given, truth: Mapping[int, TrueObject]) -> Score:
    """Whether an answer is right; ``truth`` are the home's objects by their ids.

    A find is right if its place lies in or within 0.3 m of an accepted object's box. A bare name of several is right
    with a question that holds a word that tells them apart, or with the nearest one and a word that says so. Answers to
    questions are compared exactly. What nothing serves is right without a place.
    """
    sent = given.at if given.status in ("found", "likely_near") else None
    distance = _distance(sent, item.accept_ids, truth)
    hit = distance is not None and distance <= WITHIN_M
    if item.kind == "nothing":
        return Score(sent is None)
    if item.kind == "bare":
        asked = given.status == "clarify" and _separates(given.question, item, truth)
        return Score(asked or (hit and bool(_words(given.text) & NEAREST)), distance)
    if item.kind in FIND:
        again = item.rejects and sent is not None and _same(sent, given.before, item, truth)
        return Score(hit and not again, distance)
    if given.status != "answered":
        return Score(False, f1=0.0 if item.kind == "list" else None)
    return _told(item, given.answer)


def _told(item: Item, answer: Any) -> Score:
    if item.kind == "count":
        return Score(type(answer) is int and answer == item.answer)
    if item.kind == "exists":
        return Score(type(answer) is bool and answer is item.answer)
    right = {_name(name) for name in item.answer} if isinstance(item.answer, tuple) else set()
    names = {
        _name(name) for name in (answer if isinstance(answer, list | tuple) else [answer]) if isinstance(name, str)
    }
    if item.kind != "list":
        return Score(bool(names) and names <= right)
    names -= {_name(name) for name in item.maybe} - right
    shared = len(names & right)
    return Score(names == right, f1=round(2 * shared / (len(names) + len(right)), 4) if names or right else 1.0)


def _name(name: str) -> str:
    """An object's or a room's name: synonyms are one, and "bedroom 2" is a bedroom."""
    return canonical(re.sub(r"\s+\d+$", "", name.strip()))


def _distance(
    at: tuple[float, ...] | int | None, accept: Iterable[int], truth: Mapping[int, TrueObject]
) -> float | None:
    boxes = [truth[i] for i in accept if i in truth]
    if at is None or not boxes:
        return None
    if isinstance(at, int):
        return 0.0 if at in accept else math.inf
    n, point = len(at), np.array(at)
    return min(float(box_distance(point, np.array(b.box_min[:n]), np.array(b.box_max[:n]))) for b in boxes)


def _same(
    at: tuple[float, ...] | int, before: tuple[float, ...] | int | None, item: Item, truth: Mapping[int, TrueObject]
) -> bool:
    """Whether two places are at the same accepted object."""
    if before is None:
        return False
    first, then = (min(item.accept_ids, key=lambda i: _distance(place, (i,), truth) or 0.0) for place in (at, before))
    return first == then


def _separates(question: str, item: Item, truth: Mapping[int, TrueObject]) -> bool:
    """Whether a question is about the object that was named, and holds a word that tells several apart and is new."""
    named = _words(" ".join(_name(truth[i].label) for i in item.accept_ids if i in truth))
    others = _words(" ".join(_name(obj.label) for obj in truth.values()))
    said, asked = named | _words(" ".join(item.turns)), _words(question)
    return bool(asked & (named | WHICH)) and bool(asked & ((TELLING | others) - said))


def load_items(path: str | Path) -> list[Item]:
    """Requests from JSON lines. Raises InputError with the number of the first broken line, or for an empty file."""
    items: dict[str, Item] = {}
    for where, row in read_lines(Path(path), _ItemLine, MAX_LINES, ITEM_FORM):
        if row.id in items:
            raise InputError(f"{where}: the id {row.id!r} was used before: give each request its own")
        try:
            items[row.id] = row.item()
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
    if not items:
        raise InputError(f"{path} holds no request; a line looks like {ITEM_FORM}")
    return list(items.values())


def load_answers(path: str | Path, items: Sequence[Item]) -> dict[str, Given]:
    """A system's answers from JSON lines, by the id of the request; what it left out is not there.

    Raises InputError with the number of the first broken line, and for an id that is none of the requests'.
    """
    asked, found = {item.id for item in items}, dict[str, Given]()
    for where, row in read_lines(Path(path), _AnswerLine, MAX_LINES, ANSWER_FORM):
        if row.id not in asked:
            raise InputError(f"{where}: {row.id!r} is no request of this run: ask what stands in its requests.jsonl")
        if row.id in found:
            raise InputError(f"{where}: {row.id!r} was answered on a line before")
        places = [place for place in (row.xy, row.xyz, row.object_id) if place is not None]
        if len(places) > 1:
            raise InputError(f"{where}: one of xy, xyz and object_id is enough")
        found[row.id] = Given(
            row.id,
            row.status,
            places[0] if places else None,
            row.answer,
            row.question or "",
            row.text or "",
            row.before_xy,
        )
    return found


class _ItemLine(Line):
    id: Name
    home: Name
    kind: Literal[KINDS]  # type: ignore[valid-type]
    text: Words | None = None
    turns: Annotated[tuple[Words, ...], Field(strict=False, min_length=1, max_length=MAX_TURNS)] | None = None
    accept_ids: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Field(strict=False, max_length=MAX_IDS)]
    answer: bool | int | str | Names | None
    maybe: Names = ()
    rejects: bool = False

    def item(self) -> Item:
        """Raises InputError where the fields do not go together."""
        if (self.text is None) == (self.turns is None):
            raise InputError("either text or turns is needed: the words of one turn, or of several")
        answer = (self.answer,) if isinstance(self.answer, str) else self.answer
        meant = {"count": int, "exists": bool, "where": tuple, "list": tuple, "compare": tuple}.get(self.kind, NoneType)
        if type(answer) is not meant or (answer == () and self.kind != "list"):
            raise InputError(f"answer: the kind {self.kind} needs {ANSWERS.get(self.kind, 'null')}")
        if self.kind in (*FIND, "bare") and not self.accept_ids:
            raise InputError(f"accept_ids: the kind {self.kind} needs the ids of the objects that serve it")
        if self.kind == "nothing" and self.accept_ids:
            raise InputError("accept_ids: what nothing serves has none")
        turns = tuple(check_query(turn) for turn in self.turns or (self.text or "",))
        return Item(self.id, self.home, self.kind, turns, self.accept_ids, answer, self.maybe, self.rejects)


class _AnswerLine(Line):
    id: Name
    status: Literal[STATUSES]  # type: ignore[valid-type]
    xy: Annotated[tuple[float, float], Field(strict=False)] | None = None
    xyz: Annotated[tuple[float, float, float], Field(strict=False)] | None = None
    object_id: int | None = None
    answer: bool | int | str | Names | None = None
    question: Words | None = ""
    text: Words | None = ""
    before_xy: Annotated[tuple[float, float], Field(strict=False)] | None = None
