"""Cache of saved homes: each is loaded on first use and dropped when memory runs short; none waits for another."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.home.correction_log import LOG
from cartier.home.repository import again
from cartier.home.store import MANIFEST
from cartier.live.answers import check_epoch
from cartier.serving.access import ACCESS
from cartier.types import AsOf

MAX_BYTES = 2**30
CELL_BYTES = 128  # per cell: grid, rooms, and the paths that planning caches
OBJECT_BYTES = 8192
UNPACKED = 4  # memory of an index in sizes of its file
MOST_NAMED = 20  # homes that a sentence lists


class AskedTogether(Protocol):
    """Many homes that answer a question together."""

    def ask(self, query: str, may_see: Callable[[str], bool] | None = None) -> Any:
        """A ``cartier_fleet.FleetAnswer``. Raises InputError for words that ask something else."""
        ...


@dataclass
class _Slot:
    lock: threading.Lock
    home: Home | None = None
    stamp: Any = None
    bytes: int = 0


class Homes:
    """Saved homes by the names of their folders. A home that was replaced or corrected meanwhile is loaded again.

    ``guarded``: whether a request may see only what its token names, and none without one.
    """

    guarded = False
    fleet: AskedTogether | None = None  # whose homes these are

    def __init__(self, folders: Sequence[Path], max_bytes: int = MAX_BYTES) -> None:
        if not folders:
            raise InputError("no home was given: name the folders that 'cartier map' wrote")
        self._keep(max_bytes)
        self._folders = dict[str, Path]()
        for folder in folders:
            plain = folder.resolve().name
            name = next(n for n in (plain, *(f"{plain}-{k}" for k in range(2, 10_000))) if n not in self._folders)
            self._folders[name] = folder
            if not (folder / MANIFEST).is_file():
                raise InputError(f"{folder} is no mapped home: make one with: cartier map RECORDING -o {folder}")

    def _keep(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._slots: dict[str, _Slot] = {}
        self._loaded: OrderedDict[str, int] = OrderedDict()  # bytes of each, the last used at the end
        self._order = threading.Lock()

    @property
    def names(self) -> list[str]:
        """The homes that the request may see."""
        return [name for name in self._known() if self.may_see(name)]

    @property
    def several(self) -> bool:
        """Whether a request must say which home it means."""
        return len(self._known()) > 1

    @property
    def asker(self) -> str:
        """Tells the request's token from others; "" without one."""
        access = ACCESS.get()
        return "" if access is None else access.who

    def may_see(self, name: str) -> bool:
        """Whether the request may see a home."""
        access = ACCESS.get()
        return not self.guarded if access is None else access.sees(name)

    def name(self, home: str = "") -> str:
        """The name of a home: if it is empty, the only one. Raises InputError for an unknown name."""
        wanted = home.partition("@")[0].strip()
        if wanted and self.may_see(wanted) and self._has(wanted):
            return wanted
        names = self.names
        if not wanted and len(names) == 1:
            return names[0]
        what = f"there is no home {brief(wanted, 40)!r}" if wanted else "which home?"
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        raise InputError(f"{what}: pass home as one of {', '.join(names[:MOST_NAMED])}{more}")

    def get(self, home: str = "") -> Home:
        """A home by NAME, or by NAME@ID if it must be that map. Raises InputError if there is no such home."""
        name = self.name(home)
        with self._order:
            slot = self._slots.setdefault(name, _Slot(threading.Lock()))
        with slot.lock:
            stamp = self._stamp(name)
            if slot.home is None or slot.stamp != stamp:
                slot.home, slot.stamp = self._load(name), stamp
                slot.bytes = _size(slot.home)
            found = slot.home
        self._make_room(name, slot.bytes)
        wanted = home.partition("@")[2].strip()
        if wanted and wanted != found.id:
            other = f"{name} was mapped again and is {found.id} now, not {brief(wanted, 20)}"
            raise InputError(f"{other}: list its objects again")
        return found

    def check_epoch(self, frame_epoch: int | None) -> None:
        """Raises InputError if the map was moved since an answer of this frame epoch, where one is named."""
        moment = self.moment()
        if moment is not None and frame_epoch is not None:
            check_epoch(frame_epoch, moment.frame_epoch)

    def _known(self) -> list[str]:
        return list(self._folders)

    def _has(self, name: str) -> bool:
        return name in self._folders

    def _load(self, name: str) -> Home:
        known = self._slots[name].home
        return Home.load(self._folders[name]) if known is None else again(known)

    def _stamp(self, name: str) -> Any:
        """What changes whenever a home is replaced or corrected."""
        return [_written(self._folders[name] / file) for file in (MANIFEST, LOG)]

    def start_xy(self, home: Home) -> Sequence[float]:
        """Where a drive begins (x, y), metres, if nobody says otherwise."""
        return home.start_xy

    def moment(self) -> AsOf | None:
        """Of when the homes are, if they are being mapped."""
        return None

    def state(self) -> dict[str, Any] | None:
        """How mapping goes on, if it does."""
        return None

    def _make_room(self, name: str, size: int) -> None:
        with self._order:
            self._loaded[name] = size
            self._loaded.move_to_end(name)
            while sum(self._loaded.values()) > self._max_bytes and len(self._loaded) > 1:
                self._slots[self._loaded.popitem(last=False)[0]].home = None


def _written(file: Path) -> tuple[int, int]:
    try:
        about = file.stat()
    except OSError:
        return 0, 0
    return about.st_mtime_ns, about.st_size


def _size(home: Home) -> int:
    """Estimated bytes of a loaded home; its photos stay on the disk."""
    cells = 0 if home.grid is None else home.grid.cells.size * CELL_BYTES
    held = sum(len(part) for index in home.indexes.values() for part in index.state().values())
    return cells + len(home.objects) * OBJECT_BYTES + held * UNPACKED
