"""The homes of a fleet's store, to ask and to serve: each is read where it is when somebody asks about it."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

from cartier.blob_stores import open_store
from cartier.blob_stores.contract import KEY
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.repository import read
from cartier.home.store import MANIFEST
from cartier.serving.homes import MAX_BYTES, Homes
from cartier_fleet.entity import Fleet
from cartier_fleet.publishing import home_store, latest, names_in

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


def home_at(place: str) -> Home:
    """The latest version of a home at ``STORE#NAME``, or the one at ``s3://…/homes/VERSION``; InputError if none."""
    store, named, name = place.partition("#")
    if named and not Path(place).exists():
        return Fleet(store).home(name)
    if _is_store(place):
        raise InputError(f"{place} is a fleet's store: name one of its homes, as {place}#NAME")
    return Home.load(place)


def homes_at(places: Sequence[str], max_bytes: int) -> Homes:
    """The homes of the only place, if that is a store; else those in folders. Raises InputError for both together."""
    stores = [place for place in places if _is_store(place)]
    if stores and len(places) > 1:
        raise InputError(f"{stores[0]} is a fleet's store, with many homes: serve it alone")
    return FleetHomes(Fleet(stores[0]), max_bytes) if stores else Homes([Path(place) for place in places], max_bytes)


def _is_store(place: str) -> bool:
    """Whether a place is a fleet's store, and not one home."""
    if "://" in place:
        return open_store(place).get(MANIFEST) is None
    folder = Path(place)
    return (folder / "names").is_dir() and not (folder / MANIFEST).exists()
