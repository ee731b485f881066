"""Where a recording's files lie: in a folder, or on object storage, of which single files are fetched."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from cartier.blob_stores import BlobStore
from cartier.errors import InputError
from cartier.io.files import check_file, read_bytes
from cartier.recordings.common.files import content_hash, hash_of, link_notes, names_in

MAX_FILE_BYTES = 1 << 28  # of one image
FETCHERS = 8  # files asked for at once, where all of them are hashed


class Files(Protocol):
    """The files of one recording by their names below it, with "/" between."""

    def where(self, name: str) -> str:
        """How errors call a file."""

    def read(self, name: str, max_bytes: int) -> bytes:
        """The bytes of a file. Raises InputError if it is missing or larger."""

    def has(self, folder: str) -> bool:
        """Whether there is such a folder."""

    def names(self, folder: str) -> set[str]:
        """The names in a folder. Raises InputError if it cannot be read."""

    def notes(self, names: Sequence[str]) -> list[str]:
        """What to know of files; see ``link_notes``."""

    def fingerprint(self, settings: str, names: Sequence[str]) -> str:
        """What ``content_hash`` gives: the same for the same content in any place."""


class FolderFiles:
    """Files in a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def where(self, name: str) -> str:
        return str(self._root / name)

    def read(self, name: str, max_bytes: int) -> bytes:
        check_file(self._root / name)
        return read_bytes(self._root / name, max_bytes)

    def has(self, folder: str) -> bool:
        return (self._root / folder).is_dir()

    def names(self, folder: str) -> set[str]:
        return names_in(self._root / folder)

    def notes(self, names: Sequence[str]) -> list[str]:
        return link_notes(self._root, names)

    def fingerprint(self, settings: str, names: Sequence[str]) -> str:
        return content_hash(settings, self._root, names)


class BlobFiles:
    """Files in a store, each fetched when it is asked for; nothing is kept of them but their hashes."""

    def __init__(self, store: BlobStore) -> None:
        self._store, self._keys = store, store.list()
        self._hashes = dict[str, tuple[int, bytes]]()

    def where(self, name: str) -> str:
        return f"{self._store.place.rstrip('/')}/{name}"

    def read(self, name: str, max_bytes: int) -> bytes:
        held = self._store.get(name)
        if held is None:
            raise InputError(f"{self.where(name)} is missing")
        if len(held.data) > max_bytes:
            raise InputError(f"{self.where(name)} is larger than {max_bytes} bytes, more than it should ever hold")
        self._hashes[name] = (len(held.data), hashlib.sha256(held.data).digest())
        return held.data

    def has(self, folder: str) -> bool:
        return bool(self.names(folder))

    def names(self, folder: str) -> set[str]:
        above = f"{folder}/" if folder else ""
        return {key.removeprefix(above).split("/")[0] for key in self._keys if key.startswith(above)}

    def notes(self, names: Sequence[str]) -> list[str]:
        return []

    def fingerprint(self, settings: str, names: Sequence[str]) -> str:
        unread = [name for name in names if name not in self._hashes]
        with ThreadPoolExecutor(FETCHERS) as pool:
            for _ in pool.map(self._hash, unread):
                pass
        return hash_of(settings, ((name, *self._hashes[name]) for name in names))

    def _hash(self, name: str) -> None:
        self.read(name, MAX_FILE_BYTES)
