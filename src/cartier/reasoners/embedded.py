"""Embedded reasoner: knowledge cards, the shipped text encoder and learned parts; no key, no network, no GPU.

The words are parsed once (``understanding/parser.py``). What they name is resolved exactly over the home
(``grounding.py``); what names nothing is a need, which cards and scorer serve (``needs.py``). ``docs/embedded.md``
reports the accuracy.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance
from cartier.spatial.query import Scene, called, is_door
from cartier.types import Inventory, MapObject, Selection
from cartier.understanding.answers import listed_in, spoken_of
from cartier.understanding.assembly import query as query_of
from cartier.understanding.cards import SHIPPED, Deck, read_deck
from cartier.understanding.choices import chosen, options
from cartier.understanding.dialogue_state import SERVED, DialogueState, again, in_context, named, resolve, same
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.grounding import MODEL, ReferenceGrounder
from cartier.understanding.need_scorer import Scorer
from cartier.understanding.needs import FITS, Needs, shortened
from cartier.understanding.offers import REPLIES, reply
from cartier.understanding.owners import owner_of
from cartier.understanding.parser import parser
from cartier.understanding.readings import UNSURE, picked, question
from cartier.understanding.route_rules import asked_back, asks_of_rules, driving, says_how, told
from cartier.understanding.tags import NOTHING_ASKED, NOUNS, REQUESTS, ROUTING, Clause
from cartier.understanding.tentative import OFFER, maybe_there, offer, tentative_matches, unsure, usual_place
from cartier.vision import pixels

MOST_NEEDS = 4  # most needs in one utterance
LATEST = 3000  # characters at the end of a text that are read
PARSED = 64  # turns whose parse is kept: each request reads all turns of its conversation
ROOM_ALONE = re.compile(r"^(?:no |in |the )*|(?: please)?[ .!?,]*$")
LEAST_CERTAIN, SURE_ALONE = 0.7, 0.9  # of an act in the context of the turn before, and of one without
MOST_SAID = 300  # characters of a sentence that are kept with its rules
TURNED_DOWN = Selection("answered", reason="the offer was turned down", text="All right.", model=MODEL)


class _Home:
    """An inventory with the names that may be used for what is in it."""

    def __init__(self, inventory: Inventory, names: EntityVocabulary) -> None:
        self.scene, self.names, self.listed = Scene(inventory), names, tuple(inventory.names)
        self.rules = inventory.rules


def make(cards: str | Path = SHIPPED) -> Embedded:
    """The reasoner over a card file or a folder of them: the ones shipped, or your own in the same form."""
    return Embedded(read_deck(Path(cards)))


class Embedded:
    """Reads the words once, then answers each clause: a query over the home, or a need by cards and scorer."""

    def __init__(self, deck: Deck, scorer: Scorer | None = None) -> None:
        self.name = MODEL
        self.deck, self.needs = deck, Needs(deck, scorer)
        self._parse = lru_cache(maxsize=PARSED)(self._parsed)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The listed object that serves the words in the context of the dialogue; ``next`` holds further needs."""
        if not inventory.names:
            return Selection("not_found", reason="nothing was detected in this home", model=MODEL)
        home = _Home(inventory, lexicon(self.deck, inventory))
        state = self._state(dialogue, home)
        if (by_looks := pixels.answer(query[-LATEST:], inventory, state.last, MODEL)) is not None:
            return by_looks
        clauses = self._clauses(query, dialogue[-1:], home)
        if dialogue and dialogue[-1][1].startswith(UNSURE) and clauses:
            earlier = self._clauses(dialogue[-1][0], dialogue[-2:-1], home)
            alone = self._clauses(query, (), home)  # after a question, the parser takes all for a choice of objects
            meant = picked(alone[0], min(earlier, key=lambda clause: clause.certainty)) if earlier else None
            clauses = clauses if meant is None else (meant,)
        elif dialogue and dialogue[-1][1].endswith(OFFER) and clauses:
            act = in_context(clauses[0], state).act
            if act in ("confirm", "deny"):
                return TURNED_DOWN if act == "deny" else self._anyway(dialogue, home)
        clauses = self._afresh(query, clauses, home, state)
        found: list[Selection] = []
        for clause in clauses[:MOST_NEEDS] or [Clause("need", 1.0, (), ())]:
            chosen, asked = self._with_rules(clause, home, state, query)
            found.append(chosen)
            served = [home.scene.by_id[chosen.object_id]] if chosen.object_id in home.scene.by_id else []
            state = state.then(asked, served)
        first, *rest = found
        return replace(pixels.unchecked(query[-LATEST:], first), next=tuple(rest))

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first; none if no household object serves them."""
        clauses = self._parse(query[-LATEST:], None, lexicon(self.deck, Inventory.of(())))
        if all(in_context(clause, DialogueState()).act in (*NOTHING_ASKED, *ROUTING) for clause in clauses):
            return []
        return self.needs.propose(query)

    def _afresh(self, query: str, clauses: tuple[Clause, ...], home: _Home, state: DialogueState) -> tuple[Clause, ...]:
        """The clauses, read without the turn before where that makes a surer request of them: where they answer its
        question with none of its choices, or where only they alone name an object."""
        if state == DialogueState() or len(clauses) != 1 or clauses[0].act in ("correct", "another", "confirm", "deny"):
            return clauses
        clause = clauses[0]
        own = query_of(clause, home.names)
        if clause.act == "choose":
            unlike = bool(state.choices) and self._chosen(clause, own, state) is None
        else:
            nouns = [span.role for span in clause.spans if span.role in NOUNS]
            unlike = "p" not in nouns and (clause.certainty < LEAST_CERTAIN or not nouns)
        alone = self._clauses(query, (), home) if unlike else ()
        if len(alone) != 1 or alone[0].act not in REQUESTS or alone[0].certainty < SURE_ALONE:
            return clauses
        head = query_of(alone[0], home.names).head
        named = head is not None and bool(head.labels or is_door(head))
        return alone if named or alone[0].act == "need" else clauses

    def _clauses(self, query: str, before: Sequence[tuple[str, str]], home: _Home) -> tuple[Clause, ...]:
        turn = (before[-1][0][-LATEST:], before[-1][1][-LATEST:]) if before else None
        return self._parse(query[-LATEST:], turn, home.names)

    def _parsed(self, query: str, turn: tuple[str, str] | None, names: EntityVocabulary) -> tuple[Clause, ...]:
        return tuple(parser()(self.needs.scorer.hear(query).tokens, turn, names))

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
            listed = listed_in(asked, home.scene, state.last)
            if listed and not SERVED.search(robot):
                served = spoken_of(asked, home.scene, listed)
            state = state.then(asked, served, names if offers else ())
            questioned, pointed = robot.rstrip().endswith("?"), bool(SERVED.search(robot))
            choices = self._choices(robot, asked, home)
            state = replace(state, choices=choices, questioned=questioned, listed=listed, pointed=pointed)
        return state

    def _choices(self, robot: str, asked: ParsedUtterance | None, home: _Home) -> tuple[tuple[str, int], ...]:
        """The objects that the robot asked about, in the order of its words."""
        found: dict[int, str] = {}
        before = asked.head if asked is not None else None
        for words in options(robot) if before is not None else ():
            clauses = self._clauses(words, (), home)
            if before is not None and clauses:
                option = query_of(clauses[0], home.names).head
                named = option if option is not None and option.labels - before.labels else again(before, option)
                there, _ = home.scene.meant(named, found)
                found |= {there[0].id: words} if there else {}
        return tuple((words, obj) for obj, words in found.items())

    def _with_rules(
        self, clause: Clause, home: _Home, state: DialogueState, said: str
    ) -> tuple[Selection, ParsedUtterance]:
        """The answer to one clause with what it says of the way, and what it asked; it asks back about a rule whose
        object is not known."""
        if not says_how(clause):
            return self._one(clause, home, state)
        how = driving(clause, home.names, home.scene, state, " ".join(said.split())[:MOST_SAID], home.rules)
        if clause.act in NOTHING_ASKED and (clause.act != "prohibit" or how.unknown):
            return self._one(clause, home, state)  # "the rug was cold yesterday" is no rule
        if clause.act in (*ROUTING, "prohibit") or how.unknown:
            asked_for = asks_of_rules(clause)
            answered = (
                asked_back(how, MODEL) if how.unknown else told(how, home.rules, MODEL, asked_for, clause.act == "lift")
            )
            return answered, ParsedUtterance("rule")
        chosen, asked = self._one(clause, home, state)
        return replace(chosen, rules=how.rules, lifts=how.lifts), asked

    def _one(
        self, clause: Clause, home: _Home, state: DialogueState, wanted: bool = False
    ) -> tuple[Selection, ParsedUtterance]:
        """The answer to one clause, and what it asked."""
        unsure_of, clause = clause, in_context(clause, state)
        own = query_of(clause, home.names)
        asked = home.scene.with_rooms(self._in_room(own, resolve(own, state), home, state), state.last)
        if not state.offered and (told := question(unsure_of, own)):
            return Selection("clarify", reason="two readings are likely", question=told, text=told, model=MODEL), asked
        said = " ".join(clause.tokens).replace(" ' ", "'")
        if clause.act == "deny" and state.questioned and not state.offered:
            return TURNED_DOWN, asked
        if (choice := self._chosen(clause, own, state)) is not None:
            asked = replace(own, kind="go", head=same(home.scene.by_id[choice]))
        if clause.act in (*NOTHING_ASKED, *ROUTING):
            why = shortened(said) if clause.act in ("prohibit", *ROUTING) else "nothing was asked for"
            return Selection("answered", reason=f"understood: {why}", text="Understood.", model=MODEL), asked
        if clause.act == "another" and not state.offered and len(state.rest) == 1:
            return self._picked(state.rest[0], said, asked, home, state), asked
        if clause.act in REPLIES and state.offered:
            chosen = self._replied(clause, own, asked, home, state)
            if chosen is not None:
                return chosen, asked
        if clause.act == "confirm" and state.before is not None:
            asked = state.before
        grounder = ReferenceGrounder(asked, home.scene, home.names, state, said, wanted)
        owned = owner_of(clause, own.head) if asked.kind in ("go", "where") else ""
        if owned and (whose := grounder.whose(owned)) is not None:
            return whose, asked
        chosen = self._answer(grounder, asked, home, state, said)
        return self._with_tentative(chosen, asked, home, wanted), asked

    def _in_room(
        self, own: ParsedUtterance, asked: ParsedUtterance, home: _Home, state: DialogueState
    ) -> ParsedUtterance:
        """The query, where a bare room tells which of several was meant: "take me to the lamp", "the bedroom"."""
        head, last = own.head, state.last
        before = state.before if state.before is not None and state.before.kind == "go" else None
        bare = head is not None and own.kind == "go" and head.said == ROOM_ALONE.sub("", own.need).strip()
        if head is None or not head.rooms or not bare or before is None or last is None or last.room in head.rooms:
            return asked
        there = resolve(replace(own, kind="correct"), state)
        return there if there.head is not None and home.scene.meant(there.head)[0] else asked

    def _answer(
        self, grounder: ReferenceGrounder, asked: ParsedUtterance, home: _Home, state: DialogueState, said: str
    ) -> Selection:
        """The answer of the executor, or of cards and scorer to what names nothing that is listed."""
        out = self._turned_down(asked, home, state)
        told = grounder.answer(lambda text, among: self.needs.serve(text, among or home.listed, out))
        if told is not None and not (_nowhere(told) and grounder.anywhere and asked.kind in ("go", "need")):
            return told
        head = asked.head
        if told is not None and head is not None and (is_door(head) or (head.rooms is not None and told.room is None)):
            return told
        text = asked.need if asked.kind in ("need", "go") else said
        served = self.needs.serve(text, home.listed, out)
        if told is not None and not (served.status == "found" and FITS in served.reason):
            return told if asked.head is not None and asked.head.labels else grounder.refined(served)
        return grounder.refined(served)

    def _turned_down(self, asked: ParsedUtterance, home: _Home, state: DialogueState) -> tuple[str, ...]:
        """The listed names that must not serve: turned down in the words, or served before where another is wanted."""
        names = {name for noun in asked.rejected for name in noun.labels}
        if asked.kind == "need" and asked.head is not None and asked.head.other:
            names |= {home.scene.by_id[i].label for i in state.served} | set(state.offered)
        return tuple(names)

    def _chosen(self, clause: Clause, own: ParsedUtterance, state: DialogueState) -> int | None:
        """The object that a reply picks of those that the robot asked about; None if it asks for something else."""
        before = state.before.head if state.before is not None else None
        other = own.head is not None and before is not None and own.head.labels and not own.head.labels & before.labels
        return None if other and clause.act != "choose" else chosen(clause, state.choices)

    def _replied(
        self, clause: Clause, own: ParsedUtterance, asked: ParsedUtterance, home: _Home, state: DialogueState
    ) -> Selection | None:
        """What a reply picks of the names that the robot offered; None if it asks for something else."""
        answer, said = reply(clause, own, state.offered), " ".join(clause.tokens)
        if answer is None or answer.denied:
            return TURNED_DOWN if answer is not None else None
        if answer.picked:
            return self._picked(answer.picked, said, asked, home, state)
        need = state.before.need if state.before is not None else ""
        return self.needs.serve(f"{need}. {said}", home.listed, tuple(set(home.listed).difference(answer.rest)))

    def _picked(self, name: str, said: str, asked: ParsedUtterance, home: _Home, state: DialogueState) -> Selection:
        """An offered name that was chosen."""
        reason = f"'{shortened(said)}' means this one"
        chosen = Selection("found", name, reason=reason, candidates=((name, 1.0),), model=MODEL)
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
                    return maybe_there(maybe, MODEL)
                return offer(maybe, home.scene, MODEL) if nothing else unsure(chosen, maybe, home.scene)
        if chosen.status == "found" and FITS in chosen.reason and (by_name := self._maybe_named(asked.need, home)):
            offered = offer(by_name, home.scene, MODEL)
            return offered if offered.status == "found" else chosen
        return usual_place(chosen) if chosen.status == "likely_near" and not wanted else chosen

    def _anyway(self, dialogue: Sequence[tuple[str, str]], home: _Home) -> Selection:
        """The offered object, once the person accepts it."""
        state = self._state(dialogue[:-1], home)
        clauses = self._clauses(dialogue[-1][0], dialogue[-2:-1], home) or (Clause("need", 1.0, (), ()),)
        return self._one(clauses[-1], home, state, wanted=True)[0]

    def _maybe_named(self, text: str, home: _Home) -> MapObject | None:
        """The tentative object that the words of a need name, if it would serve better than all that is confirmed."""
        maybe = tentative_matches(home.scene)
        names = named(text, sorted({candidate.label for candidate in maybe}))
        chosen = self.needs.serve(text, (*home.listed, *names)) if names else None
        return next((o for o in maybe if chosen and o.label in names and chosen.object == o.label), None)

    def _maybe(self, text: str, scene: Scene) -> MapObject | None:
        """The likeliest tentative object that would serve the words."""
        maybe = tentative_matches(scene)
        names = tuple(sorted({candidate.label for candidate in maybe}))
        chosen = self.needs.serve(text, names) if names else None
        return next(
            (o for o in maybe if chosen and chosen.status == "found" and called(o, [chosen.object or ""])), None
        )


def _nowhere(told: Selection) -> bool:
    """Whether a request for an object or its place found none, so that the words may state a need instead."""
    return told.status == "not_found" or (told.fact is not None and told.fact.kind == "where" and not told.fact.objects)


def _unknown(told: Selection) -> bool:
    """Whether a question about an object is answered with that none was seen."""
    fact = told.fact
    return fact is not None and fact.kind in ("where", "exists", "count") and not fact.objects and not told.next
