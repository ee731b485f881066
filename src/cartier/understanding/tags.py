"""Tag set of the parser: the dialogue acts of clauses and the roles of words; see tools/understanding/README.md."""

from __future__ import annotations

from typing import NamedTuple, get_args

from cartier.spatial.expressions import Kind
from cartier.types import AlarmKind

REQUESTS: tuple[Kind, ...] = (
    "go", "need", "count", "exists", "where", "list", "compare", "far", "colour", "size", "when", "which", "sure",
    "rooms",
)  # fmt: skip
REPLIES: tuple[Kind, ...] = ("correct", "another", "choose", "confirm", "deny")
COMMANDS: tuple[Kind, ...] = ("come", "back", "follow", "stop", "able", "thanks", "bye")
NOTHING_ASKED: tuple[Kind, ...] = ("prohibit", "remark", "other")
ROUTING: tuple[Kind, ...] = ("rule", "lift")
"""States route rules and no goal; takes route rules back."""
DIALOGUE_ACTS: tuple[Kind, ...] = (*REQUESTS, *REPLIES, *COMMANDS, *NOTHING_ASKED, *ROUTING)
ALARMS: tuple[AlarmKind, ...] = get_args(AlarmKind)
ACTS: tuple[str, ...] = (*DIALOGUE_ACTS, *ALARMS)
"""What words may do. Alarms are judged before all else (``alarm.py``): no clause has one for its act."""

NOUNS = ("t", "b", "l", "m", "r", "n", "p")
"""Target, second target, landmark, landmark of a landmark, room, turned-down object, pronoun."""
ATTRIBUTES = ("c", "s", "o", "x", "w")
"""Colour, superlative or size, ordinal, "other", owner."""
RELATIONS = ("on", "in", "under", "above", "next", "near", "between", "left", "right", "nearest", "farthest", "behind",
             "front", "with", "from")  # fmt: skip
NEGATED = tuple(f"!{relation}" for relation in ("on", "in", "under", "next", "near", "with", "behind"))
ROUTE_NOUNS = ("va", "vk", "vs", "vp", "vo", "vv")
"""What a route is to avoid, keep away from, be slow near, prefer, go through only, and go via."""
ROUTE_WORDS = ("vh", "vt")
"""Words that ask for the short way, and that say how long a rule holds."""
ROLES = (*NOUNS, *ATTRIBUTES, *RELATIONS, *NEGATED, "/", *ROUTE_NOUNS, *ROUTE_WORDS)
"""``/`` are words that separate two requests."""
TAGS = ("O", *(f"{part}-{role}" for role in ROLES for part in "BI"))


class Span(NamedTuple):
    """Words of one role: tokens ``start`` to ``end`` of an utterance."""

    role: str
    words: tuple[str, ...]
    start: int
    end: int


class Clause(NamedTuple):
    """One request of an utterance: its act and its probability, its spans and tokens, the second likeliest act."""

    act: Kind
    certainty: float
    spans: tuple[Span, ...]
    tokens: tuple[str, ...]
    second: tuple[Kind, float] = ("other", 0.0)
