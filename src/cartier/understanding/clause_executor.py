"""Clause executor: the answer to one clause, a query over the home or a need by cards and scorer."""

from __future__ import annotations

import re
from dataclasses import replace

from cartier.spatial.expressions import ParsedUtterance
from cartier.spatial.query import Scene, called, is_door
from cartier.types import MapObject, Selection
from cartier.understanding.assembly import query as query_of
from cartier.understanding.dialogue_state import DialogueState, in_context, named, resolve, same
from cartier.understanding.dialogue_tracker import KnownHome, picked_choice
from cartier.understanding.grounding import MODEL, ReferenceGrounder
from cartier.understanding.needs import FITS, Needs, shortened
from cartier.understanding.offers import REPLIES, reply
from cartier.understanding.owners import owner_of
from cartier.understanding.readings import question
from cartier.understanding.route_rules import asked_back, asks_of_rules, driving, says_how, told
from cartier.understanding.tags import NOTHING_ASKED, ROUTING, Clause
from cartier.understanding.tentative import maybe_there, offer, tentative_matches, unsure, usual_place

ROOM_ALONE = re.compile(r"^(?:no |in |the )*|(?: please)?[ .!?,]*$")
MOST_SAID = 300  # characters of a sentence that are kept with its rules
TURNED_DOWN = Selection("answered", reason="the offer was turned down", text="All right.", model=MODEL)


class ClauseExecutor:
    """Answers clauses; ``needs`` serves those that name nothing."""

    def __init__(self, needs: Needs) -> None:
        self.needs = needs

    def execute(
        self, clause: Clause, home: KnownHome, state: DialogueState, said: str
    ) -> tuple[Selection, ParsedUtterance]:
        """The answer to one clause with what it says of the way, and what it asked; it asks back about a rule whose
        object is not known."""
        if not says_how(clause):
            return self.answer(clause, home, state)
        how = driving(clause, home.names, home.scene, state, " ".join(said.split())[:MOST_SAID], home.rules)
        if clause.act in NOTHING_ASKED and (clause.act != "prohibit" or how.unknown):
            return self.answer(clause, home, state)  # "the rug was cold yesterday" is no rule
        if clause.act in (*ROUTING, "prohibit") or how.unknown:
            asked_for = asks_of_rules(clause)
            answered = (
                asked_back(how, MODEL) if how.unknown else told(how, home.rules, MODEL, asked_for, clause.act == "lift")
            )
            return answered, ParsedUtterance("rule")
        chosen, asked = self.answer(clause, home, state)
        return replace(chosen, rules=how.rules, lifts=how.lifts), asked

    def answer(
        self, clause: Clause, home: KnownHome, state: DialogueState, wanted: bool = False
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
        if (choice := picked_choice(clause, own, state)) is not None:
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
        chosen = self._resolved(grounder, asked, home, state, said)
        return self._with_tentative(chosen, asked, home, wanted), asked

    def _in_room(
        self, own: ParsedUtterance, asked: ParsedUtterance, home: KnownHome, state: DialogueState
    ) -> ParsedUtterance:
        """The query, where a bare room tells which of several was meant: "take me to the lamp", "the bedroom"."""
        head, last = own.head, state.last
        before = state.before if state.before is not None and state.before.kind == "go" else None
        bare = head is not None and own.kind == "go" and head.said == ROOM_ALONE.sub("", own.need).strip()
        if head is None or not head.rooms or not bare or before is None or last is None or last.room in head.rooms:
            return asked
        there = resolve(replace(own, kind="correct"), state)
        return there if there.head is not None and home.scene.meant(there.head)[0] else asked

    def _resolved(
        self, grounder: ReferenceGrounder, asked: ParsedUtterance, home: KnownHome, state: DialogueState, said: str
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

    def _turned_down(self, asked: ParsedUtterance, home: KnownHome, state: DialogueState) -> tuple[str, ...]:
        """The listed names that must not serve: turned down in the words, or served before where another is wanted."""
        names = {name for noun in asked.rejected for name in noun.labels}
        if asked.kind == "need" and asked.head is not None and asked.head.other:
            names |= {home.scene.by_id[i].label for i in state.served} | set(state.offered)
        return tuple(names)

    def _replied(
        self, clause: Clause, own: ParsedUtterance, asked: ParsedUtterance, home: KnownHome, state: DialogueState
    ) -> Selection | None:
        """What a reply picks of the names that the robot offered; None if it asks for something else."""
        answer, said = reply(clause, own, state.offered), " ".join(clause.tokens)
        if answer is None or answer.denied:
            return TURNED_DOWN if answer is not None else None
        if answer.picked:
            return self._picked(answer.picked, said, asked, home, state)
        need = state.before.need if state.before is not None else ""
        return self.needs.serve(f"{need}. {said}", home.listed, tuple(set(home.listed).difference(answer.rest)))

    def _picked(self, name: str, said: str, asked: ParsedUtterance, home: KnownHome, state: DialogueState) -> Selection:
        """An offered name that was chosen."""
        reason = f"'{shortened(said)}' means this one"
        chosen = Selection("found", name, reason=reason, candidates=((name, 1.0),), model=MODEL)
        return ReferenceGrounder(asked, home.scene, home.names, state, "").refined(chosen)

    def _with_tentative(self, chosen: Selection, asked: ParsedUtterance, home: KnownHome, wanted: bool) -> Selection:
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

    def _maybe_named(self, text: str, home: KnownHome) -> MapObject | None:
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
