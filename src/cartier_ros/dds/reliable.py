"""Reliable delivery of RTPS: a sender repeats what is not acknowledged, a receiver asks for what is missing."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from cartier_ros.dds.wire import ACKNACK, DATA, GAP, HEARTBEAT, MOST_BITS, Address, number_bytes, submessage

MOST_SAMPLES = 2000


class Identity(NamedTuple):
    """A sample: who sent it, and as which of its own."""

    guid: bytes
    number: int


class Sample(NamedTuple):
    """A received message: ``cdr`` with its encapsulation, ``sender``, and what it says that it is ``related`` to."""

    cdr: bytes
    sender: Identity
    related: Identity | None


@dataclass
class Kept:
    """A sample that was sent: to ``only`` one reader, or to all; ``key`` if it says that something is gone."""

    payload: bytes
    inline: bytes
    only: bytes | None
    key: bool = False


@dataclass
class Peer:
    """A remote endpoint: a reader with what it has, or a writer with what came of it."""

    addresses: list[Address]
    wanted: int = 1  # all before is there
    sent: int = 0
    later: set[int] = field(default_factory=set)
    count: int = 0


class Sender:
    """A writer: ``kept`` if those who come later get all."""

    def __init__(self, entity: bytes, kept: bool) -> None:
        self.entity, self.kept, self.last, self.count = entity, kept, 0, 0
        self.samples: dict[int, Kept] = {}
        self.peers: dict[bytes, Peer] = {}

    def match(self, guid: bytes, addresses: list[Address]) -> None:
        """A reader is there."""
        mine = [n for n, kept in self.samples.items() if kept.only in ((None, guid) if self.kept else (guid,))]
        first = min(mine, default=self.last + 1)
        self.peers[guid] = Peer(addresses, first, first - 1)

    def add(self, sample: Kept) -> None:
        """Keep a sample as the next."""
        self.last += 1
        self.samples[self.last] = sample
        if not self.kept and len(self.samples) > MOST_SAMPLES:
            del self.samples[min(self.samples)]

    def news(self, guid: bytes, begin: int) -> bytes:
        """Submessages for one reader from a number on: its samples, gaps where others' are, and a heartbeat."""
        reader, parts, gap = self.peers[guid], [], 0
        for number in range(begin, self.last + 1):
            kept = self.samples.get(number)
            if kept is None or kept.only not in (None, guid):
                gap = gap or number
                continue
            if gap:
                parts.append(self._gap(guid, gap, number))
            gap = 0
            parts.append(self.data(guid, number, kept))
        if gap:
            parts.append(self._gap(guid, gap, self.last + 1))
        reader.sent = self.last
        return b"".join([*parts, self.beat(guid, reader.wanted)])

    def beat(self, guid: bytes, first: int) -> bytes:
        """The submessage that says which samples there are for a reader."""
        self.count += 1
        there = number_bytes(first) + number_bytes(self.last) + struct.pack("<I", self.count)
        return submessage(HEARTBEAT, guid[12:] + self.entity + there)

    def ask(self, guid: bytes, number: int, fragments: list[int]) -> None:
        """A reader lacks fragments of a sample; there are none here."""

    def acked(self, guid: bytes, wanted: int) -> None:
        """A reader has all before a number."""
        reader = self.peers[guid]
        reader.wanted = max(reader.wanted, min(wanted, self.last + 1))
        if not self.kept:
            self.samples = {
                number: kept
                for number, kept in self.samples.items()
                if any(r.wanted <= number for g, r in self.peers.items() if kept.only in (None, g))
                or (kept.only is not None and kept.only not in self.peers)
            }

    def data(self, guid: bytes, number: int, kept: Kept) -> bytes:
        """The submessage of one sample for one reader."""
        flags = 1 | (2 if kept.inline else 0) | (8 if kept.key else 4)
        head = struct.pack("<HH", 0, 16) + guid[12:] + self.entity + number_bytes(number)
        return submessage(DATA, head + kept.inline + kept.payload, flags)

    def _gap(self, guid: bytes, first: int, end: int) -> bytes:
        return submessage(GAP, guid[12:] + self.entity + number_bytes(first) + number_bytes(end) + struct.pack("<I", 0))


class Receiver:
    """A reader; ``heard`` gets each sample once, and whether what it tells of is gone."""

    def __init__(self, entity: bytes, heard: Callable[[Sample, bool], None]) -> None:
        self.entity, self.heard = entity, heard
        self.peers: dict[bytes, Peer] = {}

    def fresh(self, guid: bytes, number: int) -> bool:
        """Whether a sample of a writer is new; it is not afterwards."""
        writer = self.peers[guid]
        if number < writer.wanted or number in writer.later or len(writer.later) > MOST_SAMPLES:
            return False
        self.skip(guid, [number])
        return True

    def skip(self, guid: bytes, numbers: Iterable[int]) -> None:
        """Samples of a writer have come, or never will."""
        writer = self.peers[guid]
        writer.later.update(number for number in numbers if number >= writer.wanted)
        while writer.wanted in writer.later:
            writer.later.discard(writer.wanted)
            writer.wanted += 1

    def answer(self, guid: bytes, first: int, last: int) -> bytes:
        """What acknowledges a heartbeat, and asks for what is missing."""
        writer = self.peers[guid]
        if writer.wanted < first:  # what is gone cannot be had
            writer.wanted = first
            writer.later = {number for number in writer.later if number >= first}
            self.skip(guid, [])
        bits = min(max(last - writer.wanted + 1, 0), MOST_BITS)
        missing = [k for k in range(bits) if writer.wanted + k not in writer.later]
        words = [0] * ((bits + 31) // 32)
        for k in missing:
            words[k // 32] |= 1 << (31 - k % 32)
        writer.count += 1
        told = (
            self.entity
            + guid[12:]
            + number_bytes(writer.wanted)
            + struct.pack(f"<I{len(words)}II", bits, *words, writer.count)
        )
        return submessage(ACKNACK, told, 1 if missing or last < first else 3)
