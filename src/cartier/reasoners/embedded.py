"""Embedded reasoner: knowledge cards, the shipped text encoder and learned parts; no key, no network, no GPU.

The words are parsed once (``understanding/parser.py``). What they name is resolved exactly over the home
(``grounding.py``); what names nothing is a need, which cards and scorer serve (``needs.py``). ``docs/embedded.md``
reports the accuracy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cartier.types import Inventory, Selection
from cartier.understanding.cards import SHIPPED, Deck, read_deck
from cartier.understanding.clause_executor import TURNED_DOWN, ClauseExecutor
from cartier.understanding.dialogue_state import DialogueState, in_context
from cartier.understanding.dialogue_tracker import LATEST, DialogueTracker, KnownHome
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.grounding import MODEL
from cartier.understanding.need_scorer import Scorer
from cartier.understanding.needs import Needs
from cartier.understanding.tags import NOTHING_ASKED, ROUTING, Clause
from cartier.understanding.tentative import OFFER
from cartier.vision import pixels

MOST_NEEDS = 4  # most needs in one utterance
A_NEED = Clause("need", 1.0, (), ())


def make(cards: str | Path = SHIPPED) -> Embedded:
    """The reasoner over a card file or a folder of them: the ones shipped, or your own in the same form."""
    return Embedded(read_deck(Path(cards)))


class Embedded:
    """Reads the words once, then answers each clause: a query over the home, or a need by cards and scorer."""

    def __init__(self, deck: Deck, scorer: Scorer | None = None) -> None:
        self.name = MODEL
        self.deck, self.needs = deck, Needs(deck, scorer)
        self.tracker = DialogueTracker(lambda text: self.needs.scorer.hear(text))
        self._executor = ClauseExecutor(self.needs)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The listed object that serves the words in the context of the dialogue; ``next`` holds further needs."""
        if not inventory.names:
            return Selection("not_found", reason="nothing was detected in this home", model=MODEL)
        home = KnownHome(inventory, lexicon(self.deck, inventory))
        state = self.tracker.state(dialogue, home)
        if (by_looks := pixels.answer(query[-LATEST:], inventory, state.last, MODEL, self.deck)) is not None:
            return by_looks
        clauses = self.tracker.meant(query, dialogue, home)
        if dialogue and dialogue[-1][1].endswith(OFFER) and clauses:
            act = in_context(clauses[0], state).act
            if act in ("confirm", "deny"):
                return TURNED_DOWN if act == "deny" else self._anyway(dialogue, home)
        clauses = self.tracker.afresh(query, clauses, home, state)
        found: list[Selection] = []
        for clause in clauses[:MOST_NEEDS] or [A_NEED]:
            chosen, asked = self._executor.execute(clause, home, state, query)
            found.append(chosen)
            served = [home.scene.by_id[chosen.object_id]] if chosen.object_id in home.scene.by_id else []
            state = state.then(asked, served)
        first, *rest = found
        return replace(pixels.unchecked(query[-LATEST:], first), next=tuple(rest))

    def propose(self, query: str) -> list[str]:
        """The names of up to five cards that serve the words, best first; none if no household object serves them."""
        clauses = self.tracker.parsed(query[-LATEST:], None, lexicon(self.deck, Inventory.of(())))
        if all(in_context(clause, DialogueState()).act in (*NOTHING_ASKED, *ROUTING) for clause in clauses):
            return []
        return self.needs.propose(query)

    def _anyway(self, dialogue: Sequence[tuple[str, str]], home: KnownHome) -> Selection:
        """The offered object, once the person accepts it."""
        state = self.tracker.state(dialogue[:-1], home)
        clauses = self.tracker.clauses(dialogue[-1][0], dialogue[-2:-1], home) or (A_NEED,)
        return self._executor.answer(clauses[-1], home, state, wanted=True)[0]
