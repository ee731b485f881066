"""Assembly of tagged words into a typed query: which noun has which attributes, and what relates it to a landmark."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from cartier.labels import name_key
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression, SpatialRelation, merged
from cartier.understanding.comparisons import compared, of_kind
from cartier.understanding.naming import with_target
from cartier.understanding.owners import owned_rooms
from cartier.understanding.phrase_words import colours_said, in_words, number_before, of_room, usual_place
from cartier.understanding.reference_words import COLOURS, GENERIC, MOST, ORDER, PLURAL, SIZES
from cartier.understanding.tags import ATTRIBUTES, NOUNS, RELATIONS, ROUTE_NOUNS, ROUTE_WORDS, Clause, Span
from cartier.understanding.text import STOP
from cartier.understanding.utterance import LONGEST_NAME, MOTION

KINDS = {"next": "next to", "left": "left of", "right": "right of", "behind": "near", "front": "near"}
"""What ``spatial.query`` calls a relation, where it has another name there."""
LEAST_TELLING = 2  # words besides a room and those of driving, that tell a need
LEAST_SECOND = 0.02  # probability of the second act
REACH = 4  # words from "one" to the room that it is in
PLACES = ("in", "on", "under", "above", "next", "with", "behind", "front", "between")
"""Relations that tell where the second of two compared objects is, not what both are compared to."""
PARTS = (",", ".", ";", "!", "?", "but")
"""Tokens between which a need and the way there stand apart."""
HEADS = ("t", "b", "p", "n")
"""Roles of nouns that are no landmark."""
NOWHERE = -1
"""Where a target stands that no word names: "the blue, please", "what is on the table"."""


def query(clause: Clause, names: EntityVocabulary) -> ParsedUtterance:
    """The typed query of a clause: the act, the target with its attributes and relations, and what is turned down."""
    clause = owned_rooms(clause, names)
    routes = [span for span in clause.spans if span.role in (*ROUTE_NOUNS, *ROUTE_WORDS)]
    clause = with_target(in_words(clause), names)
    told = _of_the_goal(_snapped(clause.spans, clause.tokens, names))
    told = told if clause.act in ("compare", "choose") else _targeted(told)
    clause = clause._replace(spans=tuple(_measures(compared(told) if clause.act == "compare" else told)))
    if clause.act == "go" and _serves(clause):
        clause = clause._replace(act="need")
    if clause.act == "need":  # what it names is not wanted; of places only rooms are sure
        kept = (s for s in clause.spans if s.role in ("n", "in", "!in") or (s.role == "r" and _is_room(s, names)))
        clause = clause._replace(spans=tuple(kept))
    spans = [span for span in clause.spans if span.role in NOUNS]
    if not any(span.role in ("t", "p") for span in spans) and (
        clause.act not in ("go", "where", "far") or not spans or _places(clause)
    ):
        spans = [_stand_in(clause), *spans]
    spans = _where_said(spans, names)
    nouns = [_noun(span, clause, names) for span in spans]
    _attach_attributes(clause.spans, spans, nouns)
    _attach_relations(clause.spans, spans, nouns)
    of = {role: [noun for span, noun in zip(spans, nouns, strict=True) if span.role == role] for role in NOUNS}
    if clause.act == "far" and not of["b"] and len(of["t"]) > 1:
        of["t"], of["b"] = of["t"][:1], of["t"][1:]
    targets = of["t"] or of["p"] or of["r"][:1] or of["l"][:1]
    head = _merged(targets) if targets else None
    if head is not None and head.said == "" and head.bare:
        head = None
    said = [span.words for span in clause.spans if span.role in ("s", "nearest", "farthest")] or [clause.tokens]
    by = next(filter(None, map(_measure, said)), "")
    return ParsedUtterance(
        clause.act, head, tuple(of_kind(noun, head) for noun in of["b"]), by, _need(clause, routes),
        of["l"][0] if of["l"] else None, tuple(_refused(noun, head) for noun in of["n"]),
    )  # fmt: skip


def _where_said(spans: Sequence[Span], names: EntityVocabulary) -> list[Span]:
    """The nouns, where "there" is a place that was just named: "I put it on the table, go there"."""
    places = [k for k, span in enumerate(spans) if span.role == "l" and names.objs.get(name_key(" ".join(span.words)))]
    pronouns = [span for span in spans if span.role in ("t", "p")]
    if len(places) != 1 or not pronouns or any(span.words != ("there",) for span in pronouns):
        return list(spans)
    return [s._replace(role="t") if k == places[0] else s for k, s in enumerate(spans) if s not in pronouns]


def routed(clause: Clause, names: EntityVocabulary) -> list[tuple[Span, ReferringExpression]]:
    """The nouns that a clause's route rules are about, in their order, each with what is said of it."""
    clause = owned_rooms(clause, names)
    told, found = _snapped(clause.spans, clause.tokens, names), list[tuple[Span, ReferringExpression]]()
    owners = _owners(told)
    for k, noun in enumerate(told):
        if noun.role in ROUTE_NOUNS:
            own = [s._replace(role="t") if s is noun else s for s, of in zip(told, owners, strict=True) if of == k]
            spans = [span for span in own if span.role in NOUNS]
            nouns = [_noun(span, clause, names) for span in spans]
            _attach_attributes(own, spans, nouns)
            _attach_relations(own, spans, nouns)
            found.append((noun, nouns[next(i for i, span in enumerate(spans) if span.role == "t")]))
    return found


def _of_the_goal(spans: Sequence[Span]) -> tuple[Span, ...]:
    """The spans that tell of the goal, not of the way there."""
    owners = _owners(spans)
    return tuple(s for s, of in zip(spans, owners, strict=True) if of is None and s.role not in ROUTE_WORDS)


def _owners(spans: Sequence[Span]) -> list[int | None]:
    """For each span the index of the route noun that it tells of; None where it tells of the goal.

    What stands right before a noun tells of that noun, what follows tells of the last one.
    """
    owners, now = list[int | None](), None
    for k, span in enumerate(spans):
        noun = next((i for i in range(k + 1, len(spans)) if spans[i].role in (*NOUNS, *ROUTE_NOUNS)), k)
        before = noun > k and all(spans[i].end >= spans[i + 1].start - 1 for i in range(k, noun))
        if span.role in (*HEADS, *ROUTE_NOUNS):
            now = k if span.role in ROUTE_NOUNS else None
        elif before and span.role in (*ATTRIBUTES, "r") and spans[noun].role in (*HEADS, *ROUTE_NOUNS):
            owners.append(noun if spans[noun].role in ROUTE_NOUNS else None)
            continue
        owners.append(now)
    return owners


def _targeted(spans: Sequence[Span]) -> tuple[Span, ...]:
    """The spans, where a landmark that is named first and follows no relation is the target: "and the clock on it"."""
    noun = next((k for k, span in enumerate(spans) if span.role in NOUNS), None)
    if noun is None or spans[noun].role != "l" or any(span.role == "t" for span in spans):
        return tuple(spans)
    before, after = spans[:noun], spans[noun + 1 :]
    if any(span.role.lstrip("!") in RELATIONS for span in before):
        return tuple(spans)
    return (
        *before,
        spans[noun]._replace(role="t"),
        *(span._replace(role="l") if span.role == "p" else span for span in after),
    )


def _serves(clause: Clause) -> bool:
    """Whether a drive to nothing but a room may be a need in that room: "I want to get clean, in the bathroom"."""
    if any(span.role in NOUNS and span.role != "r" for span in clause.spans) or clause.second[0] != "need":
        return False
    rooms = {word for span in clause.spans for word in span.words}
    rest = [w for w in clause.tokens if w[0].isalpha() and w not in STOP and w not in MOTION and w not in rooms]
    return bool(rooms) and len(rest) >= LEAST_TELLING and clause.second[1] >= LEAST_SECOND


def _is_room(span: Span, names: EntityVocabulary) -> bool:
    return name_key(" ".join(span.words)) in names.rooms


def _snapped(spans: Sequence[Span], tokens: Sequence[str], names: EntityVocabulary) -> tuple[Span, ...]:
    """The spans, where a noun that is part of a known name is that name: "chest" in "chest of drawers"."""
    found = list[Span]()
    for span in spans:
        if span.role in (*NOUNS, *ROUTE_NOUNS) and span.role != "p":
            if found and found[-1].role in NOUNS and span.start < found[-1].end:
                continue
            others = [s for s in spans if s.role in (*NOUNS, *ROUTE_NOUNS) and s.role != span.role]
            around = (
                (start, end)
                for start in range(max(span.end - LONGEST_NAME, 0), span.start + 1)
                for end in range(min(start + LONGEST_NAME, len(tokens)), span.end - 1, -1)
                if not any(start < other.end and other.start < end for other in others)
            )
            known = [
                (end - start, start, end)
                for start, end in around
                if _is_known(tokens[start:end], names) and (end == span.end or tokens[end - 1] != "one")
            ]  # "the bedroom one" is no room
            _, start, end = max(known, default=(0, span.start, span.end))
            if found and start < found[-1].end:
                start, end = span.start, span.end
            span = span._replace(words=tuple(tokens[start:end]), start=start, end=end)
        found.append(span)
    return tuple(found)


def _is_known(said: Sequence[str], names: EntityVocabulary) -> bool:
    key = name_key(" ".join(said))
    return said[-1][:1].isalnum() and said[0][:1].isalnum() and (key in names.rooms or bool(names.objs.get(key)))


def _stand_in(clause: Clause) -> Span:
    """The target of words that mark none: "one" or "it" where that is said."""
    marked = {k for span in clause.spans for k in range(span.start, span.end)}
    free = [token for k, token in enumerate(clause.tokens) if k not in marked]
    said = next((word for word in ("one", "ones", "it", "them", "there", "that") if word in free), "")
    return Span("t", (said if clause.act in ("go", "where") else "",), NOWHERE, NOWHERE)


def _places(clause: Clause) -> bool:
    """Whether the words of a drive only tell where an object is: "the one on the desk"."""
    near = [clause.tokens[max(span.start - REACH, 0) : span.start] for span in clause.spans if span.role == "r"]
    return any(span.role == "l" for span in clause.spans) or any("one" in said or "ones" in said for said in near)


def _measures(spans: Sequence[Span]) -> Iterator[Span]:
    """The spans, where "nearest" without a landmark after it is a superlative, and "the closest cup to the kettle" a
    relation."""
    for span in spans:
        after = [other for other in spans if other.start >= span.end and other.role not in ("t", "p", *ATTRIBUTES)]
        wish = MOST.get(span.words[-1], "") if span.role == "s" and after and after[0].role == "l" else ""
        if wish in ("nearest", "farthest"):
            yield span._replace(role=wish)
            continue
        alone = not any(noun.role in ("l", "m", "r") and noun.start >= span.end for noun in spans)
        yield span._replace(role="s") if span.role in ("nearest", "farthest") and alone else span


def _refused(noun: ReferringExpression, head: ReferringExpression | None) -> ReferringExpression:
    """What is turned down: an object, or what is wanted in another colour, "not the white one"."""
    colours = tuple(c for word in noun.said.split() for c in COLOURS.get(word, ()))
    wanted = replace(head, colours=colours, relations=()) if head is not None and colours else noun
    return wanted if not noun.labels else noun


def _need(clause: Clause, routes: Sequence[Span]) -> str:
    """The words of a clause; of a need without those that only give its place or the way there."""
    places = {"l", "m", "r", *RELATIONS} if clause.act == "need" else set()
    out = {k for span in clause.spans if span.role in places for k in range(span.start, span.end)}
    ends = [-1, *(k for k, token in enumerate(clause.tokens) if token in PARTS), len(clause.tokens)]
    of_routes = {k for a, b in pairwise(ends) if any(a < s.start < b for s in routes) for k in range(a + 1, b)}
    out |= of_routes if len(of_routes) < len(clause.tokens) - len(ends) + 2 else set()
    return " ".join(token for k, token in enumerate(clause.tokens) if k not in out).replace(" ' ", "'")


def _noun(span: Span, clause: Clause, names: EntityVocabulary) -> ReferringExpression:
    """A noun by its words: a room, listed labels, a stand-in such as "one", or what is not known."""
    said = " ".join(span.words).replace(" ' ", "'")
    plural = name_key(span.words[-1]) != span.words[-1] and span.words[-1].endswith("s")
    number = number_before(span, clause.tokens) if plural else 0
    base = ReferringExpression(said, plural=plural, number=number)
    if span.role == "p" or span.start == NOWHERE or (span.words[-1] in GENERIC and name_key(said) not in names.objs):
        return replace(base, generic=True, plural=span.words[-1] in PLURAL)
    owner = next((s.words for s in clause.spans if s.role == "w" and s.end <= span.start), ())
    keys = [name_key(" ".join((*owner, *span.words)))] if owner else []
    ends = 1 if "'" in span.words else len(span.words)  # "Ben's bedroom" is not just any bedroom
    keys += [name_key(" ".join(span.words[k:])) for k in range(ends)]
    whole = name_key(" ".join(span.words[:-1]))  # "the sofa side", and the door of a thing, not of a room
    if whole and (span.words[-1] == "side" or (span.words[-1] == "door" and names.objs.get(whole))):
        keys.append(whole)
    if span.role in ("r", "l", "m") or (clause.act == "far" and names.rooms.get(keys[-1])):
        rooms = next((names.rooms[key] for key in keys if key in names.rooms), None)
        if rooms is not None or span.role == "r":
            return replace(base, rooms=rooms or ())
    labels = next((names.objs[key] for key in keys if names.objs.get(key)), frozenset())
    if not labels and span.role == "t" and (key := next((key for key in keys if key in names.rooms), "")):
        return replace(base, rooms=names.rooms[key])
    if not labels and keys[-1] == "room":  # "the room with the bed"
        return replace(base, rooms=())
    usually = usual_place(keys, labels, names)
    kind = next((key for key in keys[:-1] if key in names.kinds), "")
    if kind:  # a dining table is no coffee table, but what is only called a table may be one
        labels = names.objs.get(kind) or frozenset(label for label in labels if name_key(label) == keys[-1])
    return replace(base, labels=labels, similar=names.like(kind or keys[-1]) - labels, usually=usually)


def _attach_attributes(every: Sequence[Span], spans: Sequence[Span], nouns: list[ReferringExpression]) -> None:
    """Give each attribute to the noun right after it, else to the nearest one; a room has none."""
    for span in every:
        if span.role not in ATTRIBUTES:
            continue
        able = [k for k, other in enumerate(spans) if other.role != "r" or of_room(span, k, spans)]
        after = [(spans[k].start - span.end, k) for k in able if spans[k].start >= span.end]
        before = [(span.start - spans[k].end + 1, k) for k in able if spans[k].end <= span.start]
        nearest = min((after[:1] + before[-1:]), default=None)
        if nearest is not None:
            nouns[nearest[1]] = _with(nouns[nearest[1]], span)


def _with(noun: ReferringExpression, span: Span) -> ReferringExpression:
    if span.role == "c":
        colours, also = colours_said(span.words)
        return replace(noun, colours=tuple(dict.fromkeys((*noun.colours, *colours))), also=noun.also or also)
    if span.role == "s":
        measure = _measure(span.words)
        best = any(word in MOST or word.endswith("est") for word in span.words) or measure.endswith("most")
        return replace(noun, most=measure) if best else replace(noun, size=measure)
    if span.role == "o":
        return replace(noun, order=next((ORDER[word] for word in span.words if word in ORDER), 0))
    return replace(noun, other=True) if span.role == "x" else noun


def _measure(said: Iterable[str]) -> str:
    """The superlative that words mean: "closest to me", "the tiny one", "on the left"."""
    sides = {"left": "leftmost", "right": "rightmost", "top": "highest", "upper": "highest", "bottom": "lowest"}
    return next((m for word in said if (m := MOST.get(word) or SIZES.get(word) or sides.get(word))), "")


def _attach_relations(every: Sequence[Span], spans: Sequence[Span], nouns: list[ReferringExpression]) -> None:
    """Relate landmarks and rooms to the target, or to the landmark that they tell more of; the last ones first."""
    inside = [
        k for k, (room, noun) in enumerate(pairwise(spans))
        if room.role == "r" and noun.role in ("l", "m") and room.end == noun.start
    ]  # fmt: skip
    for k in inside:  # "the kitchen table" as a landmark
        nouns[k + 1] = replace(nouns[k + 1], relations=(SpatialRelation("in", nouns[k]), *nouns[k + 1].relations))
    order = [k for k, span in enumerate(spans) if span.role in ("l", "m", "r") and k not in inside]
    target = next((k for role in ("t", "p") for k, span in enumerate(spans) if span.role == role), None)
    second = [k for k, span in enumerate(spans) if span.role == "b"]
    between: int | None = None
    for k in reversed(order):
        span = spans[k]
        kind = _kind(every, span) or ("in" if span.role == "r" else "")
        earlier = [i for i in order if i < k and spans[i].role in ("l", "m")]
        owner = earlier[-1] if span.role == "m" and earlier else target
        if kind.lstrip("!") in PLACES:
            owner = next((b for b in reversed(second) if b < k), owner)
        previous = next((i for i in reversed(order) if i < k), None)
        if kind == "" and span.role == "l" and previous is not None and _kind(every, spans[previous]) == "between":
            between = k
            continue
        unrelated = kind == "" and span.role == "l" and not (nouns[k].labels or nouns[k].rooms or nouns[k].generic)
        unknown = not (nouns[k].labels or nouns[k].rooms is not None or nouns[k].generic)
        if owner is not None and kind == "with" and unknown and nouns[k].colours:  # "the book with the white cover"
            nouns[owner] = replace(nouns[owner], colours=nouns[owner].colours or nouns[k].colours)
            continue
        if owner is None or owner == k or unrelated:  # "the nearest chair, put my bag there"
            continue
        negated = kind.startswith("!")
        kind = KINDS.get(kind.lstrip("!"), kind.lstrip("!")) or ("in" if span.role == "r" else "near")
        kind = f"not {kind}" if negated else kind
        other = nouns[between] if kind == "between" and between is not None else None
        relation = SpatialRelation(kind, nouns[k], other)
        nouns[owner] = replace(nouns[owner], relations=(relation, *nouns[owner].relations))


def _kind(every: Sequence[Span], noun: Span) -> str:
    """The relation word that stands last before a noun, with no other noun between; "" for none."""
    kind = ""
    for span in every:
        if span.start >= noun.start:
            break
        if span.role in NOUNS and span.role not in ("t", "p") and not (span.role == "r" and span.end == noun.start):
            kind = ""
        elif span.role.lstrip("!") in RELATIONS:
            kind = span.role
    return kind


def _merged(found: Sequence[ReferringExpression]) -> ReferringExpression:
    """One expression of what is said of one object in several places: "my mug … the blue one"; of two names the last
    that is known, "the desk, I mean the table"."""
    named = [k for k, noun in enumerate(found) if not noun.generic]
    known = [k for k in named if found[k].labels or found[k].rooms]
    base = (known or named or [0])[-1]
    first = found[base]
    for k, noun in enumerate(found):
        if k != base and (noun.generic or noun.labels == first.labels):
            first = replace(merged(first, noun), other=first.other or noun.other)
    return first
