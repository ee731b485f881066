"""Replies, well-behaved and not: nothing in them brings an object out of the list, and rubbish is never a guess."""

from __future__ import annotations

import itertools
import json
import random
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.llm.lookup import NOTHING
from cartier.llm.prompts import PROMPTS
from cartier.llm.reply_parser import MAX_FURTHER, REPLY_STATUSES, no_answer, parse_list, parse_object, read_reply
from cartier.types import Fact, Inventory, Selection
from flat import FLAT, UNSURE_FLAT

HOME = ["chair", "coffee machine", "machine", "tv stand", "tv", "bed", "scissors", "wine glass", "glass", "Café table"]
LISTED = Inventory.of(HOME)


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
    "'", "bed ", "'a", "{", '{"object":', " ", "“bed” ", "not the ", "<think>", "\n", "\t", ".", "?!", ". ", ",", "-",
    "9", '"', "`", "*", "}", "[", "\\", '\\"', ":", "aA", "\u0301", "\u0301\u0316", "choose the ", "send a a to ", '{"',
    '{"a":', '{"a":1}', "'object':\"", '"object":"', "'object':'", '"object": [', '"status":', "'status'", '{ "',
    '"then":[{', "</think>", "\u2028", "🙂", "1,", "( ", "«",
]  # fmt: skip
HEADS = ["", '{"object": "bed"', '{"a": "']
READERS = [lambda reply: read_reply(reply, LISTED), lambda reply: parse_object(reply, HOME), parse_list]


@pytest.mark.no_cover  # the tracer's time is not the reader's
@pytest.mark.parametrize("bit", BITS)
def test_the_time_to_read_a_reply_grows_with_its_length_and_no_faster(bit: str) -> None:
    """Some patterns were quadratic once: 4 s for 20,000 blanks, for each form of request.

    Of this thread alone, and the least of five: a busy machine makes no difference. Sixteen times the length takes 16
    times as long, where it is quadratic 256 times: 64 is far from both.
    """

    def cpu_s(read: Callable[[str], object], reply: str) -> float:
        begin = time.thread_time()
        read(reply)
        return time.thread_time() - begin

    for head, read, tail in itertools.product(HEADS, READERS, ("", "a}")):
        whole, part = (head + bit * (length // len(bit)) + tail for length in (19_200, 1_200))
        if cpu_s(read, whole) > 0.1:  # what is quick is not worth a measurement
            assert min(cpu_s(read, whole) for _ in range(5)) < 64 * min(cpu_s(read, part) for _ in range(5))


def test_nesting_without_end_stays_inside() -> None:
    """Python writes out a list with less nesting than it reads one."""
    for depth in range(10, 1500, 7):
        assert_inside(f'{{"status": {"[" * depth}{"]" * depth}, "object": "bed"}}', HOME)
    assert read_reply(f'{{"object": {"[" * 5000}', LISTED) is None


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
        ("{'status': 'absent', 'object': 'bed'}", "absent", None),
        ("{'status': 'near', 'object': 'bed'}", "near", "bed"),
        ('{"answer": "bed"}', "found", "bed"),
        ("Go to the bed.", "found", "bed"),
    ],
)
def test_a_reply_says_what_it_says(reply: str, status: str, name: str | None) -> None:
    chosen = read_reply(reply, LISTED, model="m", prompt="p")
    assert chosen is not None and (chosen.status, chosen.object) == (REPLY_STATUSES[status], name)
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
        '{"status": "found", "object": "bed", "then": [{"status": "found", "object": "ch',
        '{"status": "found", "object": "bed"',
        "{'status': 'found', 'object': 'bed'",
        said() + '{"status": "found',
        "[THINK]the bed",
        "<|channel|>analysis<|message|>the bed",
        "{'status': 'absent', 'object': 'bed'} {'status': 'found', 'object': 'bed'}",
        f"<think>{said()}",
        "the bed or the chair",
        "",
    ],
)
def test_what_is_no_answer_is_a_question_and_never_a_guess(reply: str) -> None:
    assert read_reply(reply, LISTED) is None
    asked = no_answer(reply, model="m")
    assert asked.status == "clarify" and asked.question and (asked.reply, asked.model) == (reply, "m")


def test_further_needs_keep_their_order_and_are_bounded() -> None:
    names = ["chair", "tv", "bed", "helicopter", "glass"]
    then = [{"status": "found", "object": name, "reason": name} for name in names]
    chosen = read_reply(said(then=then), LISTED)
    assert chosen is not None and [n.object for n in chosen.next] == ["chair", "tv"] and len(then) > MAX_FURTHER
    stranger = read_reply(said(then=[*then[3:], 7, "bed", None]), LISTED, model="m")
    assert stranger is not None and [(n.status, n.object) for n in stranger.next] == [
        ("clarify", None),
        ("found", "glass"),
    ]
    assert stranger.next[0].question and all(n.model == "m" for n in stranger.next)


def test_what_a_model_says_to_the_person_is_one_short_line() -> None:
    chosen = read_reply(said(status="clarify", reason="a\n\x1b[31mb" + "x" * 5000, question=["?"]), LISTED)
    assert chosen is not None and chosen.reason.startswith("a [31mb") and len(chosen.reason) <= 300 and chosen.question


@pytest.mark.no_cover  # too many rounds to trace each line
@pytest.mark.parametrize("count", [2_000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_adversarial_replies_never_leave_the_list(count: int) -> None:
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
    for _ in range(count):
        reply = "".join(rng.choice(bits) + rng.choice(["", " "]) for _ in range(rng.randrange(12)))
        assert parse_object(reply, HOME) in (*HOME, NOTHING, None)
        assert_inside(reply, HOME)


@settings(max_examples=300, deadline=None)
@given(st.text(), st.lists(st.text(min_size=1, max_size=20), max_size=6))
def test_any_text_and_any_list_stay_inside(reply: str, objects: list[str]) -> None:
    assert parse_object(reply, objects) in (*objects, NOTHING, None)
    assert_inside(reply, objects)


def assert_inside(reply: str, objects: list[str]) -> None:
    inside(reply, Inventory.of(objects))


def inside(reply: str, inventory: Inventory) -> Selection | None:
    """The reply's reading, after a look that all of it is in the inventory and can be said to a person."""
    chosen = read_reply(reply, inventory)
    for need in (chosen, *chosen.next) if chosen else ():
        assert inventory.contains(need) and all(name in inventory.names for name, _ in need.candidates)
        assert need.reason and need.reason.isprintable() and need.text.isprintable()
        assert (need.status != "clarify" or need.question) and (need.status != "answered" or need.text)
        if need.object_id is not None:
            assert next(o for o in inventory.objects if o.id == need.object_id).confirmed
        if need.fact is not None:
            assert need.status == "answered" and fits(need.fact, inventory)
            json.dumps(asdict(need.fact), allow_nan=False)
    return chosen


def test_what_is_possibly_there_is_chosen_by_number() -> None:
    chosen = read_reply(json.dumps(CUP | {"object": "vase #32"}), UNSURE_FLAT)
    assert chosen is not None and (chosen.status, chosen.object, chosen.object_id) == ("found", "vase", 32)
    assert read_reply(json.dumps(CUP | {"object": "vase"}), UNSURE_FLAT) is None, "a bare name is of what is sure"
    assert read_reply(json.dumps(CUP | {"object": "vase #33"}), UNSURE_FLAT) is None


def fits(fact: Fact, inventory: Inventory) -> bool:
    """Whether an answer for programs is one that this home can give."""
    names, rooms = set(inventory.names), {room.name for room in inventory.rooms}
    confirmed = [o.id for o in inventory.objects if o.confirmed]
    if not set(fact.objects) <= set(confirmed):
        return False
    value = fact.value
    match fact.kind:
        case "count":
            return type(value) is int and len(fact.objects) <= value <= max(len(confirmed), len(inventory.rooms))
        case "exists":
            return type(value) is bool
        case "where":
            return value is None or value in rooms | names
        case "list":
            return isinstance(value, list) and set(value) <= names | rooms
        case "compare":
            return value in names | rooms
        case "tell":
            return isinstance(value, str | int | float) and len(str(value)) <= 400


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


@pytest.mark.no_cover  # too many rounds to trace each line
@pytest.mark.parametrize("count", [2_000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_adversarial_needs_never_leave_the_list(count: int) -> None:
    rng = random.Random(1)
    answers = 0
    for _ in range(count):
        row = {"status": rng.choice(STRANGE), "object": rng.choice(STRANGE), "then": strange(rng)}
        whole = json.dumps(row | {rng.choice(list(row)): strange(rng)} if rng.random() < 0.5 else strange(rng))
        cut = whole[: rng.randrange(len(whole) + 1)] if rng.random() < 0.3 else whole
        reply = rng.choice(["", "Sure: ", "<think>", "```json\n", "{"]) + cut + rng.choice(["", "```", *STRANGE])
        assert_inside(reply, HOME)
        answers += read_reply(reply, LISTED) is not None
    assert count / 10 < answers < count * 9 / 10  # both sides of the line were tried


@given(st.sampled_from(HOME))
def test_what_the_schema_allows_is_understood(name: str) -> None:
    schema = PROMPTS["paper"].request("sit", LISTED).schema
    assert schema is not None and name in schema["properties"]["object"]["enum"]
    assert parse_object(json.dumps({"object": name}), HOME) == name


def test_proposals_are_cleaned() -> None:
    assert parse_list("1. Sofa, 2) bed\n- armchair; Sofa, ") == ["sofa", "bed", "armchair"]
    assert parse_list("") == []


CUP: dict[str, object] = {
    "reason": "It is white.",
    "status": "found",
    "object": "cup #12",
    "question": "",
    "say": "",
    "answer": None,
    "then": [],
}


def told(kind: str, value: Any, objects: list[Any], **members: Any) -> str:
    answer = {"kind": kind, "value": value, "objects": objects}
    return json.dumps(CUP | {"status": "told", "object": "nothing", "say": "So it is.", "answer": answer} | members)


@pytest.mark.parametrize(
    ("stated", "pick"),
    [
        ("cup #12", ("cup", 12, None)),
        ("Cup#12", ("cup", 12, None)),
        ("cups #14", ("cup", 14, None)),
        ("cup", ("cup", None, None)),
        ("bed #20", ("bed", 20, None)),
        ("kitchen (room 0)", ("kitchen", None, 0)),
        ("bedroom (room 2)", ("bedroom", None, 2)),
        ("Kitchen", ("kitchen", None, 0)),
    ],
)
def test_a_reply_names_an_object_by_its_number_or_a_room(stated: str, pick: tuple[Any, ...]) -> None:
    for status in ("found", "near", "told"):
        chosen = inside(json.dumps(CUP | {"status": status, "object": stated, "say": "There."}), FLAT)
        assert chosen is not None and (chosen.status, chosen.object, chosen.object_id, chosen.room) == (
            REPLY_STATUSES[status],
            *pick,
        )


@pytest.mark.parametrize(
    "stated",
    [
        "cup #13",  # no such number
        "cup #20",  # that is the bed
        "cup #31",  # not confirmed
        "vase #32",
        "vase",
        "#12",  # a number alone is not checked against anything
        "cup #-12",
        "cup #１２",
        "cup #12 #14",
        "cup #99999999999999999999",
        "kitchen (room 1)",
        "bedroom (room 7)",
        "bedroom",  # there are two
        "garage (room 0)",
        "helicopter #12",
    ],
)
def test_a_number_and_a_name_that_do_not_agree_are_no_answer(stated: str) -> None:
    for status in ("found", "near", "told"):
        assert read_reply(json.dumps(CUP | {"status": status, "object": stated, "say": "There."}), FLAT) is None
    chosen = inside(json.dumps(CUP | {"then": [CUP | {"object": stated}]}), FLAT)
    assert chosen is not None and [need.status for need in chosen.next] == ["clarify"]


def test_a_listed_name_comes_before_a_number() -> None:
    odd = Inventory.of(["cup", "cup #1", "kitchen (room 0)"])
    for name in odd.names:
        chosen = read_reply(json.dumps({"object": name}), odd)
        assert chosen is not None and (chosen.object, chosen.object_id, chosen.room) == (name, None, None)


@pytest.mark.parametrize(
    ("reply", "number"),
    [
        ("Go to the cup #14.", 14),
        ("The best is **cup #14**, by the sink", 14),
        ("the cup", None),
    ],
)
def test_free_text_may_say_the_number(reply: str, number: int | None) -> None:
    chosen = inside(reply, FLAT)
    assert chosen is not None and (chosen.object, chosen.object_id) == ("cup", number)


@pytest.mark.parametrize("reply", ["cup #12 or cup #14", "the cup #20", "the cup #77"])
def test_free_text_with_two_numbers_or_a_wrong_one_is_no_answer(reply: str) -> None:
    assert read_reply(reply, FLAT) is None


@pytest.mark.parametrize(
    ("kind", "value", "objects", "read"),
    [
        ("count", 3, [12, 14, 15], 3),
        ("count", 3.0, [], 3),
        ("count", 0, [], 0),
        ("exists", True, [12], True),
        ("exists", False, [], False),
        ("where", "kitchen", [14], "kitchen"),
        ("where", "bedroom", [14], "kitchen"),  # the map knows better
        ("where", None, [], None),
        ("list", ["Cups", "table"], [12, 14, 3], ["cup", "table"]),
        ("list", [], [12, 14, 3], ["cup", "table"]),
        ("list", ["kitchen", "bedroom (room 1)"], [], ["kitchen", "bedroom"]),
        ("compare", "bed", [20, 3], "bed"),
        ("tell", "white and blue", [12], "white and blue"),
        ("tell", 1.5, [12], 1.5),
    ],
)
def test_an_answer_for_programs_is_read(kind: str, value: Any, objects: list[int], read: Any) -> None:
    chosen = inside(told(kind, value, objects), FLAT)
    assert chosen is not None and chosen.text == "So it is." and chosen.object is None
    assert chosen.fact == Fact(kind, read, tuple(objects))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "value", "objects"),
    [
        ("count", 2, [12, 14, 15]),  # fewer than it names
        ("count", 7, []),  # more than the home has
        ("count", 2.5, []),
        ("count", True, []),
        ("count", "three", []),
        ("count", float("nan"), []),
        ("count", 10**400, []),
        ("exists", "yes", []),
        ("exists", True, [31]),  # not confirmed
        ("exists", True, [99]),
        ("exists", True, ["12"]),
        ("exists", True, [True]),
        ("exists", True, {"12": 1}),
        ("where", "garage", []),
        ("list", ["helicopter"], []),
        ("list", "cup", [12]),
        ("list", ["nothing"], []),
        ("compare", "cup", [20, 3]),
        ("compare", "helicopter", []),
        ("tell", None, []),
        ("tell", float("inf"), []),
        ("tell", ["white"], []),
        ("colour", "white", [12]),
        (None, None, []),
    ],
)
def test_a_fact_of_no_use_leaves_its_sentence(kind: Any, value: Any, objects: Any) -> None:
    chosen = read_reply(told(kind, value, objects), FLAT)
    assert chosen is not None and (chosen.status, chosen.fact) == ("answered", None) and chosen.text


def test_told_needs_words_and_no_more() -> None:
    assert read_reply(json.dumps(CUP | {"status": "told", "reason": "", "say": "\x00"}), FLAT) is None
    chosen = inside(told("count", 3, [12, 14, 15], answer=None, say="a\n\x1b[31mb" + "x" * 5000), FLAT)
    assert chosen is not None and chosen.fact is None and chosen.text.startswith("a [31mb") and len(chosen.text) <= 300


def test_two_objects_of_one_name_are_two_needs() -> None:
    then = [CUP | {"object": "cup #14"}, CUP, CUP | {"status": "told", "say": "White."}]
    chosen = inside(json.dumps(CUP | {"then": then}), FLAT)
    assert chosen is not None
    assert [(n.status, n.object_id) for n in (chosen, *chosen.next)] == [("found", 12), ("found", 14), ("answered", 12)]


POINTERS = [
    "cup", "cup #12", "cup #14", "cup #13", "cup #20", "bed #20", "#12", "vase #32", "kitchen (room 0)", "kitchen",
    "bedroom", "bedroom (room 1)", "kitchen (room 1)", "garage (room 3)", "table #", "cup # 12", "helicopter",
    "nothing", "", "room 0", "cup #0x12",
]  # fmt: skip
VALUES = [
    None,
    True,
    False,
    0,
    1,
    3,
    12,
    31,
    99,
    -1,
    2.5,
    float("nan"),
    10**400,
    [],
    [12, 14],
    [31],
    ["cup"],
    {"kind": "count"},
]
KINDS = ["count", "exists", "where", "list", "compare", "tell", "colour", None]


@pytest.mark.parametrize("total", [4_000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_adversarial_replies_never_leave_the_home(total: int) -> None:
    """Objects by number, rooms and answers for programs, true and made up, whole, cut off, and in free text."""
    rng = random.Random(2)

    def value() -> Any:
        return rng.choice([*VALUES, *POINTERS, [rng.choice(POINTERS) for _ in range(rng.randrange(3))]])

    def need(depth: int = 0) -> dict[str, Any]:
        answer = {
            "kind": rng.choice(KINDS),
            "value": value(),
            "objects": [rng.choice([3, 12, 14, 20]) for _ in range(rng.randrange(3))],
        }
        row = {
            "reason": rng.choice(["", "So.", "\x00"]),
            "status": rng.choice(["found", "near", "told", "told", "absent", "clarify"]),
            "object": rng.choice(POINTERS), "question": "",
            "say": rng.choice(["", "Three.", "\x1b[2J"]), "answer": rng.choice([None, answer]),
            "then": [need(depth + 1) for _ in range(rng.randrange(4))] if depth < 2 else [],
        }  # fmt: skip
        if rng.random() < 0.3:
            row[rng.choice(list(row))] = value()
        if rng.random() < 0.2:
            answer[rng.choice(list(answer))] = value()
        return row

    read = dict.fromkeys(REPLY_STATUSES.values(), 0)
    facts = rooms = numbers = 0
    for count in range(total):
        if count % 4 == 0:
            reply = " ".join(
                rng.choice([*POINTERS, "go to the", "not the", '{"object": "', '"}', "or", "'"])
                for _ in range(rng.randrange(9))
            )
        else:
            reply = json.dumps(need())
            reply = reply[: rng.randrange(len(reply) + 1)] if rng.random() < 0.2 else reply
        chosen = inside(reply, FLAT)
        if chosen is not None:
            read[chosen.status] += 1
            facts += chosen.fact is not None
            rooms += chosen.room is not None
            numbers += chosen.object_id is not None
    assert (
        min(*read.values(), facts, rooms, numbers) > total / 200 and sum(read.values()) < total * 9 / 10
    )  # both sides of each line were tried


@settings(max_examples=300, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(POINTERS) | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["status", "object", "answer", "kind", "value", "objects", "then", "say"]), inner
            )
        ),
        max_leaves=12,
    ),
    st.sampled_from(["found", "near", "told"]),
)
def test_any_json_stays_inside(value: Any, status: str) -> None:
    inside(json.dumps(value), FLAT)
    inside(
        json.dumps(CUP | {"status": status, "say": "So."} | (value if isinstance(value, dict) else {"answer": value})),
        FLAT,
    )
