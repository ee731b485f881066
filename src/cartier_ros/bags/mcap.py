"""One MCAP file: topics and message places from its index, messages one by one (mcap.dev/spec)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
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

MAGIC = b"\x89MCAP0\r\n"
FOOTER = 1 + 8 + 20 + len(MAGIC)
HEAD = 1 + 8  # opcode and length
SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = 3, 4, 5, 6, 7, 8
MESSAGE_HEAD = 2 + 4 + 8 + 8
ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])


@dataclass(frozen=True)
class Chunk:
    """A chunk as the index has it; ``start`` is where its record begins."""

    start: int
    indices: dict[int, int]
    compression: str
    packed: int
    size: int

    def data(self) -> int:
        """Where its messages begin."""
        return self.start + HEAD + 28 + 4 + len(self.compression.encode()) + 8


class Mcap:
    """An indexed MCAP file; also one whose messages stand outside of chunks, if it has a summary."""

    def __init__(self, path: Path) -> None:
        self._file, self._path = File(path), path
        self.topics: Sequence[Topic] = []
        self._chunks: list[Chunk] = []
        self._unpacked = lru_cache(KEPT_CHUNKS)(self._unpack)
        start, end = self._summary_place()
        self._end = start
        self._read_summary(Fields(self._file.at(start, end - start), path))

    def index(self, topic: Topic) -> Index:
        if self._chunks:
            return by_time(self._indexed(topic.key))
        return self._loose.get(topic.key, np.empty((0, 3), np.int64))

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        if chunk < 0 or not self._chunks[chunk].compression:
            base = self._chunks[chunk].data() if chunk >= 0 else 0
            bound = base + self._chunks[chunk].size if chunk >= 0 else self._end
            size = self._message_size(self._file.at(base + offset, HEAD), bound - base - offset)
            wanted = size if limit == WHOLE else min(size, limit)
            return self._file.at(base + offset + HEAD + MESSAGE_HEAD, wanted)
        data = self._unpacked(chunk)
        head = data[offset : offset + HEAD] if offset >= 0 else b""
        size = self._message_size(head, len(data) - offset)
        start = offset + HEAD + MESSAGE_HEAD
        return data[start : start + (size if limit == WHOLE else min(size, limit))]

    def _message_size(self, head: bytes, room: int) -> int:
        """The bytes of a message whose record begins with ``head`` and has ``room`` bytes at most."""
        if len(head) != HEAD or head[0] != MESSAGE:
            raise InputError(f"{self._path} is damaged: its index leads to no message")
        size = int.from_bytes(head[1:], "little")
        if not MESSAGE_HEAD <= size <= room - HEAD:
            raise InputError(f"{self._path} is damaged: a message claims {size} bytes")
        return size - MESSAGE_HEAD

    def _summary_place(self) -> tuple[int, int]:
        """Where the summary begins and ends."""
        size, path = self._file.size, self._path
        if size < len(MAGIC) or self._file.at(0, len(MAGIC)) != MAGIC:
            raise InputError(f"{path} is no MCAP file")
        footer = self._file.at(size - FOOTER, FOOTER) if size >= FOOTER + len(MAGIC) else b""
        if not footer.endswith(MAGIC) or footer[0] != 2 or int.from_bytes(footer[1:9], "little") != 20:
            raise InputError(
                f"{path} is truncated (the recording was not closed): mend it with "
                f"'mcap recover {path.name} -o MENDED.mcap'"
            )
        start = int.from_bytes(footer[9:17], "little")
        if start == 0:
            raise InputError(f"{path} has no index: write one with 'mcap recover {path.name} -o INDEXED.mcap'")
        if not len(MAGIC) <= start <= size - FOOTER:
            raise InputError(f"{path} is damaged: its index should begin at byte {start}, but it has {size}")
        if size - FOOTER - start > MAX_BLOCK:
            raise InputError(f"{path} is damaged: it claims an index of {size - FOOTER - start} bytes")
        return start, size - FOOTER

    def _read_summary(self, summary: Fields) -> None:
        types: dict[int, str] = {}
        channels: dict[int, Topic] = {}
        while summary.left():
            opcode, size = summary.numbers("<BQ")
            record = Fields(summary.take(size), self._path)
            if opcode == SCHEMA:
                (key,) = record.numbers("<H")
                types[key] = record.text()
            elif opcode == CHANNEL:
                key, schema = record.numbers("<HH")
                name, encoding = record.text(), record.text()
                channels[key] = Topic(name, _ros2_name(types.get(schema, "")), encoding, key)
                check_count(len(channels), self._path)
            elif opcode == CHUNK_INDEX:
                self._chunks.append(self._chunk(record))
        self.topics = list(channels.values())

    def _chunk(self, record: Fields) -> Chunk:
        _, _, start, length = record.numbers("<QQQQ")
        indices = Fields(record.block(), self._path)
        offsets: dict[int, int] = {}
        while indices.left():
            key, offset = indices.numbers("<HQ")
            offsets[key] = offset
        record.numbers("<Q")
        chunk = Chunk(start, offsets, record.text(), *record.numbers("<QQ"))
        if start + length > self._end or chunk.data() + chunk.packed > start + length or chunk.size > MAX_BLOCK:
            raise InputError(f"{self._path} is damaged: a chunk at byte {start} claims {chunk.size} bytes")
        if not chunk.compression and chunk.packed != chunk.size:
            raise InputError(f"{self._path} is damaged: a chunk at byte {start} has two sizes")
        if not offsets:
            raise InputError(f"{self._path} has chunks without an index: mend it with 'mcap recover'")
        return chunk

    def _indexed(self, key: int) -> Iterator[Index]:
        share = Share(self._file)
        for number, chunk in enumerate(self._chunks):
            if key not in chunk.indices:
                continue
            opcode, size = Fields(self._file.at(chunk.indices[key], HEAD), self._path).numbers("<BQ")
            share.take(size)
            record = Fields(self._file.at(chunk.indices[key] + HEAD, size), self._path)
            if opcode != MESSAGE_INDEX or record.numbers("<H")[0] != key:
                raise InputError(f"{self._path} is damaged: the index of chunk {number} is not where it should be")
            block = record.block()
            entries = np.frombuffer(block[: len(block) // ENTRY.itemsize * ENTRY.itemsize], ENTRY)
            yield index_part(entries["time"].astype(np.int64), number, entries["offset"].astype(np.int64))

    @cached_property
    def _loose(self) -> dict[int, Index]:
        """The messages that stand outside of chunks, by channel."""
        position = len(MAGIC)
        found: dict[int, list[tuple[int, int, int]]] = {}
        while position < self._end:
            head = self._file.at(position, min(HEAD + MESSAGE_HEAD, self._end - position))
            opcode, size = Fields(head, self._path).numbers("<BQ")
            if opcode == CHUNK:
                raise InputError(f"{self._path} has chunks that its index does not know: mend it with 'mcap recover'")
            if opcode == MESSAGE:
                key, _, time_ns = Fields(head[HEAD:], self._path).numbers("<HIq")
                found.setdefault(key, []).append((time_ns, -1, position))
            position += HEAD + size
        return {key: by_time([np.array(rows, np.int64)]) for key, rows in found.items()}

    def _unpack(self, number: int) -> bytes:
        chunk = self._chunks[number]
        packed = self._file.at(chunk.data(), chunk.packed)
        data = unpacked(chunk.compression, packed, chunk.size, self._path)
        (crc,) = Fields(self._file.at(chunk.start + HEAD + 24, 4), self._path).numbers("<I")
        if crc and zlib.crc32(data) != crc:
            raise InputError(f"{self._path} is damaged: the checksum of chunk {number} is wrong")
        return data


def _ros2_name(name: str) -> str:
    """``sensor_msgs/Image`` of ROS 1 as ROS 2 spells it."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name
