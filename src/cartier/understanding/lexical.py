"""Lexical matching: for each card, the best-matched phrase, with each word weighed by how few cards contain it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

from cartier.understanding.cards import Deck
from cartier.understanding.text import STOP, stem
from cartier.understanding.utterance import Mention, Sentence

RAREST = 5.0  # idf of a word on one card only, whatever the number of cards
UNSAID, VAGUE = 0.5, 1.6  # cost of a phrase's unsaid words, and of every phrase; in units of idf
UNHEARD = 0.12  # cost per idf of a sentence's words that are not on the card
ENOUGH = 12.0  # most idf of such words that counts, so that a long story is no disadvantage
BEFORE = 0.75  # weight of the words of the sentence before, and again for the one before that
FAINT = 0.3  # least weight of words of earlier sentences
NEGATED = 0.3  # weight of negated words
ALSO = 0.4  # weight of further words of the sentence that are in other phrases of the card


class Phrase(NamedTuple):
    """A phrase and its telling stems; ``card`` is an index into the deck."""

    card: int
    text: str
    stems: tuple[str, ...]


class Fit(NamedTuple):
    """How well a card's best phrase was met (0 to 1), the words that met it, and the phrase."""

    score: float
    met: str
    phrase: str


class Lexicon:
    """An inverted index over the stems of the cards' uses."""

    def __init__(self, deck: Deck) -> None:
        self.phrases = [
            Phrase(i, text, stems)
            for i, card in enumerate(deck.cards)
            for text, stems in zip(card.uses, deck.telling[i], strict=True)
        ]
        knowing: defaultdict[str, set[int]] = defaultdict(set)
        self.postings: defaultdict[str, list[int]] = defaultdict(list)
        for p, phrase in enumerate(self.phrases):
            for s in phrase.stems:
                knowing[s].add(phrase.card)
                self.postings[s].append(p)
        self._by_card: defaultdict[int, list[int]] = defaultdict(list)
        for p, phrase in enumerate(self.phrases):
            self._by_card[phrase.card].append(p)
        self.stems = [frozenset(s for stems in uses for s in stems) for uses in deck.telling]
        scale = RAREST / math.log((len(deck.cards) + 1) / 1.5)
        self.idf = {s: scale * math.log((len(deck.cards) + 1) / (len(known) + 0.5)) for s, known in knowing.items()}
        self._mass = [sum(self.idf[s] for s in phrase.stems) for phrase in self.phrases]

    def fits(self, said: list[Sentence], turned_down: frozenset[str]) -> dict[int, Fit]:
        """For each card that any word speaks for, the best fit in any sentence."""
        best: dict[int, Fit] = {}
        before: dict[str, float] = {}
        for sentence in said:
            here, spelt = _weights(sentence, turned_down)
            near = {s: BEFORE * w for s, w in before.items() if w > FAINT} | here
            met = {p: sum(self.idf[s] * near.get(s, 0.0) for s in self.phrases[p].stems) for p in self._of(here)}
            for card in dict.fromkeys(self.phrases[p].card for p in met):
                known = self.stems[card]
                shared = {s: self.idf[s] * w for s, w in here.items() if s in known}
                unheard = UNHEARD * min(sum(self.idf.get(s, RAREST) for s in here if s not in known), ENOUGH)
                for p in (p for p in self._by_card[card] if p in met):
                    phrase = self.phrases[p]
                    also = ALSO * sum(w for s, w in shared.items() if s not in phrase.stems)
                    cost = UNSAID * (self._mass[p] - met[p]) + VAGUE + unheard
                    score = sentence.weight * (met[p] + also) / (met[p] + also + cost)
                    if card not in best or score > best[card].score:
                        words = " … ".join(word for s, word in spelt.items() if s in phrase.stems)
                        best[card] = Fit(score, words, phrase.text)
            before = near
        return best

    def _of(self, here: Iterable[str]) -> list[int]:
        """The phrases that have any of some stems."""
        return sorted({p for s in here for p in self.postings.get(s, ())})


def turned_down(said: Iterable[Mention]) -> frozenset[str]:
    """The words of the names that the person does not want."""
    return frozenset(w for m in said if m.unwanted for w in m.said.split())


def _weights(sentence: Sentence, unwanted: frozenset[str]) -> tuple[dict[str, float], dict[str, str]]:
    """The telling stems of a sentence with their weights, and as they were spelt."""
    weights: dict[str, float] = {}
    spelt: dict[str, str] = {}
    for word, negated in zip(sentence.words, sentence.negated, strict=True):
        if word not in STOP and word not in unwanted:
            weights[stem(word)] = max(weights.get(stem(word), 0.0), NEGATED if negated else 1.0)
            spelt.setdefault(stem(word), word)
    return weights, spelt
