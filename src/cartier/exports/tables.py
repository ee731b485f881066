"""Tables of objects and rooms: GeoJSON for the floor plan, CSV for spreadsheets, JSON with all attributes."""

from __future__ import annotations

import csv as table
import io
import itertools
import json as js
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.home import Home
from cartier.io.files import json_bytes
from cartier.types import MapObject

COLUMNS = (
    "id", "label", "name", "room", "x", "y", "z", "x_min", "y_min", "z_min", "x_max", "y_max", "z_max",
    "probability", "confirmed", "n_detected", "n_observable", "first_seen_s", "last_seen_s", "last_looked_s",
    "colour", "aliases",
)  # fmt: skip
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""How a formula begins in a spreadsheet."""


def json(home: Home) -> bytes:
    """All that ``cartier show --json`` prints."""
    return json_bytes(home.to_dict())


def csv(home: Home) -> bytes:
    """One row for each object, also tentative ones. A text that a spreadsheet takes for a formula gets a leading '."""
    text = io.StringIO(newline="")
    writer = table.writer(text)
    writer.writerow(COLUMNS)
    for obj in home.objects:
        row = _row(home, obj)
        writer.writerow([f"'{v}" if isinstance(v, str) and v.startswith(FORMULA) else v for v in row.values()])
    return text.getvalue().encode()


def geojson(home: Home) -> bytes:
    """Rooms and objects as polygons (RFC 7946), but in metres of the map frame: a home has no geographic position."""
    features = []
    grid = home.grid
    for room in home.rooms if grid is not None else ():
        assert grid is not None
        mask = np.zeros(grid.cells.shape, bool)
        mask[tuple(room.cells.T)] = True
        shapes = [[_metres(ring, grid.origin_xy, grid.resolution_m) for ring in rings] for rings in outlines(mask)]
        about = {"kind": "room", "id": room.id, "name": room.name, "room_kind": room.kind}
        features.append(_feature(f"room:{room.id}", "MultiPolygon", shapes, about))
    for obj in home.objects:
        (x1, y1), (x2, y2) = obj.box_min[:2], obj.box_max[:2]
        ring = [[x1, y1], [x2, y1], [x2, y2], [x1, y2], [x1, y1]]
        features.append(_feature(obj.id, "Polygon", [ring], {"kind": "object"} | _row(home, obj)))
    units = "metres, x and y of the map frame; not longitude and latitude"
    about = {"home": home.name, "home_id": home.id, "coordinates": units}
    return (js.dumps({"type": "FeatureCollection", **about, "features": features}, ensure_ascii=False) + "\n").encode()


def outlines(mask: npt.NDArray[np.bool_]) -> list[list[list[tuple[int, int]]]]:
    """The polygons around true cells as rings of corners (x, y): the outer one counter-clockwise, then holes clockwise.

    Cells that only touch at a corner belong to different polygons.
    """
    from scipy import ndimage

    parts, count = ndimage.label(mask)
    polygons = []
    for number in range(1, count + 1):
        rings = _rings(parts == number)
        outer = [ring for ring in rings if _area(ring) > 0]
        polygons.append(outer + [ring for ring in rings if _area(ring) < 0])
    return polygons


def _rings(mask: npt.NDArray[np.bool_]) -> list[list[tuple[int, int]]]:
    """The rings around one part, with the inside to the left of each edge.

    Where two rings meet, the ring turns right, so that a hole that touches the outside at a corner stays a hole.
    """
    padded = np.pad(mask, 1)
    edges: dict[tuple[int, int], list[tuple[int, int]]] = {}
    square = ((0, 0), (1, 0), (1, 1), (0, 1))  # corners (x, y) of a cell
    for k, ((x0, y0), (x1, y1)) in enumerate(zip(square, square[1:] + square[:1], strict=True)):
        dr, dc = ((-1, 0), (0, 1), (1, 0), (0, -1))[k]  # the cell across this edge
        outside = ~np.roll(padded, (-dr, -dc), (0, 1))[1:-1, 1:-1]
        for row, col in np.argwhere(mask & outside).tolist():
            edges.setdefault((col + x0, row + y0), []).append((col + x1, row + y1))
    rings = []
    while edges:
        at = first = next((corner for corner, ends in edges.items() if len(ends) == 1), next(iter(edges)))
        ring, way = [first], (0, 0)
        while True:
            ends = edges[at]
            turn = (way[1], -way[0])  # to the right
            to = next((end for end in ends if (end[0] - at[0], end[1] - at[1]) == turn), ends[0])
            ends.remove(to)
            if not ends:
                del edges[at]
            step = (to[0] - at[0], to[1] - at[1])
            if step == way:
                ring[-1] = to
            else:
                ring.append(to)
            at, way = to, step
            if at == first:
                break
        rings.append(ring)
    return rings


def _area(ring: list[tuple[int, int]]) -> int:
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise(ring))


def _metres(ring: Iterable[tuple[int, int]], origin_xy: tuple[float, float], side: float) -> list[list[float]]:
    return [[round(origin_xy[0] + x * side, 4), round(origin_xy[1] + y * side, 4)] for x, y in ring]


def _feature(number: int | str, kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "id": number, "geometry": geometry, "properties": properties}


def _row(home: Home, obj: MapObject) -> dict[str, Any]:
    room = next((r.name for r in home.rooms if r.id == obj.room), "")
    values = (
        obj.id, obj.label, obj.names[0] if obj.names else "", room, *obj.position, *obj.box_min, *obj.box_max,
        obj.probability, obj.confirmed, obj.n_detected, obj.n_observable, obj.first_seen_s, obj.last_seen_s,
        obj.last_looked_s, obj.colours[0][0] if obj.colours else "", " ".join(map(str, obj.aliases)),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))
