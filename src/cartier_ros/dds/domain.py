"""Domain of DDS: the option, else ROS_DOMAIN_ID, else 0; and whether ROS is kept to this machine."""

from __future__ import annotations

import os

from cartier.errors import BackendError, brief

LAST_DOMAIN = 232  # the last whose ports fit into 16 bits


def domain_of(value: int | str | None, who: str) -> int:
    """A domain: ``value``, else this shell's ROS_DOMAIN_ID, else 0. Raises BackendError for an impossible one."""
    value = os.environ.get("ROS_DOMAIN_ID") or 0 if value is None else value
    try:
        domain = int(value)
    except ValueError:
        domain = -1
    if not 0 <= domain <= LAST_DOMAIN:
        raise BackendError(
            f"{who}: the domain (or ROS_DOMAIN_ID) must be 0 to {LAST_DOMAIN}, got {brief(repr(value), 40)}"
        )
    return domain


RANGE = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")


def range_here() -> str:
    """What this shell says of whom ROS finds, as the end of a sentence; empty if it says nothing."""
    told = [f"{name}={brief(os.environ[name], 60)}" for name in RANGE if os.environ.get(name)]
    if not told:
        return ""
    peers = "; ROS_STATIC_PEERS is not read: name the peers in CYCLONEDDS_URI" if RANGE[2] in os.environ else ""
    return f". This shell has {', '.join(told)}: has the robot's, too? If not, neither may hear the other{peers}"


def kept_here() -> bool:
    """Whether this shell keeps ROS to its machine, by ROS_AUTOMATIC_DISCOVERY_RANGE or the older ROS_LOCALHOST_ONLY."""
    return (
        os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "LOCALHOST"
        or os.environ.get("ROS_LOCALHOST_ONLY") == "1"
    )
