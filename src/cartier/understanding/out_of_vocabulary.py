"""What a person asks for by a name that the detector of their home does not have: it could never be in the list."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.labels import display_name
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.utterance import listen, mentions


def out_of_vocabulary_mention(query: str, names: Sequence[str]) -> str | None:
    """The household thing named first in the last sentence with one, as it was said, of which none of a detector's ``names`` is a name; None if all are known.

    What another thing is named after is not what is asked for: the coffee, where a coffee machine is named.
    """
    deck = read_deck(SHIPPED)
    known = {deck.card_of(display_name(name)) for name in names}
    wanted = [m for m in mentions(listen(query), deck.by_key) if not m.unwanted]
    own = [m for m in wanted if not any(set(m.said.split()) < set(other.said.split()) for other in wanted)]
    said = [m for m in own if deck.by_key[m.key] not in known]
    return max(said, key=lambda mention: mention.last).said if said else None
