"""A drive whose noun was not marked goes to the last listed name in its words."""

from __future__ import annotations

import pytest
from homes import inventory

from cartier.reasoners import embedded
from cartier.understanding.naming import with_target
from cartier.understanding.tags import Clause, Span

NAMES = embedded.lexicon(embedded.make().deck, inventory("flat"))


@pytest.mark.parametrize(
    ("words", "target"),
    [
        ("eighteen hours in this chair … sofa it is", "sofa"),
        ("not the sofa", None),
        ("the bed , never the sofa", "bed"),
        ("somewhere nice", None),
    ],
)
def test_last_listed_name_that_is_not_turned_down_is_the_target(words: str, target: str | None) -> None:
    clause = with_target(Clause("go", 0.9, (), tuple(words.split())), NAMES)
    assert [span.words for span in clause.spans] == ([] if target is None else [(target,)])


def test_what_was_marked_and_what_is_no_drive_stays() -> None:
    marked = Clause("go", 0.9, (Span("t", ("bed",), 0, 1),), ("bed", "or", "sofa"))
    asked = Clause("where", 0.9, (), ("sofa",))
    assert with_target(marked, NAMES) == marked and with_target(asked, NAMES) == asked


def test_a_name_that_is_wanted_wins_over_what_else_the_words_suggest(monkeypatch: pytest.MonkeyPatch) -> None:
    reasoner, said = embedded.make(), "mirror . i am so sleepy , i could sleep all night"
    clause = Clause("go", 0.9, (Span("t", ("mirror",), 0, 1),), tuple(said.split()))
    monkeypatch.setattr(reasoner.tracker, "parsed", lambda *_: (clause,))
    assert reasoner.select(said, inventory("flat")).object == "mirror"
    monkeypatch.setattr(reasoner.tracker, "parsed", lambda *_: (clause._replace(act="need", spans=()),))
    assert reasoner.select(said, inventory("flat")).object == "bed", "what the words suggest"
