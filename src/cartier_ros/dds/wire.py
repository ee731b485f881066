"""Wire format of RTPS 2.3: submessages, numbers, sets of numbers, and parameter lists."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterable, Iterator

DATA, ACKNACK, HEARTBEAT, GAP, INFO_DST, DATA_FRAG, NACK_FRAG = 0x15, 0x06, 0x07, 0x08, 0x0E, 0x16, 0x12
SENTINEL = 0x01
MOST_BITS = 256
Address = tuple[str, int]


def submessages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Kind, flags and body of each submessage of a datagram."""
    at = 20
    while at + 4 <= len(data):
        kind, flags = data[at], data[at + 1]
        length = int.from_bytes(data[at + 2 : at + 4], "little" if flags & 1 else "big")
        end = at + 4 + length if length else len(data)
        yield kind, flags, data[at + 4 : end]
        at = end


def submessage(kind: int, body: bytes, flags: int = 1) -> bytes:
    """A submessage, little-endian."""
    body += bytes(-len(body) % 4)
    return struct.pack("<BBH", kind, flags, len(body)) + body


def number_bytes(value: int) -> bytes:
    """A sequence number."""
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


def number_set(body: bytes, at: int, order: str) -> tuple[int, list[int]]:
    """The base of a set of numbers, and the numbers."""
    high, low, bits = struct.unpack_from(f"{order}iII", body, at)
    if bits > MOST_BITS:
        raise ValueError(bits)
    words = struct.unpack_from(f"{order}{(bits + 31) // 32}I", body, at + 12)
    base = high << 32 | low
    return base, [base + k for k in range(bits) if words[k // 32] >> (31 - k % 32) & 1]


def parameters(parts: Iterable[tuple[int, bytes]]) -> bytes:
    """A parameter list, by ids and values."""
    return b"".join(
        struct.pack("<HH", pid, len(value) + -len(value) % 4) + value + bytes(-len(value) % 4)
        for pid, value in [*parts, (SENTINEL, b"")]
    )


def listed(data: bytes, at: int, order: str) -> tuple[dict[int, list[bytes]], int]:
    """Parameters by their ids, and where they end."""
    found: dict[int, list[bytes]] = {}
    while at + 4 <= len(data):
        pid, length = struct.unpack_from(f"{order}HH", data, at)
        at += 4
        if pid == SENTINEL:
            break
        found.setdefault(pid, []).append(data[at : at + length])
        at += length
    return found, at


def text(value: str) -> bytes:
    """A string as the value of a parameter."""
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def udp_addresses(locators: list[bytes]) -> list[Address]:
    """The UDP/IPv4 addresses among some locators."""
    found = []
    for each in locators[:16]:
        if len(each) == 24:
            kind, port = struct.unpack_from("<iI", each)
            if kind == 1 and 0 < port < 1 << 16:
                found.append((socket.inet_ntoa(each[20:]), port))
    return found
