"""Choices: which object a reply means of those that the robot asked about, "Which lamp: the one … or the one …?"."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cartier.understanding.offers import EITHER, NEGATED, NEGATIONS
from cartier.understanding.reference_words import ORDER
from cartier.understanding.tags import Clause

ASKED = re.compile(r"Which [^:?]+: (?P<options>[^?]+)\?$")
SEPARATOR = re.compile(r",? or |, ")
WORD = re.compile(r"\w+")
REPLIES = ("choose", "confirm", "correct", "another", "go")
MOST_OPTIONS = 6


def options(robot: str) -> list[str]:
    """The words by which a question of the robot tells its objects apart, in their order."""
    asked = ASKED.match(robot.strip())
    return SEPARATOR.split(asked["options"])[:MOST_OPTIONS] if asked is not None else []


def chosen(reply: Clause, choices: Sequence[tuple[str, int]]) -> int | None:
    """The id that a reply means: by the words of one option alone, by its place in the question, or either."""
    if reply.act not in REPLIES or not choices:
        return None
    said = [set(WORD.findall(words.lower())) for words, _ in choices]
    own = [words.difference(*said[:k], *said[k + 1 :]) for k, words in enumerate(said)]
    kept = list(range(len(choices)))
    for k, words in enumerate(own):
        at = next((i for i, token in enumerate(reply.tokens) if token in words), None)
        if at is not None and not NEGATIONS.isdisjoint(reply.tokens[max(0, at - NEGATED) : at]):
            kept.remove(k)  # "not the one in the kitchen"
    meant = [k for k in kept if not own[k].isdisjoint(reply.tokens)]
    if len(meant) == 1:
        return choices[meant[0]][1]
    order = next((ORDER[token] for token in reply.tokens if token in ORDER), 0)
    if order and not meant and abs(order) <= len(choices):
        return choices[order - 1 if order > 0 else order][1]
    if len(kept) == 1 or not EITHER.isdisjoint(reply.tokens):
        return choices[kept[0]][1]
    return None
