"""Contract of a blob store: get, put, create, swap and list, on which claims, commits and catalogs rest; and delete."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from cartier.errors import InputError, brief

MAX_BLOB_BYTES = 2**31
MAX_KEY_CHARS = 500
KEY = re.compile(r"[\w=-][\w.=-]*(?:/[\w=-][\w.=-]*)*", re.ASCII)


class StoreError(InputError):
    """The store cannot be read or written, whatever is asked of it."""


@dataclass(frozen=True)
class Blob:
    """The bytes under a key, and the version that ``swap`` compares.

    Args:
        data: The bytes.
        version: Another one after each change of the bytes.
    """

    data: bytes
    version: str


@runtime_checkable
class BlobStore(Protocol):
    """Named bytes in one place, which many processes on many machines may use at once.

    A key is read whole or not at all. Every verb may be repeated: a write whose reply was lost is sent again, and then
    finds its own bytes.

    Args:
        place: What ``open_store`` was given.
    """

    place: str

    def get(self, key: str) -> Blob | None:
        """What is under a key, or None. Raises StoreError if the store cannot be read."""

    def put(self, key: str, data: bytes) -> None:
        """Write bytes, whatever was there. Raises StoreError if the store cannot be written."""

    def create(self, key: str, data: bytes) -> bool:
        """Write bytes where nothing is. Whether they are there now: False if others are."""

    def swap(self, key: str, data: bytes, version: str) -> bool:
        """Write bytes over those of a version. Whether they are there now: False if the version is another one."""

    def list(self, prefix: str = "") -> list[str]:
        """All keys below a prefix that ends in "/", sorted."""

    def delete(self, key: str) -> None:
        """Remove a key, if it is there."""


def check_key(key: str) -> str:
    """The key, or an InputError for one that could lead out of the store or that some store cannot hold."""
    if len(key) > MAX_KEY_CHARS or not KEY.fullmatch(key):
        raise InputError(f"{brief(key, 60)!r} is no key of a store: names of letters, digits, _ = - and . between /")
    return key
