"""Changes of rooms by corrections: two that are one, and one that is two, cut where a person points."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cartier.types import MapObject, OccupancyGrid, Room

Cells = npt.NDArray[np.int32]
DIRECTIONS_RAD = np.deg2rad(np.arange(0, 180, 5))  # of the cuts that are tried
NEAR_M = 0.3  # how far outside of the room a person may point


def joined(one: Room, other: Room) -> Room:
    """Two rooms that are one: the first, with the cells of both."""
    return replace(one, cells=np.concatenate([one.cells, other.cells]))


def halves(cells: Cells, xy: Sequence[float], grid: OccupancyGrid) -> tuple[Cells, Cells] | None:
    """The two parts of a room's cells (N, 2), the larger first, cut straight through a point (x, y) in metres.

    Of the straight cuts that divide the room there the shortest is taken: the one from jamb to jamb. None where no cut
    divides the room, or the point is not in it.
    """
    from scipy import ndimage

    nearest = cells[np.linalg.norm(grid.centre(cells) - np.asarray(xy), axis=1).argmin()]
    if np.linalg.norm(grid.centre(nearest) - np.asarray(xy)) > NEAR_M:
        return None
    low, shape = cells.min(0) - 1, np.ptp(cells, axis=0) + 3
    inside = np.zeros(shape, bool)
    inside[tuple((cells - low).T)] = True
    point, steps = nearest - low, np.arange(1, 2 * int(shape.sum())) / 2
    cuts = []
    for angle_rad in DIRECTIONS_RAD:
        way = np.array([np.sin(angle_rad), np.cos(angle_rad)])
        arms = [
            _until_outside(np.round(point + sign * steps[:, None] * way).astype(np.intp), inside) for sign in (1, -1)
        ]
        cuts.append(np.concatenate([point[None], *arms]))
    for cut in sorted(cuts, key=lambda cut: float(np.linalg.norm(np.ptp(cut, axis=0)))):
        rest = inside.copy()
        rest[tuple(cut.T)] = False
        parts, count = ndimage.label(rest)
        beside = np.unique(parts[ndimage.binary_dilation(inside & ~rest) & rest])
        sizes = np.bincount(parts.ravel(), minlength=count + 1)
        if len(beside) > 1:  # the largest part keeps what the cut does not touch, and the cut
            second = np.isin(parts, sorted(beside, key=lambda part: int(sizes[part]))[:-1])
            of = second[tuple((cells - low).T)]
            return cells[~of], cells[of]
    return None


def _until_outside(cells: npt.NDArray[np.intp], inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    within = np.asarray(((cells >= 0) & (cells < inside.shape)).all(1))
    within[within] = inside[tuple(cells[within].T)]
    return cells[: int(np.argmin(within))] if not within.all() else cells


def free_name(name: str, rooms: Iterable[Room]) -> str:
    """The name, or with a number if a room has it."""
    taken, count = {room.name.casefold() for room in rooms}, 1
    while (numbered := name if count == 1 else f"{name} {count}").casefold() in taken:
        count += 1
    return numbered


def in_part(obj: MapObject, parts: Iterable[Room], grid: OccupancyGrid) -> int:
    """The id of that of some rooms whose floor is nearest to an object."""
    return min(parts, key=lambda room: _away_m(room, obj, grid)).id


def _away_m(room: Room, obj: MapObject, grid: OccupancyGrid) -> float:
    return float(np.linalg.norm(grid.centre(room.cells) - obj.position[:2], axis=1).min())
