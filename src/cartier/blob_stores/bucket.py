"""Object storage as a blob store: S3, GCS, Azure and read-only HTTP, by obstore."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from typing import TYPE_CHECKING, Any, TypeVar

from cartier.blob_stores.contract import MAX_BLOB_BYTES, Blob, StoreError, check_key
from cartier.errors import InputError, MissingExtra, brief
from cartier.plugins import install

if TYPE_CHECKING:
    from obstore.store import ObjectStore

T = TypeVar("T")
TRIES = 8
FIRST_WAIT_S = 0.1  # doubled after each try: 12 s in all
LISTED_AT_ONCE = 1000  # what S3 gives in one reply


def open_bucket(url: str) -> ObjectStore:
    """The bucket at a URL. Raises InputError or MissingExtra."""
    try:
        from obstore.store import from_url
    except ModuleNotFoundError as error:
        raise MissingExtra(f"{brief(url)} needs the package 'obstore': {install('fleet', 'obstore')}") from error
    once = {"max_retries": 0, "retry_timeout": timedelta(seconds=30)}  # ``BucketBlobs`` repeats, and knows its bytes
    try:
        return from_url(url, retry_config=once)
    except Exception as error:  # obstore's and Python's share no base class
        raise InputError(f"{brief(url)} is no store that can be opened ({brief(error)})") from error


class BucketBlobs:
    """Blobs in a bucket. A call that fails is repeated; a write that may have arrived is looked for."""

    def __init__(self, bucket: Any, place: str) -> None:
        self.place, self._bucket = place, bucket

    def get(self, key: str) -> Blob | None:
        import obstore
        from obstore.exceptions import NotFoundError

        def once() -> Blob | None:
            try:
                found = obstore.get(self._bucket, check_key(key))
            except (NotFoundError, FileNotFoundError):
                return None
            if found.meta["size"] > MAX_BLOB_BYTES:
                raise InputError(f"{self.place}/{key} is larger than {MAX_BLOB_BYTES} bytes")
            return Blob(bytes(found.bytes()), str(found.meta["e_tag"]))

        return self._repeated(key, once)

    def put(self, key: str, data: bytes) -> None:
        import obstore

        self._repeated(key, lambda: obstore.put(self._bucket, check_key(key), data))

    def create(self, key: str, data: bytes) -> bool:
        return self._conditional(key, data, "create")

    def swap(self, key: str, data: bytes, version: str) -> bool:
        return self._conditional(key, data, {"e_tag": version})

    def list(self, prefix: str = "") -> list[str]:
        import obstore

        def once() -> list[str]:
            under = check_key(prefix.rstrip("/")) if prefix else None
            found = obstore.list(self._bucket, under, chunk_size=LISTED_AT_ONCE)
            return sorted(row["path"] for rows in found for row in rows)

        return self._repeated(prefix, once)

    def listing(self) -> tuple[tuple[str, int, str], ...]:
        """All keys with their sizes and versions, sorted. Raises StoreError."""
        import obstore

        def once() -> tuple[tuple[str, int, str], ...]:
            pages = obstore.list(self._bucket, chunk_size=LISTED_AT_ONCE)
            return tuple(sorted((row["path"], row["size"], str(row["e_tag"])) for page in pages for row in page))

        return self._repeated("", once)

    def delete(self, key: str) -> None:
        import obstore
        from obstore.exceptions import NotFoundError

        def once() -> None:
            with suppress(NotFoundError, FileNotFoundError):
                obstore.delete(self._bucket, check_key(key))

        self._repeated(key, once)

    def _conditional(self, key: str, data: bytes, mode: Any) -> bool:
        import obstore
        from obstore.exceptions import AlreadyExistsError, NotFoundError, PreconditionError

        def once() -> bool:
            try:
                obstore.put(self._bucket, check_key(key), data, mode=mode, use_multipart=False)
                return True
            except (AlreadyExistsError, PreconditionError, NotFoundError, FileNotFoundError):
                held = self.get(key)  # a try before this one may have arrived, though its reply did not
                return held is not None and held.data == data

        return self._repeated(key, once)

    def _repeated(self, key: str, call: Callable[[], T]) -> T:
        """The result of a call that is repeated while the store fails. Raises StoreError in the end."""
        from obstore.exceptions import BaseError, NotSupportedError, PermissionDeniedError, UnauthenticatedError

        for number in range(TRIES):
            try:
                return call()
            except (BaseError, OSError, NotImplementedError) as error:
                final = (NotSupportedError, PermissionDeniedError, UnauthenticatedError, NotImplementedError)
                if number + 1 == TRIES or isinstance(error, final):
                    raise StoreError(f"{self.place}/{key}: the store failed ({brief(error)})") from error
            time.sleep(FIRST_WAIT_S * 2**number * random.uniform(0.5, 1.0))
        raise AssertionError("not reached")
