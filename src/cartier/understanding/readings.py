"""Two readings: words whose act is unsure are asked about, and the reply picks one of the two likeliest readings."""

from __future__ import annotations

from cartier.spatial.describe import the
from cartier.spatial.expressions import Kind, ParsedUtterance
from cartier.understanding.reference_words import ORDER
from cartier.understanding.tags import Clause

LEAST_CERTAIN = 0.45  # chosen, as the next one, by what is right of the development lines (understanding_diary.md)
LEAST_WANTED = 0.35
"""The same for a request that may ask for nothing: a question helps less than the likelier drive."""
UNSURE = "I am not sure what you mean: "
DRIVES: tuple[Kind, ...] = ("go", "need")
QUESTIONS: tuple[Kind, ...] = (
    "count", "exists", "where", "list", "compare", "far", "colour", "size", "when", "which", "rooms"
)  # fmt: skip
NOTHING: tuple[Kind, ...] = ("prohibit", "remark", "other")
OUTCOMES = (DRIVES, QUESTIONS, NOTHING)
"""Acts whose answers differ for the person: a drive, words about the home, nothing. An alarm is judged elsewhere."""


def question(clause: Clause, asked: ParsedUtterance) -> str | None:
    """A question that names the two likeliest readings of a clause; None where it is sure enough what is asked for, or
    where both would come to the same: to be driven to a named thing and to be told of it serve nearly the same wish."""
    first, second = _outcome(clause.act), _outcome(clause.second[0])
    least = LEAST_WANTED if (first, second) == (DRIVES, NOTHING) else LEAST_CERTAIN
    if clause.certainty >= least or first is None or second is None or first == second:
        return None
    noun = the(" ".join(asked.head.said.split())) if asked.head is not None and asked.head.labels else ""
    if noun and NOTHING not in (first, second):
        return None
    told = {
        DRIVES: f"shall I go to {noun}"
        if noun and "go" in (clause.act, clause.second[0])
        else "shall I find what helps",
        QUESTIONS: f"do you want to know about {noun or 'the home'}",
        NOTHING: "is there nothing to do",
    }
    return f"{UNSURE}{told[first]}, or {told[second]}?"


def picked(reply: Clause, before: Clause) -> Clause | None:
    """The earlier clause in the reading that a reply picks; None if the reply asks for something else."""
    order = next((ORDER[token] for token in reply.tokens if token in ORDER), 0)
    outcomes = (_outcome(before.act), _outcome(before.second[0]))
    if order in (1, 2, -1) or reply.act in ("confirm", "deny"):
        second = order in (2, -1) or (order == 0 and reply.act == "deny")
    elif not any(span.role in ("t", "r", "l") for span in reply.spans) and _outcome(reply.act) in outcomes:
        second = _outcome(reply.act) == outcomes[1]
    else:
        return None
    return before._replace(act=before.second[0] if second else before.act, certainty=1.0)


def _outcome(act: Kind) -> tuple[Kind, ...] | None:
    return next((acts for acts in OUTCOMES if act in acts), None)
