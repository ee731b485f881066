"""Homes as who means harm writes them: any content, with every checksum right."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cartier.home.store import MANIFEST, blob_file, digest_of


def write_signed(folder: Path, about: Mapping[str, Any], blobs: Mapping[str, bytes]) -> None:
    """Write a home without the care of ``Store.put``: NaN, halves of characters and anything else stay in it."""
    digests = {name: digest_of(data) for name, data in blobs.items()}
    whole = {key: value for key, value in about.items() if key != "sha256"} | {"blobs": digests}
    whole["sha256"] = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
    for name, data in blobs.items():
        file = folder / blob_file(name, digests[name])
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    (folder / MANIFEST).write_text(json.dumps(whole))
