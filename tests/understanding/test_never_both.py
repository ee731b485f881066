"""Property: no typed query gets "there is none" for what the same answer, or the home, has; facts fit their words."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

from cartier.spatial.expressions import EntityVocabulary, Kind, ParsedUtterance, ReferringExpression, SpatialRelation
from cartier.spatial.query import Scene, called
from cartier.types import Inventory, Selection
from cartier.understanding.answers import answer
from cartier.understanding.dialogue_state import DialogueState
from cartier.understanding.grounding import ReferenceGrounder
from flat import FLAT, UNSURE_FLAT
from understanding.homes import inventory

HOMES = {"flat": FLAT, "unsure": UNSURE_FLAT, "names only": Inventory.of(FLAT.names), "stored": inventory("house")}
KINDS: tuple[Kind, ...] = (
    "go", "count", "exists", "where", "list", "compare", "far", "colour", "size", "when", "which",
)  # fmt: skip
RELATIONS = (
    "on", "in", "under", "above", "next to", "near", "nearest", "farthest", "left of", "with", "not on", "not in",
)  # fmt: skip
DRAWS = 400
NONE = re.compile(r"not seen (?:an?|any) ([^.]+)[.]")


def draws(scene: Scene, seed: int, count: int) -> Iterator[ParsedUtterance]:
    """Random typed queries about what is listed, and about a harp, which is nowhere."""
    rng = np.random.default_rng(seed)
    names = [*sorted({obj.label for obj in scene.objects}), "harp"]
    rooms = sorted(scene.rooms)

    def noun(deep: bool) -> ReferringExpression:
        name = str(rng.choice(names))
        relations = tuple(relation() for _ in range(int(rng.integers(0, 3)))) if deep else ()
        few = rng.random(5) < 0.25
        return ReferringExpression(
            name, frozenset({name}), plural=bool(rng.random() < 0.2), relations=relations,
            colours=(str(rng.choice(["red", "blue", "green"])),) if few[0] else (),
            size=str(rng.choice(["biggest", "smallest"])) if few[1] else "",
            most=str(rng.choice(["nearest", "tallest"])) if few[2] else "",
            order=int(rng.choice([1, 2, 3, -1])) if few[3] else 0, other=bool(few[4]),
        )  # fmt: skip

    def relation() -> SpatialRelation:
        kind = str(rng.choice(RELATIONS))
        room = ReferringExpression("room", rooms=(int(rng.choice(rooms)),)) if rooms and rng.random() < 0.3 else None
        return SpatialRelation(kind, room if room is not None and kind.endswith("in") else noun(False))

    for _ in range(count):
        kind = KINDS[int(rng.integers(len(KINDS)))]
        others = (noun(False),) if kind in ("compare", "far") else ()
        yield ParsedUtterance(kind, noun(True), others, by="biggest" if kind == "compare" else "")


def answered(asked: ParsedUtterance, scene: Scene) -> Selection | None:
    if asked.kind != "go":
        return answer(asked, scene, None, "test")
    names = EntityVocabulary({}, {})
    grounder = ReferenceGrounder(asked, scene, names, DialogueState(), "")
    return grounder.answer(lambda text, among: Selection("not_found", reason="test", model="test"))


@pytest.mark.parametrize("home", HOMES)
def test_no_answer_denies_what_is_there(home: str) -> None:
    scene = Scene(HOMES[home])
    told = 0
    for asked in draws(scene, seed=1, count=DRAWS):
        chosen = answered(asked, scene)
        if chosen is None:
            continue
        words = chosen.text or chosen.question or chosen.reason
        told += 1
        assert "  " not in words and not re.search(r" [.,;:?]", words), (words, asked)
        for denied in NONE.findall(words):
            assert not any(called(obj, [denied]) for obj in scene.objects), (words, asked)
        if chosen.object_id is not None:
            assert chosen.object_id in {obj.id for obj in HOMES[home].objects}, (words, asked)
    assert told > DRAWS / 2


@pytest.mark.parametrize("home", HOMES)
def test_facts_fit_their_words(home: str) -> None:
    scene = Scene(HOMES[home])
    kinds = set()
    for asked in draws(scene, seed=2, count=DRAWS):
        chosen = answered(asked, scene)
        if chosen is None or chosen.fact is None:
            continue
        fact = chosen.fact
        kinds.add(fact.kind)
        if fact.kind == "count":
            assert fact.value == len(fact.objects) and (fact.value == 0) == ("not seen" in chosen.text), chosen
        if fact.kind == "exists":
            assert fact.value == bool(fact.objects) == chosen.text.startswith("Yes"), chosen
        assert all(number in scene.by_id for number in fact.objects), chosen
    assert {"count", "exists", "where", "list", "compare"} <= kinds
