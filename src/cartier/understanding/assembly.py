"""Assembly of tagged words into a typed query: which noun has which attributes, and what relates it to a landmark."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from cartier.labels import name_key
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression, SpatialRelation, merged
from cartier.understanding.reference_words import COLOURS, DEFINITE, GENERIC, MOST, ORDER, PLURAL, SIZES
from cartier.understanding.tags import ATTRIBUTES, NOUNS, RELATIONS, Clause, Span

KINDS = {"next": "next to", "left": "left of", "right": "right of", "behind": "near", "front": "near"}
"""What ``spatial.query`` calls a relation, where it has another name there."""
STAND_IN = Span("t", ("",), -1, -1)
"""The target of words that name none: "the blue, please", "what is on the table"."""


def query(clause: Clause, names: EntityVocabulary) -> ParsedUtterance:
    """The typed query of a clause: the act, the target with its attributes and relations, and what is turned down."""
    spans = [span for span in clause.spans if span.role in NOUNS]
    if clause.act != "go" and not any(span.role in ("t", "p") for span in spans):
        spans = [STAND_IN, *spans]
    nouns = [_noun(span, clause, names) for span in spans]
    _attach_attributes(clause.spans, spans, nouns)
    _attach_relations(clause.spans, spans, nouns)
    of = {role: [noun for span, noun in zip(spans, nouns, strict=True) if span.role == role] for role in NOUNS}
    targets = of["t"] or of["p"] or of["r"][:1] or of["l"][:1]
    head = _merged(targets) if targets else None
    if head is not None and head.said == "" and head.bare:
        head = None
    by = next((_measure(span.words) for span in clause.spans if span.role == "s"), "")
    need = " ".join(word for span in clause.spans if span.role == "z" for word in span.words)
    return ParsedUtterance(
        clause.act, head, of["b"][0] if of["b"] else None, by, need or " ".join(clause.tokens),  # type: ignore[arg-type]
        clause.act != "need", of["l"][0] if of["l"] else None, tuple(of["n"]),
    )  # fmt: skip


def _noun(span: Span, clause: Clause, names: EntityVocabulary) -> ReferringExpression:
    """A noun by its words: a room, listed labels, a stand-in such as "one", or what is not known."""
    said, plural = " ".join(span.words), name_key(span.words[-1]) != span.words[-1] and span.words[-1].endswith("s")
    before = clause.tokens[max(span.start - 3, 0) : span.start]
    base = ReferringExpression(said, plural=plural, definite=not DEFINITE.isdisjoint(before))
    if span.role == "p" or span is STAND_IN or (span.words[-1] in GENERIC and name_key(said) not in names.objs):
        return replace(base, generic=True, plural=span.words[-1] in PLURAL)
    owner = next((s.words for s in clause.spans if s.role == "w" and s.end <= span.start), ())
    keys = [name_key(" ".join((*owner, *span.words)))] if owner else []
    keys += [name_key(" ".join(span.words[k:])) for k in range(len(span.words))]
    if span.role in ("r", "l", "m"):
        rooms = next((names.rooms[key] for key in keys if key in names.rooms), None)
        if rooms is not None or span.role == "r":
            return replace(base, rooms=rooms or ())
    labels = next((names.objs[key] for key in keys if key in names.objs and names.objs[key]), frozenset())
    if not labels and span.role == "t" and keys[-1] in names.rooms:
        return replace(base, rooms=names.rooms[keys[-1]])
    return replace(base, labels=labels)


def _attach_attributes(every: Sequence[Span], spans: Sequence[Span], nouns: list[ReferringExpression]) -> None:
    """Give each attribute to the noun right after it, else to the nearest one."""
    for span in every:
        if span.role not in ATTRIBUTES or not spans:
            continue
        after = [(other.start - span.end, k) for k, other in enumerate(spans) if other.start >= span.end]
        before = [(span.start - other.end + 1, k) for k, other in enumerate(spans) if other.end <= span.start]
        k = min(after[:1] + before[-1:])[1]
        nouns[k] = _with(nouns[k], span)


def _with(noun: ReferringExpression, span: Span) -> ReferringExpression:
    if span.role == "c":
        colours = tuple(c for word in span.words for c in COLOURS.get(word, ()))
        return replace(noun, colours=tuple(dict.fromkeys((*noun.colours, *colours))))
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
    order = [k for k, span in enumerate(spans) if span.role in ("l", "m", "r")]
    target = next((k for role in ("t", "p") for k, span in enumerate(spans) if span.role == role), None)
    between: int | None = None
    for k in reversed(order):
        span = spans[k]
        kind = _kind(every, span)
        earlier = [i for i in order if i < k and spans[i].role in ("l", "m")]
        owner = earlier[-1] if span.role == "m" and earlier else target
        previous = next((i for i in reversed(order) if i < k), None)
        if kind == "" and span.role == "l" and previous is not None and _kind(every, spans[previous]) == "between":
            between = k
            continue
        if owner is None or owner == k:
            continue
        kind = KINDS.get(kind.lstrip("!"), kind.lstrip("!")) or ("in" if span.role == "r" else "near")
        kind = f"not {kind}" if _kind(every, span).startswith("!") else kind
        other = nouns[between] if kind == "between" and between is not None else None
        relation = SpatialRelation(kind, nouns[k], other)
        nouns[owner] = replace(nouns[owner], relations=(relation, *nouns[owner].relations))


def _kind(every: Sequence[Span], noun: Span) -> str:
    """The relation word that stands last before a noun, with no other noun between; "" for none."""
    kind = ""
    for span in every:
        if span.start >= noun.start:
            break
        if span.role in NOUNS and span.role not in ("t", "p"):
            kind = ""
        elif span.role.lstrip("!") in RELATIONS:
            kind = span.role
    return kind


def _merged(found: Sequence[ReferringExpression]) -> ReferringExpression:
    """One expression of what is said of one object in several places: "my mug … the blue one"."""
    named = [k for k, noun in enumerate(found) if not noun.generic]
    first = found[named[0] if named else 0]
    for k, noun in enumerate(found):
        if k != (named[0] if named else 0):
            first = replace(merged(first, noun), other=first.other or noun.other)
    return first
