"""Made-up homes entered into a catalog without being mapped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cartier.blob_stores import BlobStore
from cartier.home import Home
from cartier.types import FREE, OCCUPIED, UNKNOWN, Camera, MapObject, OccupancyGrid, Room
from cartier_fleet.catalog_rows import chunk_of
from cartier_fleet.publishing import NEW
from flat import FLAT

KNOWS = ("cup", "table", "sink", "bed", "vase", "fire extinguisher", "sofa")


def grid(seen: float = 1.0) -> OccupancyGrid:
    """A floor of 20 m² of which a share of the border is walls, the rest open."""
    cells = np.full((42, 52), UNKNOWN, np.int8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = (OCCUPIED,) * 4
    cells[1:-1, 1:-1] = FREE
    border = np.argwhere(cells == OCCUPIED)
    for row, col in border[: round((1 - seen) * len(border))]:
        cells[row, col] = UNKNOWN
    return OccupancyGrid(cells, 0.1, (0.0, 0.0), np.zeros(cells.shape, np.float16))


def home(
    objects: Sequence[MapObject] = FLAT.objects,
    rooms: Sequence[Room] = FLAT.rooms,
    knows: Iterable[str] = KNOWS,
    seen: float = 1.0,
    depth: bool = True,
) -> Home:
    settings = {"recordings": [{"sha256": "0" * 64, "frames": 9, "looked": 4}], "knows": list(knows)}
    floor = grid(seen) if depth else None
    return Home("flat", "test", Camera(64, 48, 50.0, 50.0, 32.0, 24.0), tuple(objects), {}, floor, (0.0, 0.0), settings,
                tuple(rooms))  # fmt: skip


def enter(store: BlobStore, name: str, made: Home, version: str = "", sequence: int = 1) -> str:
    """The key of the chunk that the job of a home would write."""
    version = version or f"v-{name}"
    key = f"{NEW}{version}-{sequence}.parquet"
    store.put(key, chunk_of(made, name, version, sequence, {"wall_s": 2.0, "core_s": 1.5}))
    return key
