"""Marked words for tests of route rules, until a parser that was trained on them ships: ``[words:role]``."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from cartier.labels import plain
from cartier.spatial.expressions import Kind
from cartier.types import Inventory, MapObject
from cartier.understanding.decoding import clauses
from cartier.understanding.dialogue_tracker import DialogueTracker
from cartier.understanding.tags import Clause
from cartier.understanding.utterance import TOKEN
from route_maps import flat, thing

MARK = re.compile(r"\[([^\[\]]+):([^\[\]:]+)\]")


def clauses_of(act: Kind, marked: str) -> tuple[str, tuple[Clause, ...]]:
    """The words without marks, and the clauses as a parser would give them."""
    text, tokens, tags, end = "", [], [], 0
    for found in [*MARK.finditer(marked), None]:
        parts = [(marked[end : found.start()] if found else marked[end:], "O")]
        parts += [(found[1], found[2])] if found else []
        for words, role in parts:
            said = [token[0] for token in TOKEN.finditer(plain(words))]
            text, tokens = text + words, tokens + said
            tags += ["O" if role == "O" else f"{'I' if k else 'B'}-{role}" for k in range(len(said))]
        end = found.end() if found else end
    return text, tuple(clauses(tuple(tokens), tuple(tags), [[(act, 1.0)]]))


def flat_inventory() -> Inventory:
    """The flat of ``route_maps`` with a sofa, two chairs, a table and a vase on it."""
    site = flat(
        thing(1, "sofa", (7.0, 0.2, 7.8, 1.0)), thing(2, "chair", (3.0, 0.2, 3.4, 0.6)),
        replace(thing(3, "chair", (2.0, 0.2, 2.4, 0.6)), colours=(("red", 1.0),)),
        raised(thing(4, "vase", (5.2, 2.2, 5.4, 2.4), 0.3), 0.8),
        thing(5, "table", (5.0, 2.0, 5.6, 2.6)),
    )  # fmt: skip
    return Inventory(tuple(site.objects), tuple(site.rooms), from_xy=(0.5, 1.5), doors=tuple(site.doors))


def raised(obj: MapObject, by_m: float) -> MapObject:
    """An object that stands on something."""
    low, high, middle = ((x, y, z + by_m) for x, y, z in (obj.box_min, obj.box_max, obj.position))
    return replace(obj, box_min=low, box_max=high, position=middle)


def reads(monkeypatch: pytest.MonkeyPatch, **acts: str) -> list[str]:
    """Let the embedded reasoner read marked words as marked; gives them without marks.

    Of the keys, ``go_2`` is for "go".
    """
    known = dict(clauses_of(act.split("_")[0], marked) for act, marked in acts.items())  # type: ignore[arg-type]
    real = DialogueTracker._parsed

    def parsed(self: DialogueTracker, query: str, turn: object, names: object) -> tuple[Clause, ...]:
        return known[query] if query in known else real(self, query, turn, names)  # type: ignore[arg-type]

    monkeypatch.setattr(DialogueTracker, "_parsed", parsed)
    return list(known)
