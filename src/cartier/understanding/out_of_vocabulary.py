"""Mentions outside the detector's vocabulary: objects that a person asks for and that the list can never hold."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.labels import display_name
from cartier.understanding.cards import Deck
from cartier.understanding.utterance import listen, mentions


def out_of_vocabulary_mention(query: str, names: Sequence[str], deck: Deck) -> str | None:
    """The household object that the words ask for, if none of a detector's ``names`` covers it, else None.

    It is given in the person's words, from the last sentence that names one. A name inside another one does not count:
    the coffee, where a coffee machine is named.
    """
    known = {deck.card_of(display_name(name)) for name in names}
    wanted = [m for m in mentions(listen(query), deck.by_key) if not m.unwanted]
    own = [m for m in wanted if not any(set(m.said.split()) < set(other.said.split()) for other in wanted)]
    said = [m for m in own if deck.by_key[m.key] not in known]
    return max(said, key=lambda mention: mention.last).said if said else None
