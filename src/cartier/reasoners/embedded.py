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
from typing import NamedTuple

import numpy as np

from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance
from cartier.spatial.query import Scene, called
from cartier.types import Inventory, MapObject, Selection, Status
from cartier.understanding.answers import one
from cartier.understanding.assembly import query as query_of
from cartier.understanding.candidates import Candidates, Missing, Ranked
from cartier.understanding.cards import SHIPPED, Deck, bare, read_deck
from cartier.understanding.dialogue_state import SERVED, DialogueState, named, resolve
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.grounding import MODEL, ReferenceGrounder
from cartier.understanding.need_scorer import Judgement, Scorer
from cartier.understanding.outcome_classifier import OUTCOMES, Choice
from cartier.understanding.parser import parser
from cartier.understanding.reference_words import ORDER
from cartier.understanding.tags import NOTHING_ASKED, Clause
from cartier.understanding.tentative import OFFER, maybe_there, offer, tentative_matches, unsure, usual_place

Shares = tuple[tuple[str, float], ...]

NAME = MODEL
FITS = " serves "  # in the reason for an object that serves a need and was not named
MOST_NEEDS = 4  # most needs in one utterance
FEW = 7  # words of a reply that tells more of what was offered
REPLIES = ("choose", "confirm", "deny", "correct", "another", "go", "need")
LEAST_ASKING = 0.35  # probability of a request from which words that seem to ask for nothing are one
EITHER = frozenset({"either", "any", "whichever", "matter", "mind", "care"})
LATEST = 3000  # characters at the end of a text that are read


class Need(NamedTuple):
    """How to serve a need: without which names, and whether what is named was asked for."""

    without: tuple[str, ...] = ()
    outright: bool = True


class _Home:
    """An inventory with the names that may be used for what is in it."""

    def __init__(self, inventory: Inventory, names: EntityVocabulary) -> None:
        self.scene, self.names, self.listed = Scene(inventory), names, tuple(inventory.names)


def make(cards: str | Path = SHIPPED) -> Embedded:
    """The reasoner over a card file or a folder of them: the ones shipped, or your own in the same form."""
    return Embedded(read_deck(Path(cards)))


class Embedded:
    """Reads the words once, then answers each clause: a query over the home, or a need by cards and scorer."""

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
        home = _Home(inventory, lexicon(self.deck, inventory))
        state = self._state(dialogue, home)
        clauses = self._clauses(query, dialogue[-1:], home)
        answer = _leaning(clauses[0], state).act if clauses else ""
        if dialogue and dialogue[-1][1].endswith(OFFER) and answer in ("confirm", "deny"):
            if answer == "deny":
                return Selection("answered", reason="the offer was turned down", text="All right.", model=NAME)
            return self._anyway(dialogue, home)
        found: list[Selection] = []
        for clause in clauses[:MOST_NEEDS] or [Clause("need", 1.0, (), ())]:
            chosen, asked = self._one(clause, home, state)
            found.append(chosen)
            served = [home.scene.by_id[chosen.object_id]] if chosen.object_id in home.scene.by_id else []
            state = state.then(asked, served)
        first, *rest = found
        return replace(first, next=tuple(rest))

    def _clauses(self, query: str, before: Sequence[tuple[str, str]], home: _Home) -> list[Clause]:
        turn = (before[-1][0][-LATEST:], before[-1][1][-LATEST:]) if before else None
        return parser()(self.scorer.hear(query[-LATEST:]).tokens, turn, home.names)

    def _state(self, dialogue: Sequence[tuple[str, str]], home: _Home) -> DialogueState:
        """What the turns before leave to refer to."""
        state = DialogueState()
        for k, (person, robot) in enumerate(dialogue):
            clauses = self._clauses(person, dialogue[k - 1 : k] if k else (), home)
            asked = resolve(query_of(clauses[-1], home.names), state) if clauses else None
            served = [home.scene.by_id[int(i)] for i in SERVED.findall(robot) if int(i) in home.scene.by_id]
            names = named(robot, home.listed)
            if not served and not robot.rstrip().endswith("?"):
                served = [o for o in home.scene.objects if o.label in names[:1]][:1]
            offers = robot.rstrip().endswith("?") and not robot.startswith("Which ")
            state = state.then(asked, served, names if offers else ())
        return state

    def _one(
        self, clause: Clause, home: _Home, state: DialogueState, wanted: bool = False
    ) -> tuple[Selection, ParsedUtterance]:
        """The answer to one clause, and what it asked."""
        clause = _leaning(clause, state)
        asked = resolve(query_of(clause, home.names), state)
        if clause.act in NOTHING_ASKED:
            said = _short(" ".join(clause.tokens)) if clause.act == "prohibit" else "nothing was asked for"
            return Selection("answered", reason=f"understood: {said}", text="Understood.", model=NAME), asked
        if clause.act == "another" and not state.offered and len(state.rest) == 1:
            return self._pick(state.rest[0], clause, asked, home, state), asked
        if clause.act in REPLIES and state.offered:
            chosen = self._of_offer(clause, asked, home, state)
            if chosen is not None:
                return chosen, asked
        if clause.act == "confirm" and state.before is not None:
            asked = state.before
        said = " ".join(clause.tokens).replace(" ' ", "'")
        grounder = ReferenceGrounder(asked, home.scene, home.names, state, said, wanted)
        chosen = self._answer(grounder, asked, home, state, said)
        return self._with_tentative(chosen, asked, home, wanted), asked

    def _answer(
        self, grounder: ReferenceGrounder, asked: ParsedUtterance, home: _Home, state: DialogueState, said: str
    ) -> Selection:
        """The answer of the executor, or of cards and scorer to what names nothing that is listed."""
        out = self._turned_down(asked, home, state)

        def serve(text: str, among: tuple[str, ...]) -> Selection:
            return self._serve(text, among or home.listed, Need(out))

        told = grounder.answer(serve)
        if told is not None and not (_nowhere(told) and grounder.anywhere and asked.kind in ("go", "need")):
            return told
        text = asked.need if asked.kind in ("need", "go") else said
        served = self._serve(text, home.listed, Need(out))
        if told is not None and not (served.status == "found" and FITS in served.reason):
            return told if asked.head is not None and asked.head.labels else grounder.refined(served)
        return grounder.refined(served)

    def _turned_down(self, asked: ParsedUtterance, home: _Home, state: DialogueState) -> tuple[str, ...]:
        """The listed names that must not serve: turned down in the words, or served before where another is wanted."""
        names = {name for noun in asked.rejected for name in noun.labels}
        if asked.kind == "need" and asked.head is not None and asked.head.other:
            names |= {home.scene.by_id[i].label for i in state.served} | set(state.offered)
        return tuple(names)

    def _of_offer(self, clause: Clause, asked: ParsedUtterance, home: _Home, state: DialogueState) -> Selection | None:
        """What is chosen of the names that the robot offered; None if the reply asks for something else."""
        own, offered = query_of(clause, home.names), state.offered
        refused = {name for noun in own.rejected for name in noun.labels}
        named = [name for name in offered if own.head is not None and name in own.head.labels and name not in refused]
        rest = [name for name in offered if name not in refused]
        order = next((ORDER[token] for token in clause.tokens if token in ORDER), 0)
        if clause.act == "deny" and not named and not refused:
            return Selection("answered", reason="the offer was turned down", text="All right.", model=NAME)
        if own.head is not None and own.head.labels and not named and not refused:
            return None
        picked = named if len(named) == 1 else rest[order - 1 : order] if order else rest if len(rest) == 1 else []
        if not picked and (clause.act == "confirm" or not EITHER.isdisjoint(clause.tokens)):
            picked = rest
        said = " ".join(clause.tokens)
        if not picked:
            need = state.before.need if state.before is not None else ""
            out = tuple(set(home.listed).difference(rest))
            return self._serve(f"{need}. {said}", home.listed, Need(out)) if len(clause.tokens) <= FEW else None
        return self._pick(picked[0], clause, asked, home, state)

    def _pick(self, name: str, clause: Clause, asked: ParsedUtterance, home: _Home, state: DialogueState) -> Selection:
        """An offered name that was chosen."""
        reason = f"'{_short(' '.join(clause.tokens))}' means this one"
        chosen = Selection("found", name, reason=reason, candidates=((name, 1.0),), model=NAME)
        return ReferenceGrounder(asked, home.scene, home.names, state, "").refined(chosen)

    def _with_tentative(self, chosen: Selection, asked: ParsedUtterance, home: _Home, wanted: bool) -> Selection:
        """The answer, or what may be there where nothing confirmed serves."""
        head = asked.head
        listed = head is not None and bool(head.labels) and asked.kind == "go"
        nothing = chosen.status in ("not_found", "likely_near") and not listed
        if nothing or _unknown(chosen):
            maybe = self._maybe(asked.need, home.scene)
            if maybe is not None:
                if wanted:
                    return maybe_there(maybe, NAME)
                return offer(maybe, home.scene, NAME) if nothing else unsure(chosen, maybe, home.scene)
        return usual_place(chosen) if chosen.status == "likely_near" and not wanted else chosen

    def _anyway(self, dialogue: Sequence[tuple[str, str]], home: _Home) -> Selection:
        """The offered object, once the person accepts it."""
        state = self._state(dialogue[:-1], home)
        clauses = self._clauses(dialogue[-1][0], dialogue[-2:-1], home)
        return self._one(clauses[-1], home, state, wanted=True)[0]

    def _maybe(self, text: str, scene: Scene) -> MapObject | None:
        """The likeliest tentative object that would serve the words."""
        maybe = tentative_matches(scene)
        names = tuple(sorted({candidate.label for candidate in maybe}))
        chosen = self._serve(text, names, Need()) if names else None
        return next(
            (o for o in maybe if chosen and chosen.status == "found" and called(o, [chosen.object or ""])), None
        )

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first; none if no household object serves them."""
        heard = self.scorer.hear(query)
        clauses = parser()(heard.tokens, None, lexicon(self.deck, Inventory.of(())))
        if not heard.sentences or all(clause.act in NOTHING_ASKED for clause in clauses):
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

    def _serve(self, text: str, names: tuple[str, ...], need: Need) -> Selection:
        """The object that serves a need, or a message instead."""
        heard, candidates = self.scorer.hear(text), self._listed(names)
        if not heard.sentences:
            return Selection("clarify", reason="nothing said tells a need", question="What do you need?", model=NAME)
        judged = self.scorer.judge(heard, self._keys(names))
        among = set(names).difference(need.without)
        allowed = [r for r in candidates.ranked(judged) if r.candidate.name in among]
        if not allowed:
            return Selection("not_found", reason="nothing else is listed", model=NAME)
        choice = Choice(allowed, candidates, judged, need.outright)
        # A choice from an offer gets no further question; an object that the person refuses gives way to the next best.
        only: tuple[Status, ...] = ("found", "not_found") if need.without else OUTCOMES
        return self._say(choice, choice.decide(only), need)

    def weigh(self, text: str, names: Sequence[str]) -> Choice | None:
        """The input of the decision, for fitting it (tools/fit_decision.py); None for no words."""
        heard, candidates = self.scorer.hear(text), self._listed(tuple(names))
        judged = self.scorer.judge(heard, self._keys(tuple(names))) if heard.sentences else None
        return Choice(candidates.ranked(judged), candidates, judged, True) if judged and candidates.all else None

    def _say(self, choice: Choice, status: Status, need: Need) -> Selection:
        """A decision in words."""
        best, second, missing, judged = choice.best, choice.rival, choice.missing, choice.judged
        chosen = {"found": best.candidate.name, "likely_near": choice.near}.get(status)
        called = best.called if status == "found" and not best.stands_in else None
        reason, question = self._reason(best, judged), None
        if chosen is not None and called is not None and not need.outright:
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
        card = ranked.candidate.card
        said = judged.sentences[0] if card is None else self.scorer.why(judged, card)
        return f"{one(bare(ranked.candidate.name))}{FITS}'{_short(said)}'"


def _leaning(clause: Clause, state: DialogueState) -> Clause:
    """The clause with its second act where the first is doubtful: an alarm was judged before by the whole of the words,
    and what may ask for something is not passed over; a "no" to what was served wants another."""
    second, likely = clause.second
    if clause.act == "deny" and any(span.role == "t" for span in clause.spans):  # "no, the sink"
        return clause._replace(act="go")
    if clause.act == "deny" and not state.offered and state.last is not None:
        return clause._replace(act="another")
    if clause.act == "alarm":
        return clause._replace(act=second)
    asks = second in ("go", "need") and likely >= LEAST_ASKING
    if clause.act not in NOTHING_ASKED or not asks:
        return clause
    spans = tuple(span._replace(role="n") if span.role in ("t", "n") else span for span in clause.spans)
    return clause._replace(act=second, spans=spans if clause.act == "prohibit" else clause.spans)


def _nowhere(told: Selection) -> bool:
    """Whether a request for an object or its place found none, so that the words may state a need instead."""
    return told.status == "not_found" or (told.fact is not None and told.fact.kind == "where" and not told.fact.objects)


def _unknown(told: Selection) -> bool:
    """Whether a question about an object is answered with that none was seen."""
    fact = told.fact
    return fact is not None and fact.kind in ("where", "exists", "count") and not fact.objects and not told.next


def _candidates(ranked: Sequence[Ranked], judged: Judgement) -> Shares:
    """The five best with their probabilities; the rest of the probability is with the others and with nothing."""
    logits = np.array([judged.nothing, *(r.logit for r in ranked)])
    shares = np.exp(logits - logits.max())
    shares = shares / shares.sum()
    return tuple(
        (r.candidate.name, round(float(p), 3)) for r, p in zip(ranked[:5], shares[1:6], strict=True) if p >= 0.0005
    )


def _short(text: str) -> str:
    """The beginning of the words, on one line."""
    line = re.sub(r" (?=[,.!?;:])", "", " ".join(text.split()).replace(" ' ", "'"))
    return line if len(line) <= 60 else line[:57].rsplit(" ", 1)[0] + " …"
