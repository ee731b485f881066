"""Knowledge cards and word matching: no key, no network, no model.

A card (``cards.toml``) says what a household thing is called and which needs it serves. A request is scored two ways: by
the share of a card's phrase that was said (each word weighed by how few cards know it), and by the names that were said.
Both are judged sentence by sentence, so that a long story adds nothing up; the last sentence, the request, counts most.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cartier.reasoners._cards import RAREST, SHIPPED, Deck, bare, read_deck
from cartier.reasoners._listening import MENTIONED, Mention, Sentence, listen, mentions
from cartier.reasoners._words import STOP, name_key, stem
from cartier.text import display_name
from cartier.types import Selection

NAME = "embedded (knowledge cards, lexical)"

FLOOR = 0.46  # nothing that scores below this is chosen
RIVAL = 0.6  # nor what scores below this share of the best card, when no thing of that card's kind is listed
TIE = 0.01  # two kinds of thing closer than this are asked about
UNSAID, VAGUE = 0.5, 1.6  # what a phrase's unsaid words, and every phrase, cost; in units of idf
UNHEARD = 0.12  # what a sentence's words cost that the card does not know, per idf
ENOUGH = 12.0  # how much idf of them is held against it, so that a long story is no fault
BEFORE = 0.75  # weight of the words of the sentence before, and again for the one before that
FAINT = 0.3  # weight at which words of earlier sentences are forgotten
NEGATED = 0.3  # weight of negated words
ALSO = 0.4  # weight of further words of the sentence that other phrases of the card hold
MATE = 0.97  # for a thing that was called by another name of its card
UNWANTED = 0.2  # for what was turned down, or called useless
EARLIER = 0.85  # importance of earlier turns of the dialogue


def make(cards: str | Path = SHIPPED) -> Embedded:
    """The reasoner over a card file: the one shipped, or your own in the same form."""
    return Embedded(read_deck(Path(cards)))


class Evidence(NamedTuple):
    """What speaks for a card or a listed thing: a score in [0, 1] and why."""

    score: float
    reason: str


NOTHING = Evidence(0.0, "")


class Embedded:
    """Scores every card, then the listed things by their cards and their own names."""

    def __init__(self, deck: Deck) -> None:
        self.name = NAME
        self.deck = deck

    def select(self, query: str, objects: Sequence[str], dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The listed thing that serves the words; what the person said before counts as context."""
        said = [s for turn, _ in dialogue for s in listen(turn, EARLIER)] + listen(query)
        if not said:
            return Selection("clarify", reason="nothing said tells a need", question="What do you need?", model=NAME)
        own = {name: name_key(bare(name)) for name in objects}
        spoken = self._spoken(said, frozenset(own.values()))
        needs = self._needs(said, _turned_down(spoken))
        cards = self._cards(needs, spoken)
        listed = {name: self.deck.card_of(name) for name in own}
        scored = [(name, self._thing(own[name], card, cards, spoken)) for name, card in listed.items()]
        scored.sort(key=lambda pair: -pair[1].score)
        kinds = {self._kind(card) for card in listed.values()}
        asked = self._cards(needs, {key: m for key, m in spoken.items() if m.score > MENTIONED})
        rivals = {c: e.score for c, e in asked.items() if self._kind(c) not in kinds}
        rival = max(rivals, key=rivals.__getitem__, default=None)
        return self._decide(scored, listed, None if rival is None else (self.deck.cards[rival].name, rivals[rival]))

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first."""
        said = listen(query)
        spoken = self._spoken(said, frozenset())
        cards = self._cards(self._needs(said, _turned_down(spoken)), spoken)
        enough = max([FLOOR, *(RIVAL * e.score for e in cards.values())])
        good = [i for i, e in cards.items() if e.score >= enough and self.deck.cards[i].at_home]
        return [self.deck.cards[i].name for i in sorted(good, key=lambda i: -cards[i].score)[:5]]

    def _kind(self, card: int | None) -> str | None:
        return None if card is None else self.deck.cards[card].kind

    def _spoken(self, said: list[Sentence], own: frozenset[str]) -> dict[str, Mention]:
        """The strongest mention of each name; one that turns a thing down stands, whatever else was said."""
        known = own | self.deck.by_key.keys()
        best: dict[str, Mention] = {}
        for sentence in said:
            for m in mentions(sentence, known):
                old = best.get(m.key, m)
                strongest = max(old, m, key=lambda x: x.score)
                best[m.key] = strongest._replace(unwanted=old.unwanted or m.unwanted)
        return best

    def _cards(self, needs: dict[int, Evidence], spoken: dict[str, Mention]) -> dict[int, Evidence]:
        """Evidence for every card that anything speaks for, from its phrases and its names."""
        named: dict[int, Mention] = {}
        for key, mention in spoken.items():
            card = self.deck.by_key.get(key)
            if card is not None and (card not in named or mention.score > named[card].score):
                named[card] = mention
        return {c: _joined(named.get(c), needs.get(c, NOTHING)) for c in sorted(named.keys() | needs.keys())}

    def _thing(self, key: str, card: int | None, cards: dict[int, Evidence], spoken: dict[str, Mention]) -> Evidence:
        """Evidence for a listed thing: its card's, or its own name's where that is stronger."""
        mention = spoken.get(key)
        of_card = NOTHING if card is None else cards.get(card, NOTHING)
        if mention is None:
            return Evidence(of_card.score * MATE, of_card.reason) if card is not None else NOTHING
        own = _joined(mention, NOTHING)
        return own if mention.unwanted or own.score > of_card.score else of_card

    def _needs(self, said: list[Sentence], turned_down: frozenset[str]) -> dict[int, Evidence]:
        """For each card the phrase that the words meet best: its share that was said, against what was left unsaid."""
        best: dict[int, Evidence] = {}
        before: dict[str, float] = {}
        for sentence in said:
            here, spelt = _weights(sentence, turned_down)
            near = {s: BEFORE * w for s, w in before.items() if w > FAINT} | here
            for p in sorted({p for s in here for p in self.deck.postings.get(s, ())}):
                phrase = self.deck.phrases[p]
                met = sum(self.deck.idf[s] * near.get(s, 0.0) for s in phrase.stems)
                fits = self.deck.stems[phrase.card]
                also = sum(self.deck.idf[s] * w for s, w in here.items() if s in fits and s not in phrase.stems)
                unheard = sum(self.deck.idf.get(s, RAREST) for s in here if s not in fits)
                cost = UNSAID * (phrase.mass - met) + VAGUE + UNHEARD * min(unheard, ENOUGH)
                met += ALSO * also
                score = sentence.weight * met / (met + cost)
                if score > best.get(phrase.card, NOTHING).score:
                    words_met = " … ".join(word for s, word in spelt.items() if s in phrase.stems)
                    best[phrase.card] = Evidence(score, f"'{words_met}' fits: {phrase.text}")
            before = near
        return best

    def _decide(
        self, scored: list[tuple[str, Evidence]], listed: dict[str, int | None], rival: tuple[str, float] | None
    ) -> Selection:
        candidates = tuple((name, round(e.score, 3)) for name, e in scored if e.score > 0)[:5]
        name, best = scored[0] if scored else ("", NOTHING)
        if best.score < FLOOR or (rival and best.score < RIVAL * rival[1]):
            would = f"; that sounds like: {rival[0]}" if rival and rival[1] >= FLOOR else ""
            return Selection("absent", reason=f"nothing listed serves it{would}", candidates=candidates, model=NAME)
        for other, evidence in scored[1:]:
            alike = listed[other] is not None and self._kind(listed[other]) == self._kind(listed[name])
            if not alike and best.score - evidence.score < TIE:
                question = f"Do you mean the {display_name(bare(name))} or the {display_name(bare(other))}?"
                reason = f"{best.reason}, but also {evidence.reason}"
                return Selection("clarify", reason=reason, question=question, candidates=candidates, model=NAME)
        return Selection("found", name, reason=best.reason, candidates=candidates, model=NAME)


def _joined(mention: Mention | None, need: Evidence) -> Evidence:
    """A name and a need that point to the same thing strengthen each other."""
    if mention is None:
        return need
    score = 1 - (1 - max(mention.score, need.score)) * (1 - 0.5 * min(mention.score, need.score))
    how = "asked for" if mention.score > MENTIONED else "mentioned"
    reason = need.reason if need.score > mention.score else f"'{mention.said}' was {how} by name"
    return Evidence(score * (UNWANTED if mention.unwanted else 1.0), reason)


def _turned_down(spoken: dict[str, Mention]) -> frozenset[str]:
    return frozenset(w for m in spoken.values() if m.unwanted for w in m.said.split())


def _weights(sentence: Sentence, turned_down: frozenset[str]) -> tuple[dict[str, float], dict[str, str]]:
    """The telling stems of a sentence with their weights, and as they were spelt."""
    weights: dict[str, float] = {}
    spelt: dict[str, str] = {}
    for word, negated in zip(sentence.words, sentence.negated, strict=True):
        if word not in STOP and word not in turned_down:
            weights[stem(word)] = max(weights.get(stem(word), 0.0), NEGATED if negated else 1.0)
            spelt.setdefault(stem(word), word)
    return weights, spelt
