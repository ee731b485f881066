"""3-D scene of a home: the floor, the walls and every confirmed object as coloured boxes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.home import Home
from cartier.types import OCCUPIED, UNKNOWN, MapObject, OccupancyGrid

WALL_M = 1.5  # occupied cells higher than this are walls
FLOOR_M = 0.02
FLOOR_RGB, WALL_RGB, OTHER_RGB = (222, 219, 210), (150, 155, 165), (74, 120, 184)
RGB = {
    "black": (38, 38, 42), "white": (244, 244, 240), "grey": (141, 144, 150), "red": (200, 64, 58),
    "orange": (217, 130, 59), "brown": (138, 95, 60), "yellow": (220, 192, 76), "green": (91, 154, 82),
    "blue": (74, 120, 184), "purple": (128, 96, 159), "pink": (216, 147, 174), "beige": (216, 198, 162),
    "turquoise": (79, 169, 164),
}  # fmt: skip

FACES = np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
     (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)]
)  # fmt: skip
"""The triangles (12, 3) of a box with the corners of ``corners``, counter-clockwise from outside."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the map frame (m) with its colour; ``obj`` is the object that it represents."""

    name: str
    low: tuple[float, ...]
    high: tuple[float, ...]
    rgb: tuple[int, int, int]
    obj: MapObject | None = None


def boxes(home: Home) -> list[Box]:
    """The floor and the walls in few boxes, then the confirmed objects."""
    found = list(_ground(home.grid)) if home.grid is not None else []
    for obj in home.objects:
        if obj.confirmed:
            colour = RGB.get(obj.colours[0][0], OTHER_RGB) if obj.colours else OTHER_RGB
            found.append(Box(f"{called(obj)} {obj.id}", obj.box_min, obj.box_max, colour, obj))
    return found


def called(obj: MapObject) -> str:
    """The name that people gave an object, else its label."""
    return obj.names[0] if obj.names else obj.label


def corners(box: Box) -> npt.NDArray[np.float64]:
    """The corners (8, 3) of a box: x changes fastest, then y, then z."""
    ends = np.array([box.low, box.high], np.float64)
    return np.array([(ends[x, 0], ends[y, 1], ends[z, 2]) for z in (0, 1) for y in (0, 1) for x in (0, 1)])


def _ground(grid: OccupancyGrid) -> Iterator[Box]:
    wall = (grid.cells == OCCUPIED) & (grid.height_m > WALL_M)
    for kind, mask in (("wall", wall), ("floor", (grid.cells != UNKNOWN) & ~wall)):
        for row, col, down, across in rectangles(mask):
            x, y = (np.array([col, row]) * grid.resolution_m + grid.origin_xy).tolist()
            side = grid.resolution_m
            patch = grid.height_m[row : row + down, col : col + across]
            top = float(patch.max()) if kind == "wall" else 0.0
            low, high = (x, y, 0.0 if kind == "wall" else -FLOOR_M), (x + across * side, y + down * side, top)
            yield Box(kind, low, high, WALL_RGB if kind == "wall" else FLOOR_RGB)


def rectangles(mask: npt.NDArray[np.bool_]) -> Iterator[tuple[int, int, int, int]]:
    """Row, column, rows and columns of rectangles that cover each true cell once."""
    left = mask.copy()
    for row, col in np.argwhere(mask).tolist():
        if not left[row, col]:
            continue
        run = left[row, col:]
        across = len(run) if run.all() else int(run.argmin())
        full = np.asarray(left[row:, col : col + across].all(axis=1))
        down = len(full) if full.all() else int(full.argmin())
        left[row : row + down, col : col + across] = False
        yield row, col, down, across
