"""Outcome of a need: one softmax over found, near, absent and clarify, fitted by tools/fit_decision.py.

Words that ask for nothing have acts of their own (``tags.py``): a fitted fifth class lost one need in 25 to it.
"""

from __future__ import annotations

import json
from collections.abc import Container, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from cartier.types import Array, Status
from cartier.understanding.candidates import Candidates, Missing, Ranked
from cartier.understanding.card_vectors import ALIKE
from cartier.understanding.need_scorer import Judgement

FITTED = Path(__file__).with_name("decision.json")
OUTCOMES: tuple[Status, ...] = ("found", "likely_near", "not_found", "clarify")
LEAST, MOST = -4.0, 3.0  # bounds of the logit differences to the missing and to the second candidate


class Choice:
    """The input of the decision: listed candidates, the best first, the best unlike it, and what is missing."""

    def __init__(self, ranked: Sequence[Ranked], candidates: Candidates, judged: Judgement) -> None:
        self.ranked, self.best, self.judged = ranked, ranked[0], judged
        self._knowledge = candidates.scorer.knowledge
        self.rival = next((r for r in ranked[1:] if not self._alike(r)), None)
        self.missing = candidates.missing(judged, self.best.candidate)
        self.at_home = candidates.scorer.deck.cards[self.missing.card].at_home
        kept = candidates.kept_beside(self.missing.card)
        self.near = kept if any(r.candidate.name == kept for r in ranked) else None

    def _alike(self, other: Ranked) -> bool:
        one, two = self.best.candidate, other.candidate
        if one.card is None or two.card is None:
            return one.key == two.key
        return one.card == two.card or bool(self._knowledge.likeness(one.card)[two.card] > ALIKE)

    def features(self) -> Array:
        """(9,) what the decision is made from."""
        card, logit, nothing = self.best.candidate.card, self.best.logit, self.judged.nothing
        better = max(self.missing.logit - logit, LEAST)
        fit = self.judged.fits.get(-1 if card is None else card)
        ahead = MOST if self.rival is None else min(logit - self.rival.logit, MOST)
        called, elsewhere = (_called(r) for r in (self.best, self.missing))
        also = _called(self.rival) if self.rival else 0.0
        return np.array([
            logit, logit - nothing, ahead, better, called, elsewhere, also,
            float(not self.at_home), fit.score if fit else 0.0,
        ])  # fmt: skip

    @property
    def possible(self) -> tuple[Status, ...]:
        """Near needs the usual place of a missing object; clarify needs two candidates."""
        never = {"likely_near": self.near is None, "clarify": self.rival is None}
        return tuple(status for status in OUTCOMES if not never.get(status))

    def decide(self, among: Container[Status] = OUTCOMES) -> Status:
        """The most probable of the statuses that are possible."""
        mean, spread, weights, bias = _fitted()
        logits = dict(zip(OUTCOMES, (self.features() - mean) / spread @ weights + bias, strict=True))
        return max((s for s in self.possible if s in among), key=lambda s: float(logits[s]))


def _called(one: Ranked | Missing) -> float:
    return 0.0 if one.called is None else one.called.weight


@cache
def _fitted() -> tuple[Array, ...]:
    kept = json.loads(FITTED.read_text(encoding="utf-8"))
    return tuple(np.array(kept[name]) for name in ("mean", "spread", "weights", "bias"))
