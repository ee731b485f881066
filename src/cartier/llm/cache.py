"""Reply cache of language models: no request is sent twice."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from cartier.errors import ReasonerError


def digest(*parts: Any) -> str:
    """The sha256 (hex) of JSON values."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class Cache:
    """Replies by request, in one SQLite file that several threads and processes may share.

    Raises ReasonerError if the file is no SQLite file or cannot be used.
    """

    def __init__(self, file: str | Path) -> None:
        self._file = file
        self._run("create table if not exists replies(key text primary key, reply text)")

    def get(self, key: str) -> str | None:
        rows = self._run("select reply from replies where key = ?", key)
        return str(rows[0][0]) if rows else None

    def put(self, key: str, reply: str) -> None:
        self._run("insert or replace into replies values (?, ?)", key, reply)

    def _run(self, statement: str, *values: str) -> list[tuple[Any, ...]]:
        try:
            with closing(sqlite3.connect(self._file, isolation_level=None)) as connection:
                return connection.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise ReasonerError(f"cannot use {self._file} as a cache of replies: {error}") from error
