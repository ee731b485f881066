"""Cache of saved homes: each is loaded on first use and dropped when memory runs short; none waits for another."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.home.correction_log import LOG
from cartier.home.store import MANIFEST

MAX_BYTES = 2**30
CELL_BYTES = 128  # per cell: grid, rooms, and the paths that planning caches
OBJECT_BYTES = 8192
UNPACKED = 4  # memory of an index in sizes of its file


@dataclass
class _Slot:
    folder: Path
    lock: threading.Lock
    home: Home | None = None
    stamp: tuple[tuple[int, int], ...] = ()
    bytes: int = 0


class Homes:
    """Saved homes by the names of their folders. A home that was replaced or corrected meanwhile is loaded again."""

    def __init__(self, folders: Sequence[Path], max_bytes: int = MAX_BYTES) -> None:
        if not folders:
            raise InputError("no home was given: name the folders that 'cartier map' wrote")
        self._max_bytes = max_bytes
        self._slots: dict[str, _Slot] = {}
        self._loaded: OrderedDict[str, int] = OrderedDict()  # bytes of each, the last used at the end
        self._order = threading.Lock()
        for folder in folders:
            plain = folder.resolve().name
            name = next(n for n in (plain, *(f"{plain}-{k}" for k in range(2, 10_000))) if n not in self._slots)
            self._slots[name] = _Slot(folder, threading.Lock())
            if not (folder / MANIFEST).is_file():
                raise InputError(f"{folder} is no mapped home: make one with: cartier map RECORDING -o {folder}")

    @property
    def names(self) -> list[str]:
        return list(self._slots)

    def name(self, home: str = "") -> str:
        """The name of a home: if it is empty, the only one. Raises InputError for an unknown name."""
        wanted = home.partition("@")[0].strip()
        if not wanted and len(self._slots) == 1:
            return next(iter(self._slots))
        if wanted not in self._slots:
            what = f"there is no home {brief(wanted, 40)!r}" if wanted else "which home?"
            raise InputError(f"{what}: pass home as one of {', '.join(self._slots)}")
        return wanted

    def get(self, home: str = "") -> Home:
        """A home by NAME, or by NAME@ID if it must be that map. Raises InputError if there is no such home."""
        name = self.name(home)
        slot = self._slots[name]
        with slot.lock:
            stamp = _stamp(slot.folder)
            if slot.home is None or slot.stamp != stamp:
                slot.home, slot.stamp = Home.load(slot.folder), stamp
                slot.bytes = _size(slot.home)
            found = slot.home
        self._make_room(name, slot.bytes)
        wanted = home.partition("@")[2].strip()
        if wanted and wanted != found.id:
            other = f"{name} was mapped again and is {found.id} now, not {brief(wanted, 20)}"
            raise InputError(f"{other}: list its objects again")
        return found

    def _make_room(self, name: str, size: int) -> None:
        with self._order:
            self._loaded[name] = size
            self._loaded.move_to_end(name)
            while sum(self._loaded.values()) > self._max_bytes and len(self._loaded) > 1:
                self._slots[self._loaded.popitem(last=False)[0]].home = None


def _stamp(folder: Path) -> tuple[tuple[int, int], ...]:
    """What changes whenever a home is replaced or corrected."""
    times = []
    for file in (folder / MANIFEST, folder / LOG):
        try:
            about = file.stat()
            times.append((about.st_mtime_ns, about.st_size))
        except OSError:
            times.append((0, 0))
    return tuple(times)


def _size(home: Home) -> int:
    """Estimated bytes of a loaded home; its photos stay on the disk."""
    cells = 0 if home.grid is None else home.grid.cells.size * CELL_BYTES
    held = sum(len(part) for index in home.indexes.values() for part in index.state().values())
    return cells + len(home.objects) * OBJECT_BYTES + held * UNPACKED
