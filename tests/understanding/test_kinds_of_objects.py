"""Names of a home: which listed labels people's words mean."""

from __future__ import annotations

import pytest

from cartier.types import Inventory
from cartier.understanding.assembly import query
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.entity_vocabulary import lexicon
from route_talk import clauses_of


@pytest.mark.parametrize(
    ("said", "listed", "meant"),
    [
        ("dining table", "coffee table, side table", ""),
        ("dining table", "coffee table, table", "table"),
        ("dining table", "coffee table, dining table", "dining table"),
        ("table", "coffee table, side table", "coffee table, side table"),
        ("wooden table", "coffee table, side table", "coffee table, side table"),
        ("table", "coffee table, table", "table"),
        ("desk lamp", "floor lamp", ""),
        ("lamp", "floor lamp", "floor lamp"),
        ("reading lamp", "floor lamp", "floor lamp"),
    ],
)
def test_a_kind_of_object_is_no_other_kind(said: str, listed: str, meant: str) -> None:
    names = listed.split(", ")
    (clause,) = clauses_of("go", f"to the [{said}:t]")[1]
    head = query(clause, lexicon(read_deck(SHIPPED), Inventory.of(names))).head
    assert head is not None and sorted(head.labels) == sorted(filter(None, meant.split(", ")))
    assert meant or not head.similar
