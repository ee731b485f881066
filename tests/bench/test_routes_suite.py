from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.types import Inventory, Selection
from cartier.types.route_rules import RouteRule
from cartier_bench import route_drives, route_run, route_sentences, suite
from cartier_bench.route_homes import home_names, off_m, true_home

LINES = """# home 76201
rule avoid floor:rug hard standing :: keep off the rug
go 2 + avoid floor:rug soft drive + shortest hard drive :: to the coffee table
lift avoid floor:rug :: the rug is free again
rule avoid none:trampoline hard standing :: keep off the trampoline
go 2 + !avoid room:bathroom hard drive :: not checked
go 2 :: no rule
"""


class Scripted:
    """Answers in the order of the lines with what it was given."""

    name = "scripted"

    def __init__(self, answers: Sequence[Selection]) -> None:
        self.answers = list(answers)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        chosen = self.answers.pop(0)
        return replace(chosen, lifts=inventory.rules) if query == "the rug is free again" else chosen

    def propose(self, query: str) -> list[str]:
        return []


def answer(*rules: str, status: str = "answered") -> Selection:
    return Selection(status, text="so", rules=tuple(RouteRule.parse(rule) for rule in rules))


def test_sentences_are_judged_part_by_part(tmp_path: Path) -> None:
    file = tmp_path / "lines.txt"
    file.write_text(LINES)
    lines = route_sentences.sentence_lines([file])
    assert len(lines) == 4
    scripted = Scripted([
        answer("keep-away floor:rug hard standing"), answer("shortest hard drive", "avoid floor:rug soft drive"),
        answer(), answer(status="clarify"),
    ])  # fmt: skip
    rows = [route_sentences.judged(line, scripted) for line in lines]
    assert [row.exact for row in rows] == [False, True, True, True]
    assert rows[0].right == {"kind": False, "target": True, "strength": True, "scope": True}
    figures = route_sentences.figures(rows)
    assert figures["all"] == {"lines": 4, "exact": 0.75, "kind": 0.75, "target": 1.0, "strength": 1.0, "scope": 1.0}
    assert figures["several rules"]["lines"] == 1 and list(figures)[-1] == "all"
    file.write_text("# home 76201\ngo 2 :: no rule\n")
    with pytest.raises(InputError, match="no line has a route rule"):
        route_sentences.sentence_lines([file])


def test_the_shipped_sentences_are_many() -> None:
    lines = route_sentences.sentence_lines()
    assert len(lines) >= 200 and len({(line.where.split(":")[0], line.voice) for line in lines}) >= 20


def test_a_broken_rule_is_seen() -> None:
    """A drive that obeys is told so, and the same path under a rule that it breaks is told to be broken."""
    home = true_home("studio+rugs+narrow")
    done = [route_drives.driven(drive) for drive in route_drives.drawn(["studio+rugs+narrow"], 3, 0)]
    figures = route_drives.figures(done)
    assert figures["drives"] == 3 and figures["hard_rules_broken"] == 0 and figures["collided"] == 0
    rule = RouteRule.parse(f"avoid room:{home.scene.rooms[0].name} hard drive")
    x1, y1, x2, y2 = home.scene.rooms[0].box
    far = off_m(rule, home)(np.array([[(x1 + x2) / 2, (y1 + y2) / 2], [x2 + 5.0, y2 + 5.0]]))
    assert far[0] < 0 < far[1]
    broken = route_drives.Outcome([("avoid room, hard", "broken")], False, True, 0.0, 1.0)
    assert route_drives.figures([*done, broken])["hard_rules_broken"] == 1


def test_the_suite_writes_a_report(tmp_path: Path) -> None:
    file = tmp_path / "lines.txt"
    file.write_text("# home 76201\nrule avoid floor:rug hard standing :: keep off the rug\n")
    scripted = Scripted([answer("avoid floor:rug hard standing")])
    lines, settings = route_sentences.sentence_lines([file]), route_run.RouteSettings(home_names(["studio"]), drives=2)
    suite.run(tmp_path / "run", route_run.routes(settings, lines, scripted))
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert results["homes"] == ["studio+rugs+narrow"] and results["sentences"]["all"]["exact"] == 1.0
    assert results["driving"]["drives"] == 2
    assert "| all | 1 | 100 |" in (tmp_path / "run" / "report.md").read_text()
    suite.run(tmp_path / "run", route_run.routes(settings, lines, Scripted([])))  # asked for once


def test_homes_have_rugs_and_narrow_doors() -> None:
    names = home_names()
    assert len(names) >= 13 and all(name.endswith("+rugs+narrow") for name in names)


def test_prompts_of_the_sentences_are_written_and_nobody_is_asked(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text(LINES)
    file = tmp_path / "prompts.jsonl"
    options = ["bench", "routes", "-o", "run", "--queries", "lines.txt", "--write-prompts", "prompts.jsonl"]
    run = subprocess.run([sys.executable, "-m", "cartier", *options], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0 and "nothing was sent" in run.stdout, run.stderr
    written = [json.loads(line)["body"]["messages"][-1]["content"] for line in file.read_text().splitlines()]
    assert len(written) == 4 and any("keep off the rug" in words for words in written)
    assert not (tmp_path / "run").exists()
