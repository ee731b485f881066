"""True floor plan of a scene: where a round robot fits, exact from all triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from cartier_dollhouse.model import Scene, triangles
from cartier_dollhouse.openings import hole_box

BAND_M = (0.05, 1.5)  # what lies lower is driven over, what hangs higher is driven under
CELL_M = 0.05
FINE = 3  # fine cells along one cell of the grid
MARGIN_M = 0.3
LARGE = 2  # fine cells

Corners = npt.NDArray[np.float32]


class Plan:
    """Where a robot of a radius can stand in a scene: exact to one fine cell of 1.7 cm."""

    def __init__(self, scene: Scene, radius_m: float) -> None:
        self.radius_m = radius_m
        boxes = np.array([room.box for room in scene.rooms])
        low = np.floor((boxes[:, :2].min(0) - MARGIN_M) / CELL_M)
        high = np.ceil((boxes[:, 2:].max(0) + MARGIN_M) / CELL_M)
        self._origin = low * CELL_M
        columns, rows = (high - low).astype(int).tolist()
        self._height_m = _heights(scene, self._origin, (rows * FINE, columns * FINE))
        self._floor = self._inside(scene)
        self._drop_cavities(scene.start_xy)
        blocked = (self._height_m > 0) | ~self._floor
        # Between centres of cells; what blocks begins half a cell before its cell's centre.
        self._clearance_m = (ndimage.distance_transform_edt(~blocked) - 0.5) * (CELL_M / FINE)

    def clearance(self, xy: Sequence[float]) -> float:
        """Distance (m) from a point to what would stop a robot, 0 in a wall, in furniture or outside."""
        return max(0.0, float(self._clearance_m[self._fine_cell(xy)]))

    def free(self, xy: Sequence[float]) -> bool:
        """Whether the robot's disc at a point (x, y) hits nothing."""
        return self.clearance(xy) >= self.radius_m

    def grid(self) -> OccupancyGrid:
        """The true grid, not inflated, in cells of 5 cm; what lies outside of rooms and doorways is unknown."""
        heights = _blocks(self._height_m).max((1, 3))
        cells = np.where(_blocks(self._floor).any((1, 3)), FREE, UNKNOWN)
        cells[heights > 0] = OCCUPIED
        return OccupancyGrid(cells.astype(np.int8), CELL_M, self._corner, heights.astype(np.float16))

    def reachable(self, start_xy: Sequence[float]) -> npt.NDArray[np.bool_]:
        """Cells of ``grid()`` on whose centres the robot can stand after driving there from a point; all False if it is
        not free."""
        parts, _ = ndimage.label(self._clearance_m >= self.radius_m)
        if not self.free(start_xy):
            return np.zeros(_blocks(parts).shape[::2], bool)
        return np.asarray((parts == parts[self._fine_cell(start_xy)])[FINE // 2 :: FINE, FINE // 2 :: FINE])

    @property
    def _corner(self) -> tuple[float, float]:
        return float(self._origin[0]), float(self._origin[1])

    def _drop_cavities(self, start_xy: Sequence[float]) -> None:
        """The inside of a closed wardrobe, which nothing could enter from the start, is no floor."""
        parts, _ = ndimage.label(self._floor & (self._height_m == 0))
        start = parts[self._fine_cell(start_xy)]
        if start:
            self._floor &= (parts == start) | (self._height_m > 0)

    def _fine_cell(self, xy: Sequence[float]) -> tuple[int, int]:
        """(row, column) of the fine cell of a point, or of the nearest cell to it."""
        column, row = np.floor((np.asarray(xy, dtype=np.float64) - self._origin) * (FINE / CELL_M)).astype(int).tolist()
        rows, columns = self._height_m.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _inside(self, scene: Scene) -> npt.NDArray[np.bool_]:
        """Fine cells whose centre lies in a room or in a doorway."""
        rows, columns = self._height_m.shape
        x = self._origin[0] + (np.arange(columns) + 0.5) * (CELL_M / FINE)
        y = self._origin[1] + (np.arange(rows) + 0.5) * (CELL_M / FINE)
        inside = np.zeros((rows, columns), bool)
        doorways = [hole_box(opening) for opening in scene.openings if opening.kind == "door"]
        for x1, y1, x2, y2 in [*(room.box for room in scene.rooms), *doorways]:
            inside |= np.outer((y >= y1) & (y <= y2), (x >= x1) & (x <= x2))
        return inside


def _blocks(fine: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    rows, columns = fine.shape
    return fine.reshape(rows // FINE, FINE, columns // FINE, FINE)


def _heights(scene: Scene, origin: npt.NDArray[np.float64], shape: tuple[int, int]) -> npt.NDArray[np.float32]:
    """How high triangles within the band reach in each fine cell, 0 where there are none.

    Triangles are halved along their longest edge in the plan until they are smaller than a cell; each then marks the
    cells of its corners. Large ones that are level or upright, as most are, need not be halved.
    """
    mesh = triangles(scene)
    corners = mesh.vertices[mesh.faces]
    corners[..., :2] = (corners[..., :2] - origin.astype(np.float32)) * np.float32(FINE / CELL_M)
    corners = _within_band(corners)
    heights = np.zeros(shape, np.float32)
    edges = corners[:, [1, 2, 0], :2] - corners[..., :2]
    lengths = np.hypot(edges[..., 0], edges[..., 1])
    area = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    large = lengths.max(1) > LARGE
    level = large & (np.ptp(corners[..., 2], axis=1) < 1e-3)
    upright = large & ~level & (area < 0.1 * lengths.max(1))
    _fill(heights, corners[level])
    _draw(heights, corners[upright])
    corners = corners[~level & ~upright]
    while len(corners):
        x, y = corners[..., 0], corners[..., 1]
        lengths = np.stack([np.hypot(x[:, b] - x[:, a], y[:, b] - y[:, a]) for a, b in ((0, 1), (1, 2), (2, 0))], 1)
        small = _most(lengths) <= 1.0
        _mark(heights, corners[small, :, :2].reshape(-1, 2), _most(corners[small, :, 2]).repeat(3))
        coarse, longest = corners[~small], lengths[~small].argmax(1)
        rows = np.arange(len(coarse))
        a, b, c = (coarse[rows, (longest + k) % 3] for k in range(3))
        middle, count = (a + b) / 2, len(coarse)
        halves = np.empty((2 * count, 3, 3), corners.dtype)
        halves[:count, 0], halves[:count, 1] = a, middle
        halves[count:, 0], halves[count:, 1] = middle, b
        halves[:count, 2] = halves[count:, 2] = c
        corners = _within_band(halves)
    return heights


def _within_band(corners: Corners) -> Corners:
    z = corners[..., 2]
    lowest = np.minimum(np.minimum(z[:, 0], z[:, 1]), z[:, 2])
    return np.asarray(corners[(_most(z) > BAND_M[0]) & (lowest < BAND_M[1])])


def _most(values: Corners) -> Corners:
    """The largest of each three (N, 3): numpy reduces so short an axis many times more slowly."""
    return np.maximum(np.maximum(values[:, 0], values[:, 1]), values[:, 2])


def _fill(heights: Corners, corners: Corners) -> None:
    """Marks the cells whose centres lie within level triangles."""
    low = np.floor(corners[..., :2].min(1)).astype(np.int64)
    wide, deep = (np.ceil(corners[..., :2].max(1)).astype(np.int64) - low).T
    counts = wide * deep
    which = np.repeat(np.arange(len(corners)), counts)
    cell = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    x, y = (low[which] + np.stack([cell % wide[which], cell // wide[which]], 1) + 0.5).astype(np.float32).T
    left, right = np.ones(len(which), bool), np.ones(len(which), bool)
    for k in range(3):
        (ax, ay, _), (bx, by, _) = corners[:, k].T, corners[:, (k + 1) % 3].T
        side = (bx - ax)[which] * (y - ay[which]) - (by - ay)[which] * (x - ax[which])
        left &= side >= 0
        right &= side <= 0
    within = left | right
    _mark(heights, np.stack([x, y], 1)[within], corners[which[within], 0, 2])


def _draw(heights: Corners, corners: Corners) -> None:
    """Marks the cells along upright triangles, where they are within the band."""
    spans = np.ptp(corners[..., :2], axis=1)
    order = np.argsort(np.where(spans[:, :1] > spans[:, 1:], corners[..., 0], corners[..., 1]), axis=1)
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[..., None], 1).astype(np.float64), 1, 0)
    length = np.hypot(*(c - a)[:, :2].T)
    bend = np.clip(np.hypot(*(b - a)[:, :2].T) / length, 1e-9, 1 - 1e-9)
    counts = (2 * length).astype(np.int64) + 2
    which = np.repeat(np.arange(len(corners)), counts)
    t = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)) / (counts[which] - 1)
    a, b, c, bend = a[which], b[which], c[which], bend[which]
    # From end to end, an upright triangle spans from its long edge to the other two.
    one = a[:, 2] + t * (c - a)[:, 2]
    other = np.where(t < bend, a[:, 2] + t / bend * (b - a)[:, 2], c[:, 2] + (1 - t) / (1 - bend) * (b - c)[:, 2])
    low, high = np.minimum(one, other), np.maximum(one, other)
    met = (high > BAND_M[0]) & (low < BAND_M[1])
    _mark(heights, (a + t[:, None] * (c - a))[met, :2], high[met])


def _mark(heights: Corners, xy: npt.NDArray[np.floating], top: npt.NDArray[np.floating]) -> None:
    columns, rows = np.floor(xy).astype(np.int32).T
    inside = (columns >= 0) & (columns < heights.shape[1]) & (rows >= 0) & (rows < heights.shape[0])
    values = np.minimum(top[inside], BAND_M[1]).astype(np.float32)
    np.maximum.at(heights, (rows[inside], columns[inside]), values)
