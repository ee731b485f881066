"""Dialogue context: whether words reply to a question, correct the robot, or state a new need."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from cartier.labels import name_key, plain, singular, words
from cartier.understanding.cards import bare
from cartier.understanding.text import STOP

FIRST = re.compile(r"\b(first|former|1st)\b")
SECOND = re.compile(r"\b(second|latter|last|2nd)\b")
OTHER = re.compile(r"\b(other one|other|another|something else|anything else|somewhere else|different)\b")
NO = re.compile(
    r"^(no|nope|nah|wrong|not that|not this|not there|not it)\b|\b(wrong one|isn t it|not that one|not it)\b"
)
YES = frozenset(words("yes yeah yep yup sure ok okay right exactly correct that please do it fine good perfect thanks"))
EITHER = re.compile(
    r"\b(either|whichever|any of them|you choose|your choice|i do not mind|i don t mind|don t care|no matter)\b"
)
AGAIN = re.compile(
    r"^(no|nope|nah|not|but|and|or|without|wrong|i said|i meant|i mean|actually|sorry|it s|that s|too)\b"
)
NEW = 3  # content words besides the refused names that make a new need
FEW = 7  # words after an answer, up to which they may belong to it
REFUSES = re.compile(r"\b(not|without|except|anything but|don t want|instead of)\b")
NOT = re.compile(r"\b(not|no|without|except|but not|don t(?! know| mind)|never|instead of)\b")


class FollowUp(NamedTuple):
    """How to take the person's words.

    ``text`` is what to judge, ``only`` the names to choose from (none: all), ``without`` the excluded names,
    ``forbidden`` those that the robot must avoid, and ``picked`` the chosen one. Without ``outright`` nothing was asked
    for in so many words, so that what is merely named is not wanted.
    """

    text: str
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    forbidden: tuple[str, ...] = ()
    outright: bool = True
    picked: str | None = None


def understand(query: str, names: Sequence[str], dialogue: Sequence[tuple[str, str]]) -> FollowUp:
    """The words in the light of the latest turns, which are (person, robot), oldest first."""
    said = " ".join(words(plain(query)))
    if not dialogue or not said:
        return FollowUp(query)
    need, robot = dialogue[-1]
    offered = named(robot, names)
    if robot.rstrip().endswith("?"):
        return _reply(query, said, need, offered, names)
    turned_down = [n for turn in dialogue for n in named(turn[1], names)] if offered else []
    if OTHER.search(said) and len(said.split()) <= FEW:
        asked = next((named(r, names) for _, r in reversed(dialogue) if r.rstrip().endswith("?")), [])
        rest = [n for n in asked if n not in offered]
        if len(rest) == 1:
            return FollowUp(query, picked=rest[0])
        return FollowUp(_first_need(dialogue), without=tuple({*offered, *_corrected(dialogue, names)}))
    negated = _negated(said, names)
    if negated and not set(negated) & set(offered) and len(said.split()) <= 2 * FEW:
        rest = [w for w in said.split() if w not in STOP and w not in " ".join(negated).split()]
        return FollowUp(query if len(rest) >= NEW else _first_need(dialogue), without=tuple(negated))
    if NO.search(said) or AGAIN.search(said):
        tells = [w for w in said.split() if w not in STOP]
        out = tuple(dict.fromkeys([*offered, *_corrected(dialogue, names)])) if NO.search(said) else ()
        if not tells:
            return FollowUp(_first_need(dialogue), without=tuple(dict.fromkeys([*out, *turned_down])))
        if len(said.split()) <= 2 * FEW:
            return FollowUp(f"{_first_need(dialogue)}. {query}" if NOT.search(said) else query, without=out)
    return FollowUp(query)


def _reply(query: str, said: str, need: str, offered: list[str], names: Sequence[str]) -> FollowUp:
    """The reply to a question about the objects offered, in the order of the offer."""
    short = len(said.split()) <= FEW
    if offered and short:
        if EITHER.search(said):
            return FollowUp(query, picked=offered[0])
        if len(offered) == 1 and YES.issuperset(said.split()):
            return FollowUp(query, picked=offered[0])
        if FIRST.search(said) and not named(said, offered):
            return FollowUp(query, picked=offered[0])
        if SECOND.search(said) and len(offered) > 1 and not named(said, offered):
            return FollowUp(query, picked=offered[-1])
    meant = named(said, offered)
    if offered and NOT.search(said):
        rest = [n for n in offered if n not in meant]
        if meant and len(rest) == 1:
            return FollowUp(query, picked=rest[0])
        nothing_else = not [w for w in said.split() if w not in STOP]  # "neither of them", "no"
        if len(offered) == 1 and (meant or nothing_else):
            return FollowUp(query)
        if not meant and nothing_else:
            return FollowUp(need, without=tuple(offered))
    elif len(meant) == 1:
        return FollowUp(query, picked=meant[0])
    if named(said, names) or not short:
        return FollowUp(query if not offered or not short else f"{need}. {query}")
    return FollowUp(f"{need}. {query}", only=tuple(offered))


def _negated(said: str, names: Sequence[str]) -> list[str]:
    """The listed names right after a "not": "not the mug", "anything but not a knife"."""
    tails = (said[found.end() :].split() for found in REFUSES.finditer(said))
    return list(dict.fromkeys(name for tail in tails for name in named(" ".join(tail[:4]), names)))


def _first_need(dialogue: Sequence[tuple[str, str]]) -> str:
    """What the person wanted before they began to correct."""
    for need, _ in reversed(dialogue):
        said = " ".join(words(plain(need)))
        if not (NO.search(said) or (OTHER.search(said) and len(said.split()) <= FEW)) and len(said.split()) > 1:
            return need
    return dialogue[0][0]


def _corrected(dialogue: Sequence[tuple[str, str]], names: Sequence[str]) -> list[str]:
    """What the robot had offered before the corrections that lead up to now."""
    found: list[str] = []
    for need, robot in reversed(dialogue):
        found.extend(named(robot, names))
        said = " ".join(words(plain(need)))
        if not (NO.search(said) or OTHER.search(said)):
            break
    return found


def named(text: str, names: Sequence[str]) -> list[str]:
    """The listed names that occur in a text, longest first at each place, in their order."""
    said = [singular(w) for w in words(plain(text))]
    keys: dict[str, str] = {}
    for name in names:
        keys.setdefault(name_key(name), name)
        keys.setdefault(name_key(bare(name)), name)
    found, i = [], 0
    while i < len(said):
        for end in range(min(i + 5, len(said)), i, -1):
            meant = keys.get(name_key(" ".join(said[i:end])))
            if meant is not None:
                found.append(meant)
                i = end
                break
        else:
            i += 1
    return list(dict.fromkeys(found))
