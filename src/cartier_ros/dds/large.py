"""Large samples over RTPS, such as images: fragments at a pace that sockets keep up with.

cyclonedds sends all fragments of a sample at once; a socket that holds 0.2 MB, as Linux gives it and Fast DDS takes it,
loses most of an image, and a best-effort reader never gets it again.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator

from cartier_ros.dds.reliable import Kept, Sender
from cartier_ros.dds.rtps import Participant
from cartier_ros.dds.types import dds_name, store
from cartier_ros.dds.wire import DATA_FRAG, Address, number_bytes, submessage

FRAGMENT = 15_800  # bytes of a sample in a datagram, for which Linux takes 16 KiB of a socket's buffer
SHORTEST_S = 1e-3  # sleep
KEPT = 5  # samples that a reliable reader may still ask for


class Large(Sender):
    """A writer of large samples; what readers ask for again goes out before the next sample."""

    def __init__(self, entity: bytes) -> None:
        super().__init__(entity, False)
        self._asked: dict[tuple[bytes, int], set[int]] = {}

    def add(self, sample: Kept) -> None:
        super().add(sample)
        self.samples.pop(self.last - KEPT, None)

    def news(self, guid: bytes, begin: int) -> bytes:
        """A heartbeat: what a reader lacks of it, it asks for."""
        self.peers[guid].sent = self.last
        return self.beat(guid, max(self.peers[guid].wanted, min(self.samples, default=self.last + 1)))

    def ask(self, guid: bytes, number: int, fragments: list[int]) -> None:
        """A reader lacks fragments of a sample; all where none are named."""
        self._asked.setdefault((guid, number), set()).update(fragments)

    def due(self) -> Iterator[tuple[bytes, bytes, list[Address]]]:
        """Whom to send what (a participant, a submessage, addresses): what was asked for, then the newest sample."""
        asked, self._asked = self._asked, {}
        everybody = {(guid[:12], tuple(peer.addresses[:1])): peer.addresses for guid, peer in self.peers.items()}
        meant = [(guid, number, wanted, self.peers[guid].addresses)
                 for (guid, number), wanted in asked.items() if guid in self.peers]  # fmt: skip
        for guid, number, wanted, addresses in [
            *meant, *((to + bytes(4), self.last, set[int](), at) for (to, _), at in everybody.items()),
        ]:  # fmt: skip
            data = self.samples[number].payload if number in self.samples else b""
            for k in range(-(-len(data) // FRAGMENT)):
                if not wanted or k + 1 in wanted:
                    head = struct.pack("<HH", 0, 28) + guid[12:] + self.entity + number_bytes(number)
                    head += struct.pack("<IHHI", k + 1, 1, FRAGMENT, len(data))
                    yield guid[:12], submessage(DATA_FRAG, head + data[k * FRAGMENT : (k + 1) * FRAGMENT]), addresses


class LargeWriter:
    """Publishes large messages on a topic, reliably.

    Args:
        participant: Whose it is.
        name: The topic, such as ``/image``.
        kind: The type of its messages.
    """

    def __init__(self, participant: Participant, name: str, kind: str) -> None:
        self._participant = participant
        about = f"typehash={store().hash_rihs01(kind)};".encode()
        self._sender: Large = participant.offer(f"rt{name}", dds_name(kind), Large, about)

    def write(self, data: bytes, bytes_a_s: float) -> None:
        """Send the CDR bytes of a message at a pace; returns when they are sent."""
        begin_s, sent, here = time.monotonic(), 0, self._participant.hosts
        with self._participant.lock:
            self._sender.add(Kept(data, b"", None))
            due = list(self._sender.due())
        for to, part, addresses in due:
            self._participant.send(to, part, [each for each in addresses if each[0] in here][:1] or addresses)
            sent += len(part)
            ahead_s = begin_s + sent / bytes_a_s - time.monotonic()
            if ahead_s > SHORTEST_S:
                time.sleep(ahead_s)
        self._participant.tell(self._sender)

    def listeners(self) -> int:
        """How many readers there are."""
        return len(self._sender.peers)
