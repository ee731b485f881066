"""Comparisons: which spans of a question are compared with each other, and what they are compared to."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from cartier.spatial.expressions import ReferringExpression, merged
from cartier.understanding.reference_words import COLOURS, GENERIC
from cartier.understanding.tags import Span

BOTH = ("t", "b")


def compared(spans: Sequence[Span]) -> tuple[Span, ...]:
    """The spans with one target ``t``; each that it is compared with is ``b``, what all are compared to ``l``."""
    spans = _coloured(spans)
    both = [span for span in spans if span.role in BOTH]
    if len(both) == 3 and both[0].role == "b":  # "farther from the bed, the desk or the sofa"
        spans = [span._replace(role="l") if span is both[0] else span for span in spans]
    spans = _to_what(spans)
    named = [span for span in spans if span.role in BOTH and span.words[-1] not in GENERIC]
    if len(named) == 1 and sum(span.role == "r" for span in spans) == 2:
        return _in_two_rooms(spans, named[0])
    targets = [span for span in spans if span.role == "t"]
    first = next((span for span in targets if span in named), targets[0] if targets else None)
    return tuple(
        span._replace(role="b") if span.role == "t" and span is not first else span
        for span in spans
        if span.role != "t" or span in named or span is first
    )


def _to_what(spans: Sequence[Span]) -> list[Span]:
    """The spans with a target, and of three objects the one that "closer to" names as what both are compared to."""
    both = [span for span in spans if span.role in BOTH]
    near = next((k for k, span in enumerate(spans) if span.role in ("nearest", "farthest")), None)
    to = next((span for span in spans[near + 1 :] if span in both), None) if near is not None else None
    if len(both) < 3 or any(span.role == "l" for span in spans):
        to = None
    left = [span for span in both if span is not to]
    said = any(span.role in ("t", "p") for span in spans if span is not to)
    head = None if said or not left else left[0]
    return [
        span._replace(role="l") if span is to else span._replace(role="t") if span is head else span for span in spans
    ]


def of_kind(noun: ReferringExpression, head: ReferringExpression | None) -> ReferringExpression:
    """A second object that is not named is of the first one's kind: "than the one in the hall"."""
    if head is None or not noun.generic or noun.obj is not None:
        return noun
    return merged(ReferringExpression(head.said, head.labels, similar=head.similar), noun)


def _coloured(spans: Sequence[Span]) -> list[Span]:
    """The spans, where the colour of a second object is no object: "the white lamp"."""
    found = list(spans)
    for k, (one, after) in enumerate(pairwise(spans)):
        if one.role == after.role == "b" and one.end == after.start and one.words[-1] in COLOURS:
            found[k] = one._replace(role="c")
    return found


def _in_two_rooms(spans: Sequence[Span], named: Span) -> tuple[Span, ...]:
    """The spans with the object named twice: "which box is bigger, the one in the bedroom or the one in the study"."""
    room = [span for span in spans if span.role == "r"][1]
    where = next((s for s in reversed(spans) if s.role == "in" and s.start < room.start), room).start
    kept = [span for span in spans if span.role not in BOTH or span is named]
    at = next(k for k, span in enumerate(kept) if span.start >= where)
    return (*kept[:at], named._replace(role="b", start=where, end=where), *kept[at:])
