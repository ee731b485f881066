"""The listed things: each with its card, how strongly a request calls for it, and what else it calls for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartier.reasoners._cards import bare
from cartier.reasoners._reading import reader
from cartier.reasoners._scorer import Judgement, Scorer, Spoken
from cartier.reasoners._words import name_key, words
from cartier.types import Array

MATE = 0.5  # logits that it costs a thing to be called by another name of its card
DETAIL = 1.0  # logits for a word that tells a thing from others of its card
KIN = 0.55  # cosine of a name without a card to one with, from which it is taken to be good for the same
LEAST = -4.0  # how far behind a thing that is not listed counts
MOST = 6.0  # how far ahead of the second the best counts


class Thing(NamedTuple):
    """A listed name: its key, its card, and for a name without one the cards like it with their cosines.

    ``details`` are the words that tell it from other things of its card: ``blue`` of a ``blue armchair``.
    """

    name: str
    key: str
    card: int | None
    kin: tuple[tuple[int, float], ...]
    details: frozenset[str]

    @property
    def cards(self) -> tuple[int, ...]:
        """Its card, or those like it."""
        return tuple(card for card, _ in self.kin) if self.card is None else (self.card,)


class Ranked(NamedTuple):
    """A listed thing with its logit and the name by which it was called."""

    thing: Thing
    logit: float
    called: Spoken | None


class Missing(NamedTuple):
    """A card none of whose things is listed: its logit, and the name by which it was called."""

    card: int
    logit: float
    called: Spoken | None


class Things:
    """The things of one list."""

    def __init__(self, scorer: Scorer, names: Sequence[str]) -> None:
        self.scorer = scorer
        deck = scorer.deck
        listed = list(dict.fromkeys(names))
        cards = {name: deck.card_of(name) for name in listed}
        strange = [name for name in listed if cards[name] is None]
        vectors = reader().vectors([bare(name) for name in strange])
        self._vectors: dict[str, Array] = dict(zip(strange, vectors, strict=True))
        kin = {name: self._kin(vector) for name, vector in self._vectors.items()}
        self.all = [Thing(n, name_key(bare(n)), cards[n], kin.get(n, ()), self._details(n, cards[n])) for n in listed]
        self.keys = frozenset(thing.key for thing in self.all)
        self.cards = frozenset(thing.card for thing in self.all if thing.card is not None)

    def _details(self, name: str, card: int | None) -> frozenset[str]:
        """The words of a name before the one that its card has."""
        parts = words(bare(name))
        first = next((i for i in range(len(parts)) if name_key(" ".join(parts[i:])) in self.scorer.deck.by_key), 0)
        return frozenset(parts[:first]) if card is not None else frozenset()

    def _kin(self, vector: Array) -> tuple[tuple[int, float], ...]:
        knowledge = self.scorer.knowledge
        cosines = np.maximum.reduceat(knowledge.names @ vector, knowledge.name_starts)
        return tuple((int(c), float(cosines[c])) for c in np.argsort(-cosines)[:3] if cosines[c] >= KIN)

    def ranked(self, judged: Judgement) -> list[Ranked]:
        """All things, the one that the request calls for most first."""
        by_card = self._by_card(judged)
        said = frozenset(judged.sentences[0].split())
        return sorted((self._rank(thing, judged, by_card, said) for thing in self.all), key=lambda r: -r.logit)

    def missing(self, judged: Judgement) -> tuple[Missing, Missing | None]:
        """What the request calls for most that is not listed, and what it calls for most by name."""
        by_card = {card: s for card, s in self._by_card(judged).items() if s.mention.key not in self.keys}
        logits = judged.logits.copy()
        for card, spoken in by_card.items():
            logits[card] += spoken.weight
        logits[list(self.cards)] = -np.inf
        card = int(logits.argmax())
        named = max((c for c in by_card if c not in self.cards), key=lambda c: float(logits[c]), default=None)
        most = Missing(card, float(logits[card]), by_card.get(card))
        return most, None if named is None else Missing(named, float(logits[named]), by_card[named])

    def _by_card(self, judged: Judgement) -> dict[int, Spoken]:
        """For each card whose name was said, the strongest."""
        found: dict[int, Spoken] = {}
        for key, spoken in judged.spoken.items():
            card = self.scorer.deck.by_key.get(key)
            if card is not None and (card not in found or spoken.weight > found[card].weight):
                found[card] = spoken
        return found

    def _rank(self, thing: Thing, judged: Judgement, by_card: dict[int, Spoken], said: frozenset[str]) -> Ranked:
        called = judged.spoken.get(thing.key)
        mate = None if thing.card is None else by_card.get(thing.card)
        if called is None and mate is not None:
            called = mate._replace(weight=mate.weight - MATE) if mate.mention.key in self.keys else mate
        if thing.card is not None:
            logit = float(judged.logits[thing.card]) + DETAIL * len(thing.details & said)
        else:
            logit = self.scorer.strange(judged, self._vectors[thing.name], thing.kin)
        return Ranked(thing, logit + (called.weight if called else 0.0), called)


def evidence(ranked: Sequence[Ranked], missing: tuple[Missing, Missing | None], nothing: float, home: bool) -> Array:
    """What tells whether the best of a list serves (7,), for the learned judgement in ``Scorer.sure``.

    ``home`` is whether what is most missing is a thing that homes have.
    """
    best, most, named = ranked[0], *missing
    second = ranked[1].logit if len(ranked) > 1 else best.logit - MOST
    return np.array(
        [
            best.logit,
            best.logit - nothing,
            min(best.logit - second, MOST),
            max(most.logit - best.logit, LEAST),
            max(named.logit - best.logit, LEAST) if named else LEAST,
            best.called.weight if best.called else 0.0,
            float(not home),
        ]
    )
