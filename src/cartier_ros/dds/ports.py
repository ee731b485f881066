"""UDP sockets of an RTPS participant: the domain's ports, and this machine's addresses."""

from __future__ import annotations

import socket
from collections.abc import Iterable

from cartier_ros.dds.domain import kept_here

GROUP = "239.255.0.1"
PORTS, PER_DOMAIN, PER_PARTICIPANT, UNICAST = 7400, 250, 2, 10
INDICES = 20  # participants of one machine that are looked for without multicast


def hosts() -> list[str]:
    """This machine's address towards others, and the loopback; the latter alone if ROS is kept to this machine."""
    here = ["127.0.0.1"]
    if kept_here():
        return here
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((GROUP, PORTS))  # sends nothing
            outside = str(probe.getsockname()[0])
        except OSError:
            return here
    return here if outside in here else [outside, *here]


def unicast(base: int) -> socket.socket:
    """The socket of this participant, on the first port that is free. Raises OSError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    for index in range(INDICES * 5):
        try:
            made.bind(("", base + UNICAST + PER_PARTICIPANT * index))
        except OSError:  # another participant of this machine
            continue
        return made
    raise OSError("all ports of its participants are taken on this machine")


def multicast(base: int, joined: Iterable[str]) -> socket.socket:
    """A socket that hears the announcements of others. Raises OSError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if hasattr(socket, "SO_REUSEPORT"):
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    made.bind(("", base))
    for host in joined:
        try:
            made.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + socket.inet_aton(host)
            )
        except OSError:  # an interface without multicast
            continue
    return made
