"""Way to a server: straight to one on this machine or in its own network, to others by the proxy of the environment."""

from __future__ import annotations

import ipaddress
import os
import socket
from dataclasses import dataclass
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

OWN_NAMES = (".localhost", ".local", ".internal", ".intranet", ".lan", ".home", ".home.arpa", ".private")
"""Ends of names that no public server has."""


@dataclass(frozen=True)
class Proxy:
    """A proxy that the environment names: its URL, the same without credentials, and the variable that names it."""

    url: str
    shown: str
    variable: str

    def __str__(self) -> str:
        return f"the proxy {self.shown} ({self.variable})"


def proxy_to(url: str) -> Proxy | None:
    """The proxy on the way to a server's URL; None if requests go straight to it."""
    parts = urlsplit(url)
    if is_own(parts.hostname or "") or proxy_bypass(parts.netloc.rpartition("@")[2]):
        return None
    named, kind = getproxies(), parts.scheme if parts.scheme in getproxies() else "all"
    if not (proxy := named.get(kind, "").strip()):
        return None
    scheme, mark, rest = proxy.rpartition("://")
    spelt = (f"{kind}_proxy", f"{kind}_PROXY".upper())
    variable = next((name for name in spelt if os.environ.get(name, "").strip() == proxy), "of this system")
    return Proxy(proxy if mark else f"http://{proxy}", f"{scheme or 'http'}://{rest.rpartition('@')[2]}", variable)


def is_own(host: str) -> bool:
    """Whether a name or an address is of this machine or of a network that is not the internet."""
    name = host.rstrip(".").lower()
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        try:
            address = ipaddress.IPv4Address(socket.inet_aton(name))  # 127.1, as resolvers read it
        except (OSError, ValueError):
            return "." not in name or name.endswith(OWN_NAMES)
    inner = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return not (inner or address).is_global
