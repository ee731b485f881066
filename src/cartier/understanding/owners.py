"""Rooms by whose they are: "Ben's room" is asked about once, and known from the reply on.

Names of persons are no words that a parser could learn, so the phrase is found by its form.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from cartier.labels import name_key, plain
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, rephrased
from cartier.types import Inventory
from cartier.understanding.entity_vocabulary import ROOMS
from cartier.understanding.tags import Clause, Span

ROOM_WORDS = frozenset(["room", "office", *(name.split()[-1] for name in ROOMS)])
NO_PERSONS = frozenset(
    ["it", "that", "what", "there", "let", "who", "where", "here", "he", "she", "how", "when", "this", "today", "one"]
)
MOST_NAMED = 6  # rooms in a question
QUESTION = re.compile(r"Which room is (?P<name>[^\W\d_][\w-]*'s [a-z ]+)(?::[^?]*)?\?")


def owned_rooms(clause: Clause, names: EntityVocabulary) -> Clause:
    """The clause with each "Ben's room" as one span of a room; other marks on its words go."""
    tokens, spans = clause.tokens, clause.spans
    for start in range(len(tokens) - 3):
        person, mark, s, *rest = tokens[start : start + 5]
        if mark != "'" or s != "s" or not person.isalpha() or person in NO_PERSONS:
            continue
        length = next((n for n in (2, 1) if len(rest) >= n and _is_room(rest[:n], names)), 0)
        if length:
            end = start + 3 + length
            others = [span for span in spans if span.end <= start or span.start >= end]
            spans = tuple(sorted([*others, Span("r", tokens[start:end], start, end)], key=lambda span: span.start))
    return clause._replace(spans=spans)


def _is_room(said: Sequence[str], names: EntityVocabulary) -> bool:
    return said[-1] in ROOM_WORDS and (len(said) == 1 or name_key(" ".join(said)) in names.rooms)


def unknown_owner(asked: ParsedUtterance) -> str:
    """The first "ben's room" of a query that no room is called; "" for none."""
    phrases = [phrase for phrase in (asked.head, *asked.others, asked.to) if phrase is not None]
    near = [relation.target for phrase in phrases for relation in phrase.relations if relation.target is not None]
    return next((phrase.said for phrase in (*phrases, *near) if phrase.rooms == () and "'s " in phrase.said), "")


def owner_question(said: str, rooms: Sequence[str]) -> str:
    """What the robot asks when it first hears of a person's room."""
    of = f": {', '.join(f'the {name}' for name in rooms[:MOST_NAMED])}" if rooms else ""
    return f"Which room is {said[:1].upper()}{said[1:]}{of}?"


def with_owner(asked: ParsedUtterance, rooms: tuple[int, ...]) -> ParsedUtterance:
    """The query with its unknown person's room replaced by rooms."""
    said = unknown_owner(asked)

    return rephrased(asked, lambda phrase: replace(phrase, rooms=rooms if phrase.said == said else phrase.rooms))


def owner_told(words: str, robot: str, inventory: Inventory) -> tuple[int, str] | None:
    """The room and its new name in a reply to the robot's question whose room is which: a room's name, no more."""
    asked = QUESTION.fullmatch(robot.strip())
    if asked is None:
        return None
    said = name_key(re.sub(r"^(?:(?:it is|it's|that is|that's|it) )?(?:the )?", "", plain(words).strip(" .!")))
    told = [room.id for room in inventory.rooms if name_key(room.name) == said]
    return (told[0], asked["name"]) if len(told) == 1 else None
