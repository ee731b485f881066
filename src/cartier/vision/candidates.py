"""Candidate objects of a visual question: what its noun phrase may mean in a home, by the parser and the list."""

from __future__ import annotations

from cartier.spatial.query import Scene
from cartier.types import Inventory, MapObject, Selection
from cartier.understanding.assembly import query
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.parser import parser
from cartier.understanding.utterance import listen
from cartier.vision.attributes import Asked

WEAK_LABEL = 0.5
"""The share of the evidence for an object's label below which it is doubtful what the object is."""


def meant(asked: Asked, inventory: Inventory) -> list[MapObject]:
    """The confirmed objects that the noun phrase of a question may mean, the nearest first; none if it names none."""
    scene, names = Scene(inventory), lexicon(read_deck(SHIPPED), inventory)
    for clause in parser()(listen(f"go to {asked.noun}").tokens, None, names)[:1]:
        head = query(clause, names).head
        if head is not None and (head.labels or head.similar):
            return scene.meant(head)[0]
    return []


def doubtful(selection: Selection, inventory: Inventory) -> MapObject | None:
    """The object that a choice rests on, if it is tentative or if it is unclear what it is; else None."""
    number = selection.tentative if selection.tentative is not None else selection.object_id
    if selection.status not in ("found", "clarify") or number is None:
        return None
    obj = next((obj for obj in inventory.objects if obj.id == number), None)
    if obj is None or obj.by_person:
        return None
    total = sum(weight for _, weight in obj.labels)
    own = sum(weight for label, weight in obj.labels if label == obj.label)
    return obj if not obj.confirmed or (total > 0 and own / total < WEAK_LABEL) else None
