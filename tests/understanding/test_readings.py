"""Words whose act is unsure: the question names both readings, and the reply picks one."""

from __future__ import annotations

import pytest
from homes import inventory

from cartier.reasoners import embedded
from cartier.understanding import readings
from cartier.understanding.assembly import query as query_of
from cartier.understanding.tags import Clause

HOME = inventory("flat")
SAID = "take me to the sofa"


@pytest.fixture
def unsure(monkeypatch: pytest.MonkeyPatch) -> embedded.Embedded:
    """A reasoner to which "take me to the sofa" may be a drive or a remark, nearly as likely."""
    reasoner = embedded.make()
    read = reasoner.tracker.parsed

    def parsed(query: str, turn: tuple[str, str] | None, names: object) -> tuple[Clause, ...]:
        found = read(query, turn, names)
        if query == SAID:
            return (found[0]._replace(act="go", certainty=0.33, second=("remark", 0.32)),)
        return found

    monkeypatch.setattr(reasoner.tracker, "parsed", parsed)
    return reasoner


def test_question_names_both_readings(unsure: embedded.Embedded) -> None:
    asked = unsure.select(SAID, HOME)
    assert (asked.status, asked.object) == ("clarify", None)
    assert asked.question == f"{readings.UNSURE}shall I go to the sofa, or is there nothing to do?"


@pytest.mark.parametrize("reply", ["the first", "yes please", "go there"])
def test_first_reading_is_picked(unsure: embedded.Embedded, reply: str) -> None:
    question = unsure.select(SAID, HOME).question or ""
    chosen = unsure.select(reply, HOME, [(SAID, question)])
    assert (chosen.status, chosen.object) == ("found", "sofa")


@pytest.mark.parametrize("reply", ["the second", "no"])
def test_second_reading_is_picked(unsure: embedded.Embedded, reply: str) -> None:
    question = unsure.select(SAID, HOME).question or ""
    chosen = unsure.select(reply, HOME, [(SAID, question)])
    assert (chosen.status, chosen.object, chosen.text) == ("answered", None, "Understood.")


def test_another_request_is_no_reply(unsure: embedded.Embedded) -> None:
    question = unsure.select(SAID, HOME).question or ""
    assert unsure.select("take me to the bed", HOME, [(SAID, question)]).object == "bed"


def test_likelier_request_that_may_ask_for_nothing_is_served_sooner_than_a_remark_that_may_be_one() -> None:
    names = embedded.lexicon(embedded.make().deck, HOME)
    need = Clause("need", 0.4, (), ("tired",), ("remark", 0.4))
    asked = query_of(need, names)
    assert readings.question(need, asked) is None
    assert readings.question(need._replace(certainty=0.34), asked) is not None
    assert readings.question(need._replace(act="remark", second=("need", 0.4)), asked) is not None


def test_sure_words_and_readings_that_come_to_the_same_are_not_asked_about() -> None:
    reasoner = embedded.make()
    assert reasoner.select(SAID, HOME).status == "found"
    names = embedded.lexicon(reasoner.deck, HOME)
    clause = Clause("where", 0.4, (), ("where",), ("exists", 0.39))
    assert readings.question(clause, query_of(clause, names)) is None
    (named,) = reasoner.tracker.parsed(SAID, None, names)
    for first, second in (("go", "where"), ("count", "go")):  # either reading serves who named the sofa
        named = named._replace(act=first, certainty=0.4, second=(second, 0.39))
        assert readings.question(named, query_of(named, names)) is None
