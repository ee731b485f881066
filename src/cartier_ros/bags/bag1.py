"""One ROS 1 bag (format 2.0): topics and message places from its index, messages one by one.

The format: wiki.ros.org/Bags/Format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from cartier.errors import InputError
from cartier.io.bounded_file import (
    KEPT_CHUNKS,
    MAX_BLOCK,
    WHOLE,
    Fields,
    File,
    Index,
    Share,
    Topic,
    by_time,
    check_count,
    index_part,
    unpacked,
)

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = (bytes([op]) for op in (2, 3, 4, 5, 6, 7))
MAX_HEADER = 1 << 20
MAX_BEFORE = 100  # records of other kinds before a message; writers put one
ENTRY = np.dtype([("s", "<u4"), ("ns", "<u4"), ("offset", "<u4")])


@dataclass(frozen=True)
class Chunk:
    """A chunk: where its data lies, how large it is packed and unpacked, and where the index of each topic begins."""

    data: int
    packed: int
    compression: str
    size: int
    indices: dict[int, int]


class Bag1:
    """An indexed ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._file, self._path = File(path), path
        self._unpacked = lru_cache(KEPT_CHUNKS)(self._unpack)
        if self._file.at(0, min(len(MAGIC), self._file.size)) != MAGIC:
            raise InputError(f"{path} is no ROS 1 bag of format 2.0")
        head, _, _ = self._record(len(MAGIC), BAG)
        position = _number(head, b"index_pos", path)
        connections, chunks = _number(head, b"conn_count", path), _number(head, b"chunk_count", path)
        if position == 0:
            raise InputError(
                f"{path} has no index (the recording was not closed): 'rosbag reindex {path.name}' mends it"
            )
        if position > self._file.size:
            raise InputError(
                f"{path} is truncated: its index should begin at byte {position}, but it has {self._file.size}; "
                f"'rosbag reindex {path.name}' mends it"
            )
        check_count(connections, path)
        topics = []
        for _ in range(connections):
            topic, position = self._connection(position)
            topics.append(topic)
        self.topics: Sequence[Topic] = topics
        self._chunks: list[Chunk] = []
        share = Share(self._file)
        for _ in range(chunks):
            head, data, size = self._record(position, CHUNK_INFO)
            count = min(size // 8, _number(head, b"count", path))
            self._chunks.append(self._chunk(_number(head, b"chunk_pos", path), count, share))
            position = data + size
        if position > self._file.size:
            raise InputError(f"{path} is truncated: 'rosbag reindex {path.name}' mends it")

    def index(self, topic: Topic) -> Index:
        return by_time(self._indexed(topic.key))

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        place = self._chunks[chunk]
        if place.compression == "none":
            return self._message(self._file.at, place.data, offset, place.size, limit)
        data = self._unpacked(chunk)
        return self._message(lambda start, size: data[start : start + size], 0, offset, place.size, limit)

    def _unpack(self, number: int) -> bytes:
        chunk = self._chunks[number]
        return unpacked(chunk.compression, self._file.at(chunk.data, chunk.packed), chunk.size, self._path)

    def _message(self, at: Callable[[int, int], bytes], base: int, offset: int, room: int, limit: int) -> bytes:
        """The message at ``offset`` of a chunk of ``room`` bytes; connection records before it are passed over."""
        for _ in range(MAX_BEFORE):
            if not 0 <= offset <= room - 8:
                break
            (size,) = Fields(at(base + offset, 4), self._path).numbers("<I")
            if size > room - offset - 8:
                break
            header = Fields(at(base + offset + 4, size + 4), self._path)
            op = _fields(header.take(size), self._path).get(b"op")
            (length,) = header.numbers("<I")
            offset += size + 8
            if length > room - offset:
                break
            if op == MESSAGE:
                return at(base + offset, length if limit == WHOLE else min(length, limit))
            offset += length
        raise InputError(f"{self._path} is damaged: its index leads to no message")

    def _record(self, position: int, op: bytes) -> tuple[dict[bytes, bytes], int, int]:
        """A record's header, and where its data begins and how long it is."""
        (size,) = Fields(self._file.at(position, 4), self._path).numbers("<I")
        if size > MAX_HEADER:
            raise InputError(f"{self._path} is damaged: a header at byte {position} claims {size} bytes")
        header = Fields(self._file.at(position + 4, size + 4), self._path)
        fields = _fields(header.take(size), self._path)
        if fields.get(b"op") != op:
            raise InputError(f"{self._path} is damaged: another kind of record was expected at byte {position}")
        return fields, position + size + 8, header.numbers("<I")[0]

    def _connection(self, position: int) -> tuple[Topic, int]:
        head, data, size = self._record(position, CONNECTION)
        if size > MAX_HEADER:
            raise InputError(f"{self._path} is damaged: a topic's description claims {size} bytes")
        inner = _fields(memoryview(self._file.at(data, size)), self._path)
        name, kind = (str(value, "utf-8", "replace") for value in (head.get(b"topic", b""), inner.get(b"type", b"")))
        return Topic(name, kind.replace("/", "/msg/", 1), "ros1", _number(head, b"conn", self._path)), data + size

    def _chunk(self, position: int, connections: int, share: Share) -> Chunk:
        head, data, packed = self._record(position, CHUNK)
        size = _number(head, b"size", self._path)
        if max(size, packed) > MAX_BLOCK or data + packed > self._file.size:
            raise InputError(f"{self._path} is damaged or truncated: a chunk at byte {position} claims {packed} bytes")
        compression = str(head.get(b"compression", b""), "utf-8", "replace")
        indices, place = {}, data + packed
        for _ in range(connections):
            entry, start, length = self._record(place, INDEX)
            share.take(start + length - place)
            indices[_number(entry, b"conn", self._path)] = place
            place = start + length
        return Chunk(data, packed, compression, size, indices)

    def _indexed(self, key: int) -> Iterator[Index]:
        for number, chunk in enumerate(self._chunks):
            if key in chunk.indices:
                _, start, size = self._record(chunk.indices[key], INDEX)
                entries = np.frombuffer(self._file.at(start, size // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
                times_ns = entries["s"].astype(np.int64) * 10**9 + entries["ns"]
                yield index_part(times_ns, number, entries["offset"].astype(np.int64))


def _fields(data: memoryview, path: Path) -> dict[bytes, bytes]:
    """The ``name=value`` fields of a header."""
    left, found = Fields(data, path), {}
    while left.left():
        name, equals, value = bytes(left.block()).partition(b"=")
        if not equals:
            raise InputError(f"{path} is damaged: a header has a field without a name")
        found[name] = value
    return found


def _number(fields: dict[bytes, bytes], name: bytes, path: Path) -> int:
    value = fields.get(name, b"")
    if len(value) not in (4, 8):
        raise InputError(f"{path} is damaged: a header has no {name.decode()}")
    return int.from_bytes(value, "little")
