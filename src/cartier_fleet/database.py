"""Catalog in DuckDB: SQL over homes, rooms and objects, which reads nothing else, writes nothing, and is bounded.

Questions join objects of one home, which is several times faster by a number than by a name. So the objects lie in
``placed``, where ``home`` is the place of the home's row in ``homes``; ``objects`` is a view of it with the names.
``held`` has what each object stands on or in, and what that does; ``unsure`` the tentative objects that are mentioned.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from cartier.errors import InputError, MissingExtra, brief
from cartier.plugins import install
from cartier.spatial.query import DEEPEST, LIKELY
from cartier_fleet.catalog import Tables
from cartier_fleet.catalog_rows import TABLES

T = TypeVar("T")

MAX_SQL_CHARS = 20_000
MAX_ROWS = 10_000
MAX_S = 30.0
MAX_MEMORY = "2GB"
LOCKED = {"enable_external_access": "false", "lock_configuration": "true"}
"""Set once the tables are in: no file, address, extension or setting can be reached from SQL."""
OPTIONS = {
    "memory_limit": MAX_MEMORY, "temp_directory": "", "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false", "python_enable_replacements": "false",
}  # fmt: skip
MADE = (
    "create table homes as from homes_given order by home",
    "create table rooms as from rooms_given",
    "create table placed as select homes.rowid::integer as home, given.* exclude (home, version) "
    "from objects_given given join homes on homes.home = given.home",
    "create view objects as select homes.home, homes.version, placed.* exclude (home) "
    "from placed join homes on homes.rowid = placed.home",
    "create table held as with recursive up as (select home, object, on_object as below, 1 as deep from placed "
    "where on_object is not null union all select up.home, up.object, on_object, deep + 1 from up join placed "
    "on placed.home = up.home and placed.object = up.below "
    f"where on_object is not null and deep < {DEEPEST}) from up",
    f"create table unsure as from placed where not confirmed and probability >= {LIKELY}",
)


@dataclass(frozen=True)
class Rows:
    """A table: the names of its columns, its rows, and whether there were more.

    Args:
        columns: The names.
        rows: A tuple of values each.
        cut: Whether rows beyond the limit were left out.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    cut: bool = False


class Database:
    """The tables of a catalog in memory. Raises InputError if they do not fit."""

    def __init__(self, tables: Tables) -> None:
        try:
            import duckdb
        except ModuleNotFoundError as error:
            raise MissingExtra(f"questions need the package 'duckdb': {install('fleet', 'duckdb')}") from error
        self._duckdb = duckdb
        self._connection = duckdb.connect(":memory:", config=dict(OPTIONS))
        for name in TABLES:
            self._connection.register(f"{name}_given", tables[name])
        try:
            for sql in MADE:
                self._connection.execute(sql)
        except duckdb.Error as error:
            raise InputError(f"the catalog cannot be asked: {brief(error, 300)}") from error
        for name in TABLES:
            self._connection.unregister(f"{name}_given")
        for option, value in LOCKED.items():
            self._connection.execute(f"set {option}={value}")

    def query(self, sql: str, values: Sequence[Any] = (), most: int = MAX_ROWS, most_s: float = MAX_S) -> Rows:
        """The rows of one SELECT. Raises InputError for anything else, a mistake in it, or one that takes too long."""

        def taken(cursor: Any) -> Rows:
            rows = cursor.fetchmany(most + 1)
            return Rows(tuple(about[0] for about in cursor.description), tuple(rows[:most]), len(rows) > most)

        return self._run(sql, values, most_s, taken)

    def by_home(self, sql: str) -> dict[str, list[int]]:
        """The ids that a query of ``home`` (a number, in order) and ``object`` gives, by the homes' names."""
        found = self._run(sql, (), MAX_S, lambda cursor: cursor.fetchnumpy())
        numbers, begins = np.unique(found["home"], return_index=True)
        ids, places = found["object"].tolist(), [*begins.tolist(), len(found["home"])]
        return {self.names[n]: ids[a:b] for n, a, b in zip(numbers.tolist(), places, places[1:], strict=False)}

    @cached_property
    def names(self) -> list[str]:
        """The homes by their numbers."""
        return [name for (name,) in self._all("select home from homes order by rowid")]

    @cached_property
    def unsure(self) -> dict[str, list[str]]:
        """The homes with tentative objects that are mentioned, by the names of these."""
        names = "select home, unnest(names || [label]) as name from unsure"
        rows = self._all(f"select name, list(distinct home) from ({names}) group by name")
        return {name: [self.names[number] for number in homes] for name, homes in rows}

    @cached_property
    def unsure_labels(self) -> list[str]:
        """The labels of these."""
        return [label for (label,) in self._all("select distinct label from unsure")]

    def _all(self, sql: str) -> list[tuple[Any, ...]]:
        rows: list[tuple[Any, ...]] = self._connection.cursor().execute(sql).fetchall()
        return rows

    def _run(self, sql: str, values: Sequence[Any], most_s: float, taken: Callable[[Any], T]) -> T:
        if len(sql) > MAX_SQL_CHARS:
            raise InputError(f"the query has {len(sql)} characters, where up to {MAX_SQL_CHARS} may be")
        cursor = self._connection.cursor()
        timer = threading.Timer(most_s, cursor.interrupt)
        timer.start()
        try:
            statements = cursor.extract_statements(sql)
            if len(statements) != 1 or statements[0].type != self._duckdb.StatementType.SELECT:
                raise InputError("a query is one SELECT over homes, rooms and objects; nothing can be written")
            cursor.execute(statements[0], list(values))
            return taken(cursor)
        except self._duckdb.InterruptException as error:
            raise InputError(f"the query took more than {most_s:g} s: ask for less") from error
        except self._duckdb.Error as error:
            raise InputError(f"SQL: {brief(error, 300)}") from error
        finally:
            timer.cancel()
            with suppress(self._duckdb.Error):
                cursor.close()
