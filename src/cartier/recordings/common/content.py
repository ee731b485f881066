"""What all readers do with files: what lies in a folder, that it lies there, and the content's hash."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath

from cartier.errors import InputError
from cartier.io.files import check_file

READERS = 4  # threads that may ask a reader of files for frames at once: each opens files of its own


def names_in(folder: Path) -> set[str]:
    """The names in a folder, or an InputError."""
    try:
        return {entry.name for entry in folder.iterdir()}
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror})") from error


def check_inside(root: Path, names: Collection[str]) -> None:
    """Raises InputError if a file of a recording, or a folder on the way to it, is a link that leads out of its folder.

    Who maps a stranger's recording and passes the map on would pass on what such links lead to.
    """
    home = Path(os.path.realpath(root))  # unlike resolve, it takes links that run in a circle
    parts = set(names)
    parts |= {
        parent.as_posix() for folder in {name.rpartition("/")[0] for name in parts} for parent in _to_root(folder)
    }
    for path in (root / part for part in parts):
        if path.is_symlink() and not Path(os.path.realpath(path)).is_relative_to(home):
            raise InputError(
                f"{path} is a link that leads out of the recording's folder: put the file itself there, not a link to it"
            )


def _to_root(folder: str) -> list[PurePosixPath]:
    """A folder and those above it, without the root."""
    path = PurePosixPath(folder)
    return [part for part in (path, *path.parents) if part.parts]


def content_hash(settings: str, root: Path, names: Iterable[str]) -> str:
    """sha256 (hex) over the reader's settings and each file's name below ``root``, size and bytes, read in pieces."""
    total = hashlib.sha256(settings.encode())
    for name in names:
        path = root / name
        check_file(path)
        try:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256")
                total.update(f"\0{name}\0{file.tell()}\0".encode() + content.digest())
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror})") from error
    return total.hexdigest()
