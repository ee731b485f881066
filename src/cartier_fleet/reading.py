"""Words about an object, read once by the parser, and meant as in one home, for each vocabulary of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from cartier.errors import InputError, brief
from cartier.labels import display_name
from cartier.spatial.expressions import ReferringExpression, SpatialRelation
from cartier.types import Inventory, Room
from cartier.understanding.assembly import query as query_of
from cartier.understanding.cards import SHIPPED, Deck, read_deck
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.parser import parser
from cartier.understanding.tags import Clause
from cartier.understanding.utterance import listen
from cartier_fleet.catalog_rows import ANY_NAME

MAX_CHARS = 300


@dataclass(frozen=True)
class Vocabulary:
    """What one detector can name, what it named in its homes, and the kinds of the homes' rooms.

    Args:
        knows: The names that it can give; empty if that is unknown.
        seen: The labels and people's names in its homes.
        kinds: The kinds of rooms.
    """

    knows: tuple[str, ...]
    seen: frozenset[str]
    kinds: tuple[str, ...]

    @cached_property
    def inventory(self) -> Inventory:
        """All that may be named, with one room of each kind, whose id is its place.

        Who can name anything is looked at as who knows all household names: a dining table is no coffee table.
        """
        anything = {card.name for card in deck().cards} if ANY_NAME in self._given else set[str]()
        names = sorted({*self._given - {ANY_NAME}, *self.seen, *anything})
        none = np.zeros((1, 2), np.int32)
        return replace(Inventory.of(names), rooms=tuple(Room(k, kind, kind, none) for k, kind in enumerate(self.kinds)))

    def could_name(self, phrase: ReferringExpression) -> bool:
        """Whether the detector can give one of the names that a phrase means."""
        return not self._given.isdisjoint((ANY_NAME, *phrase.labels, *phrase.similar))

    @cached_property
    def _given(self) -> frozenset[str]:
        return frozenset(map(display_name, self.knows))


def union(vocabularies: Sequence[Vocabulary]) -> Vocabulary:
    """All that any of them can name, or named."""
    return Vocabulary(
        tuple(sorted({name for one in vocabularies for name in one.knows})),
        frozenset().union(*(one.seen for one in vocabularies)),
        vocabularies[0].kinds if vocabularies else (),
    )


def read_phrase(
    about: str, vocabularies: Sequence[Vocabulary], together: Vocabulary
) -> Mapping[Vocabulary, ReferringExpression]:
    """What words about an object mean to each vocabulary.

    Args:
        about: The words.
        vocabularies: Those of the homes.
        together: Their ``union``, for which the words are parsed once.

    Raises:
        InputError: The words name no object, or several.
    """
    asked = f"where is {about}?" if about.startswith("the ") else f"how many {about} are there?"
    clauses = parser()(listen(asked[:MAX_CHARS]).tokens, None, lexicon(deck(), together.inventory))
    if len(clauses) != 1:
        raise InputError(f"{brief(about, 80)!r} is more than one object: ask about one at a time")
    return {one: _meant(about, clauses[0], one) for one in vocabularies}


def _meant(about: str, clause: Clause, vocabulary: Vocabulary) -> ReferringExpression:
    head = query_of(clause, lexicon(deck(), vocabulary.inventory)).head
    if head is None or head.generic or head.rooms is not None or not head.said:
        raise InputError(f"{brief(about, 80)!r} names no object that I could look for")
    return head


@cache
def deck() -> Deck:
    """The cards of household objects."""
    return read_deck(SHIPPED)


def with_rooms(phrase: ReferringExpression, rooms: Mapping[int, tuple[int, ...]]) -> ReferringExpression:
    """A phrase whose rooms, places in ``Vocabulary.kinds``, are replaced by the ids of one home's rooms."""

    def moved(end: ReferringExpression | None) -> ReferringExpression | None:
        return None if end is None else with_rooms(end, rooms)

    own = None if phrase.rooms is None else tuple(number for kind in phrase.rooms for number in rooms.get(kind, ()))
    told = tuple(SpatialRelation(r.kind, moved(r.target), moved(r.other)) for r in phrase.relations)
    return replace(phrase, rooms=own, relations=told)


def rooms_of(phrase: ReferringExpression) -> set[int]:
    """The kinds of rooms, by their places, that a phrase speaks of."""
    ends = [end for relation in phrase.relations for end in (relation.target, relation.other) if end is not None]
    return set(phrase.rooms or ()).union(*map(rooms_of, ends))
