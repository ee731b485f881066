"""Compaction of the log of corrections: what later entries replaced goes, so that a log has an end one can live with.

A home that was corrected a million times keeps what still holds, and the latest hundred corrections as they were given.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartier.errors import InputError
from cartier.home.corrected import FIRST_MADE, SAME_M
from cartier.home.correction_log import LOG, MAX_BYTES, Correction, damaged, in_force, line_of, read_lines
from cartier.home.store import Store
from cartier.io.atomic import opened_log, write_file
from cartier.io.files import read_bytes

UNDOABLE = 100  # the latest corrections in force, which ``undo`` can take back one by one
LONG = 2 * UNDOABLE  # a log of fewer entries keeps all of them
STEP_BYTES = 2**17  # the log is compacted once in so many bytes: on average, a correction costs its own line
END_BYTES = 64  # by which a log is known again
REPLACED = ("name", "confirm", "relabel", "move", "evidence")  # of these the latest counts, of one subject


@dataclass(frozen=True)
class Log:
    """The entries of a log that count, notes about damaged lines, and what was read: the file, its size, its end."""

    entries: tuple[Correction, ...] = ()
    notes: tuple[str, ...] = ()
    inode: int = 0
    size: int = 0
    end: bytes = b""


def read(store: Store) -> Log:
    """The log of a home. Of one that the store knows, only what was appended since is read. Raises InputError."""
    file, known = store.folder / LOG, store.log if isinstance(store.log, Log) else Log()
    if not file.exists():
        return Log()
    about = file.lstat()
    begin = known.size - len(known.end) if known.inode == about.st_ino and known.size <= about.st_size else 0
    data = read_bytes(file, 2 * MAX_BYTES, follow_link=False, begin=begin)
    if begin and not data.startswith(known.end):  # written by hand
        begin, data = 0, read_bytes(file, 2 * MAX_BYTES, follow_link=False)
    known = known if begin else Log()
    rows = read_lines(data[len(known.end) :])
    entries = (*known.entries, *(entry for entry, _ in rows if entry is not None))
    short = compacted(entries) if len(entries) > LONG else entries
    store.log = Log(short, known.notes + damaged(rows), about.st_ino, begin + len(data), data[-END_BYTES:])
    return store.log


def add(store: Store, entry: Correction) -> None:
    """Append an entry to the log of a home, on the disk, and compact a log that has grown.

    Raises InputError if it cannot be written, or if the log is full of what still holds.
    """
    line, file = line_of(entry), store.folder / LOG
    before = file.stat().st_size if file.exists() else 0
    if before + len(line.encode()) >= MAX_BYTES:
        _compact(file)
        if file.stat().st_size + len(line.encode()) >= MAX_BYTES:
            raise InputError(f"{file} holds as many corrections as a home can have: undo some, or map the home again")
    store.append(LOG, line)
    if file.stat().st_size // STEP_BYTES > before // STEP_BYTES:
        with suppress(InputError):  # the correction is on the disk, and the next one tries again
            _compact(file)


def _compact(file: Path) -> None:
    """Rewrite a log without the entries that no longer count, if that is worth it. What cannot be read stays."""
    with opened_log(file):
        rows = read_lines(read_bytes(file, 2 * MAX_BYTES, follow_link=False))
        kept = {id(entry) for entry in compacted([entry for entry, _ in rows if entry is not None])}
        whole = b"".join(line + b"\n" for entry, line in rows if entry is None or id(entry) in kept)
        if len(whole) <= file.stat().st_size - STEP_BYTES // 2:
            write_file(file, whole)


def compacted(log: Sequence[Correction], undoable: int = UNDOABLE) -> tuple[Correction, ...]:
    """The entries of a log that still count, oldest first: applied to a map, they give what all of them give.

    The latest ``undoable`` entries in force stay, and all that they replace. What was undone goes, and so do rules that
    were lifted, and objects that people added and took away again.
    """
    holding = in_force(log)
    old, late = holding[: len(holding) - undoable], holding[max(0, len(holding) - undoable) :]
    newest = max((number for entry in log for number in _made(entry)), default=0)  # no later object has its id
    gone = _lifted(old) | _taken_away(old, {newest}.union(*map(_made, late)))
    stay = {entry.id for entry in (*_latest([entry for entry in old if entry.id not in gone]), *late)}
    undone = {entry.id for entry in log if newest and newest in _made(entry)} - stay
    return tuple(entry for entry in log if entry.id in stay | undone or entry.undoes in undone)


class _MadeNear:
    """Where in a log objects were made at a place where another stood at any time: they may have become one."""

    def __init__(self, entries: Sequence[Correction]) -> None:
        made = [(place, e.other or e.subject) for place, e in enumerate(entries) if e.what in ("add", "split")]
        objects = [(place, each) for place, each in made if each is not None and each.kind == "object"]
        self._places = np.array([place for place, _ in objects], np.int64)
        self._xy = np.array([each.position[:2] for _, each in objects]).reshape(-1, 2)
        self._stood, self._reach_m = dict[int, set[tuple[float, ...]]](), dict[int, float]()
        for entry in entries:
            if entry.subject is not None and entry.subject.kind == "object":
                number, size = entry.subject.id, entry.subject.size
                stood = self._stood.setdefault(number, {entry.subject.position[:2]})
                stood.update(() if entry.to_xy is None else (entry.to_xy,))
                whole = entry.other is None and bool(size)  # one that was merged or split has another size
                reach_m = SAME_M + math.hypot(*size[:2]) / 2 if whole else math.inf
                self._reach_m[number] = max(reach_m, self._reach_m.get(number, 0.0))
        self._of = dict[int, NDArray[np.int64]]()

    def between(self, number: int, begin: int, end: int) -> int:
        """How many objects were made near that one, later than one place of the log and before another."""
        if number not in self._of:
            stood = np.array(sorted(self._stood[number]))
            off_m = np.linalg.norm(self._xy[:, None] - stood, axis=2).min(1, initial=math.inf)
            self._of[number] = self._places[off_m <= self._reach_m[number]]
        found = self._of[number]
        return int(np.searchsorted(found, end) - np.searchsorted(found, begin, "right"))


def _latest(entries: Sequence[Correction]) -> Iterator[Correction]:
    """The entries that no later one of the same kind and subject replaces.

    What makes one object or room of two, or two of one, separates the entries before it from those after it. So does a
    rule for rooms: it names them as they were called then; and where an object is made, what stood there as what.
    """
    parted, seen, made_near = Counter[object](), set[object](), _MadeNear(entries)
    for place, entry in reversed(list(enumerate(entries))):
        subject = entry.subject
        if entry.what in REPLACED and subject is not None:
            placed = subject.kind == "object" and entry.what in ("relabel", "move")
            made = made_near.between(subject.id, place, len(entries)) if placed else 0
            parts = parted[subject.id if subject.kind == "object" else "rooms"]
            about = subject if subject.kind == "object" else (subject.id, subject.position)  # its label is its name
            key = (entry.what, subject.kind, about, entry.origin, parts, made)
            if key not in seen:
                yield entry
            seen.add(key)
            continue
        touched = [each for each in (subject, entry.other) if each is not None]
        parted["rooms"] += entry.what == "rule" or any(each.kind == "room" for each in touched)
        parted.update(each.id for each in touched if each.kind == "object")
        yield entry


def _lifted(old: Sequence[Correction]) -> set[str]:
    """Rules that were taken back, and what took them back."""
    lifts = {entry.undoes: entry.id for entry in old if entry.what == "lift"}
    rules = {entry.id for entry in old if entry.what == "rule"}
    return {each for rule, lift in lifts.items() if rule in rules for each in (str(rule), lift)}


def _taken_away(old: Sequence[Correction], stay: set[int]) -> set[str]:
    """All entries about objects that people added and then forgot, if nothing was made of them, with them or near them.

    ``stay`` are the ids of objects that stay.
    """
    shared = {number for entry in old if entry.other is not None for number in _made(entry)}
    made_near, added, away = _MadeNear(old), dict[int, int](), set[int]()
    for place, entry in enumerate(old):
        number = next(iter(_made(entry)), 0)
        if entry.what == "add":
            added[number] = place
        elif entry.what == "forget" and number in added and number not in stay | shared:
            away |= set() if made_near.between(number, added[number], place) else {number}
    return {entry.id for entry in old if away.intersection(_made(entry))}


def _made(entry: Correction) -> list[int]:
    """The ids in an entry of objects that people made."""
    about = (entry.subject, entry.other)
    return [each.id for each in about if each is not None and each.kind == "object" and each.id >= FIRST_MADE]
