"""Repository of homes: what is saved of a home, in which blobs, and how it is read back."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cartier import plugins
from cartier.blob_stores import open_store
from cartier.contracts import SpatialIndex
from cartier.errors import InputError
from cartier.home import compaction, correction_log
from cartier.home.corrected import Corrected, apply
from cartier.home.data import HomeData, origin_of
from cartier.home.map_server import grid_from, pgm, yaml
from cartier.home.old_names import OLD_OBJECTS
from cartier.home.photos import check_photo
from cartier.home.schema import Manifest, floor_kinds_from, manifest_from, objects_from, printed, rooms_from
from cartier.home.store import NAV2, PublishedStore, Store, blob_file, digest_of
from cartier.io.files import json_bytes, npz_bytes, parse_json, read_npz
from cartier.types import Camera, MapObject, OccupancyGrid, Room

Key = TypeVar("Key", int, str)
AnyHome = TypeVar("AnyHome", bound=HomeData)
SCHEMA = 2

"""Fields of an object that cartier 0.1.0 wrote under another name."""
MAX_ATTEMPTS = 5  # to read a home while other processes replace it
GROWTH, PHOTOS, INDEXES = "growth/", "photos/", "indexes/"
"""How the names of blobs begin: the state that growing needs, JPEGs by frame, the states of the indices."""


def save(home: HomeData, folder: str | Path) -> None:
    """Write a home; see ``Home.save``."""
    about, blobs, files = _parts(home)
    known = home.corrected
    if known and known.log and not (Path(folder) / correction_log.LOG).exists():
        files[correction_log.LOG] = "".join(f"{correction_log.line_of(entry)}\n" for entry in known.log).encode()
    Store(folder).put(about, blobs, files)


def publish(home: HomeData, store: PublishedStore) -> None:
    """Write a home that was just mapped to where it stays. Raises InputError if it cannot be written."""
    store.publish(*_parts(home))


def _parts(home: HomeData) -> tuple[dict[str, Any], dict[str, bytes], dict[str, bytes]]:
    """What is kept of a home: its manifest, its blobs, and files for other programs."""
    grid, known = home.grid, home.corrected
    objects, rooms = (home.objects, home.rooms) if known is None else (known.mapped_objects, known.mapped_rooms)
    blobs = {"objects.json": json_bytes([asdict(obj) for obj in objects])}
    for name, index in home.indexes.items():
        blobs |= {f"{INDEXES}{name}/{part}": data for part, data in index.state().items()}
    blobs |= {f"{GROWTH}{part}": data for part, data in home.growth.items()}
    blobs |= {f"{PHOTOS}{frame:06d}.jpg": jpeg for frame, jpeg in home.photos.items()}
    files = dict[str, bytes]()
    if grid is not None:
        room_of_cell = np.full(grid.cells.shape, -1, np.int16)
        for number, room in enumerate(home.rooms):
            room_of_cell[tuple(room.cells.T)] = number
        floors = {} if grid.floor_kinds is None else {"floor_kinds": grid.floor_kinds}
        arrays = npz_bytes(height_m=grid.height_m, rooms=room_of_cell, **floors)
        blobs |= {"occupancy.pgm": pgm(grid), "occupancy.npz": arrays}
        files |= _for_nav2(grid, blobs)
    return _manifest(home, rooms), blobs, files


def _for_nav2(grid: OccupancyGrid, blobs: Mapping[str, bytes]) -> dict[str, bytes]:
    """The floor plan's description for Nav2, which wants a name that stays."""
    return {NAV2: yaml(grid, blob_file("occupancy.pgm", digest_of(blobs["occupancy.pgm"])))}


def _manifest(home: HomeData, rooms: tuple[Room, ...]) -> dict[str, Any]:
    camera, grid = home.camera, home.grid
    return {
        "schema": SCHEMA,
        "id": home.id,
        "name": home.mapped_name,
        "detector": home.detector,
        "camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
        "indexes": list(home.indexes),
        "grid": None if grid is None else {"resolution_m": grid.resolution_m, "origin_xy": list(grid.origin_xy)},
        "rooms": [[room.id, room.name, room.kind] for room in rooms],
        "start_xy": list(home.start_xy),
        "settings": dict(home.settings),
        "notes": list(home.notes),
    }


def load(place: str | Path, kind: type[AnyHome]) -> AnyHome:
    """Read a saved home as a ``kind``; see ``Home.load``."""
    published = isinstance(place, str) and "://" in place
    return read(PublishedStore(open_store(str(place))) if published else Store(place), kind)


def pull(store: PublishedStore, folder: Path, kind: type[AnyHome]) -> AnyHome:
    """Write a published home to a folder, atomically, once all of it was read and is sound. Raises InputError."""
    home, about = read(store, kind), store.manifest()
    blobs = {name: store.get(name, about) for name in about["blobs"]}
    rest = {key: value for key, value in about.items() if key not in ("blobs", "sha256")}
    Store(folder).put(rest, blobs, {} if home.grid is None else _for_nav2(home.grid, blobs))
    return home


def read(store: Store, kind: type[AnyHome]) -> AnyHome:
    """The home in a store, while others may replace it. Raises InputError."""
    unchanged = 0
    for attempt in range(MAX_ATTEMPTS):
        about = store.manifest()
        try:
            return _read(store, about, kind)
        except InputError:  # a blob is missing: was the home replaced after its manifest was read, perhaps twice?
            unchanged += store.manifest().get("sha256") == about.get("sha256")
            if attempt + 1 == MAX_ATTEMPTS or unchanged == 2:
                raise
    raise AssertionError("not reached")


def _read(store: Store, about: Mapping[str, Any], kind: type[AnyHome]) -> AnyHome:
    place, schema = store.place, about.get("schema")
    if schema != SCHEMA:
        newer = isinstance(schema, int) and schema > SCHEMA
        mend = "upgrade cartier" if newer else f"map its recording again: cartier map RECORDING -o {place}"
        raise InputError(
            f"{place} was made by {'a newer' if newer else 'an older'} cartier (schema {str(schema)[:20]}, "
            f"this one reads {SCHEMA}): {mend}"
        )
    try:
        made = manifest_from(about)
        grid, rooms = _floor(store, about, made)
        rows = parse_json(store.get("objects.json", about), "objects.json")
        objects = objects_from([_renamed(row) for row in rows], rooms)
        corrected = _corrected(store, objects, rooms, grid, made.name, made.settings)
        indexes = {name: _index(store, about, name) for name in made.indexes}
        for index in indexes.values():
            index.set_objects(corrected.objects)
        return kind(
            name=corrected.name,
            detector=made.detector,
            camera=Camera(*made.camera),
            objects=corrected.objects,
            indexes=indexes,
            grid=grid,
            start_xy=made.start_xy,
            settings=printed(made.settings),
            rooms=corrected.rooms,
            photos=_Photos(store, about, PHOTOS, lambda name: int(name.partition(".")[0])),
            notes=made.notes,
            growth=_Blobs(store, about, GROWTH, str),
            store=store,
            corrected=corrected,
        )
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, RecursionError, InputError) as error:
        told = str(error) if place in str(error) else f"{place} is damaged ({type(error).__name__}: {error})"
        raise InputError(told.replace("\n", " ")[:300]) from error


def again(home: AnyHome) -> AnyHome:
    """A home that was loaded, with its log as it is now; all of it is read again only if it was replaced meanwhile."""
    store, known = home.store, home.corrected
    assert store is not None and known is not None  # it was loaded
    if not store.is_as_read():
        return read(store, type(home))
    corrected = _corrected(
        store, known.mapped_objects, known.mapped_rooms, home.grid, known.mapped_name, home.settings
    )  # fmt: skip
    indexes = copy.deepcopy(dict(home.indexes))
    for index in indexes.values():
        index.set_objects(corrected.objects)
    return replace(
        home, name=corrected.name, objects=corrected.objects, rooms=corrected.rooms, indexes=indexes,
        corrected=corrected,
    )  # fmt: skip


def _corrected(
    store: Store,
    objects: tuple[MapObject, ...],
    rooms: tuple[Room, ...],
    grid: OccupancyGrid | None,
    name: str,
    settings: Mapping[str, Any],
) -> Corrected:
    """What frames showed, with the log of a saved home applied."""
    log = compaction.read(store)
    corrected = apply(log.entries, objects, rooms, grid, name, origin_of(settings))
    return replace(corrected, notes=(*log.notes, *corrected.notes))


class _Blobs(Mapping[Key, bytes]):
    """The blobs of a saved home whose names begin with ``begin``, read on access."""

    def __init__(self, store: Store, about: Mapping[str, Any], begin: str, key: Callable[[str], Key]) -> None:
        self._store, self._about = store, about
        self._names: dict[Key, str] = {
            key(name[len(begin) :]): name for name in about["blobs"] if name.startswith(begin)
        }

    def __getitem__(self, key: Key) -> bytes:
        return self._store.get(self._names[key], self._about)

    def __iter__(self) -> Iterator[Key]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class _Photos(_Blobs[int]):
    """The photographs of a saved home by frame."""

    def __getitem__(self, key: int) -> bytes:
        return check_photo(super().__getitem__(key), f"{self._store.place}: its photo of frame {key}")


def _renamed(row: Any) -> Any:
    """A row of objects.json with today's field names."""
    return {OLD_OBJECTS.get(name, name): value for name, value in row.items()} if isinstance(row, dict) else row


def _floor(store: Store, about: Mapping[str, Any], made: Manifest) -> tuple[OccupancyGrid | None, tuple[Room, ...]]:
    if made.grid is None:
        return None, ()
    arrays = read_npz(store.get("occupancy.npz", about), where="occupancy.npz")
    image = store.get("occupancy.pgm", about)
    grid = grid_from(image, made.grid.resolution_m, made.grid.origin_xy, arrays["height_m"])
    if "floor_kinds" in arrays:  # homes that were mapped before have none
        grid = replace(grid, floor_kinds=floor_kinds_from(arrays["floor_kinds"], grid))
    return grid, rooms_from(made.rooms, arrays["rooms"], grid)


def _index(store: Store, about: Mapping[str, Any], name: str) -> SpatialIndex:
    if name not in [b.name for b in plugins.backends("indexes")]:
        raise InputError(f"{store.place} names an index {str(name)[:60]!r} that is not installed")
    index = plugins.make("indexes", name)
    index.restore(dict(_Blobs(store, about, f"{INDEXES}{name}/", str)))
    return index
