"""Bounded reads of bag files, shared by the three storages: topics, message places and decompressed chunks.

rosbags gives us the message types, but not the storages: its readers decompress without a bound and load whole chunks
for one time stamp, which is unsafe for untrusted bags and slow for long ones.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.files import check_file

MAX_BLOCK = 256 << 20  # bytes of one chunk, message or index; a 4K float depth image has 35 MB
MAX_TOPICS = 10_000
KEPT_CHUNKS = 2  # decompressed: messages of one time lie in one or two chunks
WHOLE = -1

Index = npt.NDArray[np.int64]
"""(N, 3): log time in ns, chunk, offset; what the last two mean is the storage's own affair."""


@dataclass(frozen=True)
class Topic:
    """A topic as one storage knows it. ``type`` is spelled ``sensor_msgs/msg/Image``, ``encoding`` is cdr or ros1."""

    name: str
    type: str
    encoding: str
    key: int


class Storage(Protocol):
    """One file of a bag."""

    topics: Sequence[Topic]

    def index(self, topic: Topic) -> Index:
        """Where a topic's messages lie, by log time."""
        ...

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        """One message, or its first ``limit`` bytes."""
        ...


class File:
    """A file whose every read is checked against its size before it is made."""

    def __init__(self, path: Path) -> None:
        self.path = path
        check_file(path)
        try:
            self._file = path.open("rb", buffering=0)
            self.size = path.stat().st_size
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror})") from error
        if not self.size:
            raise InputError(f"{path} is empty")

    def at(self, offset: int, size: int) -> bytes:
        """``size`` bytes, or an InputError if the file has not so many there."""
        if size > MAX_BLOCK:
            raise InputError(f"{self.path} is damaged: at byte {offset} it claims a piece of {size} bytes")
        if offset < 0 or size < 0 or offset + size > self.size:
            raise InputError(f"{self.path} is damaged or truncated: byte {offset} + {size} lies beyond its {self.size}")
        self._file.seek(offset)
        data = self._file.read(size)
        if data is None or len(data) != size:
            raise InputError(f"{self.path} is damaged or truncated at byte {offset}")
        return data


class Fields:
    """Reads little-endian values one after another from bytes; an InputError where they run out."""

    def __init__(self, data: bytes | memoryview, path: Path) -> None:
        self.data, self.path, self.position = memoryview(data), path, 0

    def left(self) -> int:
        return len(self.data) - self.position

    def take(self, size: int) -> memoryview:
        if not 0 <= size <= self.left():
            raise InputError(f"{self.path} is damaged: a record claims {size} bytes where {self.left()} are left")
        self.position += size
        return self.data[self.position - size : self.position]

    def numbers(self, form: str) -> tuple[int, ...]:
        return struct.unpack(form, self.take(struct.calcsize(form)))

    def block(self) -> memoryview:
        """Bytes after their length in 4 bytes."""
        return self.take(self.numbers("<I")[0])

    def text(self) -> str:
        return str(self.block(), "utf-8", "replace")


def check_count(count: int, path: Path) -> None:
    if count > MAX_TOPICS:
        raise InputError(f"{path} claims {count} topics; cartier reads bags of up to {MAX_TOPICS}")


class Share:
    """The bytes of a file that were read to learn where its messages lie; parts that lie over each other run it out.

    Without it, a thousand chunks that share one index would be a million index entries.
    """

    def __init__(self, file: File) -> None:
        self._file, self._left = file, file.size

    def take(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise InputError(f"{self._file.path} is damaged: parts of it lie over each other")


def unpacked(compression: str, data: bytes, size: int, path: Path) -> bytes:
    """``data`` decompressed; never more than the ``size`` that its header claims, and never more than MAX_BLOCK."""
    if size > MAX_BLOCK:
        raise InputError(f"{path} is damaged: a chunk claims {size} bytes")
    try:
        plain = _decompress(compression, data, size + 1)
    except (ValueError, RuntimeError, OSError, EOFError) as error:
        raise InputError(f"{path} is damaged: a {compression} chunk cannot be decompressed ({brief(error)})") from error
    except KeyError as error:
        raise InputError(f"{path} is compressed with {brief(compression, 40)!r}, which cartier cannot read") from error
    if len(plain) != size:
        raise InputError(f"{path} is damaged: a chunk has not the {size} bytes that it claims")
    return plain


def _decompress(compression: str, data: bytes, limit: int) -> bytes:
    if compression in ("", "none"):
        return data
    if compression == "bz2":
        from bz2 import BZ2Decompressor

        return BZ2Decompressor().decompress(data, limit)
    if compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        return bytes(LZ4FrameDecompressor().decompress(data, limit))
    if compression == "zstd":
        from backports.zstd import ZstdDecompressor, ZstdError

        try:
            return bytes(ZstdDecompressor().decompress(data, limit))
        except ZstdError as error:
            raise ValueError(str(error)) from error
    raise KeyError(compression)


def by_time(parts: Iterable[Index]) -> Index:
    """Index parts as one, by log time, equal times in the order given."""
    there = [part for part in parts if len(part)]
    if not there:
        return np.empty((0, 3), np.int64)
    index = np.concatenate(there)
    return np.asarray(index[np.argsort(index[:, 0], kind="stable")])


def index_part(times_ns: npt.ArrayLike, chunk: int, offsets: npt.ArrayLike) -> Index:
    """Index rows of one chunk."""
    times = np.asarray(times_ns, dtype=np.int64)
    return np.stack([times, np.full(len(times), chunk, np.int64), np.asarray(offsets, dtype=np.int64)], axis=1)
