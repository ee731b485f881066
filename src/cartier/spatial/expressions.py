"""What references and questions are made of: noun phrases, their relations, and what is asked of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

Kind = Literal[
    "find", "count", "exists", "where", "list", "compare", "far", "when", "colour", "size", "room", "rooms", "which",
    "sure", "stop", "come", "back", "follow", "able", "thanks", "bye",
]  # fmt: skip


@dataclass(frozen=True)
class ReferringExpression:
    """A noun phrase. ``labels`` are the listed names that it may mean, none for what is not listed; ``rooms`` the ids of rooms.

    ``generic`` is for "one", "something", "it". ``most`` is a superlative such as "biggest", ``order`` counts from 1, ``thing``
    is the id of an object that was spoken of before.
    """

    said: str
    labels: frozenset[str] = frozenset()
    rooms: tuple[int, ...] | None = None
    generic: bool = False
    definite: bool = False
    plural: bool = False
    colours: tuple[str, ...] = ()
    size: str = ""
    most: str = ""
    other: bool = False
    order: int = 0
    relations: tuple[SpatialRelation, ...] = ()
    obj: int | None = None

    @property
    def bare(self) -> bool:
        """Whether nothing but the name is said."""
        told = self.colours or self.size or self.most or self.other or self.order or self.relations
        return not told and self.obj is None


@dataclass(frozen=True)
class SpatialRelation:
    """The thing is ``kind`` (on, in, under, above, next to, near, nearest, farthest, between, left of, right of, with) the target.

    Without a target "nearest" and "farthest" are from where the robot stands.
    """

    kind: str
    target: ReferringExpression | None = None
    other: ReferringExpression | None = None


@dataclass(frozen=True)
class ParsedUtterance:
    """What is asked: to be driven there (``find``), or a question about ``head`` (and ``other``, for ``compare``).

    ``need`` are the words without what only says where. ``direct`` is said where the thing is asked for outright. ``to`` is what
    the nearer one of two is nearer to.
    """

    kind: Kind
    head: ReferringExpression | None = None
    other: ReferringExpression | None = None
    by: str = ""
    need: str = ""
    direct: bool = False
    to: ReferringExpression | None = None


@dataclass(frozen=True)
class EntityVocabulary:
    """What may be named: the listed labels that each key of a name stands for (none: known, but not listed), and rooms' ids.

    ``like`` gives the labels that a name may mean where nothing of the very name fits.
    """

    objs: Mapping[str, frozenset[str]]
    rooms: Mapping[str, tuple[int, ...]]
    like: Callable[[str], frozenset[str]] = lambda _: frozenset()


def merged(before: ReferringExpression, now: ReferringExpression) -> ReferringExpression:
    """What was asked for, with what was added to it."""
    return replace(
        before, relations=(*before.relations, *now.relations), colours=now.colours or before.colours, size=now.size or before.size,
        most=now.most or before.most, order=now.order or before.order, other=now.other,
    )  # fmt: skip
