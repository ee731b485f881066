"""Fuse dense image features into a top-down grid: features, depth, camera, pose → mean feature per cell.

The mean is taken over *every* pixel with depth, with bilinear sampling of the features at that pixel, but no pixel's
feature is formed: the share of each feature vector in each cell is one sparse matrix, and one sparse product does it
all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import BackendError, InputError
from cartier.types import Array, Camera

MAX_SIDE_M = 200.0  # a home that spans more has a pose outlier in it
MARGIN = 64  # cells around what was seen, so that the table of cells seldom grows
HEIGHT_M = (-0.5, 2.2)  # what lies below the floor is noise, what hangs higher is the ceiling of a room


CELL = np.dtype(
    [("xy", np.int32, 2), ("pixels", np.int64), ("height_sum", np.float64), ("most", np.int64), ("frame", np.int32)]
)


class FeatureGrid:
    """A sparse top-down grid: only cells that something was seen in take memory.

    ``cells`` (n,) are records: ``xy`` whole numbers, (i, j) spans [i, i + 1) × [j, j + 1) times ``cell_m``; ``pixels``
    that fell into it; ``height_sum`` of their metres above the floor; ``frame``, the one that shows most of it, in
    ``most`` pixels. ``sums`` (n, D) are float32 sums of the pixels' features.
    """

    def __init__(self, cell_m: float = 0.05) -> None:
        if not 0.005 <= cell_m <= 1:
            raise BackendError(f"option cell_m must be from 0.005 to 1 m, got {cell_m}")
        self.cell_m = cell_m
        self._used = 0
        self._cells, self._sums = np.zeros(0, CELL), np.zeros((0, 0), np.float32)
        self._low_xy = np.zeros(2, np.int64)
        self._slot = np.full((0, 0), -1, np.int32)  # by y and x: which cell of the list is here, -1 = none
        self._tables: _Tables | None = None

    @property
    def cells(self) -> npt.NDArray[Any]:
        return self._cells[: self._used]

    @property
    def sums(self) -> npt.NDArray[np.float32]:
        return self._sums[: self._used]

    def add(self, features: Array, depth_m: Array, camera: Camera, world_from_camera: Array, frame: int = 0) -> None:
        """Fuse one frame: ``features`` (h, w, D) float32 cover the image of depth (H, W), at any resolution.

        Raises InputError if the pose would make the grid larger than 200 m, BackendError for NaN or infinite features.
        """
        features = np.ascontiguousarray(features, np.float32)
        if self._tables is None or self._tables.of != (depth_m.shape, features.shape[:2], camera):
            self._tables = _Tables(depth_m.shape, features.shape[:2], camera)
        window = _window(depth_m, world_from_camera, self._tables, self.cell_m, frame)
        if window is None:
            return
        starts, lengths = self._tables.pieces(window.cells)
        of_piece = window.cells[starts]
        pixels = np.bincount(of_piece, lengths).astype(np.int64)
        height_until = np.cumsum(window.heights_m)
        ends = starts + lengths - 1
        heights = np.bincount(of_piece, height_until[ends] - height_until[starts] + window.heights_m[starts])
        pixels[0] = 0  # no cell has the number 0
        touched = np.flatnonzero(pixels)
        rows = np.zeros(len(pixels), np.int32)
        rows[touched] = np.arange(len(touched))
        used = of_piece > 0
        shares = self._tables.shares(starts[used], lengths[used], rows[of_piece[used]], len(touched))
        cells_xy = np.stack([touched % window.size_x, touched // window.size_x], 1) + window.low_xy
        fused = shares.T @ features.reshape(-1, features.shape[2])
        if not np.isfinite(fused.sum()):  # the sum tells it faster than a look at every number
            raise BackendError(f"frame {frame}: the features hold NaN or infinity")
        slots = self._slots(cells_xy, features.shape[2], f"frame {frame}")
        for begin in range(0, len(slots), 128):  # pieces that stay in the cache
            self._sums[slots[begin : begin + 128]] += fused[begin : begin + 128]
        cells, pixels = self.cells, pixels[touched]
        cells["pixels"][slots] += pixels
        cells["height_sum"][slots] += heights[touched]
        better = pixels > cells["most"][slots]
        cells["most"][slots[better]], cells["frame"][slots[better]] = pixels[better], frame

    def restore(self, cells: npt.NDArray[Any], sums: npt.NDArray[np.float32]) -> None:
        """Take over what an earlier grid held."""
        slots = self._slots(cells["xy"].astype(np.int64), sums.shape[1], "a saved grid")
        if len(np.unique(slots)) < len(cells):
            raise InputError("a saved grid holds a cell twice")
        self._cells[slots], self._sums[slots] = cells, sums

    def _slots(self, cells_xy: npt.NDArray[np.int64], width: int, what: str) -> npt.NDArray[np.int32]:
        """Where in the list these cells are; new ones are appended."""
        self._cover(cells_xy.min(0), cells_xy.max(0), what)
        x, y = (cells_xy - self._low_xy).T
        slots: npt.NDArray[np.int32] = self._slot[y, x]
        new = np.flatnonzero(slots < 0)
        begin, self._used = self._used, self._used + len(new)
        if self._used > len(self._cells):
            more = max(4096, self._used)
            self._cells = np.concatenate([self._cells, np.zeros(more, CELL)])
            self._sums = np.concatenate([self._sums.reshape(-1, width), np.zeros((more, width), np.float32)])
        slots[new] = np.arange(begin, self._used)
        self._cells["xy"][begin : self._used] = cells_xy[new]
        self._slot[y[new], x[new]] = slots[new]
        return slots

    def _cover(self, low_xy: npt.NDArray[np.int64], high_xy: npt.NDArray[np.int64], what: str) -> None:
        """Grow the table of cells so that it holds these."""
        known = self._slot.size > 0
        size_xy = np.array(self._slot.shape[::-1])
        end_xy = self._low_xy + size_xy
        if known and (low_xy >= self._low_xy).all() and (high_xy < end_xy).all():
            return
        low, end = (np.minimum(low_xy, self._low_xy), np.maximum(high_xy, end_xy)) if known else (low_xy, high_xy)
        if (end - low).max() * self.cell_m > MAX_SIDE_M + 2 * MARGIN * self.cell_m:
            (x, y), (far_x, far_y) = low_xy * self.cell_m, high_xy * self.cell_m
            raise InputError(
                f"{what} would make the map larger than {MAX_SIDE_M:.0f} m: it reaches x {x:.0f} to {far_x:.0f}, "
                f"y {y:.0f} to {far_y:.0f} m; is its pose an outlier, or in another unit?"
            )
        low, end = np.minimum(low, low_xy - MARGIN), np.maximum(end, high_xy + MARGIN)
        grown = np.full((end - low)[::-1], -1, np.int32)
        x, y = self._low_xy - low
        if known:
            grown[y : y + size_xy[1], x : x + size_xy[0]] = self._slot
        self._slot, self._low_xy = grown, low


@dataclass(frozen=True)
class _Window:
    """What a frame shows, on the grid: cell number per pixel (0 = none) from ``low_xy`` on, ``size_x`` cells wide."""

    cells: npt.NDArray[np.int32]
    heights_m: npt.NDArray[np.float64]
    low_xy: npt.NDArray[np.int64]
    size_x: int


def _window(depth_m: Array, world_from_camera: Array, tables: _Tables, cell_m: float, frame: int) -> _Window | None:
    valid = depth_m > 0  # false for NaN
    depth = np.where(valid, depth_m, np.float64(0))
    world = np.array(world_from_camera, np.float64)[:3]
    world[:2] /= cell_m  # metres along z, cells along x and y
    x, y, z = (np.add.outer(row[1] * tables.slope_y, row[0] * tables.slope_x + row[2]) for row in world)
    for axis, row in zip((x, y, z), world, strict=True):
        axis *= depth
        axis += row[3]
    valid &= (z > HEIGHT_M[0]) & (z < HEIGHT_M[1])
    if not valid.any():
        return None
    low, high = (
        np.floor([getattr(a, end)(where=valid, initial=start) for a in (x, y)]).astype(np.int64)
        for end, start in (("min", np.inf), ("max", -np.inf))
    )
    if (high - low).max() * cell_m > MAX_SIDE_M:  # the table of cells must not fill the memory
        raise InputError(
            f"frame {frame} shows more than {MAX_SIDE_M:.0f} m of the world; is its depth in another unit?"
        )
    size_x = int(high[0] - low[0]) + 2
    x -= low[0] - 1  # from 1, so that no cell has the number 0
    y -= low[1]
    cells = y.astype(np.int32)
    cells *= np.int32(size_x)
    cells += x.astype(np.int32)
    cells *= valid
    return _Window(cells.ravel(), z.ravel(), np.array([low[0] - 1, low[1]]), size_x)


class _Tables:
    """What depends on sizes and intrinsics only: ray slopes, bilinear taps, the matrix from row sums to features."""

    def __init__(self, depth_shape: tuple[int, ...], feature_shape: tuple[int, ...], camera: Camera) -> None:
        from scipy.sparse import csr_array

        self.of = (depth_shape, feature_shape, camera)
        self.slope_x = (
            np.arange(depth_shape[1]) - camera.cx
        ) / camera.fx  # in double precision: cells have sharp edges
        self.slope_y = (np.arange(depth_shape[0]) - camera.cy) / camera.fy
        (self.height, self.width), (h, w) = depth_shape, feature_shape
        self.columns = w
        self.column, share = _taps(self.width, w)
        self.share_before = np.concatenate([[0], np.cumsum(share)])
        self.new_column = np.diff(self.column, prepend=-1) != 0
        # Sums over a piece of an image row go to the feature left and right of it, in the feature rows above and below.
        row, below = _taps(self.height, h)
        pieces = np.arange(self.height * w)
        above_at, weight = (row[:, None] * w + np.arange(w)).ravel(), np.repeat(below, w)
        right = np.minimum(np.tile(np.arange(w), self.height) + 1, w - 1) - np.tile(np.arange(w), self.height)
        below_at = np.minimum(above_at + w, (h - 1) * w + above_at % w)
        to = np.concatenate([above_at, below_at, above_at + right, below_at + right])
        of = np.concatenate([pieces, pieces, pieces + len(pieces), pieces + len(pieces)])
        values = np.tile(np.concatenate([1 - weight, weight]), 2).astype(np.float32)
        self.collect = csr_array((values, (to.astype(np.int32), of.astype(np.int32))), shape=(h * w, 2 * len(pieces)))

    def pieces(self, cells: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Starts and lengths of pieces of image rows that lie in one cell and between the same two features."""
        grid = cells.reshape(self.height, self.width)
        new = np.empty(grid.shape, bool)
        new[:, 0] = True
        np.not_equal(grid[:, 1:], grid[:, :-1], out=new[:, 1:])
        new |= self.new_column
        starts = np.flatnonzero(new).astype(np.int32)
        return starts, np.diff(starts, append=np.int32(len(cells)))

    def shares(
        self, starts: npt.NDArray[np.int32], lengths: npt.NDArray[np.int32], rows: npt.NDArray[np.int32], count: int
    ) -> Any:
        """(features, ``count`` cells) sparse: how many pixels' worth of each feature vector falls into each cell."""
        from scipy.sparse import csr_array

        v = starts // np.int32(self.width)
        u = starts - v * np.int32(self.width)
        right = self.share_before[u + lengths] - self.share_before[u]
        half = self.collect.shape[1] // 2
        ends = np.cumsum(np.bincount(v * np.int32(self.columns) + self.column[u], minlength=half), dtype=np.int32)
        pieces = csr_array(
            (
                np.concatenate([lengths - right, right], dtype=np.float32, casting="same_kind"),
                np.concatenate([rows, rows]),
                np.concatenate([[0], ends, ends + ends[-1]], dtype=np.int32),
            ),
            shape=(2 * half, count),
        )
        return self.collect @ pieces  # adds up what falls on one feature and one cell


def _taps(pixels: int, features: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Per pixel along one axis the feature at or before its centre, and the share of the next one (bilinear)."""
    at = np.clip((np.arange(pixels) + 0.5) * features / pixels - 0.5, 0, features - 1)
    low = np.minimum(at.astype(np.int64), max(features - 2, 0))
    return low.astype(np.int32), at - low
