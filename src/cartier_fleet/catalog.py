"""Catalog of a fleet: Parquet of homes, rooms and objects, one chunk a home as it is mapped, and compacted snapshots.

    catalog/new/KEY-N.parquet               one home, as its job entered it (``catalog_rows``); N counts its versions
    catalog/000007-…/objects.parquet        a snapshot, with rooms.parquet and homes.parquet
    catalog/HEAD.json                       which snapshot holds; swapped

A reader takes the snapshot and the chunks that are newer; of each home the latest version counts, once.
"""

from __future__ import annotations

import io
import secrets
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

from cartier.blob_stores import Blob, BlobStore
from cartier.errors import InputError, brief
from cartier.io.files import json_bytes, parse_json, typed
from cartier_fleet.catalog_rows import TABLES, arrow, schemas
from cartier_fleet.publishing import NEW

HEAD = "catalog/HEAD.json"
READERS = 16  # keys fetched at once
MAX_ATTEMPTS = 8  # to read or compact while others compact
MAY_LACK = {"floor_seen", "room", "room_name", "room_kind", "on_object", "on_relation"}


@dataclass(frozen=True)
class Most:
    """What a Parquet file may unpack to: values of a column, bytes as stored, and bytes that texts may take."""

    values: int
    bytes: int
    texts: int


ENTRY, SNAPSHOT = Most(200_000, 2**26, 2**31), Most(2**26, 2**31, 2**50)
Tables = Mapping[str, Any]
"""A pyarrow.Table for each of ``TABLES``."""


@dataclass(frozen=True)
class Head:
    """The snapshot that holds: its number and its folder ("" for none)."""

    number: int = 0
    folder: str = ""


class _Gone(Exception):
    """A file was deleted since its name was read: somebody compacted."""


def version_of(store: BlobStore) -> tuple[str, tuple[str, ...]]:
    """What ``read_catalog`` would read now: another value after each change."""
    head = store.get(HEAD)
    return "" if head is None else head.version, tuple(store.list(NEW))


def read_catalog(store: BlobStore, names: Sequence[str] = TABLES, held: dict[str, Tables] | None = None) -> Tables:
    """The rows of the latest version of every home, in the tables of these names; "homes" must be among them.

    ``held`` keeps the chunks, which never change, for whoever reads again. Raises InputError if the catalog is damaged.
    """
    for _ in range(MAX_ATTEMPTS):
        try:
            return _read(store, _head(store.get(HEAD)), store.list(NEW), names, {} if held is None else held)
        except _Gone:
            continue
    raise InputError(f"{store.place}: the catalog changes faster than it can be read: try again")


def compact(store: BlobStore) -> dict[str, int]:
    """Make one snapshot of the last one and all newer chunks, and delete what it replaces.

    Killed at any point, or run by several at once, nothing is lost: what a snapshot holds is deleted after it holds.

    Returns:
        ``compacted`` chunks, and the ``homes``, ``rooms`` and ``objects`` of the snapshot.

    Raises:
        InputError: The catalog is damaged, or others compact all the time.
    """
    for _ in range(MAX_ATTEMPTS):
        held, chunks = store.get(HEAD), store.list(NEW)
        before = _head(held)
        try:
            tables = _read(store, before, chunks, TABLES, {})
        except _Gone:
            continue
        if not chunks or _put_snapshot(store, held, before, tables):
            after = _head(store.get(HEAD))
            _sweep(store, after, chunks)
            return {"compacted": len(chunks)} | {name: tables[name].num_rows for name in TABLES}
    raise InputError(f"{store.place}: others compact the catalog at the same time: try again")


def _put_snapshot(store: BlobStore, held: Blob | None, before: Head, tables: Tables) -> bool:
    """Write a snapshot and make it the one that holds; False if another one was faster."""
    import pyarrow.parquet as pq

    head = Head(before.number + 1, f"catalog/{before.number + 1:06d}-{secrets.token_hex(4)}")
    for name in TABLES:
        buffer = io.BytesIO()
        pq.write_table(tables[name], buffer, compression="zstd")
        store.put(f"{head.folder}/{name}.parquet", buffer.getvalue())
    data = json_bytes(asdict(head))
    return store.create(HEAD, data) if held is None else store.swap(HEAD, data, held.version)


def _sweep(store: BlobStore, head: Head, chunks: list[str]) -> None:
    """Delete chunks that are in the snapshot, and snapshots of smaller numbers, which nobody will make hold."""
    for key in chunks:
        store.delete(key)
    for key in store.list("catalog/"):
        number = key.split("/")[1].split("-")[0]
        if number.isascii() and number.isdigit() and int(number[:18]) < head.number:
            store.delete(key)


def _read(
    store: BlobStore, head: Head, chunks: list[str], names: Sequence[str], held: dict[str, Tables]
) -> Tables:  # fmt: skip
    pa = arrow()
    snapshot = {name: schemas()[name].empty_table() for name in names}
    for key in held.keys() - set(chunks):
        del held[key]
    fresh = [key for key in chunks if key not in held]
    with ThreadPoolExecutor(READERS) as pool:
        if head.folder:
            read = pool.map(lambda name: _table(store, f"{head.folder}/{name}.parquet", name), names)
            snapshot = dict(zip(names, read, strict=True))
        held |= zip(fresh, pool.map(lambda key: _chunk(store, key), fresh), strict=True)
    new = [held[key] for key in chunks]
    rows = zip(*(snapshot["homes"][column].to_pylist() for column in ("home", "sequence", "version")), strict=True)
    latest: dict[str, tuple[int, str, int]] = {home: (number, version, -1) for home, number, version in rows}
    for place, tables in enumerate(new):
        home, number, version = (tables["homes"][name][0].as_py() for name in ("home", "sequence", "version"))
        latest[home] = max((number, version, place), latest.get(home, (0, "", -1)))
    kept = pa.array([version for _, version, place in latest.values() if place < 0], pa.string())
    chosen = [new[place] for _, _, place in latest.values() if place >= 0]
    return {
        name: pa.concat_tables([_only(snapshot[name], kept), *(tables[name] for tables in chosen)]) for name in names
    }


def _only(table: Any, versions: Any) -> Any:
    import pyarrow.compute as pc

    return table.filter(pc.is_in(table["version"], versions))


def _table(store: BlobStore, key: str, name: str) -> Any:
    """A table of a snapshot, with the columns of this cartier."""
    table = _parquet(store, key, SNAPSHOT)
    try:
        return _whole(table.select(schemas()[name].names).cast(schemas()[name]))
    except (KeyError, ValueError) as error:
        raise InputError(f"{store.place}/{key} is no table of cartier's ({brief(error)})") from error


def _chunk(store: BlobStore, key: str) -> Tables:
    """The tables of one home."""
    pa = arrow()
    nested, kinds = _parquet(store, key, ENTRY), schemas()
    try:
        if nested.num_rows != 1:
            raise ValueError(f"{nested.num_rows} rows")
        found = {"homes": nested["homes"].combine_chunks()}
        found |= {name: nested[name].combine_chunks().flatten() for name in ("rooms", "objects")}
        return {
            name: _whole(pa.Table.from_struct_array(found[name]).select(kinds[name].names).cast(kinds[name]))
            for name in TABLES
        }
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{store.place}/{key} is no entry of the catalog ({brief(error)}): delete it") from error


def _whole(table: Any) -> Any:
    """The table. Raises ValueError if a value is missing where one belongs, also within lists."""
    import pyarrow.types as kinds

    for name in table.column_names:
        parts = [] if name in MAY_LACK else [table[name].combine_chunks()]
        while parts:
            part = parts.pop()
            if part.null_count:
                raise ValueError(f"{name} lacks a value")
            if kinds.is_list(part.type) or kinds.is_struct(part.type):
                inner = part.flatten()
                parts += inner if isinstance(inner, list) else [inner]
    return table


def _parquet(store: BlobStore, key: str, most: Most) -> Any:
    """A table of a file. Its metadata is looked at first: a small file may unpack to gigabytes."""
    import pyarrow.parquet as pq

    held = store.get(key)
    if held is None:
        raise _Gone
    try:
        file = pq.ParquetFile(io.BytesIO(held.data))
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        columns = [group.column(k) for group in groups for k in range(group.num_columns)]
        values = max((column.num_values for column in columns), default=0)
        unpacked = [column.total_uncompressed_size for column in columns]
        texts = sum(
            column.num_values * column.total_uncompressed_size  # each value may be the longest of its dictionary
            for column in columns
            if column.physical_type == "BYTE_ARRAY"
        )
        if values > most.values or sum(unpacked) > most.bytes or texts > most.texts:
            raise InputError(f"{store.place}/{key} unpacks to more than a catalog should ever hold: delete it")
        return file.read()
    except (OSError, ValueError) as error:
        raise InputError(f"{store.place}/{key} is damaged ({brief(error)})") from error


def _head(held: Blob | None) -> Head:
    if held is None:
        return Head()
    try:
        head: Head = typed(parse_json(held.data, HEAD), Head)
        return head
    except (TypeError, ValueError) as error:
        raise InputError(f"{HEAD} is damaged ({brief(error)})") from error
