"""Publishing of a fleet's homes: blobs first, the manifest as the commit, then the catalog and the home's name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from cartier.blob_stores import Blob, BlobStore
from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.home.repository import publish as publish_home
from cartier.home.repository import pull as pull_home
from cartier.home.repository import read
from cartier.home.store import MANIFEST, PublishedStore
from cartier.io.atomic import check_ours
from cartier.io.files import json_bytes, parse_json, typed
from cartier_fleet.catalog_rows import chunk_of
from cartier_fleet.jobs import Job, MapSettings, Task

NEW = "catalog/new/"


@dataclass(frozen=True)
class Pointer:
    """The latest version of a home: ``sequence`` counts them. What it was mapped from is known by ``signature``."""

    key: str
    sequence: int
    signature: str
    settings: str


def home_store(store: BlobStore, key: str) -> PublishedStore:
    """Where the home of a job is, or will be."""
    return PublishedStore(store, f"homes/{key}/")


def published(store: BlobStore, key: str) -> Home | None:
    """The home of a job whose worker died after the commit."""
    return None if store.get(f"homes/{key}/{MANIFEST}") is None else read(home_store(store, key), Home)


def is_current(store: BlobStore, name: str, seen: str, settings: MapSettings) -> bool:
    """Whether a home is mapped from files of this signature by these settings, and entered everywhere."""
    pointer = _pointer(store.get(_at(name)))
    same = pointer is not None and (pointer.signature, pointer.settings) == (seen, settings.digest)
    return same and pointer is not None and store.get(f"jobs/{pointer.key}/done.json") is not None


def publish(
    store: BlobStore, job: Job, task: Task, home: Home, seen: str, settings: MapSettings, cost: Mapping[str, float]
) -> None:
    """Publish a home, unless it is published already, and enter it.

    Done twice, by whomever, it has the effect of once. Raises InputError if the store fails.
    """
    if store.get(f"homes/{job.key}/{MANIFEST}") is None:
        publish_home(home, home_store(store, job.key))
    while not job.finished:
        held = store.get(_at(task.name))
        before = _pointer(held)
        ours = before is not None and before.key == job.key
        sequence = 1 if before is None else before.sequence + (not ours)
        store.put(f"{NEW}{job.key}-{sequence}.parquet", chunk_of(home, task.name, job.key, sequence, cost))
        pointer = json_bytes(asdict(Pointer(job.key, sequence, seen, settings.digest)))
        if store.create(_at(task.name), pointer) if held is None else store.swap(_at(task.name), pointer, held.version):
            job.finish({"home": f"homes/{job.key}", **cost})


def key_of(store: BlobStore, name: str) -> str:
    """The latest version of a home by its name, or the version itself. Raises InputError for an unknown one."""
    if version := latest(store, name):
        return version
    if store.get(f"homes/{name}/{MANIFEST}") is not None:
        return name
    raise InputError(f"{store.place} has no home called {brief(name, 60)}: 'cartier fleet status' counts them")


def latest(store: BlobStore, name: str) -> str:
    """The latest version of a home by its name; "" where there is none."""
    pointer = _pointer(store.get(_at(name)))
    return "" if pointer is None else pointer.key


def names_in(store: BlobStore) -> list[str]:
    """The names of all homes."""
    return [key.removeprefix("names/").removesuffix(".json") for key in store.list("names/")]


def pull(store: BlobStore, name: str, folder: Path) -> Home:
    """Write a home to a folder: verified, and switched atomically; what people corrected there stays.

    Raises InputError for an unknown or damaged home, or a folder that is not a home's.
    """
    check_ours(folder, MANIFEST)
    return pull_home(home_store(store, key_of(store, name)), folder, Home)


def _at(name: str) -> str:
    return f"names/{name}.json"


def _pointer(held: Blob | None) -> Pointer | None:
    if held is None:
        return None
    try:
        pointer: Pointer = typed(parse_json(held.data, "a name"), Pointer)
        return pointer
    except (TypeError, ValueError) as error:
        raise InputError(f"the name of a home in the store is damaged ({brief(error)}): map it again") from error
