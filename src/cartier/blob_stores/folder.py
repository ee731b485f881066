"""Folder as a blob store: one file a key, made whole under another name and then linked or renamed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cartier.blob_stores.contract import MAX_BLOB_BYTES, Blob, StoreError, check_key
from cartier.errors import InputError
from cartier.io.atomic import create_file, locked, write_file
from cartier.io.files import read_bytes

WAIT_S = 60.0  # for a lock that is held for one small write


class FolderBlobs:
    """Blobs as files below a folder, which may be shared over a network where links and locks work."""

    def __init__(self, place: str | Path) -> None:
        self.place, self._root = str(place), Path(place)

    def get(self, key: str) -> Blob | None:
        file = self._file(key)
        try:
            data = read_bytes(file, MAX_BLOB_BYTES, follow_link=False)
        except InputError:
            if file.exists():
                raise
            return None
        return Blob(data, _version(data))

    def put(self, key: str, data: bytes) -> None:
        file = self._file(key)
        with _told():
            write_file(file, data)

    def create(self, key: str, data: bytes) -> bool:
        file = self._file(key)
        with _told():
            return create_file(file, data) or self._holds(key, data)

    def swap(self, key: str, data: bytes, version: str) -> bool:
        file = self._file(key)
        with _told(), locked(file, wait_s=WAIT_S):
            held = self.get(key)
            if held is None or held.version != version:
                return held is not None and held.data == data
            write_file(file, data)
        return True

    def list(self, prefix: str = "") -> list[str]:
        root = self._root / check_key(prefix.rstrip("/")) if prefix else self._root
        files = (path for path in root.rglob("*") if not path.name.startswith(".") and path.is_file())
        return sorted(path.relative_to(self._root).as_posix() for path in files if not path.is_symlink())

    def delete(self, key: str) -> None:
        with suppress(FileNotFoundError):
            self._file(key).unlink()

    def _file(self, key: str) -> Path:
        return self._root / check_key(key)

    def _holds(self, key: str, data: bytes) -> bool:
        held = self.get(key)
        return held is not None and held.data == data


@contextmanager
def _told() -> Iterator[None]:
    """Faults of the disk as those of the store."""
    try:
        yield
    except InputError as error:
        raise StoreError(str(error)) from error


def _version(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
