"""Decoding of the parser's output: clauses with their spans, from the tag of each token."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.spatial.expressions import Kind
from cartier.understanding.tags import Clause, Span


def clauses(tokens: Sequence[str], tags: Sequence[str], acts: Sequence[Sequence[tuple[Kind, float]]]) -> list[Clause]:
    """The clauses between separators; ``acts`` are the likeliest acts of each with their probabilities."""
    found, spans, start, part = list[Clause](), list[Span](), 0, 0
    for span in (*spans_of(tokens, tags), None):
        if span is not None and span.role != "/":
            spans.append(span)
            continue
        end = len(tokens) if span is None else span.start
        if span is not None and not any(token[0].isalnum() for token in tokens[start:end]):
            start, part = span.end, part + 1  # two separators in a row: "; then"
            continue
        (act, certainty), *further = acts[min(part, len(acts) - 1)]
        moved = (s._replace(start=s.start - start, end=s.end - start) for s in spans)
        found.append(Clause(act, certainty, tuple(moved), tuple(tokens[start:end]), *further[:1]))
        spans, start, part = [], len(tokens) if span is None else span.end, part + 1
    return found


def spans_of(tokens: Sequence[str], tags: Sequence[str]) -> list[Span]:
    """The runs of one role; a run begins at ``B``, or where the role changes."""
    found = list[Span]()
    for k, tag in enumerate(tags):
        part, _, role = tag.partition("-")
        if not role:
            continue
        if part == "I" and found and found[-1].role == role and found[-1].end == k:
            found[-1] = found[-1]._replace(words=(*found[-1].words, tokens[k]), end=k + 1)
        else:
            found.append(Span(role, (tokens[k],), k, k + 1))
    return found
