"""The memory of a bench: it tells homes apart that have the same names, and gives back all of an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cartier.types import Fact, Inventory, Selection
from cartier_bench.asked import Asked
from flat import FLAT, OBJECTS

CHOSEN = Selection(
    "answered", "cup", "counted", candidates=(("cup", 1.0),), object_id=12, text="Three.",
    fact=Fact("count", 3, (12, 14, 15)), next=(Selection("found", "kitchen", "asked for", room=0),),
)  # fmt: skip


class Counting:
    name = "counting (test)"
    calls = tokens = 0

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        self.calls += 1
        return CHOSEN

    def propose(self, query: str) -> list[str]:
        return []


def test_an_answer_comes_back_as_it_was_in_another_process(tmp_path: Path) -> None:
    reasoner = Counting()
    assert Asked(reasoner, tmp_path / "asked.jsonl").select("how many cups?", FLAT) == CHOSEN
    again = Asked(reasoner, tmp_path / "asked.jsonl")
    assert again.select("how many cups?", FLAT) == CHOSEN and reasoner.calls == 1


def test_the_same_names_are_not_the_same_home(tmp_path: Path) -> None:
    """An object's number means nothing in another home."""
    reasoner = Counting()
    memory = Asked(reasoner, tmp_path / "asked.jsonl")
    moved = (replace(OBJECTS[0], position=(5.0, 5.0, 0.5)), *OBJECTS[1:])
    others = [
        replace(FLAT, objects=moved),
        replace(FLAT, rooms=()),
        replace(FLAT, from_xy=(9.0, 9.0)),
        Inventory.of(FLAT.names),
    ]
    for inventory in (FLAT, *others, FLAT):
        memory.select("how many cups?", inventory)
    assert reasoner.calls == 5
