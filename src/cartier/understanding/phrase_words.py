"""Words around the marked ones that change what they mean: numbers, exceptions, "of them", "next to me", "window side".

Each function takes the spans of a clause and its tokens, and gives the spans as they are meant.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from cartier.labels import name_key, words
from cartier.spatial.expressions import EntityVocabulary, ReferringExpression, SpatialRelation
from cartier.spatial.query import HERE
from cartier.understanding.reference_words import COLOURS, ORDER
from cartier.understanding.tags import NOUNS, Clause, Span

NUMBERS = {word: k for k, word in enumerate(words("two three four five six seven eight"), 2)}
USUAL = {
    name_key(name): place
    for place, every in {
        "bed": "bedside table, bedside cabinet, nightstand, night stand, night table, bedside lamp",
        "dining table": "dining chair, dining room chair", "desk": "desk chair, office chair, swivel chair",
    }.items()
    for name in every.split(", ")
}  # fmt: skip
"""What an object is by whose name tells its place."""
LISTED = ("them", "those", "these")
EXCEPT = re.compile(
    r"\b(?:besides|except(?: for)?|excluding|(?:apart|aside) from|other than)(?: the| my| that| a| an| our)?$"
)
ASKS_FOR_SEVERAL = ("list", "count", "exists", "where", "which")
BY = frozenset(["near", "beside", "around", "by"])  # "near me"
TO = frozenset(["next", "close", "near", "nearby"])  # "next to me"
LONGEST_EXCEPTION = 4  # tokens before what is excepted


def in_words(clause: Clause) -> Clause:
    """The clause with its spans as the words around them have it."""
    spans = _excepted(_ordered(_one_colour(_ends(clause)), clause.tokens), clause)
    return _beside_us(clause._replace(spans=tuple(sorted(spans, key=lambda span: span.start))))


def number_before(span: Span, tokens: Sequence[str]) -> int:
    """How many a noun means: "the two pillows", "two white pillows"; 0 where that is not said."""
    return next((NUMBERS[t] for t in reversed(tokens[max(span.start - 2, 0) : span.start]) if t in NUMBERS), 0)


def _ends(clause: Clause) -> tuple[Span, ...]:
    """The spans, where the second object of "between the bed and the desk" is a landmark like the first."""
    if clause.act == "far" and [span.role for span in clause.spans] == ["r", "t"]:  # "how far is the hall from the bed"
        room, noun = clause.spans
        if "from" in clause.tokens[room.end : noun.start]:
            return room, noun._replace(role="b")
    if clause.act in ("compare", "far") or not any(span.role == "between" for span in clause.spans):
        return clause.spans
    joined = [span for span in clause.spans if span.role == "r" and "and" in clause.tokens[span.start - 2 : span.start]]
    return tuple(span._replace(role="l") if span.role == "b" or span in joined else span for span in clause.spans)


def _one_colour(spans: Sequence[Span]) -> list[Span]:
    """Colours that follow one another as one span: "green and", "white"."""
    found = list[Span]()
    for span in spans:
        if found and found[-1].role == span.role == "c" and found[-1].end == span.start:
            found[-1] = Span("c", (*found[-1].words, *span.words), found[-1].start, span.end)
        else:
            found.append(span)
    return found


def _ordered(spans: Sequence[Span], tokens: Sequence[str]) -> list[Span]:
    """The spans with the ordinal of "the second of them"."""
    found = list(spans)
    for span in spans:
        if span.words[-1] in LISTED and span.start > 1 and tokens[span.start - 1] == "of":
            at = span.start - 2
            if tokens[at] in ORDER and not any(s.start <= at < s.end for s in spans):
                found.append(Span("o", (tokens[at],), at, at + 1))
    return found


def _excepted(spans: Sequence[Span], clause: Clause) -> list[Span]:
    """The spans, where what a question leaves out is turned down: "what is on the table besides the cup"."""
    if clause.act not in ASKS_FOR_SEVERAL:
        return list(spans)
    return [
        span._replace(role="n")
        if span.role in NOUNS
        and EXCEPT.search(" ".join(clause.tokens[max(span.start - LONGEST_EXCEPTION, 0) : span.start]))
        else span
        for span in spans
    ]


def _beside_us(clause: Clause) -> Clause:
    """The clause, where "next to me" tells the nearest, or in a question for several is where the robot stands."""
    tokens, spans = clause.tokens, clause.spans
    at = next((k for k, t in enumerate(tokens) if t in HERE and _is_by(tokens[:k], t)), None)
    if at is None:
        return clause
    begin = at - (1 if tokens[at - 1] in BY else 2)
    rest = tuple(span for span in spans if span.end <= begin or span.start > at)
    named = any(span.role == "t" for span in rest)
    if clause.act in ("list", "count", "exists") or (clause.act == "which" and not named):
        place = [Span("near", tokens[begin:at], begin, at), Span("l", (tokens[at],), at, at + 1)]
        clause = clause._replace(act="list" if clause.act == "which" else clause.act)
    else:
        place = [Span("s", ("nearest",), begin, at + 1)]
    if not named and clause.act not in ("list", "count", "exists"):
        return clause
    return clause._replace(spans=tuple(sorted((*rest, *place), key=lambda span: span.start)))


def _is_by(before: Sequence[str], place: str) -> bool:
    by = ("near", "nearby") if place == "here" else BY  # "in by here" is no more than "here"
    return before[-1:] != () and (before[-1] in by or (before[-1] == "to" and len(before) > 1 and before[-2] in TO))


def colours_said(said: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The colours that words may mean, and those of a second colour that is there as well: "green and white"."""
    each = [(k, COLOURS[word]) for k, word in enumerate(said) if word in COLOURS]
    cut = next((k for k, word in enumerate(said) if word in ("and", "with")), len(said))
    first = tuple(dict.fromkeys(c for k, colours in each for c in colours if k < cut))
    also = tuple(dict.fromkeys(c for k, colours in each for c in colours if k > cut))
    return (first, also) if first else (also, ())


def usual_place(keys: Sequence[str], labels: frozenset[str], names: EntityVocabulary) -> SpatialRelation | None:
    """Where an object of a telling name is, if the home calls it something else: a bedside table is by a bed."""
    key = next((key for key in keys if key in USUAL), "")
    place = names.objs.get(name_key(USUAL.get(key, ""))) if key and key not in map(name_key, labels) else None
    return SpatialRelation("near", ReferringExpression(USUAL[key], place)) if place else None


def of_room(span: Span, room: int, spans: Sequence[Span]) -> bool:
    """Whether an attribute is a room's: "the second bedroom", not "the biggest kitchen table"."""
    end = spans[room].end
    alone = not any(noun.start == end and noun.role in ("t", "b", "l", "m") for noun in spans)
    return alone and span.role in ("s", "o", "x") and span.end == spans[room].start
