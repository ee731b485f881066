"""Rooms by whose they are: asked about when first met, then known."""

from __future__ import annotations

import pytest

from cartier.reasoners import embedded
from cartier.types import Inventory
from cartier.understanding.owners import owner_told
from cartier.understanding.spoken_corrections import SpokenCorrection, spoken_correction
from flat import OBJECTS
from flat import ROOMS as FLAT_ROOMS

ROOMS = FLAT_ROOMS[:2]
FLAT = Inventory(OBJECTS, ROOMS, from_xy=(0.0, 0.0))
ROOM = ROOMS[0]


@pytest.fixture(scope="module")
def reasoner() -> embedded.Embedded:
    return embedded.make()


@pytest.mark.parametrize(
    "words",
    ["take me to Ben's room", "where is Ben's bedroom?", "how many chairs are in Ben's room?", "the bed in Ben's room"],
)
def test_unknown_owner_is_asked_about(reasoner: embedded.Embedded, words: str) -> None:
    asked = reasoner.select(words, FLAT)
    assert asked.status == "clarify"
    assert asked.question is not None
    assert asked.question.startswith("Which room is Ben's ")
    assert all(room.name in asked.question for room in ROOMS)


def test_reply_serves_the_request_that_waited(reasoner: embedded.Embedded) -> None:
    words = "take me to Ben's room"
    question = reasoner.select(words, FLAT).question or ""
    for room in ROOMS:
        told = reasoner.select(f"the {room.name}", FLAT, [(words, question)])
        assert (told.status, told.room) == ("found", room.id)


@pytest.mark.parametrize("words", ["there's room on the table", "what's room service", "Ben's mug please"])
def test_other_possessives_are_no_rooms(reasoner: embedded.Embedded, words: str) -> None:
    assert "Which room" not in (reasoner.select(words, FLAT).question or "")


def test_reply_names_the_room_for_good() -> None:
    robot = f"Which room is Ben's room: the {ROOM.name}?"
    meant = SpokenCorrection("name", f"room:{ROOM.id}", "Ben's room", drive=True)
    assert spoken_correction(f"It's the {ROOM.name}.", [("go to Ben's room", robot)], FLAT, None) == meant


@pytest.mark.parametrize("words", ["no idea", "the garage", "take me to the bed"])
def test_other_replies_name_nothing(words: str) -> None:
    assert owner_told(words, "Which room is Ben's room?", FLAT) is None
