"""Log of the corrections that people make to a home, and of what vision models said: its entries, written and read.

Each entry says who, when and what. Undoing is an entry as well; ``compaction.py`` keeps the log short.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, get_args

from cartier.errors import MAX_FAR_M, InputError, brief
from cartier.io.files import read_bytes
from cartier.types.route_rules import RouteRule

LOG = "corrections.jsonl"
MAX_BYTES = 2**24  # of a log; one that an older cartier wrote may be a little longer
MAX_NAME_CHARS, MAX_WHO_CHARS, MAX_LABEL_CHARS = 60, 60, 200
MAX_ID = 2**53
MAX_RULE_CHARS, MAX_SAID_CHARS = 5000, 300
MAX_FACTOR = 1000.0
CorrectionKind = Literal[
    "name", "confirm", "relabel", "add", "merge", "split", "forget", "move", "rule", "lift", "undo"
]
EntryKind = CorrectionKind | Literal["evidence"]
"""What an entry is: a correction of a person, or evidence, which no person gives."""
OBJECT_OR_ROOM = {"merge": ("object", "room"), "split": ("object", "room")}
POINTS = {"object": 3, "room": 2, "home": 0}
"""How many coordinates the position of a subject has, by its kind."""


@dataclass(frozen=True)
class Subject:
    """What an entry corrects, as it was then; ``position`` (m) is an object's middle, or a point (x, y) of a room.

    ``size`` (m) is that of an object's box; older entries have none.
    """

    kind: Literal["object", "room", "home"]
    id: int
    label: str
    position: tuple[float, ...]
    size: tuple[float, ...] = ()


@dataclass(frozen=True)
class Correction:
    """One entry of the log.

    ``name`` is for "name", ``label`` for "relabel", ``to_xy`` (m) for "move", ``undoes`` (an entry's id) for "undo".
    ``other`` is the object or room that "merge" takes in, or the second one that "split" makes, a room at ``to_xy``;
    "add" makes its ``subject``.
    ``rule`` is a route rule in its text form, for "rule" with the sentence that made it in ``name``; "lift" takes back
    the entry ``undoes``. "evidence" is what a vision model said of its ``subject``, in ``name``: the odds that it is
    there are multiplied by ``factor``, and so is the evidence for ``label`` where it chose one. ``origin`` names the
    pose frame of the positions, and ``newest`` is the largest id of an object then; older entries have neither.
    """

    id: str
    when: str
    who: str
    what: EntryKind
    subject: Subject | None = None
    name: str | None = None
    to_xy: tuple[float, float] | None = None
    undoes: str | None = None
    label: str | None = None
    other: Subject | None = None
    origin: str | None = None
    newest: int | None = None
    rule: str | None = None
    factor: float | None = None


def read_log(folder: Path) -> tuple[tuple[Correction, ...], tuple[str, ...]]:
    """The entries of a home's log, oldest first, and a note for each damaged line, which is left out.

    Raises InputError if the log cannot be read at all.
    """
    file = folder / LOG
    rows = read_lines(read_bytes(file, 2 * MAX_BYTES, follow_link=False)) if file.exists() else []
    return tuple(entry for entry, _ in rows if entry is not None), damaged(rows)


def damaged(rows: Sequence[tuple[Correction | None, bytes]]) -> tuple[str, ...]:
    """A note for each line that has no entry."""
    lines = [number for number, (entry, line) in enumerate(rows, start=1) if entry is None and line.strip()]
    return tuple(f"{LOG} line {number} is damaged: this correction is left out" for number in lines)


def read_lines(data: bytes) -> list[tuple[Correction | None, bytes]]:
    """The lines of a log with their entries, None for a damaged or empty one."""
    rows = list[tuple[Correction | None, bytes]]()
    for line in data.removesuffix(b"\n").split(b"\n"):
        entry = None
        with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError, InputError):
            entry = _entry(json.loads(line))
        rows.append((entry, line))
    return rows


def line_of(entry: Correction) -> str:
    """An entry as a line of the log."""
    return json.dumps(_without_empty(asdict(entry)), ensure_ascii=False)


def in_force(log: Iterable[Correction]) -> list[Correction]:
    """The corrections that were not undone, oldest first."""
    entries = list(log)
    undone = {entry.undoes for entry in entries if entry.what == "undo"}
    return [entry for entry in entries if entry.what != "undo" and entry.id not in undone]


def rules_of(holding: Iterable[Correction]) -> tuple[RouteRule, ...]:
    """The route rules of entries in force, oldest first, without those that were taken back."""
    entries = list(holding)
    lifted = {entry.undoes for entry in entries if entry.what == "lift"}
    given = [entry for entry in entries if entry.what == "rule" and entry.id not in lifted]
    return tuple(replace(rule_in(entry), id=entry.id) for entry in given)


def rule_in(entry: Correction) -> RouteRule:
    """The route rule of an entry of the log."""
    return RouteRule.parse(entry.rule or "", entry.name or "", entry.when)


def in_words(entry: Correction, log: Iterable[Correction] = ()) -> str:
    """What an entry does, in a few words; ``log`` holds the entry that it undoes."""
    if entry.what == "undo":
        undone = next((each for each in log if each.id == entry.undoes), None)
        return "undone" if undone is None else f"undone: {in_words(undone)}"
    if entry.what == "rule":
        return rule_in(entry).in_words()
    if entry.what == "lift":
        return f"no longer {RouteRule.parse(entry.rule or '').wish}"
    assert entry.subject is not None
    if entry.what == "evidence":
        return f"{_called(entry.subject)} was looked at: {entry.name}"
    about, other = _called(entry.subject), "" if entry.other is None else _called(entry.other)
    x, y = entry.to_xy or (*entry.subject.position, 0.0, 0.0)[:2]
    return {
        "name": f"{about} is called {entry.name}",
        "confirm": f"{about} is there",
        "relabel": f"{about} is labelled {entry.label}",
        "add": f"{about} is added at x {x:.2f} y {y:.2f} m",
        "merge": f"{about} and {other} are one",
        "split": f"{about} is two: the other is {other}",
        "forget": f"{about} is forgotten",
        "move": f"{about} stands at x {x:.2f} y {y:.2f} m",
    }[entry.what]


def clean(text: str, most: int, what: str) -> str:
    """A text of a person in one line. Raises InputError unless it has 1 to ``most`` printable characters."""
    line = " ".join(text.split())
    if not line or len(line) > most or not line.isprintable():
        raise InputError(f"{what} has 1 to {most} printable characters, got {brief(text, 40)!r}")
    return line


def _called(subject: Subject) -> str:
    if subject.kind == "home":
        return f"the home {subject.label}"
    return f"{subject.label} ({'room:' if subject.kind == 'room' else ''}{subject.id})"


def _without_empty(values: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in values.items() if value is not None and (key, value) != ("size", ())}
    return {key: _without_empty(value) if isinstance(value, dict) else value for key, value in kept.items()}


def _entry(row: Mapping[str, Any]) -> Correction:
    """An entry from its line. Raises ValueError, KeyError, TypeError or InputError for an invalid one."""
    what = row["what"]
    if what != "evidence" and what not in get_args(CorrectionKind):
        raise ValueError(what)
    about: dict[str, Any] = {key: clean(row[key], MAX_WHO_CHARS, key) for key in ("id", "when", "who")}
    if what == "undo":
        return Correction(**about, what=what, undoes=clean(row["undoes"], MAX_WHO_CHARS, "undoes"))
    if what in ("rule", "lift"):
        about["rule"] = RouteRule.parse(clean(row["rule"], MAX_RULE_CHARS, "rule")).text
        about |= {"undoes": clean(row["undoes"], MAX_WHO_CHARS, "undoes")} if what == "lift" else {}
        about |= {"name": clean(row["name"], MAX_SAID_CHARS, "name")} if row.get("name") else {}
        datetime.fromisoformat(about["when"])
        return Correction(**about, what=what)
    subject = _subject(row["subject"])
    if subject.kind not in (("object", "room", "home") if what == "name" else OBJECT_OR_ROOM.get(what, ("object",))):
        raise ValueError(subject)
    if what == "move" or (what == "split" and subject.kind == "room"):
        about["to_xy"] = _floats(row["to_xy"], 2)
    if what in ("name", "evidence"):
        about["name"] = clean(row["name"], MAX_NAME_CHARS, "name")
    if what == "evidence":
        about["factor"] = _factor(row["factor"])
        about |= {"label": clean(row["label"], MAX_NAME_CHARS, "label")} if "label" in row else {}
    if what == "relabel":
        about["label"] = clean(row["label"], MAX_NAME_CHARS, "label")
    if what in ("merge", "split"):
        about["other"] = _subject(row["other"])
        if about["other"].kind != subject.kind:
            raise ValueError(about)
    if what in ("add", "split") and subject.kind == "object" and not (about.get("other") or subject).size:
        raise ValueError(row)  # what is made has a size
    origin = clean(row["origin"], MAX_WHO_CHARS, "origin") if "origin" in row else None
    newest = _whole(row["newest"]) if "newest" in row else None
    return Correction(**about, what=what, subject=subject, origin=origin, newest=newest)


def _subject(about: Mapping[str, Any]) -> Subject:
    position = _floats(about["position"], POINTS[about["kind"]])
    size = _floats(about["size"], 3) if "size" in about else ()
    if min(size, default=0.0) < 0:
        raise ValueError(size)
    label = clean(about["label"], MAX_LABEL_CHARS, "label")
    return Subject(about["kind"], _whole(about["id"]), label, position, size)


def _whole(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= MAX_ID:
        raise ValueError(value)
    return value


def _factor(value: Any) -> float:
    if type(value) not in (int, float) or not 1 / MAX_FACTOR <= value <= MAX_FACTOR:
        raise ValueError(value)  # NaN, too
    return float(value)


def _floats(values: Any, size: int) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != size or not all(abs(v) <= MAX_FAR_M for v in values):
        raise ValueError(values)  # NaN, too
    return tuple(map(float, values))
