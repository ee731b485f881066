"""Catalog in DuckDB: SQL over homes, rooms and objects, which reads nothing else, writes nothing, and is bounded."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from cartier.errors import InputError, MissingExtra, brief
from cartier.fleet.catalog import Tables
from cartier.fleet.catalog_rows import TABLES
from cartier.plugins import install

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
    """The tables ``homes``, ``rooms`` and ``objects`` of a catalog in memory."""

    def __init__(self, tables: Tables) -> None:
        try:
            import duckdb
        except ModuleNotFoundError as error:
            raise MissingExtra(f"questions need the package 'duckdb': {install('fleet', 'duckdb')}") from error
        self._duckdb = duckdb
        self._connection = duckdb.connect(":memory:", config=dict(OPTIONS))
        for name in TABLES:
            self._connection.register("given", tables[name])
            self._connection.execute(f"create table {name} as select * from given")
            self._connection.unregister("given")
        for option, value in LOCKED.items():
            self._connection.execute(f"set {option}={value}")

    def query(self, sql: str, values: Sequence[Any] = (), most: int = MAX_ROWS, most_s: float = MAX_S) -> Rows:
        """The rows of one SELECT. Raises InputError for anything else, a mistake in it, or one that takes too long."""
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
            rows = cursor.fetchmany(most + 1)
            return Rows(tuple(about[0] for about in cursor.description), tuple(rows[:most]), len(rows) > most)
        except self._duckdb.InterruptException as error:
            raise InputError(f"the query took more than {most_s:g} s: ask for less") from error
        except self._duckdb.Error as error:
            raise InputError(f"SQL: {brief(error, 300)}") from error
        finally:
            timer.cancel()
            with suppress(self._duckdb.Error):
                cursor.close()
