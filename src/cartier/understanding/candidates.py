"""The listed things: each with its card, how strongly a request calls for it, and what else it calls for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartier.labels import name_key, plain, singular, words
from cartier.understanding.card_vectors import UNLIKE
from cartier.understanding.cards import bare
from cartier.understanding.entity_vocabulary import NO_ENDS
from cartier.understanding.need_scorer import Judgement, Scorer, Spoken
from cartier.understanding.text_encoder import reader


class Candidate(NamedTuple):
    """A listed name with its key, its card, and the keys of general words for it, as a floor lamp is a lamp."""

    name: str
    key: str
    card: int | None
    ends: tuple[str, ...]


class Ranked(NamedTuple):
    """A listed thing with its logit, the name by which it was called, and whether that is of something much the same."""

    candidate: Candidate
    logit: float
    called: Spoken | None
    stands_in: bool


class Missing(NamedTuple):
    """A card none of whose things is listed: its logit, and the name by which it was called."""

    card: int
    logit: float
    called: Spoken | None


class Candidates:
    """The things of one list."""

    def __init__(self, scorer: Scorer, names: Sequence[str]) -> None:
        self.scorer = scorer
        cards = {name: scorer.deck.card_of(name) for name in dict.fromkeys(names)}
        self.cards = frozenset(card for card in cards.values() if card is not None)
        own = frozenset(name_key(bare(name)) for name in cards)
        self.all = [Candidate(name, name_key(bare(name)), card, self._ends(name, own)) for name, card in cards.items()]
        self.keys = own.union(key for candidate in self.all for key in candidate.ends)
        strange = [candidate.name for candidate in self.all if candidate.card is None]
        self._vectors = dict(zip(strange, reader().vectors([bare(name) for name in strange]), strict=True))
        self._twins: dict[int, frozenset[int]] = {}

    def _ends(self, name: str, own: frozenset[str]) -> tuple[str, ...]:
        """The general words for a thing that are not the name of another listed thing."""
        parts, by_key = words(plain(bare(name))), self.scorer.deck.by_key
        ends = (name_key(" ".join(parts[i:])) for i in range(1, len(parts)))
        known = (end for end in ends if end in by_key and end not in NO_ENDS and end not in own)
        return tuple(end for end in known if by_key[end] not in self.cards)

    def near_synonyms(self, card: int) -> frozenset[int]:
        """The cards of listed things that are much the same as a card that is not listed."""
        if card not in self._twins:
            same = (other for other in self.cards if self.scorer.knowledge.near_synonyms(card, other))
            self._twins[card] = frozenset() if card in self.cards else frozenset(same)
        return self._twins[card]

    def ranked(self, judged: Judgement) -> list[Ranked]:
        """All things, the one that the request calls for most first; of equal ones that whose name was said."""
        by_card = self._by_card(judged)
        said = {singular(word) for word in judged.sentences[0].split()}
        found = [self._rank(candidate, judged, by_card) for candidate in self.all]
        return sorted(
            found, key=lambda r: (-r.logit, -len(said.intersection(map(singular, words(plain(r.candidate.name))))))
        )

    def missing(self, judged: Judgement, best: Candidate) -> Missing:
        """What is called for most by name, or else is good for something else than the best, and nothing listed is much the same."""
        by_card = {card: s for card, s in self._by_card(judged).items() if s.mention.key not in self.keys}
        logits = judged.logits.copy()
        if best.card is not None:
            logits[self.scorer.knowledge.likeness(best.card) > UNLIKE] = -np.inf
        for card, spoken in by_card.items():
            logits[card] = judged.logits[card] + spoken.weight
        logits[[*self.cards, *(card for card in by_card if self.near_synonyms(card))]] = -np.inf
        card = int(logits.argmax())
        return Missing(card, float(logits[card]), by_card.get(card))

    def _by_card(self, judged: Judgement) -> dict[int, Spoken]:
        """For each card whose name was said, the strongest."""
        found: dict[int, Spoken] = {}
        for key, spoken in judged.spoken.items():
            card = self.scorer.deck.by_key.get(key)
            if card is not None and (card not in found or spoken.weight > found[card].weight):
                found[card] = spoken
        return found

    def _rank(self, candidate: Candidate, judged: Judgement, by_card: dict[int, Spoken]) -> Ranked:
        """A thing is called by its name, the end of it, another name of its card, or the name of what is much the same."""
        called = next((judged.spoken[key] for key in (candidate.key, *candidate.ends) if key in judged.spoken), None)
        if candidate.card is None:
            logit, same = self.scorer.strange(judged, self._vectors[candidate.name]), None
        else:
            logit, called = float(judged.logits[candidate.card]), called or by_card.get(candidate.card)
            same = next(
                (spoken for card, spoken in by_card.items() if candidate.card in self.near_synonyms(card)), None
            )
        spoken = called or same
        return Ranked(
            candidate, logit + (spoken.weight if spoken else 0.0), spoken, called is None and same is not None
        )

    def kept_beside(self, card: int) -> str | None:
        """The listed thing that a card's is kept beside first of all, or what is much the same as that.

        In generated homes a thing was within a metre of it in 71 % of 379 cases, of what comes second on its card in 45 %,
        of the third in 23 %, and of any thing in 20 %.
        """
        first = self.scorer.deck.card_of(next(iter(self.scorer.deck.cards[card].beside), ""))
        same = () if first is None else (first, *self.near_synonyms(first))
        return next((candidate.name for candidate in self.all if candidate.card in same), None)
