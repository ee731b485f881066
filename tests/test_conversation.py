"""The loop of a conversation: what a reasoner is told of the turns before, and where the robot stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import cartier
from cartier.conversation import Conversation
from cartier.errors import InputError, ReasonerError
from cartier.llm.prompts import MAX_QUERY_CHARS, MAX_TURNS
from cartier.pipeline import map_home
from cartier.types import FREE, Fact, Inventory, Room, Selection
from synthetic import THINGS, TrueBoxes, walk

CHAIR = Selection("found", "chair", "for your feet")
ASKS = Selection("clarify", reason="two fit", question="The chair or the table?")
ABSENT = Selection("not_found", reason="no gate here")


class Script:
    """Gives its answers in turn and keeps what it was told: what is tested here is the loop around it."""

    name = "script"

    def __init__(self, *answers: Selection | Exception) -> None:
        self.answers, self.told = list(answers), []

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        self.told.append((query, list(dialogue)))
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def propose(self, query: str) -> list[str]:
        return []


@pytest.fixture(scope="module")
def home() -> cartier.Home:
    return map_home(walk(), TrueBoxes(THINGS))


def number_of(home: cartier.Home, name: str) -> str:
    """The object of a name, as a turn of the robot says it."""
    return f"{name} #{next(obj.id for obj in home.objects if obj.label == name)}"


def test_each_turn_is_told_to_the_next(home: cartier.Home) -> None:
    reasoner = Script(ASKS, CHAIR, ABSENT, CHAIR)
    talk = Conversation(home, reasoner)
    for words in ("let me rest", "the chair\n", "and my gate?", "thanks"):
        talk.say(words)
    turns = [
        ("let me rest", "The chair or the table?"),
        ("the chair", number_of(home, "chair")),
        ("and my gate?", "nothing here serves that"),
    ]
    assert reasoner.told[-1] == ("thanks", turns) and [len(told) for _, told in reasoner.told] == [0, 1, 2, 3]


def test_several_needs_are_one_turn_and_the_robot_ends_at_the_last(home: cartier.Home) -> None:
    other = next(name for name in home.names if name != "chair")
    both = Selection("found", "chair", next=(Selection("likely_near", other), ABSENT))
    reasoner = Script(both, CHAIR)
    talk = Conversation(home, reasoner, from_xy=(1.0, 1.0))
    first = talk.say("sit, then the rest")
    assert first.next[0].goal is not None and first.goal is not None
    assert tuple(talk.from_xy) == (first.next[0].goal.x, first.next[0].goal.y)
    second = talk.say("back again")
    assert reasoner.told[1][1] == [
        (
            "sit, then the rest",
            f"{number_of(home, 'chair')}, then {number_of(home, other)}, then nothing here serves that",
        )
    ]
    assert second.goal is not None and tuple(second.goal.path[0]) == pytest.approx(tuple(first.next[0].goal.path[-1]))


def test_what_failed_was_not_said(home: cartier.Home) -> None:
    reasoner = Script(ReasonerError("cannot reach it"), CHAIR)
    talk = Conversation(home, reasoner)
    for words, error in (("sit", ReasonerError), (" \x00", InputError), ("x" * 10**6, InputError)):
        with pytest.raises(error):
            talk.say(words)
    assert talk.turns == [] and tuple(talk.from_xy) == tuple(home.start_xy)
    talk.say("sit")
    assert reasoner.told[-1] == ("sit", [])


def test_a_long_conversation_stays_bounded(home: cartier.Home) -> None:
    reasoner = Script(*[ABSENT] * 40)
    talk = Conversation(home, reasoner)
    for number in range(20):
        talk.say(f"request {number}")
    assert [person for person, _ in talk.turns] == [f"request {n}" for n in range(20 - MAX_TURNS, 20)]
    for _ in range(20):
        talk.say("y" * 3000)
    assert len(talk.turns) >= 1 and sum(len(p) + len(r) for p, r in talk.turns) <= MAX_QUERY_CHARS


def test_a_turn_says_which_object_which_room_or_the_sentence_that_was_told(home: cartier.Home) -> None:
    table = next(obj for obj in home.objects if obj.label == "table")
    room = Room(4, "dining room", "dining room", np.argwhere(home.grid.cells == FREE).astype(np.int32))  # type: ignore[union-attr]
    there = replace(home, rooms=(room,))
    told = Selection(
        "answered", "table", text="There is one table.", object_id=table.id, fact=Fact("count", 1, (table.id,))
    )
    answers = [Selection("found", "table", object_id=table.id), Selection("found", room.name, room=room.id), told]
    reasoner = Script(*answers, CHAIR)
    talk = Conversation(there, reasoner)
    for words in ("the table", "the dining room", "how many tables?", "sit"):
        answer = talk.say(words)
        assert (answer.goal is None) == (answer.selection.status == "answered")
    said = [robot for _, robot in reasoner.told[-1][1]]
    assert said == [f"table #{table.id}", "dining room (room 4)", f"There is one table. (#{table.id})"]
