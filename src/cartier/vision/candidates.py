"""Candidate objects of a visual question: what its noun phrase may mean in a home, by the parser and the list."""

from __future__ import annotations

from cartier.spatial.expressions import ReferringExpression
from cartier.spatial.query import Scene
from cartier.types import Inventory, MapObject, Selection
from cartier.understanding.assembly import query
from cartier.understanding.cards import Deck
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.parser import parser
from cartier.understanding.utterance import listen
from cartier.vision.attributes import Asked

WEAK_LABEL = 0.5
"""The share of the evidence for an object's label below which it is doubtful what the object is."""


def meant(asked: Asked, inventory: Inventory, deck: Deck) -> list[MapObject]:
    """The confirmed objects that the noun phrase of a question may mean, the nearest first; none if it names none."""
    head = _phrase(asked, inventory, deck)
    return Scene(inventory).meant(head)[0] if head is not None and (head.labels or head.similar) else []


def passages(asked: Asked, inventory: Inventory, deck: Deck, shut: bool = False) -> list[tuple[int, int]]:
    """The passages of the floor plan that the noun phrase may mean, each by the ids of the rooms that it joins; with
    ``shut`` those that are shut by now."""
    head = _phrase(asked, inventory, deck)
    return [] if head is None else [door.rooms for door in Scene(inventory).doors(head, shut)]


def _phrase(asked: Asked, inventory: Inventory, deck: Deck) -> ReferringExpression | None:
    """The noun phrase as the parser reads it."""
    names = lexicon(deck, inventory)
    clauses = parser()(listen(f"go to {asked.noun}").tokens, None, names)
    return query(clauses[0], names).head if clauses else None


def doubtful(selection: Selection, inventory: Inventory) -> MapObject | None:
    """The object that a choice rests on, if it is tentative or if it is unclear what it is; else None."""
    number = selection.tentative if selection.tentative is not None else selection.object_id
    if selection.status not in ("found", "clarify") or number is None:
        return None
    obj = next((obj for obj in inventory.objects if obj.id == number), None)
    if obj is None or obj.by_person:
        return None
    return None if obj.confirmed and clear_label(obj) else obj


def clear_label(obj: MapObject, share: float = WEAK_LABEL) -> bool:
    """Whether an object's label has a share of the evidence for its labels; with no evidence it is clear."""
    total = sum(weight for _, weight in obj.labels)
    own = sum(weight for label, weight in obj.labels if label == obj.label)
    return total <= 0 or own / total >= share
