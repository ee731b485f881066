"""Fleet: many mapped homes in one store, with questions over all of them that are answered with three values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

from cartier.blob_stores import open_store
from cartier.errors import InputError
from cartier.home import Home
from cartier_fleet.answer import FleetAnswer


class Fleet:
    """Many homes in one store. The catalog is read when it is first needed, and again after it has changed.

    Args:
        store: A folder, or ``s3://BUCKET/PREFIX``, ``gs://…``, ``az://…``.

    Example:
        >>> import cartier
        >>> cartier_fleet.Fleet("homes").store.place
        'homes'
    """

    def __init__(self, store: str) -> None:
        self.store = open_store(store)
        self._version: Any = None
        self._loaded: Any = None
        self._chunks = dict[str, Any]()
        self._loading = Lock()

    def ask(self, query: str, may_see: Callable[[str], bool] | None = None) -> FleetAnswer:
        """Answer a question over all homes: which have or lack something, how many, most, fewest, biggest, or a list.

        Args:
            query: The words, in plain English.
            may_see: Whether a home, given by its name, is to be asked; None for all.

        Returns:
            The answer. A home "has none" only where the detector knows the name and the floor was seen; otherwise
            nobody can tell, and the answer says why.

        Raises:
            InputError: The words ask something else, or the catalog is damaged.
            MissingExtra: The extra ``fleet`` is not installed.
        """
        from cartier_fleet.answering import answer

        loaded = self._catalog()
        return answer(query, loaded if may_see is None else loaded.only(may_see))

    def query(self, sql: str, limit: int = 10_000) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Run one SELECT over the tables homes, rooms and objects; docs/fleet.md has their columns.

        Args:
            sql: The query, in DuckDB's SQL. It reads nothing else and writes nothing.
            limit: The most rows; further ones are left out.

        Returns:
            The names of the columns, and the rows.

        Raises:
            InputError: It is no SELECT, has a mistake, or takes more than 30 s.
            MissingExtra: The extra ``fleet`` is not installed.
        """
        found = self._catalog().database.query(sql, (), limit)
        return found.columns, list(found.rows)

    def home(self, name: str) -> Home:
        """Read one home where it is.

        Args:
            name: Its name, or one of its versions.

        Returns:
            The home; its photographs are read on access.

        Raises:
            InputError: There is no such home, or it is damaged.
        """
        from cartier.home.repository import read
        from cartier_fleet.publishing import home_store, key_of

        return read(home_store(self.store, key_of(self.store, name)), Home)

    def pull(self, name: str, folder: str | Path) -> Home:
        """Write one home to a folder, verified and switched atomically; what people corrected there stays.

        Args:
            name: Its name, or one of its versions.
            folder: Where to.

        Returns:
            The home.

        Raises:
            InputError: There is no such home, it is damaged, or the folder is not a home's.
        """
        from cartier_fleet.publishing import pull

        return pull(self.store, name, Path(folder))

    def _catalog(self) -> Any:
        from cartier_fleet.answering import Loaded
        from cartier_fleet.catalog import read_catalog, version_of

        version = version_of(self.store)
        with self._loading:
            if self._loaded is None or version != self._version:
                self._loaded, self._version = Loaded.of(read_catalog(self.store, held=self._chunks)), version
            loaded = self._loaded
        if not loaded.homes:
            raise InputError(f"{self.store.place} holds no homes: cartier fleet map RECORDINGS --store STORE")
        return loaded
