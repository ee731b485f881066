"""The homes of a fleet's store, served: each is read where it is when somebody asks about it, and put away again."""

from __future__ import annotations

import threading
import time

from cartier.blob_stores.contract import KEY
from cartier.errors import InputError
from cartier.fleet.entity import Fleet
from cartier.fleet.publishing import home_store, latest, names_in
from cartier.home import Home
from cartier.home.repository import read
from cartier.serving.homes import MAX_BYTES, Homes

FRESH_S = 2.0  # for which the version of a home counts as the latest
NAMES_FRESH_S = 10.0  # for which a list of all homes does


class FleetHomes(Homes):
    """Published homes by their names in the fleet. They cannot be corrected here."""

    def __init__(self, fleet: Fleet, max_bytes: int = MAX_BYTES) -> None:
        self.fleet, self._store = fleet, fleet.store
        self._keep(max_bytes)
        self._names, self._listed_s = list[str](), float("-inf")
        self._versions = dict[str, tuple[float, str]]()
        self._lock = threading.Lock()
        if not self._known():
            raise InputError(f"{fleet.store.place} holds no homes: cartier fleet map RECORDINGS --store STORE")

    @property
    def several(self) -> bool:
        return True  # more may come

    def _known(self) -> list[str]:
        with self._lock:
            if time.monotonic() - self._listed_s >= NAMES_FRESH_S:
                self._names, self._listed_s = names_in(self._store), time.monotonic()
            return self._names

    def _has(self, name: str) -> bool:
        return KEY.fullmatch(name) is not None and bool(self._stamp(name))

    def _stamp(self, name: str) -> str:
        """The latest version of a home; "" where there is none."""
        seen_s, version = self._versions.get(name, (float("-inf"), ""))
        if time.monotonic() - seen_s >= FRESH_S and (version := latest(self._store, name)):
            self._versions[name] = (time.monotonic(), version)
        return version

    def _load(self, name: str) -> Home:
        return read(home_store(self._store, self._stamp(name)), Home)
