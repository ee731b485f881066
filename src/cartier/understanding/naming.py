"""Names in the words of a drive in which no noun was marked."""

from __future__ import annotations

from cartier.labels import name_key
from cartier.spatial.expressions import EntityVocabulary
from cartier.understanding.offers import NEGATIONS
from cartier.understanding.tags import NOUNS, Clause, Span
from cartier.understanding.utterance import LONGEST_NAME

NEAR = 2  # words before a name, within which a negation turns it down


def with_target(clause: Clause, names: EntityVocabulary) -> Clause:
    """A drive with the last listed name in its words as the target, where no noun was marked: "bathtub it is"."""
    if clause.act != "go" or any(span.role in NOUNS for span in clause.spans):
        return clause
    tokens, marked = clause.tokens, {k for span in clause.spans for k in range(span.start, span.end)}
    for end in range(len(tokens), 0, -1):
        for start in range(max(end - LONGEST_NAME, 0), end):
            said = tokens[start:end]
            if not (said[0][0].isalnum() and said[-1][0].isalnum()) or not marked.isdisjoint(range(start, end)):
                continue
            if names.objs.get(name_key(" ".join(said))) and NEGATIONS.isdisjoint(tokens[max(start - NEAR, 0) : start]):
                spans = sorted((*clause.spans, Span("t", said, start, end)), key=lambda span: span.start)
                return clause._replace(spans=tuple(spans))
    return clause
