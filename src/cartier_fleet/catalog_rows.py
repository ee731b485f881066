"""Rows of a fleet's catalog: what is kept of each home, its rooms and its objects, and the Parquet of one home.

docs/fleet.md describes the columns. The Parquet of one home has one row, with its rooms and objects as nested lists, so
that it appears at once; compaction makes flat tables of many.
"""

from __future__ import annotations

import io
import time
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import cartier
from cartier.errors import MissingExtra
from cartier.home import Home
from cartier.plugins import install
from cartier.spatial.floor_seen import floor_seen
from cartier.spatial.relations import supports
from cartier.types import FREE, MapObject

if TYPE_CHECKING:
    import pyarrow as pa

TABLES = ("homes", "rooms", "objects")
DIGITS = 4
TRUTH, ANY_NAME = "ground truth", "*"  # how the name of that detector begins, and what stands for every name


def chunk_of(home: Home, name: str, version: str, sequence: int, cost: Mapping[str, float]) -> bytes:
    """One home as Parquet. ``sequence`` counts the versions of that name; ``cost`` has wall_s and core_s."""
    pa = arrow()
    import pyarrow.parquet as pq

    whose = {"home": name, "version": version}
    row = {
        "homes": whose | {"sequence": sequence} | _home_row(home) | dict(cost),
        "rooms": [whose | row for row in _room_rows(home)],
        "objects": [whose | row for row in _object_rows(home)],
    }
    kinds = schemas()
    columns = [
        pa.array([row["homes"]], pa.struct(list(kinds["homes"]))),
        *(pa.array([row[table]], pa.list_(pa.struct(list(kinds[table])))) for table in ("rooms", "objects")),
    ]
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns, names=list(TABLES)), buffer, compression="zstd")
    return buffer.getvalue()


def arrow() -> Any:
    """The module pyarrow. Raises MissingExtra."""
    try:
        import pyarrow
    except ModuleNotFoundError as error:
        raise MissingExtra(f"the catalog needs the package 'pyarrow': {install('fleet', 'pyarrow')}") from error
    return pyarrow


@cache
def schemas() -> dict[str, pa.Schema]:
    """The columns of each table."""
    pa = arrow()
    text, count, number, yes = pa.string(), pa.int32(), pa.float64(), pa.bool_()
    whose = {"home": text, "version": text}
    metres = dict.fromkeys(("x", "y", "z", "x_min", "y_min", "z_min", "x_max", "y_max", "z_max"), number)
    return {
        "homes": pa.schema(whose | {
            "sequence": count, "id": text, "detector": text, "cartier": text, "mapped_at": number, "recording": text,
            "frames": count, "looked": count, "with_depth": yes, "scale_guessed": yes, "floor_m2": number,
            "floor_seen": number, "knows": pa.list_(text), "notes": pa.list_(text), "start_x": number,
            "start_y": number, "wall_s": number, "core_s": number,
        }),
        "rooms": pa.schema(whose | {"room": count, "name": text, "kind": text, "area_m2": number}),
        "objects": pa.schema(whose | {
            "object": pa.int64(), "label": text, "names": pa.list_(text), "probability": number, "confirmed": yes,
            "by_person": yes, "n_detected": pa.int64(), "n_observable": pa.int64(), "room": count, "room_name": text,
            "room_kind": text, **metres,
            "colours": pa.list_(pa.struct({"name": text, "share": number})), "on_object": pa.int64(),
            "on_relation": text, "first_seen_s": number, "last_seen_s": number, "last_looked_s": number,
        }),
    }  # fmt: skip


def _home_row(home: Home) -> dict[str, Any]:
    recordings, grid = home.settings.get("recordings") or [{}], home.grid
    cell_m2 = 0.0 if grid is None else grid.resolution_m**2
    return {
        "id": home.id, "detector": home.detector, "cartier": cartier.__version__, "mapped_at": time.time(),
        "recording": str(recordings[0].get("sha256", "")),
        "frames": sum(int(row.get("frames", 0)) for row in recordings),
        "looked": sum(int(row.get("looked", row.get("frames", 0))) for row in recordings),
        "with_depth": grid is not None, "scale_guessed": home.scale_guessed,
        "floor_m2": 0.0 if grid is None else round(float((grid.cells == FREE).sum()) * cell_m2, 2),
        "floor_seen": None if grid is None else round(floor_seen(grid), DIGITS),
        "knows": _known(home), "notes": list(home.notes),
        "start_x": home.start_xy[0], "start_y": home.start_xy[1],
    }  # fmt: skip


def _known(home: Home) -> list[str]:
    """The names that a home's detector can give; ground truth has all that is there, so that it can give any."""
    return [ANY_NAME] if home.detector.startswith(TRUTH) else list(map(str, home.settings.get("knows") or ()))


def _room_rows(home: Home) -> list[dict[str, Any]]:
    cell_m2 = 0.0 if home.grid is None else home.grid.resolution_m**2
    return [
        {"room": room.id, "name": room.name, "kind": room.kind, "area_m2": round(len(room.cells) * cell_m2, 2)}
        for room in home.rooms
    ]


def _object_rows(home: Home) -> list[dict[str, Any]]:
    sure = [obj for obj in home.objects if obj.confirmed]
    standing = supports(sure)
    rooms = {room.id: (room.name, room.kind) for room in home.rooms}
    rows = []
    for obj in home.objects:
        held = standing.get(obj.id)
        name, kind = rooms.get(-1 if obj.room is None else obj.room, (None, None))
        rows.append({
            "object": obj.id, "label": obj.label, "names": list(obj.names), "probability": obj.probability,
            "confirmed": obj.confirmed, "by_person": obj.by_person, "n_detected": obj.n_detected,
            "n_observable": obj.n_observable, "room": obj.room, "room_name": name, "room_kind": kind, **_box(obj),
            "colours": [{"name": colour, "share": share} for colour, share in obj.colours],
            "on_object": None if held is None else held.object, "on_relation": None if held is None else held.kind,
            "first_seen_s": obj.first_seen_s, "last_seen_s": obj.last_seen_s, "last_looked_s": obj.last_looked_s,
        })  # fmt: skip
    return rows


def _box(obj: MapObject) -> dict[str, float]:
    axes = ("x", "y", "z")
    middle = dict(zip(axes, obj.position, strict=True))
    low = {f"{axis}_min": value for axis, value in zip(axes, obj.box_min, strict=True)}
    return middle | low | {f"{axis}_max": value for axis, value in zip(axes, obj.box_max, strict=True)}
