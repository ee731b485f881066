"""Cache of a reasoner's answers in a file, with what each question cost; no question is asked twice."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from cartier.contracts import Reasoner, ReasonerDefaults, optional
from cartier.io.atomic import append_line
from cartier.io.files import read_rows
from cartier.types import Fact, Inventory, Selection
from cartier.types.route_rules import RouteRule


class Asked:
    """Obeys the Reasoner contract; without a file nothing is kept. ``spent`` adds up what the questions cost when they
    were first asked: seconds, calls, tokens."""

    def __init__(self, reasoner: Reasoner, file: Path | None) -> None:
        self._reasoner, self._file = reasoner, file
        self.name = reasoner.name
        self.spent = {"seconds": 0.0, "calls": 0, "tokens": 0}

    @cached_property
    def _known(self) -> dict[str, dict[str, Any]]:
        """By the question; read when the first is asked, since by then the run folder is locked."""
        rows = [] if self._file is None else read_rows(self._file, ("asked", "reply", "cost"))
        return {json.dumps(row["asked"]): row for row in rows}

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        reply = self._recall(
            ["select", query, _digest(inventory), list(dialogue)],
            lambda: _plain(self._reasoner.select(query, inventory, dialogue)),
        )
        return _selection(reply)

    def propose(self, query: str) -> list[str]:
        reply: list[str] = self._recall(["propose", query], lambda: self._reasoner.propose(query))
        return reply

    def _recall(self, question: list[Any], ask: Callable[[], Any]) -> Any:
        row = self._known.get(json.dumps(question))
        if row is None:
            calls, tokens = (optional(self._reasoner, ReasonerDefaults, total) for total in ("calls", "tokens"))
            begin = time.perf_counter()
            reply = ask()
            cost = {
                "seconds": time.perf_counter() - begin,
                "calls": optional(self._reasoner, ReasonerDefaults, "calls") - calls,
                "tokens": optional(self._reasoner, ReasonerDefaults, "tokens") - tokens,
            }
            row = {"asked": question, "reply": reply, "cost": cost}
            self._known[json.dumps(question)] = row
            if self._file is not None:
                append_line(self._file, json.dumps(row, ensure_ascii=False))
        for what, much in row["cost"].items():
            self.spent[what] += much
        return row["reply"]


def _digest(inventory: Inventory) -> str:
    """The same for the same objects, rooms, and standpoint of the robot."""
    rooms = [(room.id, room.name) for room in inventory.rooms]
    seen = [asdict(obj) for obj in inventory.objects]
    return hashlib.sha256(json.dumps([seen, rooms, inventory.from_xy]).encode()).hexdigest()[:16]


def _plain(selection: Selection) -> dict[str, Any]:
    kept = asdict(selection) | {"prompt": "", "next": [_plain(further) for further in selection.next]}
    kept |= {key: [rule.text for rule in getattr(selection, key)] for key in ("rules", "lifts")}
    return kept


def _selection(row: dict[str, Any]) -> Selection:
    candidates = tuple((str(name), float(score)) for name, score in row["candidates"])
    told = row["fact"]
    fact = None if told is None else Fact(told["kind"], _frozen(told["value"]), tuple(told["objects"]))
    rules = {key: tuple(map(RouteRule.parse, row[key])) for key in ("rules", "lifts")}
    further = tuple(map(_selection, row["next"]))
    return Selection(**(row | rules | {"candidates": candidates, "fact": fact, "next": further}))


def _frozen(value: Any) -> Any:
    """A JSON list as the tuple that it was."""
    return tuple(value) if isinstance(value, list) else value
