"""Decision after a look, as a table: the latest verified observation, margins, too few views, several that fit."""

from __future__ import annotations

import pytest

from cartier.types import CANNOT_TELL, VisualAnswer
from cartier.vision.decision import decide
from cartier.vision.look import question_about
from vision.staged_photos import BOX, mug

ONE = [mug(1, [(1, BOX, 0), (5, BOX, 90)])]
TWO = [*ONE, mug(2, [(2, BOX, 0), (6, BOX, 90)])]
ONCE = [mug(1, [(1, BOX, 0)])]
LARGE = 200.0
Row = tuple[int, int, str | None, float, float]
"""Object, frame, answer, certainty, apparent size."""

ROWS: dict[str, tuple[list, list[Row], bool, str, str | None, int | None]] = {
    "one sure answer": (ONE, [(1, 1, "clean", 0.9, LARGE)], False, "told", "clean", 1),
    "the latest wins, not the surest": (
        ONE, [(1, 1, "clean", 0.99, LARGE), (1, 5, "dirty", 0.7, LARGE)], False, "told", "dirty", 1,
    ),
    "the latest wins in any order": (
        ONE, [(1, 5, "dirty", 0.7, LARGE), (1, 1, "clean", 0.99, LARGE)], False, "told", "dirty", 1,
    ),
    "cannot tell verifies nothing": (
        ONE, [(1, 1, "clean", 0.9, LARGE), (1, 5, None, 0.0, LARGE)], False, "told", "clean", 1,
    ),
    "nothing can be told": (ONE, [(1, 1, None, 0.0, LARGE)], False, "cannot_tell", None, None),
    "a small view says nothing": (ONE, [(1, 1, "clean", 0.99, 63.9)], False, "cannot_tell", None, None),
    "64 px are enough": (ONE, [(1, 1, "clean", 0.9, 64.0)], False, "told", "clean", 1),
    "margin of 0.14": (ONE, [(1, 1, "clean", 0.57, LARGE)], False, "refused", None, None),
    "margin of 0.16": (ONE, [(1, 1, "clean", 0.58, LARGE)], False, "told", "clean", 1),
    "seen once": (ONCE, [(1, 1, "clean", 0.99, LARGE)], False, "refused", None, None),
    "both alike": (TWO, [(1, 1, "clean", 0.9, LARGE), (2, 2, "clean", 0.8, LARGE)], False, "told", "clean", 1),
    "they differ": (TWO, [(1, 1, "clean", 0.9, LARGE), (2, 2, "dirty", 0.8, LARGE)], False, "several", None, None),
    "one of two fits": (TWO, [(1, 1, "dirty", 0.9, LARGE), (2, 2, "clean", 0.9, LARGE)], True, "told", "clean", 2),
    "two fit": (TWO, [(1, 1, "clean", 0.95, LARGE), (2, 2, "clean", 0.6, LARGE)], True, "several", None, None),
    "none fits": (TWO, [(1, 1, "dirty", 0.9, LARGE), (2, 2, "dirty", 0.9, LARGE)], True, "told", None, None),
    "none of the seen fits": (
        TWO, [(1, 1, "dirty", 0.9, LARGE), (2, 2, None, 0.0, LARGE)], True, "cannot_tell", None, None,
    ),
    "the other is unknown": (TWO, [(1, 1, "clean", 0.64, LARGE), (2, 2, None, 0, LARGE)], True, "refused", None, None),
    "the other is unknown, this one sure": (
        TWO, [(1, 1, "clean", 0.9, LARGE), (2, 2, None, 0, LARGE)], True, "told", "clean", 1,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_decision(name: str) -> None:
    candidates, rows, choose, verdict, answer, number = ROWS[name]
    answers = [VisualAnswer(*row[:4]) for row in rows]
    question = question_about("cup", "clean", "clean", objects=tuple(obj.id for obj in candidates))
    decision = decide(question, candidates, answers, [row[4] for row in rows], choose)
    assert (decision.verdict, decision.answer, decision.object_id) == (verdict, answer, number)


def test_cannot_tell_is_no_choice() -> None:
    assert CANNOT_TELL not in question_about("cup", "clean").choices
