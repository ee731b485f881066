"""Topics of a DDS domain: who publishes what, and readers and writers of CDR bytes, by ROS 2's names and service."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Iterator
from typing import Any, NamedTuple

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cartier.errors import BackendError, brief
from cartier_ros.dds.domain import kept_here
from cartier_ros.dds.types import as_sample, dds_name, ros_name, store, topic_type

SOCKET_BYTES = 10_000_000  # an image of 1280x720 comes in 2,100 pieces at once
EPROSIMA = "1.15"  # vendor id: type information of Fast DDS 3 (Kilted) describes types that cyclonedds cannot match
SETTINGS = (
    f'<CycloneDDS><Domain><Internal><SocketReceiveBufferSize max="{SOCKET_BYTES}B"/></Internal>'
    f"<Compatibility><IgnoreTypeInformation>{EPROSIMA}</IgnoreTypeInformation></Compatibility></Domain></CycloneDDS>"
)
HERE = (  # without multicast, as a Fast DDS that is kept to its machine does not listen to it
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex></Discovery>'
    "</Domain></CycloneDDS>"
)
RMEM_MAX = "/proc/sys/net/core/rmem_max"
MOST_WRITERS = 4096
BLOCK_S = 0.1  # how long a writer may wait for a slow listener
KEPT = 10  # messages that a slow listener may still get
KEPT_LATCHED = 100  # messages of a latched topic that those who come later get
HASH = re.compile(rb"RIHS01_[0-9a-f]{64}")
NAME = re.compile(r"rt(/[A-Za-z0-9_~]+)+", re.ASCII)
URI = "CYCLONEDDS_URI"
_environment = threading.Lock()


class Offer(NamedTuple):
    """A topic that somebody publishes: its ROS name and type, and what all of its writers offer."""

    name: str
    kind: str
    reliable: bool
    latched: bool


def participant(domain: int) -> Any:
    """A participant of a domain. Large socket buffers are asked for; CYCLONEDDS_URI says more, or otherwise.

    Raises BackendError if DDS cannot use the network.
    """
    with _environment:  # cyclonedds reads its settings from there alone
        before = os.environ.get(URI)
        os.environ[URI] = ",".join(filter(None, (SETTINGS, HERE if kept_here() and not before else "", before)))
        try:
            return DomainParticipant(domain)
        except DDSException as error:
            raise BackendError(
                f"DDS cannot be used in domain {domain}: {error}; check CYCLONEDDS_URI and the network"
            ) from error
        finally:
            if before is None:
                del os.environ[URI]
            else:
                os.environ[URI] = before


def socket_limit() -> int | None:
    """How many bytes this computer lets a socket hold, if that is fewer than are asked for."""
    try:
        with open(RMEM_MAX, encoding="ascii") as file:  # noqa: PTH123  # a file of the kernel, without a size
            limit = int(file.read(32))
    except (OSError, ValueError):
        return None
    return limit if limit < SOCKET_BYTES else None


class Publishers:
    """Who is in a domain, and publishes what, now."""

    def __init__(self, participant: Any) -> None:
        self._ours = str(participant.guid)
        self._programs = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        self._there = ReadCondition(self._programs, SampleState.Any | ViewState.Any | InstanceState.Alive)
        self._reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._alive = ReadCondition(self._reader, SampleState.Any | ViewState.Any | InstanceState.Alive)

    def programs(self) -> int:
        """How many other participants there are; a program has one, seldom more."""
        found = self._programs.read(MOST_WRITERS, self._there)
        return sum(each.sample_info.valid_data and str(each.key) != self._ours for each in found)

    def foreign(self) -> list[str]:
        """The DDS names of topics whose types are none of ROS 2."""
        return sorted({str(w.topic_name) for w in self._writers() if not ros_name(str(w.type_name))})

    def obstacles(self, name: str, kind: str) -> list[str]:
        """Why writers of a ROS topic of this type cannot be heard, as far as they say it themselves."""
        found = dict[str, None]()
        for writer in self._writers():
            qos = writer.qos
            if str(writer.topic_name) != f"rt{name}":
                continue
            if (other := ros_name(str(writer.type_name))) != kind:
                found[f"a second program publishes it as {brief(other or str(writer.type_name), 60)}"] = None
                continue
            told = qos[Policy.Userdata].data if Policy.Userdata in qos else b""
            if (theirs := HASH.search(told)) and theirs[0] != store().hash_rihs01(kind).encode():
                found[f"its {kind} has other fields than ours: another version of the message"] = None
            if Policy.Partition in qos and qos[Policy.Partition].partitions:
                found[f"it is in the DDS partition {brief(', '.join(qos[Policy.Partition].partitions), 60)!r}"] = None
            if Policy.Ownership in qos and qos[Policy.Ownership] != Policy.Ownership.Shared:
                found["its writer claims exclusive ownership"] = None
        return list(found)

    def _writers(self) -> Iterator[Any]:
        for writer in self._reader.read(MOST_WRITERS, self._alive):
            if writer.sample_info.valid_data and NAME.fullmatch(str(writer.topic_name)):
                yield writer

    def offers(self) -> dict[str, Offer]:
        """The topics of ROS 2 by name. Of several writers the least is said, so that all of them can be heard."""
        found: dict[str, Offer] = {}
        for writer in self._writers():
            name, kind = str(writer.topic_name), ros_name(str(writer.type_name))
            if not kind or len(name) > 256:
                continue
            reliable = writer.qos[Policy.Reliability] != Policy.Reliability.BestEffort
            latched = writer.qos[Policy.Durability] != Policy.Durability.Volatile
            other = found.get(name[2:], Offer(name[2:], kind, True, True))
            if other.kind == kind:
                found[name[2:]] = Offer(name[2:], kind, reliable and other.reliable, latched and other.latched)
        return found


class Reader:
    """Hears a topic.

    Args:
        participant: Whose it is.
        offer: The topic, and what its writers offer: that much is asked for.
        depth: How many messages wait until they are taken.

    Raises:
        BackendError: The topic was heard with another type before.
    """

    def __init__(self, participant: Any, offer: Offer, depth: int) -> None:
        self.offer = offer
        self.count = 0
        """How many messages came."""
        qos = Qos(
            _reliability(offer.reliable),
            Policy.Durability.TransientLocal if offer.latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(max(depth, KEPT_LATCHED if offer.latched else 0)),
        )
        try:
            topic = Topic(participant, f"rt{offer.name}", topic_type(offer.kind))
            self._reader: Any = DataReader(participant, topic, qos=qos)
        except DDSException as error:
            raise BackendError(f"DDS cannot hear {offer.name}: {error}") from error

    def take(self, most: int = 64) -> list[bytes]:
        """The messages that came since the last call, at most so many. Raises BackendError if DDS has none to give."""
        try:
            samples = self._reader.take(most)
        except DDSException as error:
            raise BackendError(f"DDS cannot read {self.offer.name}: {error}") from error
        taken = [sample.data for sample in samples if sample.sample_info.valid_data]
        self.count += len(taken)
        return taken

    def writers(self) -> int:
        """How many writers it matches."""
        return len(self._reader.get_matched_publications())


class Writer:
    """Publishes on a topic, reliably, as ROS 2 does by default.

    Args:
        participant: Whose it is.
        name: The topic, such as ``/tf``.
        kind: The type of its messages.
        depth: How many messages are kept for a listener that is slow; 0 for 10, or 100 where they are latched.
        latched: Whether those who come later get the last messages.
        prefix: ``rt`` for a topic, ``rq`` for the requests of a service.
    """

    def __init__(
        self, participant: Any, name: str, kind: str, depth: int = 0, latched: bool = False, prefix: str = "rt"
    ) -> None:
        self._kind = kind
        kept = Policy.History.KeepLast(depth or (KEPT_LATCHED if latched else KEPT))
        qos = Qos(
            _reliability(True),
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            kept,
            Policy.DurabilityService(duration(seconds=0), kept, -1, -1, -1),
            Policy.Userdata(f"typehash={store().hash_rihs01(kind)};".encode()),  # robots from Iron on expect it
        )
        try:
            topic = Topic(participant, f"{prefix}{name}", topic_type(kind))
            self._writer: Any = DataWriter(participant, topic, qos=qos)
        except DDSException as error:
            raise BackendError(f"DDS cannot publish {name}: {error}") from error

    def write(self, data: bytes) -> None:
        """Send the CDR bytes of a message. Raises BackendError if DDS does not take them."""
        try:
            self._writer.write(as_sample(self._kind, data))
        except DDSException as error:
            raise BackendError(f"DDS did not take a message of {dds_name(self._kind)}: {error}") from error

    def listeners(self) -> int:
        """How many readers there are."""
        return len(self._writer.get_matched_subscriptions())

    def received(self, timeout_s: float) -> bool:
        """Whether every reliable reader has got everything within so long."""
        try:
            return bool(self._writer.wait_for_acks(duration(seconds=timeout_s)))
        except AttributeError:  # cyclonedds 11.0.1 misspells its own exception when the time is over
            return False


def _reliability(reliable: bool) -> Any:
    return Policy.Reliability.Reliable(duration(seconds=BLOCK_S)) if reliable else Policy.Reliability.BestEffort
