"""Blob stores: a folder or object storage (S3, GCS, Azure, HTTP) behind the same few verbs."""

from __future__ import annotations

from cartier.blob_stores.contract import Blob, BlobStore, StoreError
from cartier.blob_stores.folder import FolderBlobs
from cartier.errors import InputError, brief

__all__ = ["Blob", "BlobStore", "FolderBlobs", "StoreError", "open_store"]
BUCKETS = ("s3", "gs", "az", "http", "https")


def open_store(place: str) -> BlobStore:
    """The store at a place.

    Args:
        place: A folder, or ``s3://BUCKET/PREFIX``, ``gs://…``, ``az://…`` or ``https://…`` (which can only be read).
            Keys and endpoints come from the environment, as the vendor names them (AWS_ENDPOINT_URL …).

    Returns:
        The store. Nothing is asked or written yet.

    Raises:
        InputError: It is no such place.
        MissingExtra: Object storage needs the extra ``fleet``.
    """
    scheme, separator, _ = place.partition("://")
    if not separator:
        return FolderBlobs(place)
    if scheme not in BUCKETS:
        raise InputError(f"{brief(place)} is no store: give a folder, or {', '.join(f'{s}://…' for s in BUCKETS)}")
    from cartier.blob_stores.bucket import BucketBlobs, open_bucket

    return BucketBlobs(open_bucket(place), place)
