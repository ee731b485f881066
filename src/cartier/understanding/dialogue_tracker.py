"""Dialogue tracker: the clauses of what a person says, and the dialogue state that the turns before leave.

Each turn is parsed once (``parser.py``) and its parse kept: every request of a conversation reads all turns before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance
from cartier.spatial.query import Scene, is_door
from cartier.types import Inventory
from cartier.understanding.answers import listed_in, spoken_of
from cartier.understanding.assembly import query as query_of
from cartier.understanding.choices import chosen, options
from cartier.understanding.dialogue_state import SERVED, DialogueState, again, named, resolve
from cartier.understanding.parser import parser
from cartier.understanding.readings import UNSURE, picked
from cartier.understanding.tags import NOUNS, REQUESTS, Clause
from cartier.understanding.utterance import Utterance

LATEST = 3000  # characters at the end of a text that are read
PARSED = 64  # turns whose parse is kept
LEAST_CERTAIN, SURE_ALONE = 0.7, 0.9  # of an act in the context of the turn before, and of one without


class KnownHome:
    """An inventory with the names that may be used for what is in it."""

    def __init__(self, inventory: Inventory, names: EntityVocabulary) -> None:
        self.scene, self.names, self.listed = Scene(inventory), names, tuple(inventory.names)
        self.rules = inventory.rules


class DialogueTracker:
    """Reads turns; ``hear`` gives the tokens of a text."""

    def __init__(self, hear: Callable[[str], Utterance]) -> None:
        self._hear = hear
        self.parsed = lru_cache(maxsize=PARSED)(self._parsed)

    def clauses(self, query: str, before: Sequence[tuple[str, str]], home: KnownHome) -> tuple[Clause, ...]:
        """The clauses of a text said after the last of some (person, robot) turns."""
        turn = (before[-1][0][-LATEST:], before[-1][1][-LATEST:]) if before else None
        return self.parsed(query[-LATEST:], turn, home.names)

    def meant(self, query: str, dialogue: Sequence[tuple[str, str]], home: KnownHome) -> tuple[Clause, ...]:
        """The clauses of a text; those of the words before, where it picks one of their two readings."""
        clauses = self.clauses(query, dialogue[-1:], home)
        if not (dialogue and dialogue[-1][1].startswith(UNSURE) and clauses):
            return clauses
        earlier = self.clauses(dialogue[-1][0], dialogue[-2:-1], home)
        alone = self.clauses(query, (), home)  # after a question, the parser takes all for a choice of objects
        reading = picked(alone[0], min(earlier, key=lambda clause: clause.certainty)) if earlier else None
        return clauses if reading is None else (reading,)

    def afresh(
        self, query: str, clauses: tuple[Clause, ...], home: KnownHome, state: DialogueState
    ) -> tuple[Clause, ...]:
        """The clauses, read without the turn before where that makes a surer request of them: where they answer its
        question with none of its choices, or where only they alone name an object."""
        if state == DialogueState() or len(clauses) != 1 or clauses[0].act in ("correct", "another", "confirm", "deny"):
            return clauses
        clause = clauses[0]
        own = query_of(clause, home.names)
        if clause.act == "choose":
            unlike = bool(state.choices) and picked_choice(clause, own, state) is None
        else:
            nouns = [span.role for span in clause.spans if span.role in NOUNS]
            unlike = "p" not in nouns and (clause.certainty < LEAST_CERTAIN or not nouns)
        alone = self.clauses(query, (), home) if unlike else ()
        if len(alone) != 1 or alone[0].act not in REQUESTS or alone[0].certainty < SURE_ALONE:
            return clauses
        head = query_of(alone[0], home.names).head
        named = head is not None and bool(head.labels or is_door(head))
        return alone if named or alone[0].act == "need" else clauses

    def state(self, dialogue: Sequence[tuple[str, str]], home: KnownHome) -> DialogueState:
        """What the turns before leave to refer to."""
        state = DialogueState()
        for k, (person, robot) in enumerate(dialogue):
            clauses = self.clauses(person, dialogue[k - 1 : k] if k else (), home)
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

    def _choices(self, robot: str, asked: ParsedUtterance | None, home: KnownHome) -> tuple[tuple[str, int], ...]:
        """The objects that the robot asked about, in the order of its words."""
        found: dict[int, str] = {}
        before = asked.head if asked is not None else None
        for words in options(robot) if before is not None else ():
            clauses = self.clauses(words, (), home)
            if before is not None and clauses:
                option = query_of(clauses[0], home.names).head
                named = option if option is not None and option.labels - before.labels else again(before, option)
                there, _ = home.scene.meant(named, found)
                found |= {there[0].id: words} if there else {}
        return tuple((words, obj) for obj, words in found.items())

    def _parsed(self, query: str, turn: tuple[str, str] | None, names: EntityVocabulary) -> tuple[Clause, ...]:
        return tuple(parser()(self._hear(query).tokens, turn, names))


def picked_choice(clause: Clause, own: ParsedUtterance, state: DialogueState) -> int | None:
    """The object that a reply picks of those that the robot asked about; None if it asks for something else."""
    before = state.before.head if state.before is not None else None
    other = own.head is not None and before is not None and own.head.labels and not own.head.labels & before.labels
    return None if other and clause.act != "choose" else chosen(clause, state.choices)
