"""Acts of clauses as the words around them decide, on marked clauses that stand in for the parser's."""

from __future__ import annotations

import pytest

from cartier.reasoners import embedded
from cartier.understanding.dialogue_state import DialogueState, in_context
from cartier.understanding.parser import parser
from cartier.understanding.tags import Clause
from route_talk import clauses_of, flat_inventory


@pytest.mark.parametrize(
    ("words", "second", "act"),
    [
        ("closest plant to us", ("go", 0.3), "go"),
        ("closest plant to us", ("go", 0.1), "which"),
        ("closest plant to us", ("list", 0.3), "which"),
        ("which plant is closest", ("go", 0.3), "which"),
    ],
)
def test_what_begins_as_no_question_may_drive(words: str, second: tuple[str, float], act: str) -> None:
    clause = Clause("which", 0.5, (), tuple(words.split()), second)  # type: ignore[arg-type]
    assert in_context(clause, DialogueState()).act == act


@pytest.mark.parametrize(
    ("words", "act"), [("robot , where are you now ?", "where"), ("where am i", "where"), ("where can you go", "able")]
)
def test_where_are_you_is_a_question(words: str, act: str) -> None:
    clause = Clause("able", 0.7, (), tuple(words.split()), ("back", 0.2))
    assert in_context(clause, DialogueState()).act == act


@pytest.mark.parametrize(
    ("act", "words", "rules"),
    [
        ("prohibit", "stay off the [rug:va]", ["avoid floor:rug hard standing"]),
        ("prohibit", "stay off the [trampoline:va]", []),
        ("remark", "the [rug:va] was cold yesterday", []),
    ],
)
def test_only_prohibitions_of_what_is_there_are_rules(
    monkeypatch: pytest.MonkeyPatch, act: str, words: str, rules: list[str]
) -> None:
    text, clauses = clauses_of(act, words)
    reasoner = embedded.make()
    monkeypatch.setattr(reasoner.tracker, "parsed", lambda *_: tuple(clauses))
    chosen = reasoner.select(text, flat_inventory())
    assert chosen.status == "answered" and chosen.object is None
    assert [rule.text for rule in chosen.rules] == rules


@pytest.mark.parametrize("words", ["take me to Ben's room", "the curtains are burning", "she drank the bleach"])
def test_parser_leaves_alarms_to_the_screen(words: str) -> None:
    names = embedded.lexicon(embedded.make().deck, flat_inventory())
    for clause in parser()(words.replace("'", " ' ").split(), None, names):
        assert "alarm" not in (clause.act, clause.second[0]) and 0 < clause.certainty <= 1
