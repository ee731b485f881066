"""Route rules that a language model states in its one reply."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from cartier.llm import route_rules
from cartier.llm.prompts import prompt_named
from cartier.llm.reply_parser import read_reply
from cartier.types.route_rules import RouteRule
from route_talk import flat_inventory

HOME = flat_inventory()
GOAL = {
    "reason": "asked for",
    "status": "found",
    "object": "sofa",
    "question": "",
    "say": "",
    "answer": None,
    "then": [],
}
TOLD = GOAL | {"status": "told", "object": "nothing", "say": "I keep off it."}


def rule(kind: str, target: str, strength: str = "hard", scope: str = "drive") -> dict[str, str]:
    return {"kind": kind, "target": target, "strength": strength, "scope": scope}


@pytest.mark.parametrize(
    ("rules", "texts"),
    [
        ([rule("avoid", "room:hall")], ["avoid room:hall hard drive"]),
        ([rule("avoid", "room:HALL (room 2)", "soft", "standing")], ["avoid room:hall soft standing"]),
        ([rule("via", "object:4"), rule("shortest", "")], ["via object:4 hard drive", "shortest hard drive"]),
        ([rule("prefer", "floor:tiles", "soft")] * 2, ["prefer floor:tiles soft drive"]),
        ([rule("avoid", "door:hall|study", "hard", "until:22:00")], ["avoid door:hall|study hard until:22:00"]),
        ([], []), (None, []),
    ],
)  # fmt: skip
def test_rules_of_a_reply_are_typed(rules: Any, texts: list[str]) -> None:
    chosen = read_reply(json.dumps(GOAL | {"rules": rules, "lifts": []}), HOME)
    assert chosen is not None and chosen.object == "sofa" and [each.text for each in chosen.rules] == texts


@pytest.mark.parametrize(
    "broken",
    [rule("avoid", "room:cellar"), rule("avoid", "object:99"), rule("fly", "room:hall"), rule("avoid", "carpet"),
     rule("avoid", "floor:lava"), rule("avoid", ""), rule("avoid", "room:hall", "very"), "avoid room:hall",
     rule("avoid", "room:hall", "hard", "until noon"), rule("avoid", "zone:0,0;1,0;1,1"), {"kind": 3}],
)  # fmt: skip
def test_a_reply_with_an_unreadable_rule_is_none(broken: Any) -> None:
    """No rule of a person is lost without a word."""
    assert read_reply(json.dumps(GOAL | {"rules": [broken]}), HOME) is None


def test_a_rule_about_nothing_becomes_a_question() -> None:
    chosen = read_reply(json.dumps(GOAL | {"rules": [rule("avoid", "none:trampoline")]}), HOME)
    assert chosen is not None and chosen.status == "clarify" and "no trampoline" in str(chosen.question)


def test_rules_alone_are_echoed_and_lifts_are_of_those_that_hold() -> None:
    chosen = read_reply(json.dumps(TOLD | {"rules": [rule("avoid", "room:hall", "hard", "standing")]}), HOME)
    assert chosen is not None and chosen.text == "Understood: stay out of the hall, until you say otherwise."
    holding = replace(HOME, rules=(RouteRule.parse("avoid room:hall hard standing"),))
    lifts = TOLD | {"rules": [], "lifts": [rule("avoid", "room:hall"), rule("avoid", "room:study")]}
    ended = read_reply(json.dumps(lifts), holding)
    assert ended is not None and ended.lifts == holding.rules and ended.text.startswith("Understood: no longer")
    none = read_reply(json.dumps(lifts), HOME)
    assert none is not None and none.lifts == ()


def test_the_prompt_asks_for_rules_only_where_the_words_do() -> None:
    plain, ways = (
        prompt_named("rich").request(words, HOME)
        for words in ("I would love to sit down", "to the sofa, but not over the carpet")
    )
    assert plain.schema is not None and "rules" not in plain.schema["properties"] and '"lifts"' not in plain.text
    assert ways.schema is not None and set(ways.schema["required"]) >= {"object", "rules", "lifts"}
    assert ways.text.startswith(plain.text.partition("\nuser:")[0]) and '"keep-away"' in ways.text
    assert "rules" not in str(prompt_named("paper").request("not over the carpet", HOME).schema)


@pytest.mark.parametrize(
    ("words", "way"),
    [
        ("the bedroom is off limits today", True), ("to the sofa, and spare the vase", True),
        ("bring me the cup", False), ("what colour is the vase?", False),
    ],
)  # fmt: skip
def test_the_parser_hears_the_way_where_no_word_of_the_table_stands(words: str, way: bool) -> None:
    assert not route_rules.WAYS.search(words) and route_rules.asks(words) == way


def test_rules_that_hold_are_listed_for_lifts() -> None:
    holding = replace(HOME, rules=(RouteRule.parse("avoid room:hall hard standing"),))
    assert '["avoid room:hall hard standing"]' in prompt_named("rich").request("use the hall again", holding).text
