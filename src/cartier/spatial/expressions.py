"""Referring expressions: noun phrases with attributes and spatial relations, and the questions built on them."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace
from typing import Literal

Kind = Literal[
    "go", "need", "count", "exists", "where", "list", "compare", "far", "when", "colour", "size", "rooms", "which",
    "sure", "correct", "another", "choose", "confirm", "deny", "stop", "come", "back", "follow", "able", "thanks",
    "bye", "prohibit", "remark", "other", "rule", "lift",
]  # fmt: skip


@dataclass(frozen=True)
class ReferringExpression:
    """A noun phrase. ``labels`` are the listed names that it may mean (none: not listed), ``similar`` those
    that it may mean where no object of these labels fits ("the cup by the sink": a mug), ``rooms`` the ids of rooms.

    ``generic`` is for "one", "something", "it". ``most`` is a superlative such as "biggest", ``order`` counts from 1,
    or from -1, the last. ``obj`` is the id of an object mentioned before. ``recalled``: what is said of it was said in
    an earlier turn. ``number`` is how many are meant ("the two pillows"; 0: not said), ``among`` the ids of what the
    robot listed, in the order of its words, ``also`` a second colour ("green and white"), and ``usually`` a relation
    that counts where some object has it ("bedside table").
    """

    said: str
    labels: frozenset[str] = frozenset()
    similar: frozenset[str] = frozenset()
    rooms: tuple[int, ...] | None = None
    generic: bool = False
    plural: bool = False
    colours: tuple[str, ...] = ()
    size: str = ""
    most: str = ""
    other: bool = False
    order: int = 0
    relations: tuple[SpatialRelation, ...] = ()
    obj: int | None = None
    recalled: bool = False
    number: int = 0
    among: tuple[int, ...] = ()
    also: tuple[str, ...] = ()
    usually: SpatialRelation | None = None

    @property
    def bare(self) -> bool:
        """Whether nothing but the name is said."""
        told = self.colours or self.size or self.most or self.other or self.order or self.relations
        return not told and self.obj is None


@dataclass(frozen=True)
class SpatialRelation:
    """The relation of an object to the target.

    ``kind`` is on, in, under, above, next to, near, nearest, farthest, between, left of, right of or with, perhaps
    after "not ". Without a target, "nearest" and "farthest" are relative to the robot's position.
    """

    kind: str
    target: ReferringExpression | None = None
    other: ReferringExpression | None = None


@dataclass(frozen=True)
class ParsedUtterance:
    """A request to drive to ``head`` (``go``), or a question about it (``compare`` and ``far``: and ``others``).

    ``need`` are the words without those that only give the place. ``to`` is the reference point of "nearer to",
    ``rejected`` what is turned down, ``instead_of`` the id of the object that a correction turns down where others fit.
    """

    kind: Kind
    head: ReferringExpression | None = None
    others: tuple[ReferringExpression, ...] = ()
    by: str = ""
    need: str = ""
    to: ReferringExpression | None = None
    rejected: tuple[ReferringExpression, ...] = ()
    instead_of: int | None = None


@dataclass(frozen=True, eq=False)  # compared by identity: an entry of a cache
class EntityVocabulary:
    """The names that may be used: the listed labels for each key of a name (none: not listed), and rooms' ids.

    ``like`` gives the labels that a name may mean where no object has the very name. ``kinds`` are the keys of the
    names of kinds of objects: a dining table is no coffee table.
    """

    objs: Mapping[str, frozenset[str]]
    rooms: Mapping[str, tuple[int, ...]]
    like: Callable[[str], frozenset[str]] = lambda _: frozenset()
    kinds: Container[str] = ()


def rephrased(asked: ParsedUtterance, change: Callable[[ReferringExpression], ReferringExpression]) -> ParsedUtterance:
    """The query with each of its noun phrases changed, those of relations first."""

    def put(phrase: ReferringExpression) -> ReferringExpression:
        told = tuple(replace(r, target=ends(r.target), other=ends(r.other)) for r in phrase.relations)
        return change(replace(phrase, relations=told))

    def ends(phrase: ReferringExpression | None) -> ReferringExpression | None:
        return None if phrase is None else put(phrase)

    others, rejected = (tuple(put(phrase) for phrase in each) for each in (asked.others, asked.rejected))
    return replace(asked, head=ends(asked.head), to=ends(asked.to), others=others, rejected=rejected)


def merged(before: ReferringExpression, now: ReferringExpression) -> ReferringExpression:
    """The earlier phrase with the constraints that the new one adds."""
    return replace(
        before, relations=(*before.relations, *now.relations), colours=now.colours or before.colours,
        size=now.size or before.size, most=now.most or before.most, order=now.order or before.order, other=now.other,
        also=now.also if now.colours else before.also, number=now.number or before.number,
    )  # fmt: skip
