"""RTPS participant for ROS 2 services, beside that of cyclonedds, which can neither read nor write which request a
reply belongs to: rmw_fastrtps says it in a sample's inline QoS.

It speaks of RTPS 2.3 what services need: discovery, reliable delivery, small messages over UDP/IPv4; large ones are in
``large``.
"""

from __future__ import annotations

import secrets
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

from cartier.errors import BackendError
from cartier_ros.dds.ports import GROUP, INDICES, PER_DOMAIN, PER_PARTICIPANT, PORTS, UNICAST, hosts, multicast, unicast
from cartier_ros.dds.reliable import MOST_SAMPLES, Identity, Kept, Peer, Receiver, Sample, Sender
from cartier_ros.dds.wire import (
    ACKNACK,
    DATA,
    GAP,
    HEARTBEAT,
    INFO_DST,
    NACK_FRAG,
    Address,
    listed,
    number_bytes,
    number_set,
    parameters,
    submessage,
    submessages,
    text,
    udp_addresses,
)

S = TypeVar("S", bound=Sender)
VENDOR, CYCLONE = b"\x01\xca", b"\x01\x10"
LEASE_S, ANNOUNCE_S, SOON_S, REPEAT_S = 20, 3.0, 0.2, 0.25
SOON = 10  # announcements that follow each other quickly, at the beginning
MOST_PEERS, MOST_ENDPOINTS, MOST_BYTES = 500, 20_000, 65507
PARTICIPANT_W, PARTICIPANT_R = bytes.fromhex("000100c2"), bytes.fromhex("000100c7")
WRITERS_W, WRITERS_R = bytes.fromhex("000003c2"), bytes.fromhex("000003c7")
READERS_W, READERS_R = bytes.fromhex("000004c2"), bytes.fromhex("000004c7")
ENDPOINTS = 0b111111  # announces and detects participants, writers and readers
LEASE, TOPIC, TYPE, VERSION, VENDOR_ID, RELIABILITY, DURABILITY = 0x02, 0x05, 0x07, 0x15, 0x16, 0x1A, 0x1D
USER_DATA, LOCATOR, DEFAULT_LOCATOR, META_LOCATOR, PARTICIPANT, SET, ENDPOINT = 0x2C, 0x2F, 0x31, 0x32, 0x50, 0x58, 0x5A
STATUS, RELATED, RELATED_TOO = 0x71, 0x83, 0x800F
GONE = struct.pack(">I", 3)


class Send(Protocol):
    """Sends CDR bytes."""

    def __call__(self, cdr: bytes, related: Identity | None, only: bytes | None = None) -> None: ...


class Participant:
    """A participant of a domain that serves: readers of requests and writers of replies.

    Args:
        domain: The DDS domain.

    Raises:
        BackendError: The network cannot be used.
    """

    def __init__(self, domain: int) -> None:
        self.prefix = VENDOR + secrets.token_bytes(10)
        self.lock, self._closed = threading.RLock(), threading.Event()
        self._base = PORTS + PER_DOMAIN * domain
        try:
            self.hosts = hosts()
            self._sockets = [multicast(self._base, self.hosts), unicast(self._base)]
            self._port: int = self._sockets[1].getsockname()[1]
        except OSError as error:
            raise BackendError(f"services cannot use the network in domain {domain}: {error}") from error
        self._leases: dict[bytes, float] = {}
        self._places: dict[bytes, tuple[list[Address], list[Address]]] = {}  # of participants: discovery, and data
        self._writers = {e: Sender(e, True) for e in (WRITERS_W, READERS_W)}
        self._readers = {
            WRITERS_R: Receiver(WRITERS_R, lambda sample, gone: self._found(sample, gone, True)),
            READERS_R: Receiver(READERS_R, lambda sample, gone: self._found(sample, gone, False)),
        }
        self._endpoints: dict[bytes, tuple[str, bool, list[Address]]] = {}  # of others: topic, whether it writes, where
        self._heard: list[tuple[Callable[[Sample], None], Sample]] = []
        self._topics: dict[str, bytes] = {}  # the entity that hears or tells a topic
        self._thread = threading.Thread(target=self._run, name="rtps", daemon=True)
        self._thread.start()

    def reader(self, topic: str, kind: str, heard: Callable[[Sample], None]) -> None:
        """Hear a topic of DDS (its name, and that of its type) reliably; ``heard`` is called in a thread of its own."""
        entity = self._entity(topic, 0x04)
        with self.lock:
            self._readers[entity] = Receiver(
                entity, lambda sample, gone: None if gone else self._heard.append((heard, sample))
            )
            self._tell(READERS_W, entity, topic, kind)

    def writer(self, topic: str, kind: str) -> Send:
        """Offer a topic reliably. Returns what sends CDR bytes, what they are related to, to one reader or to all."""
        entity = self.offer(topic, kind, lambda entity: Sender(entity, False)).entity
        return lambda cdr, related, only=None: self._write(entity, cdr, related, only)

    def offer(self, topic: str, kind: str, make: Callable[[bytes], S], about: bytes = b"") -> S:
        """Offer a topic by a sender that is made for its entity; ``about`` is told of it as user data."""
        entity = self._entity(topic, 0x03)
        with self.lock:
            self._writers[entity] = sender = make(entity)
            self._tell(WRITERS_W, entity, topic, kind, about)
        return sender

    def tell(self, sender: Sender) -> None:
        """Say to all readers which samples there are."""
        with self.lock:
            for guid in sender.peers:
                self._news(sender, guid)

    def close(self) -> None:
        """Take leave of the others."""
        self._closed.set()
        self._thread.join(2)
        with self.lock:
            gone = parameters([(PARTICIPANT, self.prefix + b"\0\0\x01\xc1")])
            left = Kept(b"\0\3\0\0" + gone, parameters([(STATUS, GONE)]), None, True)
            self._announce(left)
            for each in self._sockets:
                each.close()

    def _entity(self, topic: str, kind: int) -> bytes:
        with self.lock:
            self._topics[topic] = entity = struct.pack(">I", (len(self._topics) + 1) << 8 | kind)
        return entity

    def _tell(self, by: bytes, entity: bytes, topic: str, kind: str, about: bytes = b"") -> None:
        parts = [
            (ENDPOINT, self.prefix + entity), (PARTICIPANT, self.prefix + b"\0\0\x01\xc1"), (TOPIC, text(topic)),
            (TYPE, text(kind)), (RELIABILITY, struct.pack("<IiI", 2, 0, 1 << 29)), (DURABILITY, struct.pack("<I", 0)),
            (VERSION, b"\x02\x03\0\0"), (VENDOR_ID, VENDOR + b"\0\0"),
            *([(USER_DATA, struct.pack("<I", len(about)) + about)] if about else []),
        ]  # fmt: skip
        self._writers[by].add(Kept(b"\0\3\0\0" + parameters(parts), b"", None))
        for guid in self._writers[by].peers:
            self._news(self._writers[by], guid)
        for guid in self._endpoints:
            self._match(guid)

    def _write(self, entity: bytes, cdr: bytes, related: Identity | None, only: bytes | None) -> None:
        inline = b""
        if related is not None:
            told = related.guid + number_bytes(related.number)
            inline = parameters([(RELATED, told), (RELATED_TOO, told)])
        with self.lock:
            self._writers[entity].add(Kept(cdr, inline, only))
            self.tell(self._writers[entity])

    def _news(self, writer: Sender, guid: bytes, begin: int = 0) -> None:
        reader = writer.peers[guid]
        self.send(guid[:12], writer.news(guid, begin or reader.sent + 1), reader.addresses)

    def send(self, to: bytes, parts: bytes, addresses: Iterable[Address]) -> None:
        """Send submessages to a participant, or to all for an empty prefix; from any thread."""
        head = b"RTPS\x02\x03" + VENDOR + self.prefix + (submessage(INFO_DST, to) if to else b"")
        for address in addresses:
            try:
                self._sockets[1].sendto(head + parts, address)
            except OSError:  # a network that is down now; it is sent again
                continue

    def _announce(self, left: Kept | None = None, to: list[Address] | None = None) -> None:
        place = [struct.pack("<II", 1, self._port) + bytes(12) + socket.inet_aton(host) for host in self.hosts]
        parts = [
            (VERSION, b"\x02\x03\0\0"), (VENDOR_ID, VENDOR + b"\0\0"), (PARTICIPANT, self.prefix + b"\0\0\x01\xc1"),
            (LEASE, struct.pack("<iI", LEASE_S, 0)), (SET, struct.pack("<I", ENDPOINTS)),
            (USER_DATA, struct.pack("<I", 10) + b"enclave=/;"),
            *((META_LOCATOR, each) for each in place), *((DEFAULT_LOCATOR, each) for each in place),
        ]  # fmt: skip
        writer = Sender(PARTICIPANT_W, True)
        told = writer.data(bytes(12) + PARTICIPANT_R, 1, left or Kept(b"\0\3\0\0" + parameters(parts), b"", None))
        if to is None:
            to = [("127.0.0.1", self._base + UNICAST + PER_PARTICIPANT * k) for k in range(INDICES)]
            to += [each for meta, _ in self._places.values() for each in meta]
            for host in self.hosts:
                self._sockets[1].setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(host))
                self.send(b"", told, [(GROUP, self._base)])
        self.send(b"", told, dict.fromkeys(to))

    def _run(self) -> None:
        told, next_s, repeat_s = 0, 0.0, 0.0
        while not self._closed.is_set():
            now_s = time.monotonic()
            with self.lock:
                if now_s >= next_s:
                    self._announce()
                    self._ask()
                    told, next_s = told + 1, now_s + (SOON_S if told < SOON else ANNOUNCE_S)
                    for prefix in [p for p, end_s in self._leases.items() if end_s < now_s]:
                        self._forget(prefix)
                if now_s >= repeat_s:
                    repeat_s = now_s + REPEAT_S
                    for writer in self._writers.values():
                        for guid, reader in writer.peers.items():
                            if reader.wanted <= writer.last:
                                self._news(writer, guid, reader.wanted)
            for ready in select.select(self._sockets, [], [], 0.05)[0]:
                data = ready.recv(MOST_BYTES)
                with self.lock:
                    self._read(data)
                    waiting, self._heard = self._heard, []
                for heard, sample in waiting:  # without the lock, which whoever replies meanwhile may need
                    heard(sample)

    def _ask(self) -> None:
        """Ask for the endpoints of participants of which none have come."""
        for entity in (WRITERS_R, READERS_R):
            for guid, writer in self._readers[entity].peers.items():
                if writer.wanted == 1:
                    self.send(guid[:12], self._readers[entity].answer(guid, 1, 0), writer.addresses)

    def _read(self, data: bytes) -> None:
        """A datagram of anybody: what is not RTPS as it should be is passed over."""
        if data[:5] != b"RTPS\x02" or len(data) < 20 or data[8:20] == self.prefix:
            return
        source, ours = data[8:20], True
        try:
            for kind, flags, body in submessages(data):
                order = "<" if flags & 1 else ">"
                if kind == INFO_DST:
                    ours = body[:12] in (self.prefix, bytes(12))
                elif ours and kind == DATA:
                    self._data(source, order, flags, body)
                elif ours and kind == HEARTBEAT:
                    self._beat(source, order, body)
                elif ours and kind == GAP:
                    self._gapped(source, order, body)
                elif ours and kind == ACKNACK:
                    self._acked(source, order, flags, body)
                elif ours and kind == NACK_FRAG:
                    self._lacks(source, order, body)
        except (struct.error, ValueError, IndexError):
            return

    def _data(self, source: bytes, order: str, flags: int, body: bytes) -> None:
        to_inline, to, by, high, low = struct.unpack_from(f"{order}2xH4s4siI", body)
        at, guid, number = 4 + to_inline, source + by, high << 32 | low
        inline: dict[int, list[bytes]] = {}
        if flags & 2:
            inline, at = listed(body, at, order)
        gone = bool(inline.get(STATUS, [b"\0"])[0][-1] & 3)
        payload = body[at:] if flags & 12 else b""
        if by == PARTICIPANT_W:
            self._participant(source, payload, gone)
            return
        told = (inline.get(RELATED) or inline.get(RELATED_TOO) or [b""])[0]
        related = Identity(told[:16], int.from_bytes(told[16:20], "little") << 32) if len(told) >= 24 else None
        for reader in list(self._readers.values()):
            if to in (reader.entity, bytes(4)) and guid in reader.peers and reader.fresh(guid, number):
                reader.heard(Sample(payload, Identity(guid, number), related), gone)

    def _beat(self, source: bytes, order: str, body: bytes) -> None:
        to, by, *four = struct.unpack_from(f"{order}4s4siIiI", body)
        first, last = four[0] << 32 | four[1], four[2] << 32 | four[3]
        for reader in self._readers.values():
            guid = source + by
            if to in (reader.entity, bytes(4)) and guid in reader.peers:
                self.send(source, reader.answer(guid, first, last), reader.peers[guid].addresses)

    def _gapped(self, source: bytes, order: str, body: bytes) -> None:
        to, by, high, low = struct.unpack_from(f"{order}4s4siI", body)
        base, numbers = number_set(body, 16, order)
        first = high << 32 | low
        for reader in self._readers.values():
            if to in (reader.entity, bytes(4)) and (guid := source + by) in reader.peers:
                writer = reader.peers[guid]
                if first <= writer.wanted < base:
                    writer.wanted = base
                reader.skip(
                    guid, [*range(max(first, writer.wanted), min(base, writer.wanted + MOST_SAMPLES)), *numbers]
                )

    def _acked(self, source: bytes, order: str, flags: int, body: bytes) -> None:
        by, to = body[:4], body[4:8]
        writer, guid = self._writers.get(to), source + by
        if writer is None or guid not in writer.peers:
            return
        base, missing = number_set(body, 8, order)
        writer.acked(guid, base)
        if missing:
            for number in missing:
                writer.ask(guid, number, [])
            self._news(writer, guid, max(min(missing), writer.peers[guid].wanted))
        elif not flags & 2:
            self._news(writer, guid)

    def _lacks(self, source: bytes, order: str, body: bytes) -> None:
        writer, guid = self._writers.get(body[4:8]), source + body[:4]
        if writer is not None and guid in writer.peers:
            _, low = struct.unpack_from(f"{order}iI", body, 8)
            lacking = number_set(body, 12, order)[1]  # read as if the sample's number were the high half of theirs
            writer.ask(guid, low, [each & 0xFFFFFFFF for each in lacking])

    def _participant(self, source: bytes, payload: bytes, gone: bool) -> None:
        if gone:
            self._forget(source)
            return
        told, _ = listed(payload, 4, "<" if payload[1:2] == b"\3" else ">")
        lease_s = int.from_bytes(told[LEASE][0][:4], "little") if LEASE in told else 100
        known = source in self._places
        if not known and len(self._places) >= MOST_PEERS:
            return
        self._leases[source] = time.monotonic() + min(lease_s, 1000)
        meta, data = (udp_addresses(told.get(pid, [])) for pid in (META_LOCATOR, DEFAULT_LOCATOR))
        if known or not meta:
            return
        self._places[source] = meta, data or meta
        self._announce(to=meta)
        for ours, theirs in ((WRITERS_R, WRITERS_W), (READERS_R, READERS_W)):
            self._readers[ours].peers[source + theirs] = Peer(meta)
            self._writers[theirs].match(source + ours, meta)
            self._news(self._writers[theirs], source + ours)
        self._ask()

    def _found(self, sample: Sample, gone: bool, writes: bool) -> None:
        """Somebody's endpoint: remembered, since ours may come later, and matched if its topic is one of ours."""
        told, _ = listed(sample.cdr, 4, "<" if sample.cdr[1:2] == b"\3" else ">")
        guid = told.get(ENDPOINT, [b""])[0]
        topic = told.get(TOPIC, [b"\0" * 5])[0][4:].split(b"\0")[0].decode("utf-8", "replace")
        place = self._places.get(guid[:12])
        if gone:
            self._endpoints.pop(guid, None)
            for each in self._ends():
                each.peers.pop(guid, None)
        elif place is not None and len(guid) == 16 and len(self._endpoints) < MOST_ENDPOINTS:
            self._endpoints[guid] = topic, writes, udp_addresses(told.get(LOCATOR, [])) or place[1]
            self._match(guid)

    def _match(self, guid: bytes) -> None:
        """Match somebody's endpoint with ours of its topic, if there is one."""
        topic, writes, addresses = self._endpoints[guid]
        entity = self._topics.get(topic, b"")
        reader, writer = self._readers.get(entity), self._writers.get(entity)
        if writes and reader is not None and guid not in reader.peers:
            reader.peers[guid] = Peer(addresses)
        elif not writes and writer is not None and guid not in writer.peers:
            writer.match(guid, addresses)
            self._news(writer, guid)

    def _ends(self) -> list[Receiver | Sender]:
        return [*self._readers.values(), *self._writers.values()]

    def _forget(self, prefix: bytes) -> None:
        self._leases.pop(prefix, None)
        self._places.pop(prefix, None)
        for each in self._ends():
            peers = each.peers
            for guid in [guid for guid in peers if guid[:12] == prefix]:
                del peers[guid]
        self._endpoints = {guid: each for guid, each in self._endpoints.items() if guid[:12] != prefix}
