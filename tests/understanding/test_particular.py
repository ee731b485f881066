"""References and questions over a made-up flat: which one, where, how many, and what nobody can say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cartier import plugins
from cartier.contracts import Reasoner
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression
from cartier.types import Inventory, Selection
from cartier.understanding.dialogue_state import DialogueState, resolve
from flat import UNSURE_FLAT as FLAT
from flat import obj

SINK_CUP, TABLE_CUP, BED_CUP = 14, 12, 15


@pytest.fixture(scope="module")
def embedded() -> Reasoner:
    made: Reasoner = plugins.make("reasoners", "embedded")
    return made


def ask(reasoner: Reasoner, words: str, *turns: tuple[str, str]) -> Selection:
    chosen = reasoner.select(words, FLAT, turns)
    assert FLAT.contains(chosen) and all(FLAT.contains(need) for need in chosen.next)
    return chosen


@pytest.mark.parametrize(
    ("words", "number"),
    [
        ("bring me the cup by the sink", SINK_CUP),
        ("the cup on the table, please", TABLE_CUP),
        ("Could you fetch me the red cup?", SINK_CUP),
        ("I need the cup closest to the bed", BED_CUP),
        ("take me to the farthest cup", BED_CUP),
        ("the nearest cup", TABLE_CUP),
        ("go to the cup that's next to the sink", SINK_CUP),
    ],
)
def test_the_very_thing_is_found(embedded: Reasoner, words: str, number: int) -> None:
    chosen = ask(embedded, words)
    assert (chosen.status, chosen.object, chosen.object_id) == ("found", "cup", number)


def test_a_bare_name_of_several_is_the_nearest_and_says_so(embedded: Reasoner) -> None:
    chosen = ask(embedded, "bring me to the cup")
    assert chosen.object_id == TABLE_CUP and "nearest" in chosen.text and "There are 3" in chosen.text


@pytest.mark.parametrize(
    ("words", "number"),
    [("no, the other one by the sink", SINK_CUP), ("the red one", SINK_CUP), ("the one closest to the bed", BED_CUP)],
)
def test_what_follows_is_understood_by_what_was_served(embedded: Reasoner, words: str, number: int) -> None:
    assert ask(embedded, words, ("bring me to the cup", f"cup #{TABLE_CUP}")).object_id == number


@pytest.mark.parametrize("words", ["no, another one", "the other one", "not that one", "a different one, please"])
@pytest.mark.parametrize("before", ["bring me the red cup", "the cup by the sink", "the cup farthest from the bed"])
def test_another_one_need_not_be_as_the_first_one_was(embedded: Reasoner, before: str, words: str) -> None:
    first = ask(embedded, before).object_id
    chosen = ask(embedded, words, (before, f"cup #{first}"))
    assert chosen.object_id in {SINK_CUP, TABLE_CUP, BED_CUP} - {first}, chosen


def test_what_is_said_of_another_one_is_meant() -> None:
    red = ReferringExpression("cup", frozenset({"cup"}), colours=("red",))
    state = DialogueState(before=ParsedUtterance("go", red))
    for one, recalled in ((ReferringExpression("one", generic=True), True), (replace(red, labels=frozenset()), False)):
        head = resolve(ParsedUtterance("another", one), state).head
        assert head is not None and head.other and head.colours == ("red",) and head.recalled is recalled


def test_one_that_is_not_there_is_not_replaced(embedded: Reasoner) -> None:
    chosen = ask(embedded, "bring me the cup under the bed")
    assert chosen.status == "not_found" and "none as you say" in chosen.text
    assert ask(embedded, "drive to the washing machine").status != "found"


@pytest.mark.parametrize(
    ("words", "kind", "value"),
    [
        ("how many cups are there?", "count", 3),
        ("how many cups are in the kitchen?", "count", 2),
        ("is there a cup on the table?", "exists", True),
        ("is there a piano?", "exists", False),
        ("do we have any vases?", "exists", False),
        ("what is on the table?", "list", ["cup"]),
        ("where is the sink?", "where", "kitchen"),
        ("which room is the table in?", "where", "kitchen"),
        ("which is bigger, the bed or the cup?", "compare", "bed"),
        ("is the sink or the bed nearer to the table?", "compare", "sink"),
        ("what colour is the table?", "tell", "brown"),
    ],
)
def test_questions_get_words_and_no_goal(embedded: Reasoner, words: str, kind: str, value: Any) -> None:
    chosen = ask(embedded, words)
    assert chosen.status == "answered" and chosen.text and chosen.fact is not None
    assert (chosen.fact.kind, chosen.fact.value) == (kind, value)


def test_a_room_is_a_goal(embedded: Reasoner) -> None:
    chosen = ask(embedded, "go to the kitchen")
    assert (chosen.status, chosen.object, chosen.room) == ("found", "kitchen", 0)
    assert ask(embedded, "take me to the garage").room is None


@pytest.mark.parametrize("words", ["stop", "never mind", "come here", "don't bring me the cup by the sink"])
def test_what_is_no_request_gets_words(embedded: Reasoner, words: str) -> None:
    chosen = ask(embedded, words)
    assert chosen.status == "answered" and chosen.object is None and chosen.text


def test_what_was_seen_too_seldom_is_offered_and_served_to_who_says_yes(embedded: Reasoner) -> None:
    offered = ask(embedded, "bring me the vase")
    assert (offered.status, offered.object) == ("clarify", None) and "may have seen a vase" in str(offered.question)
    before = ("bring me the vase", str(offered.question))
    chosen = ask(embedded, "yes please", before)
    assert (chosen.status, chosen.object, chosen.object_id) == ("found", "vase", 32)
    assert ask(embedded, "no", before).status == "answered"
    assert ask(embedded, "no, the sink", before).object == "sink"


def test_request_is_evidence_for_what_it_names(embedded: Reasoner) -> None:
    chosen = ask(embedded, "bring me the key chain")
    assert (chosen.status, chosen.object_id) == ("found", 33) and chosen.text.startswith("I think I saw a key chain")
    assert chosen.candidates == (("key chain", 0.794),), "the certainty is that of an object once it is asked for"


@pytest.mark.parametrize(
    ("words", "probability", "number"),
    [
        ("I'm tired, I'd like to lie down on the sofa", 0.5, 40),
        ("I'm tired, I'd like to lie down on the sofa", 0.1, 20),
        ("I'm tired, I'd like to lie down", 0.5, 20),
        ("I'm tired, I'd like to lie down, but not on the sofa", 0.5, 20),
    ],
)
def test_need_that_names_what_is_likely_there_goes_to_it(
    embedded: Reasoner, words: str, probability: float, number: int
) -> None:
    sofa = obj(40, "sofa", (6.0, 3.0, 0.4), (2.0, 0.9, 0.8), 1, probability=probability)
    chosen = embedded.select(words, Inventory((*FLAT.objects, sofa), FLAT.rooms, from_xy=(0.0, 0.0)))
    assert chosen.status == "found" and (chosen.object_id or chosen.object) in (number, "bed" if number == 20 else "")


@pytest.mark.parametrize("words", ["where are my keys?", "is there a key chain?", "where is the vase?"])
def test_question_tells_what_may_be_there(embedded: Reasoner, words: str) -> None:
    told = ask(embedded, words)
    assert told.status == "answered" and "I may have seen" in told.text and told.text.endswith("I am not sure.")
    assert told.fact is not None and not told.fact.objects


def test_a_verb_at_the_beginning_is_no_name(embedded: Reasoner) -> None:
    assert ask(embedded, "Light the way to the sink").object == "sink"
