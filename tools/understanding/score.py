"""Score of the embedded reasoner on lines of ``ACT ANSWER :: words``: what it answers in the home's truth.

    python tools/understanding/score.py [FILE...] [--failures]

Without files the held-out lines (``held_out/``), of which only totals may be looked at. ``--failures`` prints each
wrong line; use it on development lines only.
"""

from __future__ import annotations

import re
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

from cartier.labels import object_ref
from cartier.reasoners import embedded
from cartier.spatial.query import called
from cartier.types import Inventory, Selection
from cartier_bench.marked_lines import Line, read
from cartier_bench.true_home import perfect_map

HELD_OUT = Path(__file__).parent / "held_out"
QUESTIONS = ("count", "exists", "where", "list", "compare", "far", "colour", "size", "when", "which", "rooms", "sure")
NO_GOAL = ("prohibit", "remark", "other", "deny", "stop", "come", "follow", "able", "thanks", "bye")
UNCHECKED = ("!", "?")
"""Beginnings of answers whose words are good, but about which the writer and the executor may be of two opinions."""


class Scored(NamedTuple):
    """One line with what was answered."""

    line: Line
    sort: str
    chosen: Selection
    right: bool
    took_s: float


def scored(reasoner: embedded.Embedded, files: list[Path]) -> Iterator[Scored]:
    """Every line whose answer is checked; route rules are judged by benchmarks/routes.py."""
    for file in files:
        last: Selection | None = None
        for line in read(file):
            home = perfect_map(line.home)
            dialogue = _dialogue(line, home, last)
            began = time.perf_counter()
            chosen = last = reasoner.select(line.text, home, dialogue)
            took = time.perf_counter() - began
            if not line.answers[0].startswith(UNCHECKED) and not any(line.rules):
                parts = [chosen, *chosen.next]
                right = len(parts) >= len(line.acts) and all(
                    is_right(act, answer, part, home)
                    for act, answer, part in zip(line.acts, line.answers, parts, strict=False)
                )
                yield Scored(line, _sort(line), chosen, right, took)


def _dialogue(line: Line, home: Inventory, last: Selection | None) -> list[tuple[str, str]]:
    """The turns before: the robot said what is written, went to the object of the written answer, or said what it did
    say to a question."""
    objects = {str(obj.id): obj for obj in home.objects}
    turns = []
    for k, (person, robot) in enumerate(line.context):
        obj = objects.get(robot.removeprefix("@")) if robot.startswith("@") else None
        if obj is not None:
            robot = object_ref(obj.label, obj.id)
        elif k == len(line.context) - 1 and robot == "all right" and last is not None:
            robot = last.text or last.reason or robot
            robot += f" (#{last.object_id})" if last.object_id is not None else ""  # as Session.ask writes it down
        turns.append((person, robot))
    return turns


def is_right(act: str, answer: str, chosen: Selection, home: Inventory) -> bool:
    """Whether a reply is what the writer wrote down."""
    ids, fact = {int(i) for i in re.findall(r"\d+", answer)}, chosen.fact
    if act in NO_GOAL:
        return chosen.object is None and chosen.status == "answered"
    if act in ("count", "exists"):
        told = {"yes": "True", "no": "False"}.get(answer, answer)
        return fact is not None and fact.kind == act and str(fact.value) == told
    if act in ("rooms", "sure"):
        return fact is not None and fact.kind == {"rooms": "list", "sure": "tell"}[act]
    if act == "list":
        return fact is not None and fact.kind == "list" and set(fact.objects) == ids
    if act in QUESTIONS:
        found = set(fact.objects) if fact is not None else set()
        return bool(found & ids) if ids else fact is not None and not found
    if answer in ("none", ""):
        return chosen.object is None if answer else chosen.status in ("found", "answered")
    if not ids:
        return chosen.room is not None and answer in (
            chosen.object,
            *(r.kind for r in home.rooms if r.id == chosen.room),
        )
    if chosen.status != "found":
        return False
    if chosen.object_id is not None:
        return chosen.object_id in ids
    return any(obj.id in ids and called(obj, [chosen.object or ""]) for obj in home.objects)


def _sort(line: Line) -> str:
    act = line.acts[0]
    if line.context:
        return "turns of a conversation"
    if len(line.acts) > 1:
        return "several requests at once"
    if act in ("prohibit", "remark"):
        return "nothing asked"
    if act in NO_GOAL:
        return "small talk and commands"
    return "questions" if act in QUESTIONS else "needs" if act == "need" else "particular objects"


def main() -> None:
    """Score and print totals."""
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="lines to score (default: the held-out ones)")
    parser.add_argument("--failures", action="store_true", help="print each wrong line")
    options = parser.parse_args()
    of: dict[str, list[bool]] = defaultdict(list)
    times = []
    for one in scored(embedded.make(), options.files or sorted(HELD_OUT.glob("*.txt"))):
        of[one.sort].append(one.right)
        of["all"].append(one.right)
        times.append(one.took_s)
        if options.failures and not one.right:
            head = " / ".join(f"{a} {b}" for a, b in zip(one.line.acts, one.line.answers, strict=True))
            got = one.chosen.object_id or one.chosen.object or (one.chosen.fact and one.chosen.fact.value)
            said = one.chosen.text or one.chosen.reason
            print(f"{one.line.where} [{head}] {one.line.text}\n    {one.chosen.status} {got}: {said}")
    print("| kind of line | lines | right |\n|---|---:|---:|")
    for sort, right in sorted(of.items(), key=lambda item: item[0] == "all"):
        print(f"| {sort} | {len(right)} | {np.mean(right):.1%} |")
    print(f"\n{1000 * np.median(times):.0f} ms a line at the median, {1000 * max(times):.0f} ms at most")


if __name__ == "__main__":
    run_script(main)
