"""Embedded reasoner: knowledge cards, the shipped text encoder and a learned scorer; no key, no network, no GPU.

A card (``cards/*.toml``) lists the names of a household object, its uses, and where it is usually kept. A request calls
for an object by meaning, by name, or by words that it shares with one of its uses; ``understanding/need_scorer.py``
weighs the three as learned from requests in many voices (``tools/train_scorer.py``). ``docs/embedded.md`` reports the
accuracy.
"""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from cartier.labels import name_key, object_ref, plain, words
from cartier.spatial.query import Scene, called
from cartier.types import Inventory, MapObject, Selection, Status
from cartier.understanding.candidates import Candidates, Missing, Ranked
from cartier.understanding.cards import SHIPPED, Deck, bare, read_deck
from cartier.understanding.dialogue import FollowUp, understand
from cartier.understanding.dialogue_acts import DialogueAct, sort_out
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.follow_ups import SERVED
from cartier.understanding.grounding import ReferenceGrounder
from cartier.understanding.need_scorer import Judgement, Scorer
from cartier.understanding.outcome_classifier import OUTCOMES, Choice
from cartier.understanding.reference_words import STANDS_FOR
from cartier.understanding.references import parse
from cartier.understanding.tentative import accepted, maybe_there, offer, tentative_matches, unsure, usual_place
from cartier.understanding.utterance import MOST_CHARACTERS, mentions

Shares = tuple[tuple[str, float], ...]

NAME = "embedded (knowledge cards, MiniLM, learned scorer)"
FITS = " fits: "  # in the reason for an object that serves a need and was not named
MOST_NEEDS, LONGEST_PART = 4, 30  # most needs in one utterance, and most words of each
THEN = re.compile(
    r"[,;.]?\s+(?:and\s+)?(?:then|afterwards|after\s+that|after\s+which|next(?!\s+to\b))\b[,\s]*|\s*;\s*"
    r"|[,.]?\s+(?:and|n)\s+then\b[,\s]*",
    re.IGNORECASE,
)
AND = re.compile(
    r"[,;.]?\s+(?:(?:and\s+)?also\b|plus\b|as\s+well\s+as\b|and\s+(?=(?:something|somewhere|i\s+(?:need|want)"
    r"|(?:my|the|an?|some)\s+\w+)\b))[,\s]*",
    re.IGNORECASE,
)
ALSO = re.compile(r"\balso\b", re.IGNORECASE)
BETWEEN = re.compile(r"\b(?:between|both|either)\b", re.IGNORECASE)  # "and" after these joins one need
OPENING = re.compile(r"^\s*(?:first(?:ly)?(?: of all)?|and|then|so|also|finally)\b[,\s]*", re.IGNORECASE)


def make(cards: str | Path = SHIPPED) -> Embedded:
    """The reasoner over a card file or a folder of them: the ones shipped, or your own in the same form."""
    return Embedded(read_deck(Path(cards)))


class Embedded:
    """Scores every card, then the listed objects by their cards and their own names."""

    def __init__(self, deck: Deck, scorer: Scorer | None = None) -> None:
        self.name = NAME
        self.deck = deck
        self._given = scorer
        self._listed = lru_cache(maxsize=8)(lambda names: Candidates(self.scorer, names))

    @cached_property
    def scorer(self) -> Scorer:
        """The learned part, loaded for the first request."""
        return self._given or Scorer(self.deck)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The listed object that serves the words in the context of the dialogue; ``then`` holds further needs."""
        if not inventory.names:
            return Selection("not_found", reason="nothing was detected in this home", model=NAME)
        scene = Scene(inventory)
        agreed = accepted(query, dialogue)
        if agreed:
            return self._anyway(dialogue[-1][0], inventory, scene, dialogue[:-1])
        if agreed is False:
            return Selection("answered", reason="the offer was turned down", text="All right.", model=NAME)
        chosen = self._among(query, inventory, scene, dialogue)
        nothing = (
            chosen.status in ("not_found", "likely_near")
            and not chosen.next
            and not self._listed_asked(query, inventory)
        )
        if (nothing or _unknown(chosen)) and (maybe := self._maybe(query, scene)) is not None:
            return offer(maybe, scene, NAME) if nothing else unsure(chosen, maybe, scene)
        return usual_place(chosen) if chosen.status == "likely_near" else chosen

    def _listed_asked(self, query: str, inventory: Inventory) -> bool:
        """Whether a listed name is asked for, so that no object of another name may serve instead."""
        asked = parse(plain(query[-MOST_CHARACTERS:]), lexicon(self.deck, inventory), name_key)
        return asked is not None and asked.direct and asked.head is not None and bool(asked.head.labels)

    def _anyway(self, query: str, inventory: Inventory, scene: Scene, dialogue: Sequence[tuple[str, str]]) -> Selection:
        """The offered object, once the person accepts it."""
        chosen = self._among(query, inventory, scene, dialogue, wanted=True)
        maybe = self._maybe(query, scene) if chosen.status in ("not_found", "likely_near") else None
        return chosen if maybe is None else maybe_there(maybe, NAME)

    def _maybe(self, query: str, scene: Scene) -> MapObject | None:
        """Names of objects that would serve the words."""
        maybe = tentative_matches(scene)
        names = tuple(sorted({candidate.label for candidate in maybe}))
        chosen = self._by_name(query, names, ()) if names else None
        return next(
            (o for o in maybe if chosen and chosen.status == "found" and called(o, [chosen.object or ""])), None
        )

    def _among(
        self, query: str, inventory: Inventory, scene: Scene, dialogue: Sequence[tuple[str, str]], wanted: bool = False
    ) -> Selection:
        """The answer from the confirmed objects."""
        needs = _parts(query)
        outright = needs if THEN.search(query) else needs[:1] if not ALSO.search(query) else ()
        if len(needs) > 1 and all(self._asks(need) or (k and _anaphoric(need)) for k, need in enumerate(outright)):
            chosen = self._each(needs, inventory, scene, dialogue)
            goals = [(c.object, c.object_id, c.room) for c in chosen if c.status in ("found", "likely_near")]
            others = {c.status for c in chosen} - {"found", "likely_near"}
            # Parts separated by "then" are served one by one; "and" may join words that are one need after all.
            said = goals and others <= {"not_found", "clarify"} and THEN.search(query)
            if (said or not others) and len(set(goals)) == len(goals):
                first, *rest = chosen
                return replace(first, next=tuple(rest))
        return self._one(query, inventory, scene, dialogue, wanted)

    def _each(
        self, needs: Sequence[str], inventory: Inventory, scene: Scene, dialogue: Sequence[tuple[str, str]]
    ) -> list[Selection]:
        """The answers to several needs; "the blue one" is understood by the need before it."""
        chosen: list[Selection] = []
        for k, need in enumerate(needs):
            turns = list(dialogue)
            if chosen and chosen[-1].object_id is not None and _anaphoric(need):
                turns.append((needs[k - 1], object_ref(chosen[-1].object or "", chosen[-1].object_id)))
            chosen.append(self._one(need, inventory, scene, turns))
        return chosen

    def _asks(self, said: str) -> bool:
        return sort_out(self.scorer.hear(said), self.deck.by_key).asked == "outright"

    def _one(
        self, query: str, inventory: Inventory, scene: Scene, dialogue: Sequence[tuple[str, str]], wanted: bool = False
    ) -> Selection:
        """The answer to one need."""
        names = tuple(inventory.names)
        if not scene.known:
            return self._by_name(query, names, [(person, SERVED.sub("", robot)) for person, robot in dialogue])
        heard = self.scorer.hear(query)
        text = " ".join(heard.tokens).replace(" ' ", "'")
        particular = ReferenceGrounder(text, scene, lexicon(self.deck, inventory), dialogue, NAME, wanted)
        if particular.outright or sort_out(heard, self._keys(names)).asked != "not":
            told = particular.answer(lambda need, among: self._serve(need, among or names, FollowUp(need)))
            if told is not None and not (_nowhere(told) and particular.anywhere):
                return told
            if told is not None:
                served = self._by_name(query, names, [])
                return particular.refined(served) if served.status == "found" and FITS in served.reason else told
        return particular.refined(self._by_name(query, names, [(p, SERVED.sub("", robot)) for p, robot in dialogue]))

    def _by_name(self, query: str, names: tuple[str, ...], dialogue: Sequence[tuple[str, str]]) -> Selection:
        """The listed name that serves the words in the context of the dialogue."""
        turn = understand(query, names, dialogue)
        if turn.picked is not None:
            reason = f"'{_short(query)}' means this one"
            return Selection("found", turn.picked, reason=reason, candidates=((turn.picked, 1.0),), model=NAME)
        if turn == FollowUp(query):  # words about an offer are a correction
            said = sort_out(self.scorer.hear(query), self._keys(names))
            if said.asked == "not":
                return _told(said)
            turn = turn._replace(forbidden=self._forbidden(said, names), outright=said.asked == "outright")
        return self._serve(turn.text, names, turn)

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first; none if no household object serves them."""
        heard = self.scorer.hear(query)
        if not heard.sentences or sort_out(heard, self.deck.by_key).asked == "not":
            return []
        judged = self.scorer.judge(heard, self.deck.by_key.keys())
        candidates = self._listed(tuple(card.name for card in self.deck.cards if card.at_home))
        ranked = candidates.ranked(judged)
        most = candidates.missing(judged, ranked[0].candidate)
        if most.logit > ranked[0].logit and not self.deck.cards[most.card].at_home:
            return []
        return [r.candidate.name for r in ranked[:5] if r.logit > judged.nothing]

    def _keys(self, names: tuple[str, ...]) -> Set[str]:
        """The keys of all names to listen for."""
        return self.deck.by_key.keys() | self._listed(names).keys

    def _forbidden(self, said: DialogueAct, names: tuple[str, ...]) -> tuple[str, ...]:
        """The listed objects that a prohibition names, if the words say nothing else."""
        keys, by_key = self._keys(names), self.deck.by_key
        off, named = ({m.key for m in mentions(self.scorer.hear(t), keys)} for t in (said.forbidden, said.rest))
        cards = {by_key[key] for key in off if key in by_key} - {by_key[key] for key in named if key in by_key}
        return tuple(t.name for t in self._listed(names).all if t.key in off - named or t.card in cards)

    def _serve(self, text: str, names: tuple[str, ...], turn: FollowUp) -> Selection:
        """The object that serves a need, or a message instead."""
        heard, candidates = self.scorer.hear(text), self._listed(names)
        if not heard.sentences:
            return Selection("clarify", reason="nothing said tells a need", question="What do you need?", model=NAME)
        judged = self.scorer.judge(heard, self._keys(names))
        out = {*turn.without, *turn.forbidden}
        allowed = [
            r
            for r in candidates.ranked(judged)
            if r.candidate.name in (turn.only or names) and r.candidate.name not in out
        ]
        if not allowed:
            return Selection("not_found", reason="nothing else is listed", model=NAME)
        choice = Choice(allowed, candidates, judged, turn.outright)
        # A choice from an offer gets no further question; an object that the person refuses gives way to the next best.
        only: tuple[Status, ...] = ("found",) if turn.only else ("found", "not_found") if turn.without else OUTCOMES
        return self._say(choice, choice.decide(only), turn)

    def weigh(self, text: str, names: Sequence[str]) -> Choice | None:
        """The input of the decision, for fitting it (tools/fit_decision.py); None for no words."""
        heard, candidates = self.scorer.hear(text), self._listed(tuple(names))
        judged = self.scorer.judge(heard, self._keys(tuple(names))) if heard.sentences else None
        outright = sort_out(heard, self._keys(tuple(names))).asked == "outright"
        return Choice(candidates.ranked(judged), candidates, judged, outright) if judged and candidates.all else None

    def _say(self, choice: Choice, status: Status, turn: FollowUp) -> Selection:
        """A decision in words."""
        best, second, missing, judged = choice.best, choice.rival, choice.missing, choice.judged
        chosen = {"found": best.candidate.name, "likely_near": choice.near}.get(status)
        called = best.called if status == "found" and not best.stands_in else None
        reason, question = self._reason(best, judged), None
        if chosen is not None and called is not None and not turn.outright:
            reason = f"'{called.mention.said}' was named, but not asked for"
            question, chosen, status = f"Shall I go to the {bare(chosen)}?", None, "clarify"
        elif status == "clarify" and second is not None:
            reason = f"{reason}, but also {self._reason(second, judged)}"
            question = f"Do you mean the {bare(best.candidate.name)} or the {bare(second.candidate.name)}?"
        elif status == "likely_near" and chosen is not None:
            reason = f"{self._not_seen(missing)}, but usually kept beside the {bare(chosen)}"
        elif status == "not_found":
            reason = self._not_seen(missing) if missing.logit > judged.nothing else "nothing here serves that"
        return Selection(
            status, chosen, reason=reason, question=question, candidates=_candidates(choice.ranked, judged), model=NAME
        )

    def _not_seen(self, missing: Missing) -> str:
        if missing.called is not None and missing.called.weight > 0:
            return f"no {missing.called.mention.said} to be seen here"
        return f"what would serve ({self.deck.cards[missing.card].name}) was not seen here"

    def _reason(self, ranked: Ranked, judged: Judgement) -> str:
        if ranked.called is not None and ranked.called.weight > 0:
            said = ranked.called.mention.said
            return (
                f"no {said} to be seen here, but this is much the same"
                if ranked.stands_in
                else f"'{said}' was asked for by name"
            )
        if ranked.candidate.card is None:
            return f"'{_short(judged.sentences[0])}' fits the name {bare(ranked.candidate.name)}"
        sentence, use = self.scorer.why(judged, ranked.candidate.card)
        return f"'{_short(sentence)}'{FITS}{use}"


def _anaphoric(need: str) -> bool:
    """Whether a need refers to the object named before it: "the blue one"."""
    return not STANDS_FOR.isdisjoint(words(plain(need)))


def _nowhere(told: Selection) -> bool:
    """Whether a request for an object or its place found none, so that the words may state a need instead."""
    return told.status == "not_found" or (told.fact is not None and told.fact.kind == "where" and not told.fact.objects)


def _unknown(told: Selection) -> bool:
    """Whether a question about an object is answered with that none was seen."""
    fact = told.fact
    return fact is not None and fact.kind in ("where", "exists", "count") and not fact.objects and not told.next


def _told(said: DialogueAct) -> Selection:
    """No goal, and a message that the words were understood."""
    reason = f"understood: {_short(said.forbidden)}" if said.forbidden else "understood: nothing was asked for"
    return Selection("answered", reason=reason, text="Understood.", model=NAME)


def _candidates(ranked: Sequence[Ranked], judged: Judgement) -> Shares:
    """The five best with their probabilities; the rest of the probability is with the others and with nothing."""
    logits = np.array([judged.nothing, *(r.logit for r in ranked)])
    shares = np.exp(logits - logits.max())
    shares = shares / shares.sum()
    return tuple(
        (r.candidate.name, round(float(p), 3)) for r, p in zip(ranked[:5], shares[1:6], strict=True) if p >= 0.0005
    )


def _parts(text: str) -> list[str]:
    """The needs in one utterance, separated by "then", "after that" or a semicolon."""
    if BETWEEN.search(text):
        return [text]
    parts = [
        OPENING.sub("", part).strip(" ,.;")
        for part in (THEN if THEN.search(text) else AND).split(text[-MOST_CHARACTERS:])
    ]
    parts = [part for part in parts if part]
    few = len(parts) <= MOST_NEEDS and all(len(part.split()) <= LONGEST_PART for part in parts)
    return parts if few else [text]


def _short(text: str) -> str:
    """The beginning of the words, on one line."""
    line = re.sub(r" (?=[,.!?;:])", "", " ".join(text.split()).replace(" ' ", "'"))
    return line if len(line) <= 60 else line[:57].rsplit(" ", 1)[0] + " …"
