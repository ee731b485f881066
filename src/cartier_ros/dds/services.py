"""Services of ROS 2 served over DDS, for clients of rmw_fastrtps and of rmw_cyclonedds."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from cartier.errors import InputError
from cartier_ros.dds.reliable import Identity, Sample
from cartier_ros.dds.rtps import CYCLONE, Participant, Send
from cartier_ros.dds.types import dds_name, decode, encoded

READERS = (0x04, 0x07)  # kinds of entities
HEADER = 16  # bytes of rmw_cyclonedds before a request and its reply: the client and the number of its request


class Request:
    """A request: the message ``value``, and ``reply``, which takes the message that answers it."""

    def __init__(self, value: Any, reply: Callable[[Any], None]) -> None:
        self.value, self.reply = value, reply


class Services:
    """Services of a domain. Raises BackendError if the network cannot be used."""

    def __init__(self, domain: int) -> None:
        self.participant = Participant(domain)

    def serve(self, name: str, kind: str, answered: Callable[[Request], object]) -> None:
        """Serve a service such as ``/amcl/get_state`` of a type such as ``lifecycle_msgs/srv/GetState``.

        ``answered`` gets each request in a thread of this object, and replies at once or later, from any thread. What
        is no such request is passed over.
        """
        where, asked = name.lstrip("/"), f"{kind}_Request"
        send = self.participant.writer(f"rr/{where}Reply", dds_name(f"{kind}_Response"))

        def heard(sample: Sample) -> None:
            with contextlib.suppress(InputError):
                answered(_request(sample, asked, send))

        self.participant.reader(f"rq/{where}Request", dds_name(asked), heard)

    def close(self) -> None:
        """Take leave of the others."""
        self.participant.close()


def _request(sample: Sample, kind: str, send: Send) -> Request:
    cdr, who = sample.cdr, sample.related.guid if sample.related and any(sample.related.guid) else sample.sender.guid
    if sample.sender.guid[:2] == CYCLONE:
        with contextlib.suppress(
            InputError
        ):  # the header is a part of the message, but not of that of our own robots/dds.py
            value = decode(cdr[:4] + cdr[4 + HEADER :], kind)
            header = cdr[4 : 4 + HEADER]
            return Request(value, lambda reply: send((told := encoded(reply))[:4] + header + told[4:], None))
    only = who if who[15] in READERS else None
    return Request(decode(cdr, kind), lambda reply: send(encoded(reply), Identity(who, sample.sender.number), only))
