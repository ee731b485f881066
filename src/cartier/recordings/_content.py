"""What all readers do with files: bounded text, the content's hash, and the check of a frame's number."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from cartier.errors import InputError


def read_text(path: Path, max_bytes: int) -> str:
    """The UTF-8 text of a file no larger than ``max_bytes``."""
    try:
        if path.stat().st_size > max_bytes:
            raise InputError(f"{path} is larger than {max_bytes} bytes, which is more than it should ever hold")
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not text") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error


def names_in(folder: Path) -> set[str]:
    """The names in a folder, or an InputError."""
    try:
        return {entry.name for entry in folder.iterdir()}
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror})") from error


def content_hash(settings: str, root: Path, names: Iterable[str]) -> str:
    """sha256 (hex) over the reader's settings and each file's name below ``root``, size and bytes, read in pieces."""
    total = hashlib.sha256(settings.encode())
    for name in names:
        path = root / name
        try:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256")
                total.update(f"\0{name}\0{file.tell()}\0".encode() + content.digest())
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror})") from error
    return total.hexdigest()
