"""Answers to questions about looks without a vision model: what a map has is told, and no state is ever guessed."""

from __future__ import annotations

from dataclasses import replace

import pytest

import cartier
from cartier.reasoners import embedded
from cartier.types import Door, Inventory, MapObject, Selection
from cartier.vision.pixels import BLIND
from flat import obj
from stored import home as stored_home
from vision.staged_photos import ROOMS


def thing(number: int, label: str, *colours: tuple[str, float], room: int = 0) -> MapObject:
    return replace(obj(number, label, (1.0 + number, 2.0, 0.8), (0.3, 0.3, 0.3), room), colours=colours)


OBJECTS = (
    thing(1, "fridge", ("grey", 0.9)), thing(2, "mug", ("red", 0.8), ("white", 0.2)), thing(3, "oven"),
    thing(4, "chair", ("brown", 0.9)), thing(5, "chair", ("blue", 0.9), room=1),
    thing(6, "toilet", ("grey", 0.7), ("white", 0.25)), thing(7, "lamp", ("yellow", 0.9)),
)  # fmt: skip


def said(words: str, *objects: MapObject, dialogue: tuple[tuple[str, str], ...] = (), **more: object) -> Selection:
    home = Inventory(objects or OBJECTS, ROOMS, from_xy=(0.0, 0.0), **more)  # type: ignore[arg-type]
    return embedded.make().select(words, home, dialogue)


UNKNOWN = {
    "is the fridge open?": (1,), "is the fridge open or closed?": (1,), "is the mug clean?": (2,),
    "is the oven on?": (3,), "did I leave the oven on?": (3,), "do you know whether the fridge is open": (1,),
    "is the lamp still on?": (7,), "is the chair broken?": (4, 5), "what is written on the mug?": (2,),
    "what does the fridge look like?": (1,), "which chair is dirty?": (4, 5), "is there a clean mug?": (2,),
    "is the oven red?": (3,),
}  # fmt: skip


@pytest.mark.parametrize("words", UNKNOWN)
def test_no_state_is_guessed(words: str) -> None:
    told = said(words)
    assert told.status == "answered" and told.text.startswith(BLIND), told.text
    assert told.fact is not None
    assert (told.fact.kind, told.fact.value, told.fact.objects) == ("tell", None, UNKNOWN[words])


COLOURS = {
    "is the mug red?": ("Yes", "red"), "is the mug blue?": ("No", "red"), "is the fridge grey?": ("Yes", "grey"),
    "is the fridge white?": ("No", "grey"), "is the toilet white?": ("Yes", "white"),
    "is the toilet grey?": ("No", "white"), "are the chairs blue?": ("Some", "1 of 2"),
    "are the chairs green?": ("No", "brown"),
}  # fmt: skip


@pytest.mark.parametrize("words", COLOURS)
def test_colours_are_told_from_the_map(words: str) -> None:
    begins, value = COLOURS[words]
    told = said(words)
    assert told.text.startswith(begins) and told.fact is not None and told.fact.value == value, told.text


def test_what_is_white_in_shadow_is_told_as_white() -> None:
    fact = said("what colour is the toilet?").fact
    assert fact is not None and fact.value == "white"


def test_it_is_what_was_mentioned_last() -> None:
    told = said("is it open?", dialogue=(("where is the fridge?", "The fridge (#1) is in the kitchen."),))
    assert told.text.startswith(BLIND) and told.object_id == 1


def test_passage_of_the_floor_plan_is_open() -> None:
    told = said("is the kitchen door open?", doors=(Door((2.0, 2.0), (0, 1), 0.9),))
    assert told.text.startswith("Yes: the way between the kitchen and the bedroom was open")
    assert said("is the kitchen door closed?", doors=(Door((2.0, 2.0), (0, 1), 0.9),)).text.startswith("No")


@pytest.mark.parametrize(
    "words",
    ["is there a mug?", "is the mug on the oven?", "the mug is dirty", "bring me a clean mug", "open the fridge"],
)
def test_other_words_are_answered_as_before(words: str) -> None:
    assert BLIND not in said(words).text


def test_what_is_not_listed_was_not_seen() -> None:
    assert "not seen" in said("is the television on?").text


def test_ask_says_so_without_a_vision_model() -> None:
    home = stored_home("kitchen_diner", "truth")
    answer = cartier.ask(home, "is the fridge open?")
    assert answer.selection.text.startswith(BLIND) and answer.goal is None
    assert "look" not in answer.to_dict()
