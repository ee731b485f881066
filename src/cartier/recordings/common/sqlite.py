"""SQLite files of any origin, read-only: no views or computed columns, which may never end, and every read bounded."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cartier.errors import InputError, brief
from cartier.io.files import check_file

MAGIC = b"SQLite format 3\0"


def is_sqlite(path: Path) -> bool:
    """Whether a file begins as SQLite's do."""
    try:
        check_file(path)
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except (InputError, OSError):
        return False


class SqliteFile:
    """A file with some tables at least. ``what`` names in messages what it should have been."""

    def __init__(self, path: Path, what: str, tables: Collection[str], kinds: Collection[str], max_bytes: int) -> None:
        self.path, self._what = path, what
        check_file(path)
        try:
            with path.open("rb") as file:
                head = file.read(len(MAGIC))
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror})") from error
        if head != MAGIC:
            raise InputError(f"{path} is {f'no {what}' if head else 'empty'}")
        address = f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1"
        self._base = sqlite3.connect(address, uri=True, check_same_thread=False)
        self._base.text_factory = lambda data: data.decode("utf-8", "replace")
        self._base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max_bytes)
        self.ask("PRAGMA trusted_schema = OFF")
        plain = " OR ".join(f"sql LIKE 'CREATE {kind}%'" for kind in kinds)
        if self.ask(f"SELECT 1 FROM sqlite_master WHERE sql IS NOT NULL AND NOT ({plain}) LIMIT 1"):
            raise InputError(f"{path} is no {what}: it holds more than {', '.join(kinds).lower()}")
        lack = [table for table in tables if not self.columns(table)]
        if lack:
            raise InputError(f"{path} is no {what}: it has no tables {' and '.join(map(repr, tables))}")

    def columns(self, table: str) -> list[str]:
        """The names of a table's columns; an InputError if one of them is computed."""
        rows = self.ask(f"SELECT name, hidden FROM pragma_table_xinfo('{table}')")
        if any(hidden for _, hidden in rows):
            raise InputError(f"{self.path} is no {self._what}: columns of its table {table!r} are computed")
        return [name for name, _ in rows]

    def blob(self, table: str, column: str, row: int, limit: int | None = None) -> bytes:
        """The bytes in one cell, or the first ``limit`` of them, without the rest of its row."""
        try:
            with self._base.blobopen(table, column, row, readonly=True) as blob:
                return blob.read(len(blob) if limit is None else min(limit, len(blob)))
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"{self.path} is damaged or truncated: {column} {row}: {brief(error)}") from error

    def ask(self, question: str, *values: int) -> list[tuple[Any, ...]]:
        """The rows of an answer; questions never hold what came from a file."""
        try:
            return self._base.execute(question, values).fetchall()
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"{self.path} is damaged, truncated or no {self._what} ({brief(error)})") from error
