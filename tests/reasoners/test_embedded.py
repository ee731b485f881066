"""The embedded reasoner: what it must answer, and how good it is on requests it was not trained on.

To see every miss: ``pytest -s -k held_out``.
"""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Sequence

import pytest
from held_out import COCO, HELD_OUT, LVIS, THOR
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.reasoners import embedded
from cartier.types import Inventory, Selection
from flat import FLAT

FLOORS = {"explicit": 0.95, "implicit": 0.70, "conversational": 0.80, "absent": 0.70}
"""Under what was measured after tuning on other requests: 20/20, 19/26, 18/21, 6/8."""


@pytest.fixture(scope="module")
def reasoner() -> embedded.Embedded:
    return embedded.make()


def test_held_out_accuracy(reasoner: embedded.Embedded) -> None:
    right, asked = Counter[str](), Counter[str]()
    for kind, objects, query, expected in HELD_OUT:
        chosen = reasoner.select(query, Inventory.of(objects))
        good = chosen.object in expected.split("|") if expected else chosen.object is None
        asked[kind] += 1
        right[kind] += good
        if not good:
            got = f"{chosen.status} {chosen.object}: {chosen.reason}"
            print(f"{kind}: {query!r}: wanted {expected or 'nothing'}, got {got}")
    accuracy = {kind: right[kind] / asked[kind] for kind in asked}
    print(dict(right), dict(asked))
    assert sum(asked.values()) >= 60 and all(25 <= len(objects) <= 40 for _, objects, _, _ in HELD_OUT)
    assert all(accuracy[kind] >= floor for kind, floor in FLOORS.items()), accuracy


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("My feet hurt, I'd love to sit down for a minute", "chair"),
        ("I am so thirsty", "cup|bottle|refrigerator"),
        ("could you get me something to drink out of", "cup|bottle|wine glass"),
        ("something to read", "book"),
        ("my hands are sticky, I need to wash them", "sink"),
        ("take me to the fridge", "refrigerator"),
        ("not the knife, bring me the fork", "fork"),
        ("I don't want the couch, take me to the chair", "chair"),
        ("the chair is broken, I need to sit", "couch"),
    ],
)
def test_answers_over_a_kitchen_of_coco_names(reasoner: embedded.Embedded, query: str, expected: str) -> None:
    chosen = reasoner.select(query, Inventory.of(COCO))
    assert chosen.status == "found" and chosen.object in expected.split("|"), chosen


@pytest.mark.parametrize("objects", [COCO, THOR, LVIS])
def test_no_home_has_a_boarding_gate(reasoner: embedded.Embedded, objects: list[str]) -> None:
    chosen = reasoner.select("Where is the boarding gate for my flight?", Inventory.of(objects))
    assert chosen.object is None and chosen.status == "answered"


def test_the_papers_rambling_request_wants_coffee_only_where_there_is_a_machine(reasoner: embedded.Embedded) -> None:
    query = "I have so much work tonight... I am getting really sleepy... we better do something about that"
    assert reasoner.select(query, Inventory.of(THOR)).object == "coffee machine"
    assert reasoner.select(query, Inventory.of([o for o in THOR if o != "coffee machine"])).object != "coffee machine"


def test_the_reason_names_the_words_and_the_phrase(reasoner: embedded.Embedded) -> None:
    assert (
        reasoner.select("My feet hurt so much", Inventory.of(["chair", "cup"])).reason
        == "a chair serves 'my feet hurt so much'"
    )
    assert reasoner.select("bring me the cup", Inventory.of(["chair", "cup"])).reason == "'cup' was asked for by name"


def test_a_thing_that_is_not_there_is_not_replaced(reasoner: embedded.Embedded) -> None:
    """A fork is no bed."""
    assert reasoner.select("bring me the fork", Inventory.of(["toilet", "bed", "cup"])).status == "not_found"
    assert reasoner.select("take me to the flux capacitor", Inventory.of(THOR)).status == "not_found"


def offered_and_wanted(reasoner: embedded.Embedded, query: str, objects: Sequence[str]) -> Selection:
    """What is served to who says yes to an offer to look."""
    offer = reasoner.select(query, Inventory.of(objects))
    assert offer.status == "clarify" and offer.object is None and offer.question is not None
    assert reasoner.select("no", Inventory.of(objects), [(query, offer.question)]).status == "answered"
    return reasoner.select("yes, please", Inventory.of(objects), [(query, offer.question)])


def test_a_thing_that_is_not_there_is_near_what_it_is_kept_beside(reasoner: embedded.Embedded) -> None:
    """The tamper of the paper's coffee machine."""
    near = offered_and_wanted(reasoner, "where is the coffee tamper?", THOR)
    assert (near.status, near.object) == ("likely_near", "coffee machine") and "tamper" in near.reason
    assert reasoner.select("where is the coffee tamper?", Inventory.of(["bed", "toilet"])).status == "not_found"


@pytest.mark.parametrize(
    ("query", "objects", "near"),
    [
        ("We want to fry two eggs, sunny side up.", ["bed", "stove burner", "sofa", "floor lamp"], "stove burner"),
    ],
)
def test_a_need_that_nothing_listed_serves_is_not_met_by_what_is_of_another_kind(
    reasoner: embedded.Embedded, query: str, objects: list[str], near: str
) -> None:
    assert reasoner.select(query, Inventory.of(objects)).object == near
    assert reasoner.select(query, Inventory.of(["bed", "sofa"])).status == "not_found"


@pytest.mark.parametrize(
    "query", ["Where is the key chain?", "the apple, please", "find the umbrella please, it's raining"]
)
def test_a_thing_asked_for_by_name_is_not_replaced_by_one_that_is_not_like_it(
    reasoner: embedded.Embedded, query: str
) -> None:
    home = ["watch", "safe", "light switch", "egg", "stool", "house plant", "bed"]
    chosen = reasoner.select(query, Inventory.of(home))
    assert chosen.status in ("not_found", "answered") and chosen.object is None


@pytest.mark.parametrize(
    ("query", "objects", "twin"),
    [
        ("Bring me to the frying pan.", ["egg", "stove burner", "pan", "bed"], "pan"),
        ("Go to the hand towel holder.", ["towel rack", "sink", "bed"], "towel rack"),
        ("bring me the kettle", ["bed", "water boiler", "sink"], "water boiler"),
    ],
)
def test_what_is_much_the_same_stands_in(
    reasoner: embedded.Embedded, query: str, objects: list[str], twin: str
) -> None:
    chosen = reasoner.select(query, Inventory.of(objects))
    assert (chosen.status, chosen.object) == ("found", twin)


def test_either_of_two_that_were_named_serves(reasoner: embedded.Embedded) -> None:
    either = reasoner.select("bring me the cup or the bowl", Inventory.of(["bowl", "cup", "bed"]))
    assert either.object in ("bowl", "cup")
    assert reasoner.select("I need to sit down", Inventory.of(["armchair", "bench", "stool", "cup"])).status == "found"


@pytest.mark.parametrize("nothing", ["", "   ", "hello there, could you help me please?", "?!"])
def test_nothing_said_is_asked_about(reasoner: embedded.Embedded, nothing: str) -> None:
    chosen = reasoner.select(nothing, Inventory.of(COCO))
    assert chosen.status == "clarify" and chosen.question == "What do you need?"


def test_the_reply_to_a_question_is_read_in_its_context(reasoner: embedded.Embedded) -> None:
    dialogue = [("I need to cut this string", "Do you mean the knife or the scissors?")]
    assert reasoner.select("the scissors", Inventory.of(["knife", "scissors"]), dialogue).object == "scissors"
    assert (
        reasoner.select("not the knife, it's dirty", Inventory.of(["knife", "scissors"]), dialogue).object == "scissors"
    )


@pytest.mark.parametrize(
    ("obj", "query"),
    [
        ("kitchen chair", "I want to sit down"),
        ("FluxCapacitor", "where is the flux capacitor"),
        ("flux capacitor", "bring me the Flux-Capacitors"),
        ("iron_(for_clothing)", "my shirt is wrinkled"),
        ("blue armchair", "go to the blue armchair"),
    ],
)
def test_names_without_a_card_of_their_own(reasoner: embedded.Embedded, obj: str, query: str) -> None:
    assert reasoner.select(query, Inventory.of(["toilet", obj, "spoon"])).object == obj


PLAIN = [
    "bed",
    "floor lamp",
    "garbage can",
    "shelf",
    "radio",
    "dining table",
    "desk chair",
    "fridge",
    "pen",
    "pot",
    "mirror",
]


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("the lamp", "floor lamp"),  # a general word for a listed thing
        ("take me to the table", "dining table"),
        ("go to a chair", "desk chair"),
        ("the bin's lid", "garbage can"),  # a part of one
        ("the lid of the bin", "garbage can"),
        ("the fridge door", "fridge"),
        ("the radio on the shelf", "radio"),  # with where it stands
        ("bring me the radio that stands on the shelf", "radio"),
        ("could you check the mirror for me?", "mirror"),  # a verb that is a thing's name elsewhere
    ],
)
def test_what_is_asked_for_by_name_is_not_lost(reasoner: embedded.Embedded, query: str, expected: str) -> None:
    chosen = reasoner.select(query, Inventory.of(PLAIN))
    assert (chosen.status, chosen.object) == ("found", expected), chosen


@pytest.mark.parametrize("query", ["could you check the time?", "check how late it is", "I have to check my mail"])
def test_nobody_who_checks_something_looks_for_a_cheque(reasoner: embedded.Embedded, query: str) -> None:
    assert "no check" not in reasoner.select(query, Inventory.of(PLAIN)).reason


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("Where can our puppy and I sleep tonight?", "bed"),
        ("where do you keep what I can drink tea from", "cup"),
        ("where do these muddy carrots get washed?", "sink"),
    ],
)
def test_a_need_in_the_words_of_a_question_is_served(reasoner: embedded.Embedded, query: str, expected: str) -> None:
    assert reasoner.select(query, FLAT).object == expected
    assert reasoner.select("where is the piano?", FLAT).status == "answered"


def test_a_verb_is_no_thing(reasoner: embedded.Embedded) -> None:
    assert reasoner.select("I want to watch a film", Inventory.of(["watch", "television"])).object == "television"
    packing = reasoner.select(
        "where do my textbooks go, I am off to school", Inventory.of(["book", "backpack", "watch"])
    )
    assert "backpack" in (packing.object or packing.question or "")


def test_a_long_story_does_not_outweigh_the_request(reasoner: embedded.Embedded) -> None:
    story = "The cat sat by the window. My sister read her book and ate cake. We played cards on the bed. " * 20
    assert reasoner.select(story + "My hands are sticky, I need to wash them.", Inventory.of(COCO)).object == "sink"


def test_proposals_need_no_list(reasoner: embedded.Embedded) -> None:
    assert {"cup", "water bottle", "glass"} & set(reasoner.propose("I am so thirsty"))
    assert {"sink", "soap bar", "soap bottle"} & set(reasoner.propose("my hands are sticky, I need to wash them"))
    assert reasoner.propose("where is the boarding gate for my flight") == []


SHARED = embedded.make()
names = st.one_of(st.sampled_from(COCO + THOR + LVIS), st.text(max_size=20))


@settings(deadline=None)  # the first request loads the model
@given(
    query=st.one_of(st.text(max_size=200), st.lists(names, max_size=8).map(" ".join)),
    objects=st.lists(names, max_size=12),
)
def test_never_outside_the_list(query: str, objects: list[str]) -> None:
    reasoner = SHARED
    chosen = reasoner.select(query, Inventory.of(objects))
    assert chosen.object is None or chosen.object in objects
    assert {name for name, _ in chosen.candidates} <= set(objects) and all(0 <= s <= 1 for _, s in chosen.candidates)
    assert chosen == reasoner.select(query, Inventory.of(objects))
    assert (chosen.question is not None) == (chosen.status == "clarify") and "\n" not in (chosen.question or "")


def test_the_answer_does_not_hang_on_the_hash_seed() -> None:
    code = (
        "import sys; from cartier import Inventory; from cartier.reasoners import embedded; "
        "print(embedded.make().select(sys.argv[1], Inventory.of(sys.argv[2].split(','))))"
    )
    args = [sys.executable, "-c", code, "My feet hurt, something to drink and read please", ",".join(COCO)]
    runs = {
        subprocess.run(args, capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": s}).stdout for s in "12"
    }
    assert len(runs) == 1


def test_a_megabyte_is_no_trouble(reasoner: embedded.Embedded) -> None:
    assert (
        reasoner.select(
            "a seat for my tired feet and a cup of tea " * 25_000 + ". Go to the sink.", Inventory.of(COCO)
        ).object
        in COCO
    )
