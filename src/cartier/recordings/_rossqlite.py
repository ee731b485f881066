"""One ROS 2 bag file of the sqlite3 storage: topics, message places and messages."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from cartier.errors import InputError, brief
from cartier.files import check_file
from cartier.recordings._rosfile import MAX_BLOCK, MAX_TOPICS, WHOLE, Index, Topic, check_count, index_part

MAGIC = b"SQLite format 3\0"


class Sqlite:
    """A .db3 file, opened read-only."""

    def __init__(self, path: Path) -> None:
        self._path = path
        check_file(path)
        try:
            with path.open("rb") as file:
                head = file.read(len(MAGIC))
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror})") from error
        if head != MAGIC:
            raise InputError(f"{path} is {'no sqlite3 bag' if head else 'empty'}")
        self._base = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1", uri=True)
        self._base.text_factory = lambda data: data.decode("utf-8", "replace")
        self._base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BLOCK)
        self._ask("PRAGMA trusted_schema = OFF")
        plain = " OR ".join(f"sql LIKE 'CREATE {kind}%'" for kind in ("TABLE", "INDEX", "UNIQUE INDEX"))
        if self._ask(f"SELECT 1 FROM sqlite_master WHERE NOT ({plain}) LIMIT 1"):
            raise InputError(f"{path} is no ROS 2 bag: it holds more than tables and indices")  # a view may have no end
        for table in ("topics", "messages"):
            columns = self._ask(f"SELECT hidden FROM pragma_table_xinfo('{table}')")
            if not columns:
                raise InputError(f"{path} is no ROS 2 bag: it has no tables 'topics' and 'messages'")
            if any(hidden for (hidden,) in columns):
                raise InputError(f"{path} is no ROS 2 bag: columns of its table {table!r} are computed")
        rows = self._ask(f"SELECT id, name, type, serialization_format FROM topics LIMIT {MAX_TOPICS + 1}")
        check_count(len(rows), path)
        self.topics: Sequence[Topic] = [
            Topic(str(name), str(kind), str(form), key) for key, name, kind, form in rows if isinstance(key, int)
        ]

    def index(self, topic: Topic) -> Index:
        rows = self._ask("SELECT timestamp, id FROM messages WHERE topic_id = ? ORDER BY timestamp, id", topic.key)
        if not rows:
            return np.empty((0, 3), np.int64)
        if not all(isinstance(value, int) for row in rows for value in row):
            raise InputError(f"{self._path} is damaged: a message of {topic.name} has no time or number")
        return index_part([time_ns for time_ns, _ in rows], 0, [number for _, number in rows])

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        try:
            with self._base.blobopen("messages", "data", offset, readonly=True) as blob:
                return blob.read(len(blob) if limit == WHOLE else min(limit, len(blob)))
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"{self._path} is damaged or truncated: message {offset}: {brief(error)}") from error

    def _ask(self, question: str, *values: int) -> list[tuple[Any, ...]]:
        try:
            return self._base.execute(question, values).fetchall()
        except (sqlite3.Error, OverflowError) as error:
            raise InputError(f"{self._path} is damaged, truncated or no ROS 2 bag ({brief(error)})") from error
