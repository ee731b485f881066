"""Model weights that ship inside the package, and how they are run."""

from __future__ import annotations

import hashlib
from pathlib import Path

from cartier.errors import InputError


def read_shipped(path: Path, sha256: str) -> bytes:
    """The content of a file of weights. Raises InputError if it is missing or not the one that was shipped."""
    if not path.is_file():
        raise InputError(f"{path} is missing: install cartier again")
    data = path.read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise InputError(f"{path} was changed: its sha256 is {found[:12]}…, not {sha256[:12]}…; install cartier again")
    return data
