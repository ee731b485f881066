"""Shell of a home: floors, ceilings, and walls with door gaps and window holes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.frames import FRAMES, TRIM, skirting
from cartier_dollhouse.mesh import panel
from cartier_dollhouse.model import Opening, Part, Room
from cartier_dollhouse.openings import OUTER_M, REACH_M, Box2, axis_of, faces_of, hole_box, shared_wall

OUTSIDE = "stone:white"
SOLID, HOLE, OUTDOORS = -1, -2, -3


def structure(rooms: Sequence[Room], openings: Sequence[Opening], height_m: float) -> tuple[Part, ...]:
    """All that is built in, in world coordinates."""
    parts = [*_walls(rooms, openings, height_m), *_floors(rooms, openings, height_m)]
    trims = [part for room in rooms for part in skirting(room, openings)]
    for opening in openings:
        trims += list(FRAMES[opening.kind](opening, rooms))
    by_material: dict[str, list[Part]] = defaultdict(list)
    for part in trims:
        by_material[part.material].append(part)
    return (*parts, *(_merged(some) for some in by_material.values()))


def _floors(rooms: Sequence[Room], openings: Sequence[Opening], height: float) -> Iterator[Part]:
    for room in rooms:
        yield _level(room.box, 0.0, room.floor)
        x1, y1, x2, y2 = room.box
        yield panel((x1, y2, height), (x2, y2, height), (x2, y1, height), (x1, y1, height), "paint:white")
    for opening in openings:
        if opening.kind != "window":
            (low, high), axis = faces_of(opening, rooms), axis_of(opening)
            start, end = opening.start[1 - axis], opening.end[1 - axis]
            threshold = (low, start, high, end) if axis == 0 else (start, low, end, high)
            yield _level(threshold, 0.0, "oak")


def _level(area: Box2, z: float, material: str) -> Part:
    """A floor that is seen from above; its texture starts at the world's origin, so that equal floors go on."""
    x1, y1, x2, y2 = area
    flat = panel((x1, y1, z), (x2, y1, z), (x2, y2, z), (x1, y2, z), material)
    return Part(flat.vertices, flat.faces, flat.vertices[:, :2].copy(), material)


def _walls(rooms: Sequence[Room], openings: Sequence[Opening], height: float) -> Iterator[Part]:
    """Every boundary between wall and air, as rectangles, in the material of the side it is seen from.

    The home is cut along all its planes into cells that are wall or air: walls then meet exactly, whatever the layout.
    """
    planes, cells = _cells(rooms, openings, height)
    quads: dict[int, list[npt.NDArray[np.float64]]] = defaultdict(list)
    for axis in range(3):
        before, after = np.moveaxis(cells, axis, 0)[:-1], np.moveaxis(cells, axis, 0)[1:]
        for sign, wall, air in ((1, before, after), (-1, after, before)):
            seen = np.where((wall == SOLID) & (air != SOLID), air, SOLID)
            for i in np.flatnonzero((seen != SOLID).any((1, 2))):
                for label, u1, u2, v1, v2 in _rectangles(seen[i]):
                    u, v = (planes[other] for other in range(3) if other != axis)
                    corners = _corners(axis, sign, planes[axis][i + 1], (u[u1], u[u2]), (v[v1], v[v2]))
                    quads[label].append(corners)
    for label, some in sorted(quads.items()):
        material = {HOLE: TRIM, OUTDOORS: OUTSIDE}.get(label) or rooms[label].walls
        yield _from_quads(np.array(some), material)


def _cells(
    rooms: Sequence[Room], openings: Sequence[Opening], height: float
) -> tuple[list[npt.NDArray[np.float64]], npt.NDArray[np.int64]]:
    """The cutting planes along x, y, z, and per cell between them its room's number, SOLID, HOLE or OUTDOORS."""
    solids = [tuple(np.array(room.box) + OUTER_M * np.array([-1, -1, 1, 1])) for room in rooms]
    for i, a in enumerate(rooms):
        for b in rooms[:i]:
            shared = shared_wall(a, b)
            if shared:
                axis, middle, low, high = shared
                half = REACH_M - 0.005
                solids.append(
                    (middle - half, low, middle + half, high)
                    if axis == 0
                    else (low, middle - half, high, middle + half)
                )
    holes = [hole_box(opening) for opening in openings]
    flat = np.array([*solids, *holes, *(room.box for room in rooms)])
    heights = [0.0, height, *(z for o in openings for z in (o.bottom_m, o.top_m))]
    # One more plane around it all, so that the outermost cells are outdoors.
    planes = [
        np.unique(np.round(np.concatenate([values, [values.min() - 1, values.max() + 1]]), 6))
        for values in (flat[:, [0, 2]].ravel(), flat[:, [1, 3]].ravel(), np.array(heights))
    ]
    x, y, z = (((p[:-1] + p[1:]) / 2) for p in planes)

    def inside(area: Sequence[float]) -> npt.NDArray[np.bool_]:
        within = np.outer((x > area[0]) & (x < area[2]), (y > area[1]) & (y < area[3]))
        return np.asarray(within[:, :, None] & ((z > 0) & (z < height)))

    cells = np.full((len(x), len(y), len(z)), OUTDOORS)
    for area in solids:
        cells[inside(area)] = SOLID
    for area, opening in zip(holes, openings, strict=True):
        cells[inside(area) & (cells == SOLID) & ((z > opening.bottom_m) & (z < opening.top_m))] = HOLE
    for number, room in enumerate(rooms):
        cells[inside(room.box)] = number
    cells[:, :, 0] = np.where(cells[:, :, 1] == SOLID, SOLID, OUTDOORS)  # walls go on below: nobody sees their bottom
    return planes, cells


def _rectangles(labels: npt.NDArray[np.int64]) -> Iterator[tuple[int, int, int, int, int]]:
    """Covers the cells that are not SOLID by rectangles of one label: (label, u from, to, v from, to)."""
    left = labels != SOLID
    for u1, v1 in np.argwhere(left):
        if not left[u1, v1]:
            continue
        same = left & (labels == labels[u1, v1])
        run = same[u1, v1:]
        v2 = v1 + (len(run) if run.all() else int(np.argmin(run)))
        rows = same[u1:, v1:v2].all(1)
        u2 = u1 + (len(rows) if rows.all() else int(np.argmin(rows)))
        left[u1:u2, v1:v2] = False
        yield int(labels[u1, v1]), int(u1), int(u2), int(v1), int(v2)


def _corners(
    axis: int, sign: int, plane: float, u: tuple[float, float], v: tuple[float, float]
) -> npt.NDArray[np.float64]:
    """Four corners (4, 3), counter-clockwise seen from the side to which the normal points."""
    corners = np.empty((4, 3))
    corners[:, axis] = plane
    first, second = (other for other in range(3) if other != axis)
    corners[:, first] = np.array(u)[[0, 1, 1, 0]]
    corners[:, second] = np.array(v)[[0, 0, 1, 1]]
    forward = sign if axis != 1 else -sign  # x cross z is -y
    return corners if forward > 0 else corners[::-1]


def _from_quads(quads: npt.NDArray[np.float64], material: str) -> Part:
    """A part of rectangles (N, 4, 3); u runs along the wall and v up, both from the world's origin."""
    vertices = quads.reshape(-1, 3)
    faces = (4 * np.arange(len(quads))[:, None] + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    flat = np.ptp(quads, axis=1).argmin(1).repeat(4)  # the axis along which a rectangle has no extent
    u = np.where(flat == 0, vertices[:, 1], vertices[:, 0])
    v = np.where(flat == 2, vertices[:, 1], vertices[:, 2])
    uv = np.stack([u, v], 1)
    return Part(vertices.astype(np.float32), faces.astype(np.int32), uv.astype(np.float32), material)


def _merged(parts: Sequence[Part]) -> Part:
    offsets = np.concatenate([[0], np.cumsum([len(part.vertices) for part in parts])[:-1]])
    return Part(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]).astype(np.int32),
        np.concatenate([part.uv_m for part in parts]),
        parts[0].material,
    )
