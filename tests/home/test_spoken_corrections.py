"""Corrections in conversation: a few whole sentences correct the home, and all else is a request."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cartier import Conversation, make
from cartier.home import Home
from cartier.home.corrections import find
from cartier.pipeline import map_home
from cartier.types import Inventory
from cartier.understanding.spoken_corrections import NOTED, SpokenCorrection, spoken_correction
from cartier.understanding.tentative import OFFER
from flat import OBJECTS, ROOMS, UNSURE
from synthetic import THINGS, TrueBoxes
from synthetic import small_walk as walk

FLAT = Inventory((*OBJECTS, *UNSURE), ROOMS, from_xy=(0.0, 0.0))
OFFERED = f"I may have seen a vase in the bedroom, but too seldom to be sure. {OFFER}"


@pytest.mark.parametrize(
    ("robot", "words", "meant"),
    [
        ("cup #12", "Yes, it is there.", SpokenCorrection("confirm", "12")),
        ("cup #12", "the cup is really there", SpokenCorrection("confirm", "12")),
        (OFFERED, "yes, it's there", SpokenCorrection("confirm", "32", drive=True)),
        ("cup #12", "No, that's a pencil box", SpokenCorrection("relabel", "12", "pencil box")),
        ("There is one. (#12)", "that is a vase, not a cup", SpokenCorrection("relabel", "12", "vase")),
        ("cup #12", "This is Ben's room!", SpokenCorrection("name", "room:1", "Ben's room")),
        (f"{NOTED}cup (12) is there. (#12)", "undo that", SpokenCorrection("undo")),
    ],
)  # fmt: skip
def test_words_that_correct(robot: str, words: str, meant: SpokenCorrection) -> None:
    assert spoken_correction(words, [("where is it", robot)], FLAT, 1, ["vase"]) == meant


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        ("cup #12", "is it there?"), ("cup #12", "it is there?"), ("cup #12", "it is not there"),
        ("cup #12", "yes"), ("cup #12", "that is a pity"), ("cup #12", "that is a cup"), ("cup #12", "it is a table"),
        ("cup #12", "that is a good idea, take me to the table"), ("cup #12", "the table is there"),
        ("cup #12", "undo that"), ("cup #12, then sink #5", "yes, it is there"), ("cup #99", "that is a table"),
        ("kitchen (room 0)", "that is a table"), ("nothing here serves that", "yes, it is there"),
        ("cup #12", "this is Ben's mug"), ("cup #12", "this is a room"), (OFFERED, "yes please"),
    ],
)  # fmt: skip
def test_words_that_do_not(robot: str, words: str) -> None:
    assert spoken_correction(words, [("where is it", robot)], FLAT, 1, ["vase"]) is None


def test_a_conversation_corrects_a_saved_home_and_takes_it_back(tmp_path: Path) -> None:
    mapped = map_home(walk(), TrueBoxes(THINGS))
    mapped.save(tmp_path)
    home = Home.load(tmp_path)
    talk = Conversation(home, make("reasoners", "embedded"))
    chair = talk.say("take me to the chair").selection.object_id
    told = talk.say("no, that is a pencil box").selection
    assert told.text == f"Noted: chair ({chair}) is labelled pencil box." and told.object_id == chair
    assert talk.say("where is the pencil box?").selection.object_id == chair
    assert talk.say("this is Ben's room").selection.text.endswith("is called Ben's room.")
    for named in ("Ben's room", "pencil box"):
        undone = talk.say("undo that").selection.text
        assert undone.startswith("Noted: undone: ") and named in undone
    assert talk.home.objects == home.objects and not talk.say("undo that").selection.text.startswith("Noted")
    unsaved = Conversation(mapped, make("reasoners", "embedded"))
    unsaved.say("take me to the chair")
    unsaved.say("that is a pencil box")
    assert unsaved.home is mapped, "a home that is not on the disk stays as it is"


def test_what_was_offered_is_confirmed_and_driven_to(tmp_path: Path) -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    doubtful = tuple(
        replace(obj, probability=0.1, confirmed=False) if obj.label == "mug" else obj for obj in home.objects
    )
    replace(home, objects=doubtful).save(tmp_path)
    talk = Conversation(Home.load(tmp_path), make("reasoners", "embedded"))
    assert talk.say("take me to the mug").selection.question
    answer = talk.say("yes, it is there")
    mug = find("mug", talk.home.objects)
    assert answer.selection.status == "found" and answer.goal is not None and "mug" in talk.home.names
    assert answer.selection.object_id == mug.id


def test_room_of_a_person_is_remembered(tmp_path: Path) -> None:
    mapped = map_home(walk(), TrueBoxes(THINGS))
    mapped.save(tmp_path)
    talk = Conversation(Home.load(tmp_path), make("reasoners", "embedded"))
    room = talk.home.rooms[0].name
    assert (talk.say("take me to Ben's room").selection.question or "").startswith("Which room is Ben's room")
    assert talk.say(f"the {room}").selection.room == talk.home.rooms[0].id
    assert Home.load(tmp_path).rooms[0].name == "Ben's room"
    assert talk.say("take me to ben's room").selection.room == talk.home.rooms[0].id
