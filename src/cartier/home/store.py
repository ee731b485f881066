"""Content-addressed store of a home: named blobs with checksums, and a manifest that is written last.

Blobs never change: each is a file with its digest in its name, and the manifest says which of them are the home.
Writing one file, the manifest, replaces the old home by the new one, so that readers need no lock and a killed writer
leaves either.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cartier.blob_stores import BlobStore
from cartier.errors import InputError
from cartier.io.atomic import PART, append_line, keep_newest, locked, replaced_folder, write_file, write_json
from cartier.io.files import MAX_JSON_BYTES, json_bytes, parse_json, read_bytes

MANIFEST, NAV2 = "home.json", "occupancy.yaml"
MAX_BYTES = 2**31
NAME = re.compile(r"[a-z0-9_]+(?:/[a-z0-9_]+)*\.[a-z0-9]+")
BLOB = re.compile(r".+-([0-9a-f]{12})\.[a-z0-9]+")


class Store:
    """The blobs of one home in a folder. ``get`` verifies checksums; ``put`` takes the lock of the home."""

    def __init__(self, folder: str | Path) -> None:
        self.folder, self.place = Path(folder), str(folder)
        self._read_at: Any = None
        self.log: object = None  # what ``compaction`` read of the log of corrections

    def manifest(self) -> dict[str, Any]:
        """The manifest. Raises InputError if the folder holds no home, or if the manifest is damaged."""
        file = f"{self.place}/{MANIFEST}"
        if not self._is_made():
            raise InputError(
                f"{self.place} is no mapped home (it holds no {MANIFEST}); "
                f"make one with: cartier map RECORDING -o {self.place}"
            )
        self._read_at = self._written()
        about = parse_json(self._read(MANIFEST, MAX_JSON_BYTES), file)
        if not isinstance(about, dict):
            raise InputError(f"{file} is damaged (no object): map the recording again")
        blobs = about.get("blobs", {})  # homes of older schemas have none
        sound = isinstance(blobs, dict) and all(
            NAME.fullmatch(name) and isinstance(digest, str) and re.fullmatch("[0-9a-f]{64}", digest)
            for name, digest in blobs.items()
        )
        if not sound or ("blobs" in about and about.get("sha256") != _digest(about)):
            raise InputError(f"{file} is damaged (it is not as it was written): map the recording again")
        return about

    def get(self, name: str, about: Mapping[str, Any]) -> bytes:
        """One blob of a manifest. Raises InputError if it is missing or damaged."""
        digest = about["blobs"].get(name)
        if digest is None:
            raise InputError(f"{self.place}/{MANIFEST} is damaged (it names no {name}): map the recording again")
        file = blob_file(name, digest)
        data = self._read(file, MAX_BYTES)
        if digest_of(data) != digest:
            raise InputError(
                f"{self.place}/{file} is damaged (its bytes are not those that were written): map the recording again"
            )
        return data

    def put(self, about: Mapping[str, Any], blobs: Mapping[str, bytes], files: Mapping[str, bytes]) -> None:
        """Replace the home atomically; other files in its folder stay. Raises InputError if it cannot be written.

        ``files`` are for other programs: they keep their names, are written after the manifest, and are never read
        back.
        """
        whole = _manifest(about, blobs)
        with locked(self.folder, wait_s=60.0):
            if (self.folder / MANIFEST).is_file():
                self._fill(self.folder, whole, blobs, files)
                self._sweep(whole)
            else:
                with replaced_folder(self.folder, MANIFEST) as new:
                    self._fill(new, whole, blobs, files)

    def check_appendable(self) -> None:
        """Raises InputError if nothing may be appended here."""

    def append(self, log: str, line: str, most_bytes: int | None = None) -> None:
        """Append a line to one of the home's logs, which mapping never replaces.

        Of a log that has then more than ``most_bytes``, the older half goes. Raises InputError if that fails.
        """
        append_line(self.folder / log, line)
        if most_bytes is not None:
            keep_newest(self.folder / log, most_bytes)

    def faults(self) -> list[str]:
        """What is damaged, one line each; empty for an intact home."""
        found = []
        try:
            about = self.manifest()
            for name in about.get("blobs", {}):
                try:
                    self.get(name, about)
                except InputError as error:
                    found.append(str(error))
        except InputError as error:
            found.append(str(error))
        return found

    def is_as_read(self) -> bool:
        """Whether the home was not replaced since ``manifest`` read it."""
        return self._read_at is not None and self._read_at == self._written()

    def _written(self) -> Any:
        """What changes whenever the home is replaced."""
        with suppress(OSError):
            about = (self.folder / MANIFEST).stat()
            return about.st_mtime_ns, about.st_size, about.st_ino
        return None

    def _is_made(self) -> bool:
        return (self.folder / MANIFEST).is_file()

    def _read(self, file: str, max_bytes: int) -> bytes:
        """A file of the home. Raises InputError."""
        return read_bytes(self.folder / file, max_bytes, follow_link=file == MANIFEST)

    def _fill(
        self, folder: Path, whole: dict[str, Any], blobs: Mapping[str, bytes], files: Mapping[str, bytes]
    ) -> None:
        for name, data in blobs.items():
            file = folder / blob_file(name, whole["blobs"][name])
            if not _holds(file, data):
                write_file(file, data)
        write_json(folder / MANIFEST, whole)
        for name, data in files.items():
            write_file(folder / name, data)

    def _sweep(self, whole: Mapping[str, Any]) -> None:
        """Delete blobs that are no longer part of the home, and no other file."""
        kept = {self.folder / blob_file(name, digest) for name, digest in whole["blobs"].items()}
        for file in [path for path in self.folder.rglob("*") if path.is_file() and not path.is_symlink()]:
            if file not in kept and (PART.fullmatch(file.name) or _is_blob(file)):
                with suppress(OSError):  # a leftover does no harm
                    file.unlink()


class PublishedStore(Store):
    """The blobs of one home below a prefix of a blob store, where a home is published once and never changed."""

    def __init__(self, blobs: BlobStore, prefix: str = "") -> None:
        super().__init__(f"{blobs.place}/{prefix}".rstrip("/"))
        self._blobs, self._prefix = blobs, prefix
        self.place = f"{blobs.place}/{prefix}".rstrip("/")

    def publish(self, about: Mapping[str, Any], blobs: Mapping[str, bytes], files: Mapping[str, bytes]) -> None:
        """Write a home as ``Store.put`` does; the manifest, which is the commit, comes last.

        A home that was published before stays. Raises InputError if it cannot be written.
        """
        whole = _manifest(about, blobs)
        for name, data in blobs.items():
            self._blobs.put(self._prefix + blob_file(name, whole["blobs"][name]), data)
        for name, data in files.items():
            self._blobs.put(self._prefix + name, data)
        self._blobs.create(self._prefix + MANIFEST, json_bytes(whole))

    def put(self, about: Mapping[str, Any], blobs: Mapping[str, bytes], files: Mapping[str, bytes]) -> None:
        raise InputError(f"{self.place} is published and stays as it is: save the home to a folder")

    def check_appendable(self) -> None:
        raise InputError(f"{self.place} is published and stays as it is: pull it to a folder, and correct it there")

    def append(self, log: str, line: str, most_bytes: int | None = None) -> None:
        self.check_appendable()

    def _is_made(self) -> bool:
        return self._blobs.get(self._prefix + MANIFEST) is not None

    def _read(self, file: str, max_bytes: int) -> bytes:
        held = self._blobs.get(self._prefix + file)
        if held is None or len(held.data) > max_bytes:
            raise InputError(f"{self.place}/{file} is {'missing' if held is None else 'too large'}")
        return held.data


def _manifest(about: Mapping[str, Any], blobs: Mapping[str, bytes]) -> dict[str, Any]:
    """A home's manifest with the digests of its blobs, and its own."""
    whole: dict[str, Any] = {**about, "blobs": {name: digest_of(data) for name, data in blobs.items()}}
    return whole | {"sha256": _digest(whole)}


def blob_file(name: str, digest: str) -> str:
    """The file of a blob: its name with the first digits of its digest."""
    stem, _, suffix = name.rpartition(".")
    return f"{stem}-{digest[:12]}.{suffix}"


def digest_of(data: bytes) -> str:
    """sha256 (hex)."""
    return hashlib.sha256(data).hexdigest()


def _digest(about: Mapping[str, Any]) -> str:
    """sha256 (hex) of a manifest without its own digest."""
    rest = {key: value for key, value in about.items() if key != "sha256"}
    return digest_of(json.dumps(rest, sort_keys=True).encode())


def _holds(file: Path, data: bytes) -> bool:
    try:
        return read_bytes(file, MAX_BYTES, follow_link=False) == data
    except InputError:
        return False


def _is_blob(file: Path) -> bool:
    """Whether the name ends in the digest of the content, which no other program's file does."""
    named = BLOB.fullmatch(file.name)
    return named is not None and digest_of(file.read_bytes())[:12] == named[1]
