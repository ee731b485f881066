"""Report of the suite things: its tables and failures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cartier_bench.suite import Row
from cartier_bench.tables import markdown
from cartier_bench.things import ASK, FIND, KINDS, WRITTEN, Item, load_items

GROUPS = {
    "find the particular thing": FIND, "a bare name of several": ("bare",), "count, exists, where, list": ASK[:4],
    "compare": ("compare",), "what nothing serves": ("nothing",),
}  # fmt: skip
FAILURES = 60  # of each kind, in failures.md


def report(rows: Sequence[Row], items: Sequence[Item], who: str) -> dict[str, Any]:
    """The shares of right answers, tables to read, what was asked (to be asked again, or of another system), and
    failures; none of requests that were written by hand."""
    written = {item.id for item in load_items(WRITTEN)}
    sets = {
        "made from the truth": [row for row in rows if row["id"] not in written],
        "written by hand": [row for row in rows if row["id"] in written],
    }
    parts = [
        f"# Particular things: {who}",
        "Share of right answers in percent; n requests. docs/things.md says what is right.",
    ]
    parts += [f"## Requests {words}\n\n{table(some)}" for words, some in sets.items() if some]
    return {
        "requests.jsonl": "".join(json.dumps(item.to_dict(), ensure_ascii=False) + "\n" for item in items),
        "results.json": {"reasoner": who} | {words: shares(some) for words, some in sets.items() if some},
        "report.md": "\n\n".join(parts) + "\n",
        "failures.md": _failures(sets["made from the truth"], items),
    }


def shares(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """By kind and by group of kinds: n, and by detector and run the share of right answers (``f1`` for lists too)."""
    found: dict[str, Any] = {}
    rows = list(rows)
    for name, kinds in {**GROUPS, **{kind: (kind,) for kind in KINDS}}.items():
        some = [row for row in rows if row["kind"] in kinds]
        if not some:
            continue
        ways = dict.fromkeys((row["detector"], row["run"]) for row in some)
        found[name] = {"n": len({row["id"] for row in some})}
        for detector, how in ways:
            here = [row for row in some if (row["detector"], row["run"]) == (detector, how)]
            lists = [row["f1"] for row in here if row["f1"] is not None]
            told = {"right": round(float(np.mean([row["right"] for row in here])), 4)}
            found[name][f"{detector}, {how}"] = told | ({"f1": round(float(np.mean(lists)), 4)} if lists else {})
    return found


def table(rows: Iterable[Mapping[str, Any]]) -> str:
    """Markdown: groups of kinds, then each kind, by detector and run."""
    found = shares(rows)
    ways = list(dict.fromkeys(way for told in found.values() for way in told if way != "n"))
    titles = [way.replace("ground_truth", "ground truth").replace("embedded", "pixels") for way in ways]
    body = [
        [f"**{name}**" if name in GROUPS else name, str(told["n"]), *(_cell(told.get(way)) for way in ways)]
        for name, told in found.items()
    ]
    return markdown(["", "n", *titles], body)


def _cell(told: Mapping[str, float] | None) -> str:
    if told is None:
        return ""
    return f"{told['right']:.0%}".rstrip("%") + (f" (F1 {told['f1']:.2f})" if "f1" in told else "")


def _failures(rows: Iterable[Row], items: Iterable[Item]) -> str:
    """What went wrong with the map, kind by kind."""
    by_id, lines = {item.id: item for item in items}, ["# What went wrong"]
    wrong = [row for row in rows if not row["right"] and row["run"] in ("map", "answers")]
    for kind in KINDS:
        some = [row for row in wrong if row["kind"] == kind][:FAILURES]
        lines += [f"\n## {kind}\n"] if some else []
        for row in some:
            item, said = by_id[row["id"]], row["answer"] if row["status"] == "answered" else row.get("object")
            accepted = f"one of {list(item.accept_ids)}" if item.accept_ids else "no goal"
            lines.append(
                f"- {row['id']} ({row['detector']}): {' / '.join(item.turns)} → {row['status']} {said}, "
                f"{(row['question'] or row['text'])[:100]!r}; right: "
                f"{accepted if item.answer is None else item.answer}"
            )
    return "\n".join(lines) + "\n"
