"""Marked requests of many voices: the executor answers what their writers wrote down; broken marks get one line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cartier.errors import InputError
from cartier.understanding.assembly import query
from cartier.understanding.decoding import clauses
from cartier.understanding.tags import ACTS, ROLES, TAGS

TOOLS = Path(__file__).parents[2] / "tools" / "understanding"
sys.path.append(str(TOOLS))
from check_marks import fault, home  # noqa: E402
from markup import read, unmarked  # noqa: E402

FILES = sorted((TOOLS / "written").glob("*_1.txt"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_executor_gives_the_written_answers(file: Path) -> None:
    states: dict[str, object] = {}
    wrong = [f"{line.where}: {told}" for line in read(file) if (told := fault(line, states))]  # type: ignore[arg-type]
    assert not wrong, wrong[:5]


def test_every_act_and_role_is_written_somewhere() -> None:
    lines = [line for file in sorted((TOOLS / "written").glob("*.txt")) for line in read(file)]
    assert {act for line in lines for act in line.acts} >= {*ACTS} - {"alarm"}
    rare = {"!behind", "!near", "!next", "!under", "!with", "above", "front", "from", "left", "right", "w"}
    assert {tag[2:] for line in lines for tag in line.tags if tag != "O"} >= {*ROLES} - rare


@pytest.mark.parametrize(
    ("row", "told"),
    [("the [mug:q]", "no role 'q'"), ("the [mug", "a bracket that is no mark")],
)
def test_broken_mark_is_refused(row: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        unmarked(row, "a.txt:1")


@pytest.mark.parametrize(
    ("marked", "relations"),
    [
        ("the [cup:t] [on:on] the [table:l] [by:near] the [window:m]", [("on", "table", [("near", "window")])]),
        ("the [cup:t] [on:on] the [table:l] [by:near] the [window:l]", [("on", "table", []), ("near", "window", [])]),
        ("[not in:!in] the [kitchen:r], the [cup:t]", [("not in", "kitchen", [])]),
        ("the [kitchen:r] [table:t]", [("in", "kitchen", [])]),
        ("the [cup:t] [between:between] the [sink:l] and the [stove:l]", [("between", "sink", [])]),
    ],
)
def test_relations_go_to_their_landmarks(marked: str, relations: list[object]) -> None:
    _, tokens, tags = unmarked(marked, "here")
    asked = query(clauses(tokens, tags, [[("go", 1.0)]])[0], home("76001")[1])
    assert asked.head is not None
    assert [
        (r.kind, r.target.said, [(m.kind, m.target.said) for m in r.target.relations if m.target])
        for r in asked.head.relations if r.target
    ] == relations  # fmt: skip


def test_of_two_names_the_last_known_one_counts() -> None:
    _, tokens, tags = unmarked("the [desk:t], i mean the [fridge:t]", "here")
    head = query(clauses(tokens, tags, [[("go", 1.0)]])[0], home("76001")[1]).head
    assert head is not None and head.labels == {"fridge"}


def test_clauses_are_cut_at_separators() -> None:
    tokens = ("go", "to", "bed", "then", "sink")
    tags = ("O", "O", "B-t", "B-/", "B-t")
    assert set(tags) <= set(TAGS)
    found = clauses(tokens, tags, [[("go", 0.9)], [("go", 0.8)]])
    assert [[span.words for span in clause.spans] for clause in found] == [[("bed",)], [("sink",)]]
    assert found[1].spans[0].start == 0
