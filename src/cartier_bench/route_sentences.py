"""Sentences about the way against the typed rules that their writers wrote down: exact, and part by part.

Lines are ``ACT ANSWER + RULE … :: words`` (tools/understanding/README.md). Those that ship are by authors who read
nothing of the program; only totals are kept of them. A sentence counts where kind, target, strength and scope of all
rules are the very ones that its writer wrote down.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from cartier.contracts import Reasoner
from cartier.errors import InputError
from cartier.types.route_rules import RouteRule, RouteTarget
from cartier_bench.marked_lines import Line, read
from cartier_bench.true_home import perfect_map

HELD_OUT = Path(__file__).with_name("route_texts")
PARTS = ("kind", "target", "strength", "scope")


class Judged(NamedTuple):
    """One sentence: its sort, whether it has several rules, whether all is exact, and whether each part is."""

    sort: str
    several: bool
    exact: bool
    right: dict[str, bool]


def sentence_lines(files: Sequence[Path] = ()) -> list[Line]:
    """The lines with rules whose targets are checked; without files the held-out ones.

    Raises InputError if there are none.
    """
    found = [line for file in files or sorted(HELD_OUT.glob("*.txt")) for line in read(file) if _texts(line)]
    checked = [line for line in found if not any(text.startswith("!") for text in _texts(line))]
    if not checked:
        raise InputError("no line has a route rule: ACT ANSWER + RULE :: words (tools/understanding/README.md)")
    return checked


def _texts(line: Line) -> list[str]:
    return [text for wishes in line.rules for text in wishes]


def judged(line: Line, reasoner: Reasoner) -> Judged:
    """A line as a reasoner reads it."""
    wanted = [RouteRule.parse(text) for text in _texts(line)]
    lifting = line.acts[0] == "lift"
    standing = tuple(replace(rule, scope="standing", id=f"r{k}") for k, rule in enumerate(wanted) if lifting)
    chosen = reasoner.select(line.text, replace(perfect_map(line.home), rules=standing), list(line.context))
    got = [rule for part in (chosen, *chosen.next) for rule in (part.lifts if lifting else part.rules)]
    unknown = [rule for rule in wanted if rule.target is not None and rule.target.kind == "none"]
    if unknown and chosen.status == "clarify":  # it asks what is meant, as it should
        wanted = [rule for rule in wanted if rule not in unknown]
    right = {name: _same(got, wanted, name) for name in PARTS}
    if lifting:
        right |= {"strength": True, "scope": True}
        exact = set(got) == set(standing)  # without their ids, which kept answers do not have
    else:
        exact = set(got) == set(wanted)
    sort = "takes back" if lifting else "only a rule" if line.acts[0] == "rule" else "goal and rule"
    return Judged(sort, len(wanted) > 1, exact, right)


def _same(got: Sequence[RouteRule], wanted: Sequence[RouteRule], name: str) -> bool:
    def part(rule: RouteRule) -> str:
        value = getattr(rule, name)
        return value.text if isinstance(value, RouteTarget) else str(value)

    return Counter(map(part, got)) == Counter(map(part, wanted))


def figures(rows: Sequence[Judged]) -> dict[str, Any]:
    """The shares of exact sentences and of right parts, by sort, and in all."""
    of: dict[str, list[Judged]] = defaultdict(list)
    for row in rows:
        for sort in (row.sort, *(["several rules"] if row.several else []), "all"):
            of[sort].append(row)
    return {sort: {"lines": len(some), "exact": _share([row.exact for row in some]),
                   **{name: _share([row.right[name] for row in some]) for name in PARTS}}
            for sort, some in sorted(of.items(), key=lambda pair: (pair[0] == "all", pair[0]))}  # fmt: skip


def _share(hits: Sequence[bool]) -> float:
    return round(sum(hits) / len(hits), 4)
