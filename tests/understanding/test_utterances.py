"""Utterances over hand-made homes: what each asks for, and of which object (``tests/data/utterances.jsonl``)."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from homes import DATA, inventory

from cartier.contracts import Reasoner
from cartier.reasoners.embedded import make
from cartier.types import Selection

ROWS: list[dict[str, Any]] = [json.loads(line) for line in (DATA / "utterances.jsonl").read_text("utf-8").splitlines()]
INTENTS = Counter(row["intent"] for row in ROWS)


def parameters() -> list[Any]:
    return [
        pytest.param(
            row,
            id=f"{number}: {row['text']}",
            marks=[pytest.mark.xfail(reason=row["xfail"], strict=False, raises=AssertionError)]
            if "xfail" in row
            else [],
        )
        for number, row in enumerate(ROWS, 1)
    ]


@pytest.fixture(scope="module")
def embedded() -> Reasoner:
    return make()


@pytest.mark.parametrize("row", parameters())
def test_utterance(embedded: Reasoner, row: dict[str, Any]) -> None:
    home = inventory(row["home"])
    chosen = embedded.select(row["text"], home, [(person, robot) for person, robot in row.get("dialogue", ())])
    assert home.contains(chosen) and all(home.contains(need) for need in chosen.next)
    check(chosen, row)


def check(chosen: Selection, row: dict[str, Any]) -> None:
    fact, value, objects = chosen.fact, row.get("value"), set(row.get("objects", ()))
    then = row.get("then", [])
    assert len(chosen.next) == len(then), chosen
    for further, wanted in zip(chosen.next, then, strict=True):
        assert gives_no_goal(further) if wanted == "not_found" else further.object_id in wanted, further
    match row["intent"]:
        case "go":
            assert chosen.status == "found" and chosen.object_id in objects, chosen
        case "go room":
            assert chosen.status == "found" and chosen.room == value, chosen
        case "not_found":  # said outright, or in the question whether to look at the usual place
            told = f"{chosen.reason} {chosen.question}".lower()
            assert chosen.status in ("not_found", "clarify") and gives_no_goal(chosen), chosen
            assert chosen.status == "not_found" or "not seen" in told or f"no {row['target']}" in told, chosen
        case "clarify":
            assert chosen.status == "clarify" and (chosen.question or "").endswith("?"), chosen
        case "none":
            assert chosen.status == "answered" and fact is None and gives_no_goal(chosen) and chosen.text, chosen
        case "rooms":
            assert fact is not None and fact.kind == "list" and sorted(fact.value) == value, chosen
        case "describe":
            assert fact is not None and fact.kind == "tell" and fact.objects[0] in objects, chosen
            assert value is None or fact.value == (
                pytest.approx(value, abs=0.02) if value.__class__ is float else value
            )
        case "compare":
            assert fact is not None and fact.kind == "compare", chosen
            assert fact.objects[0] in objects if objects else fact.value is None, chosen
        case "list" if value == "everything":
            assert fact is not None and fact.kind == "list", chosen
            assert set(fact.objects) == {obj.id for obj in inventory(row["home"]).objects if obj.confirmed}
        case "list":
            assert fact is not None and fact.kind == "list" and set(fact.objects) == objects, chosen
        case kind:  # count, exists, where
            assert fact is not None and fact.kind == kind and chosen.status == "answered", chosen
            assert not objects or set(fact.objects) == objects, chosen
            assert fact.value == value if value is not None else kind == "where", chosen


def gives_no_goal(chosen: Selection) -> bool:
    return chosen.object_id is None and chosen.room is None and chosen.object is None


def test_rows_cover_what_is_asked() -> None:
    assert len(ROWS) >= 300
    expected = "go, go room, count, exists, where, list, compare, describe, rooms, clarify, not_found, none"
    assert set(INTENTS) == set(expected.split(", ")) and min(INTENTS.values()) >= 2
    assert max(Counter((r["home"], r["text"], str(r.get("dialogue"))) for r in ROWS).values()) == 1
    for row in ROWS:
        known = {obj.id for obj in inventory(row["home"]).objects}
        assert known >= set(row.get("objects", ())), row


def test_homes_are_what_they_say() -> None:
    for file in (Path(DATA / "flat.json"), Path(DATA / "house.json")):
        home = inventory(file.stem)
        assert len({obj.id for obj in home.objects}) == len(home.objects)
        rooms = {room.id for room in home.rooms}
        for obj in home.objects:
            assert obj.room in rooms
            assert all(low < high for low, high in zip(obj.box_min, obj.box_max, strict=True)), obj
