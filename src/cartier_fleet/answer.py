"""The answer to a question over many homes, and why nobody can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

UNNAMED = "its detector does not know the name"
UNKNOWN_NAMES = "it is not known what its detector can name"
UNSEEN = "too little of its floor was seen"
NO_FLOOR = "it was mapped without depth"
TENTATIVE = "one may be there, hardly seen"
NO_ROOM = "no such room is known in it"


@dataclass(frozen=True)
class FleetAnswer:
    """The answer to a question over all homes.

    Args:
        query: The words.
        text: The answer in words.
        value: The same for programs: names of homes, a number, numbers by home, or (home, object id).
        has: The homes that have what was asked for.
        has_none: The homes that have it not, though it was looked for.
        cannot_tell: Why nobody can tell, by home.
        objects: The ids of the objects that were meant, by home.
    """

    query: str
    text: str
    value: Any
    has: tuple[str, ...] = ()
    has_none: tuple[str, ...] = ()
    cannot_tell: Mapping[str, str] = field(default_factory=dict)
    objects: Mapping[str, Sequence[int]] = field(default_factory=dict)


def counted(reasons: Mapping[str, str]) -> str:
    """Reasons with how often each holds: "131: the detector does not know the name; 17: …"."""
    return "; ".join(f"{count}: {why}" for why, count in Counter(reasons.values()).most_common())
