"""Rooms by whose they are: "Ben's room" is asked about once, and known from the reply on.

Names of persons are no words that a parser could learn, so the phrase is found by its form.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from cartier.labels import name_key, plain
from cartier.spatial.describe import tell_apart
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression, rephrased
from cartier.spatial.query import Scene
from cartier.types import Inventory
from cartier.understanding.choices import chosen
from cartier.understanding.entity_vocabulary import ROOMS
from cartier.understanding.offers import MOST_WORDS
from cartier.understanding.tags import ROUTE_NOUNS, Clause, Span
from cartier.understanding.utterance import TOKEN

ROOM_WORDS = frozenset(["room", "office", *(name.split()[-1] for name in ROOMS)])
NO_PERSONS = frozenset(
    ["it", "that", "what", "there", "let", "who", "where", "here", "he", "she", "how", "when", "this", "today", "one"]
)
NO_NAMES = frozenset(["my", "our", "your", "his", "her", "their", "the", "a", "an", "this", "that", "some", "no"])
"""Words before what is no name of a person: "my son's bed", "the neighbour's chair"."""
MOST_NAMED = 6  # rooms in a question
MOST_ASKED = 4
"""Objects that a question offers for choice."""
OBJECT_QUESTION = re.compile(r"Which (?P<label>[^:?]+) is (?P<name>[^\W\d_][\w-]*'s [a-z ]+): [^?]+\?")
QUESTION = re.compile(r"Which room is (?P<name>[^\W\d_][\w-]*'s [a-z ]+)(?::[^?]*)?\?")


def owned_rooms(clause: Clause, names: EntityVocabulary) -> Clause:
    """The clause with each "Ben's room" as one span: of a room, or of a route rule that is about it; other marks on its
    words go."""
    tokens, spans = clause.tokens, clause.spans
    for start in range(len(tokens) - 3):
        person, mark, letter, *rest = tokens[start : start + 5]
        if mark != "'" or letter != "s" or not person.isalpha() or person in NO_PERSONS:
            continue
        if name_key(person) not in names.rooms:  # "Ben's" is no room
            spans = tuple(s._replace(role="w") if s.role == "r" and s.words == (person,) else s for s in spans)
        length = next((n for n in (2, 1) if len(rest) >= n and _is_room(rest[:n], names)), 0)
        if length:
            end = start + 3 + length
            others = [span for span in spans if span.end <= start or span.start >= end]
            rule = next((span for span in spans if span not in others and span.role in ROUTE_NOUNS), None)
            room = (rule or Span("r", (), 0, 0))._replace(words=tokens[start:end], start=start, end=end)
            spans = tuple(sorted([*others, room], key=lambda span: span.start))
    return clause._replace(spans=spans)


def owner_of(clause: Clause, head: ReferringExpression | None) -> str:
    """The person of "Ben's chair", with the name that the chair may get: "ben's chair"; "" where no name is said."""
    target = next((span for span in clause.spans if span.role == "t"), None)
    if head is None or not head.bare or not head.labels or target is None or target.start < 3:
        return ""
    before, (person, mark, s) = clause.tokens[: target.start - 3], clause.tokens[target.start - 3 : target.start]
    named = mark == "'" and s == "s" and person.isalpha() and person not in NO_PERSONS | NO_NAMES
    return f"{person}'s {head.said}" if named and NO_NAMES.isdisjoint(before[-1:]) else ""


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


def which_is(name: str, label: str, apart: Sequence[str]) -> str:
    """What the robot asks when it first hears of a person's object, by what tells the objects of that label apart."""
    ones = _ones(apart)
    return f"Which {label} is {name[:1].upper()}{name[1:]}: {', '.join(ones[:-1])} or {ones[-1]}?"


def _ones(apart: Sequence[str]) -> list[str]:
    return [words if words.startswith("the ") else f"the one {words}" for words in apart]


def owner_told(words: str, robot: str, inventory: Inventory) -> tuple[str, str] | None:
    """The room or object, as corrections name it, and its new name in a reply to the robot's question whose it is: a
    room's name, or words that pick one object; no more than that."""
    asked = QUESTION.fullmatch(robot.strip())
    if asked is None:
        return _object_told(words, robot, inventory)
    said = name_key(re.sub(r"^(?:(?:it is|it's|that is|that's|it) )?(?:the )?", "", plain(words).strip(" .!")))
    told = [room.id for room in inventory.rooms if name_key(room.name) == said]
    return (f"room:{told[0]}", asked["name"]) if len(told) == 1 else None


def _object_told(words: str, robot: str, inventory: Inventory) -> tuple[str, str] | None:
    asked = OBJECT_QUESTION.fullmatch(robot.strip())
    if asked is None:
        return None
    scene, said = Scene(inventory), tuple(TOKEN.findall(plain(words)))
    few = sorted((o for o in scene.objects if o.label == asked["label"]), key=scene.distance_m)[:MOST_ASKED]
    choices = [(apart, obj.id) for apart, obj in zip(_ones(tell_apart(scene, few)), few, strict=True)]
    picked = chosen(Clause("choose", 1.0, (), said), choices) if len(said) <= MOST_WORDS else None
    return (str(picked), asked["name"]) if picked is not None else None
