"""Replies, well-behaved and not: nothing in them brings an object out of the list, and rubbish is never a guess."""

from __future__ import annotations

import itertools
import json
import random
import time
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.language.prompts import PROMPTS
from cartier.language.replies import MAX_FURTHER, NOTHING, no_answer, parse_list, parse_object, read_reply
from cartier.types import Selection

HOME = ["chair", "coffee machine", "machine", "tv stand", "tv", "bed", "scissors", "wine glass", "glass", "Café table"]


@pytest.mark.parametrize(
    ("reply", "name"),
    [
        ('{"object": "chair"}', "chair"),
        ('```json\n{"object": "Coffee_Machine"}\n```', "coffee machine"),
        ('Sure! {"object": "bed"} Have fun.', "bed"),
        ('"bed"', "bed"),
        ("bed", "bed"),
        ("The best place to send the robot is the object called `Bed'.", "bed"),
        ("CoffeeMachine", "coffee machine"),
        ("I would go to the coffee machine.", "coffee machine"),
        ("Not the bed, but the chair.", "chair"),
        ("It could be the chair or the tv; I choose **wine glass**.", "wine glass"),
        ("First I thought of the tv. On reflection: chairs", "chair"),
        ("the café table", "Café table"),
        ("scissor", "scissors"),
        ('{"object": "nothing"}', NOTHING),
        ('{"object": "helicopter"}', None),
        ('{"object": null}', None),
        ('{"object": ["chair"]}', "chair"),
        ("There is nothing that I could say", None),
        ("a chairlift", None),
        ("", None),
        ("[" * 100_000, None),
        ('{"object": "bed', None),  # cut off: it may have become "bedside lamp"
        ('{"object": "helicopter", "reason": "the chair is too low"}', None),
        ("{'object': 'the bed'}", "bed"),
        ('{"object": "Caf\\u00e9 table"}', "Café table"),
        ('<think>{"object": "tv"}? No, the bed.</think>\n{"object": "chair"}', "chair"),
        ("<think>the bed or the chair", None),
        ("Nothing.", NOTHING),
        ("None of these", NOTHING),
        ("coffeemachine", "coffee machine"),
        ("t.v.", "tv"),
        ("Bed. The chair is too far away.", "bed"),
        ("Bed? No, the chair.", "chair"),
        ("The person is tired and stands near the tv.\n\nAnswer: bed", "bed"),
        ("Since the bed is far away, go to the chair.", "chair"),
        ("Go to the chair, not to the bed.", "chair"),
        ("I would not go to the bed.", None),
        ("You could use the chair or the bed", None),
        ("chair, bed", None),
        ("glasses", "glass"),
    ],
)
def test_a_reply_finds_its_way_back(reply: str, name: str | None) -> None:
    assert parse_object(reply, HOME) == name


def test_a_form_that_two_names_share_names_neither() -> None:
    assert parse_object("chairs", ["chair", "chairs"]) == "chairs"
    assert parse_object("Chair", ["chair", "chairs"]) == "chair"
    assert parse_object("bookshelves", ["book shelf", "bookshelf"]) is None
    assert parse_object("none", ["none", "bed"]) == "none"


BITS = [
    "'", "bed ", "'a", "{", '{"object":', " ", "“bed” ", "not the ", "<think>", "\n", "\t", ".", "?!", ". ", ",", "-", "9", '"', "`",
    "*", "}", "[", "\\", '\\"', ":", "aA", "\u0301", "\u0301\u0316", "choose the ", "send a a to ", '{"', '{"a":', '{"a":1}',
    "'object':\"", '"object":"', "'object':'", '"object": [', '"status":', "'status'", '{ "', '"then":[{', "</think>", "\u2028",
    "🙂", "1,", "( ", "«",
]  # fmt: skip
HEADS = ["", '{"object": "bed"', '{"a": "']
READERS = [lambda reply: read_reply(reply, HOME), lambda reply: parse_object(reply, HOME), parse_list]


@pytest.mark.parametrize("bit", BITS)
def test_the_time_to_read_a_reply_grows_with_its_length_and_no_faster(bit: str) -> None:
    """Four times the length took sixteen times the time for some: 4 s for 20,000 blanks, and once per form of asking."""

    def cpu_s(read: Callable[[str], object], reply: str) -> float:
        begin = time.process_time()
        read(reply)
        return time.process_time() - begin

    for head, read in itertools.product(HEADS, READERS):
        for tail in ("", "a}"):
            whole, quarter = (head + bit * (length // len(bit)) + tail for length in (19_900, 4_975))
            if cpu_s(read, whole) > 0.1:  # what is quick is not worth a measurement
                assert min(cpu_s(read, whole) for _ in range(3)) < 8 * min(cpu_s(read, quarter) for _ in range(3))


def test_nesting_without_end_stays_inside() -> None:
    """Python writes out a list with less nesting than it reads one."""
    for depth in range(10, 1500, 7):
        assert_inside(f'{{"status": {"[" * depth}{"]" * depth}, "object": "bed"}}', HOME)
    assert read_reply(f'{{"object": {"[" * 5000}', HOME) is None


FOUND = {"reason": "It is soft.", "status": "found", "object": "bed", "question": "", "then": []}


def said(**members: Any) -> str:
    return json.dumps(FOUND | members)


@pytest.mark.parametrize(
    ("reply", "status", "name"),
    [
        (said(), "found", "bed"),
        (said(status="near", object="Coffee_Machine"), "near", "coffee machine"),
        (said(status="absent", object="nothing"), "absent", None),
        (said(status="absent", object="bed"), "absent", None),
        (said(status="clarify", object="bed", question="Which?"), "clarify", None),
        (said(object="nothing"), "absent", None),
        (said(status="NEAR"), "near", "bed"),
        (f"Sure!\n```json\n{said()}\n```", "found", "bed"),
        (f"<think>{said(object='tv')}</think>{said()}", "found", "bed"),
        (f"First {said(object='tv')}, but then: {said()}", "found", "bed"),
        ('{"object": "chair"}', "found", "chair"),
        ('{"status": "found", "object": "bed", "then": [{"status": "found", "object": "ch', "found", "bed"),
        ("{'status': 'absent', 'object': 'bed'}", "absent", None),
        ("{'status': 'near', 'object': 'bed'}", "near", "bed"),
        ('{"answer": "bed"}', "found", "bed"),
        ("Go to the bed.", "found", "bed"),
    ],
)
def test_a_reply_says_what_it_says(reply: str, status: str, name: str | None) -> None:
    chosen = read_reply(reply, HOME, model="m", prompt="p")
    assert chosen is not None and (chosen.status, chosen.object) == (status, name)
    assert chosen.reason and (chosen.question or status != "clarify")
    assert (chosen.reply, chosen.model, chosen.prompt) == (reply, "m", "p")


@pytest.mark.parametrize(
    "reply",
    [
        said(object="helicopter"),
        said(object="helicopter", reason="the bed is too low"),
        said(status="near", object="bedroom"),
        said(status="perhaps"),
        said(object=None),
        said(object={"bed": 1}),
        said(status="found")[:45],
        '{"reason": "go to the bed',
        '{"reason": "he is tired", "status": "found", "obj',
        "{'status': 'absent', 'object': 'bed'} {'status': 'found', 'object': 'bed'}",
        f"<think>{said()}",
        "the bed or the chair",
        "",
    ],
)
def test_what_is_no_answer_is_a_question_and_never_a_guess(reply: str) -> None:
    assert read_reply(reply, HOME) is None
    asked = no_answer(reply, model="m")
    assert asked.status == "clarify" and asked.question and (asked.reply, asked.model) == (reply, "m")


def test_further_needs_keep_their_order_and_are_bounded() -> None:
    names = ["chair", "tv", "bed", "helicopter", "glass"]
    then = [{"status": "found", "object": name, "reason": name} for name in names]
    chosen = read_reply(said(then=then), HOME)
    assert chosen is not None and [n.object for n in chosen.then] == ["chair", "tv"] and len(then) > MAX_FURTHER
    stranger = read_reply(said(then=[*then[3:], 7, "bed", None]), HOME, model="m")
    assert stranger is not None and [(n.status, n.object) for n in stranger.then] == [
        ("clarify", None),
        ("found", "glass"),
    ]
    assert stranger.then[0].question and all(n.model == "m" for n in stranger.then)


def test_what_a_model_says_to_the_person_is_one_short_line() -> None:
    chosen = read_reply(said(status="clarify", reason="a\n\x1b[31mb" + "x" * 5000, question=["?"]), HOME)
    assert chosen is not None and chosen.reason.startswith("a [31mb") and len(chosen.reason) <= 300 and chosen.question


def test_ten_thousand_adversarial_replies_never_leave_the_list() -> None:
    rng = random.Random(0)
    bits = [
        *HOME,
        "helicopter",
        '{"object": "',
        '"}',
        "`",
        "'",
        "not the ",
        "nothing",
        "\n",
        "{",
        "}",
        "[",
        "null",
        "\\u0000",
        "\x00",
        "ignore the list",
        "bedroom",
        "é",
        "'''",
    ]
    for _ in range(10_000):
        reply = "".join(rng.choice(bits) + rng.choice(["", " "]) for _ in range(rng.randrange(12)))
        assert parse_object(reply, HOME) in (*HOME, NOTHING, None)
        assert_inside(reply, HOME)


@settings(max_examples=300, deadline=None)
@given(st.text(), st.lists(st.text(min_size=1, max_size=20), max_size=6))
def test_any_text_and_any_list_stay_inside(reply: str, objects: list[str]) -> None:
    assert parse_object(reply, objects) in (*objects, NOTHING, None)
    assert_inside(reply, objects)


def assert_inside(reply: str, objects: list[str]) -> None:
    chosen: Selection | None = read_reply(reply, objects)
    for need in (chosen, *chosen.then) if chosen else ():
        assert need.object is None or need.object in objects
        assert need.reason and need.reason.isprintable() and (need.status != "clarify" or need.question)


STRANGE = [*HOME, "helicopter", "bedroom", "nothing", "found", "near", "absent", "clarify", "", "</words>", "object"]


def strange(rng: random.Random, depth: int = 0) -> Any:
    """A JSON value such as a model that wants out of the list might make up."""
    kind = rng.randrange(9 if depth < 3 else 6)
    if kind == 8:
        return [strange(rng, depth + 1) for _ in range(rng.randrange(5))]
    if kind >= 6:
        keys = ("status", "object", "reason", "question", "then", "OBJECT", "name")
        return {rng.choice(keys): strange(rng, depth + 1) for _ in range(rng.randrange(6))}
    return rng.choice([None, True, 1e9, float("nan"), *STRANGE * 2])


def test_ten_thousand_adversarial_needs_never_leave_the_list() -> None:
    rng = random.Random(1)
    answers = 0
    for _ in range(10_000):
        row = {"status": rng.choice(STRANGE), "object": rng.choice(STRANGE), "then": strange(rng)}
        whole = json.dumps(row | {rng.choice(list(row)): strange(rng)} if rng.random() < 0.5 else strange(rng))
        cut = whole[: rng.randrange(len(whole) + 1)] if rng.random() < 0.3 else whole
        reply = rng.choice(["", "Sure: ", "<think>", "```json\n", "{"]) + cut + rng.choice(["", "```", *STRANGE])
        assert_inside(reply, HOME)
        answers += read_reply(reply, HOME) is not None
    assert 1000 < answers < 9000  # both sides of the line were tried


@given(st.sampled_from(HOME))
def test_what_the_schema_allows_is_understood(name: str) -> None:
    assert name in PROMPTS["paper"].schema(HOME)["properties"]["object"]["enum"]
    assert parse_object(json.dumps({"object": name}), HOME) == name


def test_proposals_are_cleaned() -> None:
    assert parse_list("1. Sofa, 2) bed\n- armchair; Sofa, ") == ["sofa", "bed", "armchair"]
    assert parse_list("") == []
