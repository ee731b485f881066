"""The requests that the embedded reasoner learns from: what their README says of them is so."""

from __future__ import annotations

import ast
import json
import re
from collections import Counter
from pathlib import Path

from cartier.understanding.cards import SHIPPED, read_deck

TOOLS = Path(__file__).parents[2] / "tools"
README = (TOOLS / "requests" / "README.md").read_text(encoding="utf-8")
ROWS = {
    file.stem: [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    for file in sorted((TOOLS / "requests").glob("*.jsonl"))
}


def test_the_counts_are_those_of_the_files() -> None:
    rows = [row for those in ROWS.values() for row in those]
    assert f"{len(rows):,} things" in README and f"({len(ROWS)} files)" in README
    for kind, count in Counter(row["kind"] for row in rows).items():
        assert f"{count:,} {kind}" in README
    assert f"{len(rows):,} in {len(ROWS)} files" in (TOOLS.parent / "docs" / "embedded.md").read_text(encoding="utf-8")


def test_what_is_held_back_is_what_the_training_holds_back() -> None:
    tree = ast.parse((TOOLS / "fit_decision.py").read_text(encoding="utf-8"))
    told = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id in ("FITTED", "REPORTED", "DEVELOPMENT")
    }
    held = README[README.index("**Held back") : README.index("Never train on them")]
    assert (
        set(re.findall(r"`([a-z_]+)`", held)) == {*told["FITTED"], *told["REPORTED"], *told["DEVELOPMENT"]} <= set(ROWS)
    )


def test_every_line_keeps_the_rules() -> None:
    deck, texts = read_deck(SHIPPED), Counter[str]()
    for row in (row for those in ROWS.values() for row in those):
        texts[row["text"]] += 1
        wanted = [name for group in row["accept"] for name in group] if row["kind"] == "several" else row["accept"]
        assert not set(wanted) & set(row["avoid"]), row
        assert all(deck.card_of(name) is not None for name in (*wanted, *row["avoid"])), row
        assert bool(wanted) == (row["kind"] != "nothing"), row
    assert max(texts.values()) == 1
