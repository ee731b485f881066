"""Conversations with the embedded reasoner: replies to its questions, corrections, and several needs in one breath."""

from __future__ import annotations

import pytest
from held_out import COCO, THOR
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.reasoners import embedded
from cartier.types import Inventory
from cartier.understanding.dialogue_state import named

ASKED = [("I need to cut this string", "Do you mean the knife or the scissors?")]
NAMES = ["knife", "scissors", "sofa", "coffee table", "kettle", "coffee machine"]


@pytest.fixture(scope="module")
def reasoner() -> embedded.Embedded:
    return embedded.make()


@pytest.mark.parametrize(
    ("reply", "expected"),
    [
        ("the scissors", "scissors"),
        ("not the knife, it's dirty", "scissors"),
        ("the first", "knife"),
        ("the first one, please", "knife"),
        ("the second one", "scissors"),
        ("the latter", "scissors"),
        ("knife please", "knife"),
        ("either will do", "knife"),
    ],
)
def test_the_reply_to_a_question(reasoner: embedded.Embedded, reply: str, expected: str) -> None:
    chosen = reasoner.select(reply, Inventory.of(NAMES), ASKED)
    assert (chosen.status, chosen.object) == ("found", expected), chosen


def test_a_reply_that_tells_the_need(reasoner: embedded.Embedded) -> None:
    dialogue = [("something hot to drink", "Do you mean the kettle or the coffee machine?")]
    assert reasoner.select("tea please", Inventory.of(NAMES), dialogue).object == "kettle"
    assert reasoner.select("espresso, please", Inventory.of(NAMES), dialogue).object == "coffee machine"
    assert (
        reasoner.select("a cup of tea, please", Inventory.of(COCO), [("Hello", "What do you need?")]).object is not None
    )


def test_a_bare_name_that_tells_the_need(reasoner: embedded.Embedded) -> None:
    dialogue = [("something hot to drink", "Do you mean the kettle or the coffee machine?")]
    assert reasoner.select("an espresso", Inventory.of(NAMES), dialogue).object == "coffee machine"


def test_a_reply_by_something_in_the_name(reasoner: embedded.Embedded) -> None:
    names = ["big towel", "small towel", "sink"]
    dialogue = [("I need a towel", "Do you mean the big towel or the small towel?")]
    assert reasoner.select("the big one", Inventory.of(names), dialogue).object == "big towel"
    assert reasoner.select("the small one", Inventory.of(names), dialogue).object == "small towel"


@pytest.mark.parametrize("no", ["no, the other one", "the other one", "No. The other!"])
def test_the_other_of_two(reasoner: embedded.Embedded, no: str) -> None:
    dialogue = [*ASKED, ("the first", "knife")]
    assert reasoner.select(no, Inventory.of(NAMES), dialogue).object == "scissors"


@pytest.mark.parametrize("no", ["no", "not that one", "something else please", "no, not the sofa"])
def test_what_was_turned_down_is_not_offered_again(reasoner: embedded.Embedded, no: str) -> None:
    names = ["sofa", "armchair", "knife", "toilet paper"]
    chosen = reasoner.select(no, Inventory.of(names), [("I want to sit down comfortably", "sofa")])
    assert chosen.object == "armchair", chosen


def test_a_correction_names_what_was_meant(reasoner: embedded.Embedded) -> None:
    dialogue = [("take me to the table", "coffee table")]
    assert reasoner.select("no, I meant the sofa", Inventory.of(NAMES), dialogue).object == "sofa"


def test_a_new_need_is_not_read_into_the_old_one(reasoner: embedded.Embedded) -> None:
    dialogue = [("my feet hurt, I want to sit down", "couch")]
    assert reasoner.select("Now I'd like to warm up my lunch", Inventory.of(COCO), dialogue).object == "microwave"


def test_several_needs_come_in_order(reasoner: embedded.Embedded) -> None:
    chosen = reasoner.select("Put these dirty clothes in the hamper, then bring me to the bed", Inventory.of(THOR))
    assert chosen.object == "laundry hamper" and [part.object for part in chosen.next] == ["bed"]
    assert reasoner.select("I want a soak in the tub", Inventory.of(THOR)).next == ()


def test_next_to_is_a_place_and_no_second_need(reasoner: embedded.Embedded) -> None:
    chosen = reasoner.select(
        "Put yourself next to the kettle and wait there.", Inventory.of(["armchair", "bed", "kettle"])
    )
    assert chosen.object == "kettle" and not chosen.next


def test_a_part_that_nothing_serves_does_not_split_a_request(reasoner: embedded.Embedded) -> None:
    chosen = reasoner.select(
        "I was at the market, then it rained, and now I want to sleep in my bed", Inventory.of(THOR)
    )
    assert chosen.object in ("bed", "pillow") and chosen.next == ()


def test_names_in_a_turn_are_found_longest_first() -> None:
    assert named("Do you mean the coffee machine or the sofas?", ["coffee", "sofa", "coffee machine"]) == [
        "coffee machine",
        "sofa",
    ]


@settings(max_examples=40, deadline=None)
@given(query=st.text(max_size=60), robot=st.text(max_size=60), person=st.text(max_size=60))
def test_no_words_break_the_understanding(reasoner: embedded.Embedded, query: str, robot: str, person: str) -> None:
    home = Inventory.of(NAMES)
    chosen = reasoner.select(query, home, [(person, robot), (robot, person + "?")])
    assert all(part.object is None or part.object in NAMES for part in (chosen, *chosen.next))
