"""One ROS 2 bag file of the sqlite3 storage: topics, message places and messages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.errors import InputError
from cartier.recordings.common.sqlite import SqliteFile
from cartier.recordings.ros.file import MAX_BLOCK, MAX_TOPICS, WHOLE, Index, Topic, check_count, index_part


class Sqlite:
    """A .db3 file, opened read-only."""

    def __init__(self, path: Path) -> None:
        self._path = path
        kinds = ("TABLE", "INDEX", "UNIQUE INDEX")
        self._file = SqliteFile(path, "ROS 2 bag", ("topics", "messages"), kinds, MAX_BLOCK)
        rows = self._file.ask(f"SELECT id, name, type, serialization_format FROM topics LIMIT {MAX_TOPICS + 1}")
        check_count(len(rows), path)
        self.topics: Sequence[Topic] = [
            Topic(str(name), str(kind), str(form), key) for key, name, kind, form in rows if isinstance(key, int)
        ]

    def index(self, topic: Topic) -> Index:
        rows = self._file.ask("SELECT timestamp, id FROM messages WHERE topic_id = ? ORDER BY timestamp, id", topic.key)
        if not rows:
            return np.empty((0, 3), np.int64)
        if not all(isinstance(value, int) for row in rows for value in row):
            raise InputError(f"{self._path} is damaged: a message of {topic.name} has no time or number")
        return index_part([time_ns for time_ns, _ in rows], 0, [number for _, number in rows])

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        return self._file.blob("messages", "data", offset, None if limit == WHOLE else limit)
