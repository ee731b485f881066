"""Needs: the listed object that serves words which name none, by cards, scorer and the fitted outcome."""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from functools import cached_property, lru_cache

import numpy as np

from cartier.types import Selection, Status
from cartier.understanding.answers import one
from cartier.understanding.candidates import Candidates, Missing, Ranked
from cartier.understanding.cards import Deck, bare
from cartier.understanding.grounding import MODEL
from cartier.understanding.need_scorer import Judgement, Scorer
from cartier.understanding.outcome_classifier import OUTCOMES, Choice

Shares = tuple[tuple[str, float], ...]

FITS = " serves "  # in the reason for an object that serves a need and was not named
MOST_PROPOSED = 5  # names of cards that are proposed for a need


class Needs:
    """Judges needs over lists of names."""

    def __init__(self, deck: Deck, scorer: Scorer | None = None) -> None:
        self.deck, self._given = deck, scorer
        self._listed = lru_cache(maxsize=8)(lambda names: Candidates(self.scorer, names))

    @cached_property
    def scorer(self) -> Scorer:
        """The learned part, loaded for the first request."""
        return self._given or Scorer(self.deck)

    def serve(self, text: str, names: tuple[str, ...], without: tuple[str, ...] = ()) -> Selection:
        """The name that serves a need, or a message instead; ``without`` are names that must not serve."""
        heard, candidates = self.scorer.hear(text), self._listed(names)
        if not heard.sentences:
            return Selection("clarify", reason="nothing said tells a need", question="What do you need?", model=MODEL)
        judged = self.scorer.judge(heard, self._keys(names))
        among = set(names).difference(without)
        allowed = [r for r in candidates.ranked(judged) if r.candidate.name in among]
        if not allowed:
            return Selection("not_found", reason="nothing else is listed", model=MODEL)
        choice = Choice(allowed, candidates, judged)
        # A choice from an offer gets no further question; an object that the person refuses gives way to the next best.
        only: tuple[Status, ...] = ("found", "not_found") if without else OUTCOMES
        return self._say(choice, choice.decide(only))

    def weigh(self, text: str, names: Sequence[str]) -> Choice | None:
        """The input of the decision, for fitting it (tools/fit_decision.py); None for no words."""
        heard, candidates = self.scorer.hear(text), self._listed(tuple(names))
        judged = self.scorer.judge(heard, self._keys(tuple(names))) if heard.sentences else None
        return Choice(candidates.ranked(judged), candidates, judged) if judged and candidates.all else None

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first; none if no household object does."""
        judged = self.scorer.judge(self.scorer.hear(query), self.deck.by_key.keys())
        candidates = self._listed(tuple(card.name for card in self.deck.cards if card.at_home))
        ranked = candidates.ranked(judged)
        most = candidates.missing(judged, ranked[0].candidate)
        if most.logit > ranked[0].logit and not self.deck.cards[most.card].at_home:
            return []
        return [r.candidate.name for r in ranked[:MOST_PROPOSED] if r.logit > judged.nothing]

    def forget(self) -> None:
        """Drop what is kept about lists of names, after a change of a rule (benchmarks/ablation.py)."""
        self._listed.cache_clear()

    def _keys(self, names: tuple[str, ...]) -> Set[str]:
        """The keys of all names to listen for."""
        return self.deck.by_key.keys() | self._listed(names).keys

    def _say(self, choice: Choice, status: Status) -> Selection:
        """A decision in words."""
        best, second, missing, judged = choice.best, choice.rival, choice.missing, choice.judged
        chosen = {"found": best.candidate.name, "likely_near": choice.near}.get(status)
        reason, question = self._reason(best, judged), None
        if status == "clarify" and second is not None:
            reason = f"{reason}, but also {self._reason(second, judged)}"
            question = f"Do you mean the {bare(best.candidate.name)} or the {bare(second.candidate.name)}?"
        elif status == "likely_near" and chosen is not None:
            reason = f"{self._not_seen(missing)}, but usually kept beside the {bare(chosen)}"
        elif status == "not_found":
            reason = self._not_seen(missing) if missing.logit > judged.nothing else "nothing here serves that"
        shares = _shares(choice.ranked, judged)
        return Selection(status, chosen, reason=reason, question=question, candidates=shares, model=MODEL)

    def _not_seen(self, missing: Missing) -> str:
        if missing.called is not None and missing.called.weight > 0:
            return f"no {missing.called.mention.said} to be seen here"
        return f"what would serve ({self.deck.cards[missing.card].name}) was not seen here"

    def _reason(self, ranked: Ranked, judged: Judgement) -> str:
        if ranked.called is not None and ranked.called.weight > 0:
            said = ranked.called.mention.said
            if ranked.stands_in:
                return f"no {said} to be seen here, but this is much the same"
            return f"'{said}' was asked for by name"
        card = ranked.candidate.card
        said = judged.sentences[0] if card is None else self.scorer.why(judged, card)
        return f"{one(bare(ranked.candidate.name))}{FITS}'{shortened(said)}'"


def _shares(ranked: Sequence[Ranked], judged: Judgement) -> Shares:
    """The five best with their probabilities; the rest of the probability is with the others and with nothing."""
    logits = np.array([judged.nothing, *(r.logit for r in ranked)])
    shares = np.exp(logits - logits.max())
    shares = shares / shares.sum()
    best = zip(ranked[:MOST_PROPOSED], shares[1:], strict=False)
    return tuple((r.candidate.name, round(float(p), 3)) for r, p in best if p >= 0.0005)


def shortened(text: str) -> str:
    """The beginning of the words, on one line."""
    line = re.sub(r" (?=[,.!?;:])", "", " ".join(text.split()).replace(" ' ", "'"))
    return line if len(line) <= 60 else line[:57].rsplit(" ", 1)[0] + " …"
