"""Report on validation requests: the outcomes, and the table of them."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scorer_requests import Homes, Request

from cartier.reasoners.embedded import Embedded
from cartier.types import Inventory

LISTS = 2  # for each request, in which something serves; and one more in which nothing does
SERVED = ("explicit", "implicit", "conversational")


@dataclass(frozen=True)
class Outcome:
    """What became of one request over one list. ``serves`` is False where the list held nothing that serves.

    ``goals`` and ``right`` are what was chosen, and whether it was that; ``top`` is whether the most probable thing
    serves.
    """

    text: str
    style: str
    kind: str
    serves: bool
    status: str
    goals: tuple[str, ...]
    right: bool
    top: bool
    wanted: tuple[str, ...]
    candidates: tuple[tuple[str, float], ...]


def put(reasoner: Embedded, requests: list[Request], homes: Homes) -> list[Outcome]:
    """Every request put to a reasoner with a few lists."""
    found = []
    for request in requests:
        for number in range(LISTS + 1):
            serves = number < LISTS and request.kind != "nothing"
            names = homes.sample(request, random.Random(f"{request.text}{number}"), serves)
            found.append(_outcome(reasoner, request, names, serves))
    return found


def _outcome(reasoner: Embedded, request: Request, names: list[str], serves: bool) -> Outcome:
    chosen = reasoner.select(request.text, Inventory.of(names))
    goals = tuple(part.object for part in (chosen, *chosen.next) if part.object is not None)
    cards = [reasoner.deck.card_of(goal) for goal in goals]
    first = reasoner.deck.card_of(chosen.candidates[0][0]) if chosen.candidates else None
    return Outcome(
        text=request.text,
        style=request.style,
        kind=request.kind,
        serves=serves,
        status=chosen.status,
        goals=goals,
        right=len(cards) == len(request.needs) and all(c in n for c, n in zip(cards, request.needs, strict=True)),
        top=bool(request.needs) and first in request.needs[0],
        wanted=tuple(reasoner.deck.cards[need[0]].name for need in request.needs),
        candidates=chosen.candidates[:3],
    )


def table(outcomes: list[Outcome]) -> str:
    """Per style and kind: how often the choice was right; and what became of requests that nothing serves."""
    lines = [
        "| style | explicit | implicit | conversational | best guess: implicit | conversational | asked back | "
        "nothing: a goal |",
        "|---|---|---|---|---|---|---|---|",
    ]
    styles = sorted({o.style for o in outcomes})
    rows = [(style, [o for o in outcomes if o.style == style]) for style in styles]
    for name, some in (*rows, ("**all**", outcomes)):
        cells = [_share(some, kind, lambda o: o.right) for kind in SERVED]
        cells += [_share(some, kind, lambda o: o.top) for kind in SERVED[1:]]
        served = [o for o in some if o.serves and o.kind in SERVED]
        cells.append(_percent([o.status == "clarify" for o in served]))
        cells.append(_percent([bool(o.goals) for o in some if o.kind == "nothing"]))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def summary(outcomes: list[Outcome]) -> str:
    """One line each about several needs, and about lists from which all that serves was taken."""
    several = [o.right for o in outcomes if o.kind == "several" and o.serves]
    lines = [f"- several needs in one breath, all goals right and in order: {_percent(several)} %"]
    for kind in SERVED:
        removed = [o for o in outcomes if o.kind == kind and not o.serves]
        shares = {
            s: _percent([o.status == s for o in removed]) for s in ("not_found", "likely_near", "clarify", "found")
        }
        lines.append(
            f"- {kind}, all that serves taken from the list: " + ", ".join(f"{s} {p} %" for s, p in shares.items())
        )
    return "\n".join(lines)


def _share(outcomes: list[Outcome], kind: str, good: Callable[[Outcome], bool]) -> str:
    return _percent([good(o) for o in outcomes if o.kind == kind and o.serves])


def _percent(values: list[bool]) -> str:
    return f"{100 * float(np.mean(values)):.0f}" if values else ""


def write(outcomes: list[Outcome], file: Path) -> None:
    file.write_text("".join(json.dumps(asdict(o)) + "\n" for o in outcomes), encoding="utf-8")


def read(file: Path) -> list[Outcome]:
    rows = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return [Outcome(**row) for row in rows]
