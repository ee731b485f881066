"""Whether the model hub can be reached at all: without a network its library tries each file for half a minute."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit
from urllib.request import getproxies

FETCH = "fetch it where there is a network (hf download NAME --local-dir FOLDER) and name that folder"


def offline() -> bool:
    """Whether the hub is switched off, or its host has no address here and no proxy would know one."""
    from huggingface_hub import constants

    if constants.HF_HUB_OFFLINE:
        return True
    if getproxies():
        return False
    try:
        socket.getaddrinfo(urlsplit(constants.ENDPOINT).hostname, 443)
    except OSError:
        return True
    return False
