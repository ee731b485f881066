"""Replies to what the robot asked or offered: a yes, a no, or a choice among the names that it offered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from cartier.spatial.expressions import ParsedUtterance
from cartier.understanding.reference_words import ORDER
from cartier.understanding.tags import Clause

REPLIES = ("choose", "confirm", "deny", "correct", "another", "go", "need")
"""Acts that may reply to an offer."""
MOST_WORDS = 7  # of a reply that tells more of what was offered
NEGATIONS = frozenset({"not", "no", "never", "without", "t", "dont"})  # "t": the end of "don't" among the tokens
NEGATED = 4  # most words from a negation to the name that it turns down
EITHER = frozenset({"either", "any", "whichever", "matter", "mind", "care", "both"})


class Reply(NamedTuple):
    """What a reply leaves of an offer: all turned down, one name picked, or several names that are still meant."""

    denied: bool = False
    picked: str = ""
    rest: tuple[str, ...] = ()


def reply(clause: Clause, said: ParsedUtterance, offered: Sequence[str]) -> Reply | None:
    """The reply that a clause is to the offered names; None if it asks for something else.

    ``said`` is the clause's own query, before anything of the turns before is put in.
    """
    head = said.head
    refused = {name for noun in said.rejected for name in noun.labels}.union(_negated(clause.tokens, offered))
    named = [name for name in offered if head is not None and name in head.labels and name not in refused]
    rest = [name for name in offered if name not in refused]
    if not named and not refused:
        if clause.act == "deny":
            return Reply(denied=True)
        if head is not None and head.labels:
            return None
    order = next((ORDER[token] for token in clause.tokens if token in ORDER), 0)
    of_order = rest[order - 1 :][:1] if order > 0 else rest[order:][:1]
    picked = named if len(named) == 1 else of_order if order else rest if len(rest) == 1 else []
    if not picked and (clause.act == "confirm" or not EITHER.isdisjoint(clause.tokens)):
        picked = rest
    if picked:
        return Reply(picked=picked[0])
    return Reply(rest=tuple(rest)) if len(clause.tokens) <= MOST_WORDS else None


def _negated(tokens: Sequence[str], offered: Sequence[str]) -> set[str]:
    """The offered names that stand shortly after a negation: "not the knife, it's dirty"."""
    found = set()
    for name in offered:
        words = name.split()
        at = next((k for k in range(len(tokens)) if list(tokens[k : k + len(words)]) == words), 0)
        if not NEGATIONS.isdisjoint(tokens[max(0, at - NEGATED) : at]):
            found.add(name)
    return found
