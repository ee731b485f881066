"""Clients of services without ROS: one as of rmw_fastrtps, one as of rmw_cyclonedds, by types of its own."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int64, uint8, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cartier_ros.dds.reliable import Identity, Sample
from cartier_ros.dds.rtps import Participant
from cartier_ros.dds.types import decode, message

KIND = "lifecycle_msgs/srv/GetState"
ASKED = b"\0\1\0\0\0\0\0\0"


def until(true: Callable[[], object], within_s: float = 8.0) -> bool:
    """Whether something comes true in time."""
    end_s = time.monotonic() + within_s
    while not true() and time.monotonic() < end_s:
        time.sleep(0.01)
    return bool(true())


@dataclass
class GetStateRequest(IdlStruct, typename="lifecycle_msgs::srv::dds_::GetState_Request_"):  # type: ignore[call-arg]
    """As rmw_cyclonedds sends it: with who asks, and as which request."""

    guid: uint64
    seq: int64
    nothing: uint8 = 0


@dataclass
class GetStateResponse(IdlStruct, typename="lifecycle_msgs::srv::dds_::GetState_Response_"):  # type: ignore[call-arg]
    guid: uint64
    seq: int64
    id: uint8
    label: str


def state(number: int) -> Any:
    return message(f"{KIND}_Response", current_state=message("lifecycle_msgs/msg/State", id=number, label="active"))


class Asker:
    """A client as one of rmw_fastrtps: what it asks and gets is told apart by inline QoS alone."""

    def __init__(self, domain: int) -> None:
        self.got = list[Sample]()
        self.participant = Participant(domain)
        self.participant.reader(
            "rr/amcl/get_stateReply", "lifecycle_msgs::srv::dds_::GetState_Response_", self.got.append
        )
        send = self.participant.writer("rq/amcl/get_stateRequest", "lifecycle_msgs::srv::dds_::GetState_Request_")
        self.reader = self.participant.prefix + b"\0\0\1\4"  # the first that it made
        self.ask = lambda cdr: send(cdr, Identity(self.reader, 0))

    def wait(self) -> None:
        """Until the service answers, as requests that come before it is known are lost."""
        assert until(lambda: self.ask(ASKED) or time.sleep(0.1) or self.got)
        count = -1
        while count != (count := len(self.got)):
            time.sleep(0.2)
        self.got.clear()

    def numbers(self) -> list[int]:
        return [decode(each.cdr, f"{KIND}_Response").current_state.id for each in self.got]


class CycloneAsker:
    """A client as one of rmw_cyclonedds: header and request are one message."""

    def __init__(self, domain: int) -> None:
        ours = DomainParticipant(domain)
        qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll)
        self._asks = DataWriter(ours, Topic(ours, "rq/amcl/get_stateRequest", GetStateRequest), qos=qos)
        self._hears = DataReader(ours, Topic(ours, "rr/amcl/get_stateReply", GetStateResponse), qos=qos)

    def asked(self, guid: int, seq: int) -> list[Any]:
        """What is answered to a request: guid, seq, id and label of each reply."""
        assert until(lambda: self._asks.get_matched_subscriptions() and self._hears.get_matched_publications())
        self._asks.write(GetStateRequest(guid, seq))
        got = list[Any]()
        until(lambda: got.extend(s for s in self._hears.take(4) if s.sample_info.valid_data) or got)
        return [(each.guid, each.seq, each.id, each.label) for each in got]
