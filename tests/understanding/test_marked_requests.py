"""Marked requests of many voices: the executor answers what their writers wrote down; broken marks get one line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cartier.errors import InputError
from cartier.understanding.assembly import query, routed
from cartier.understanding.decoding import clauses
from cartier.understanding.tags import DIALOGUE_ACTS, ROLES, TAGS
from cartier_bench.marked_lines import read, unmarked

TOOLS = Path(__file__).parents[2] / "tools" / "understanding"
sys.path.append(str(TOOLS))
from check_marks import fault, home  # noqa: E402

FILES = sorted((TOOLS / "written").glob("*_1.txt"))


def wrong_in(file: Path, homes: frozenset[str] | None = None) -> list[str]:
    """The lines of a file, perhaps only those of some homes, of which the marks do not give what is written."""
    states: dict[str, object] = {}
    lines = [line for line in read(file) if homes is None or line.home in homes]
    assert lines
    return [f"{line.where}: {told}" for line in lines if (told := fault(line, states))]  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_executor_gives_the_written_answers(file: Path) -> None:
    wrong = wrong_in(file)
    assert not wrong, wrong[:5]


def test_executor_gives_the_written_answers_in_one_home_of_every_third_voice() -> None:
    """Of every third file the lines of its first home: to build the homes takes longer than to ask in them."""
    files = FILES[::3]
    wrong = [each for file in files for each in wrong_in(file, frozenset({next(read(file)).home}))]
    assert len(files) >= 8 and not wrong, wrong[:5]


def test_every_act_and_role_is_written_somewhere() -> None:
    lines = [line for file in sorted((TOOLS / "written").glob("*.txt")) for line in read(file)]
    assert {act for line in lines for act in line.acts} >= {*DIALOGUE_ACTS}
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


@pytest.mark.parametrize(
    ("marked", "goal", "ways"),
    [
        (
            "the [mug:t] [on:on] the [desk:l], not over the [red:c] [rug:va] [by:near] the [bed:l]",
            ["desk"], [("rug", ("red",), ["bed"])],
        ),
        (
            "past the [kitchen:r] [table:vv] to the [sofa:t] [near:near] the [lamp:l]",
            ["lamp"], [("table", (), ["kitchen"])],
        ),
        (
            "slow at the [vase:vs], and then on to the [blue:c] [chair:t] [by:near] the [desk:l]",
            ["desk"], [("vase", (), [])],
        ),
        ("to the [sofa:t], off the [rug:va] and through the [hall:vv]", [], [("rug", (), []), ("hall", (), [])]),
    ],
)  # fmt: skip
def test_what_is_said_of_the_way_stays_with_it(
    marked: str, goal: list[str], ways: list[tuple[str, tuple[str, ...], list[str]]]
) -> None:
    _, tokens, tags = unmarked(marked, "here")
    clause, names = clauses(tokens, tags, [[("go", 1.0)]])[0], home("76001")[1]
    head = query(clause, names).head
    assert head is not None and [r.target.said for r in head.relations if r.target] == goal
    assert head.colours == (("blue",) if "blue" in tokens else ())
    found = [(n.said, n.colours, [r.target.said for r in n.relations if r.target]) for _, n in routed(clause, names)]
    assert found == ways


def test_need_leaves_out_the_way_there() -> None:
    _, tokens, tags = unmarked("something to drink, but not over the [carpet:va]", "here")
    asked = query(clauses(tokens, tags, [[("need", 1.0)]])[0], home("76001")[1])
    assert asked.need.split() == ["something", "to", "drink", ",", "but"]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("rule avoid floor:carpet hard standing :: keep off the [carpet:va]", ""),
        ("rule avoid floor:tiles hard standing :: keep off the [carpet:va]", "the marks give floor:carpet"),
        ("rule keep-away floor:carpet hard standing :: keep off the [carpet:va]", "nothing is marked as vk"),
        ("rule avoid floor:carpet hard until:15:00 :: keep off the [carpet:va] until three", "nothing is marked as vt"),
        ("rule avoid carpet :: keep off the [carpet:va]", "no route rule: 'avoid carpet'"),
        ("rule shortest hard standing :: the [short way:vh], not by the [carpet:va]", "va is marked without a rule"),
        ("lift avoid none:trampoline :: over the [trampoline:va] again", ""),
    ],
)
def test_rules_of_a_line_are_what_its_marks_give(tmp_path: Path, row: str, told: str) -> None:
    file = tmp_path / "a.txt"
    file.write_text(f"# home 76001\n# voice: a\n{row}\n", encoding="utf-8")
    assert [fault(line, {}) for line in read(file)] == [told]
