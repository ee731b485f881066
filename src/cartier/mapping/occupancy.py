"""Occupancy grid from depth: free, occupied and unknown cells of the floor plan.

A cell is *occupied* where points were seen in the robot's height band, or through the floor, *free* where the floor
was seen or where every ray down to knee height passed, and *unknown* otherwise. A ray that reads nothing, or passes
below the floor, may have met black leather, glass or a stairwell: rays above it clear nothing from there on. Obstacles
win over free space, unless the floor was seen far more often: a chair that was moved does not haunt the map, and
neither does its height.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import backproject, project, transform
from cartier.mapping.config import DEFAULT_CONFIG, OccupancyConfig
from cartier.types import FREE, OCCUPIED, UNKNOWN, Frame, OccupancyGrid

SIGHT_TOP_M = 2.2  # ceilings and door lintels are no obstacles to sight
KNEE_M = 0.5  # rays clear a cell if everything from here up was seen to be empty; lower things must be seen to count
STEP_M = 1.0  # the way between two camera positions closer than this was walked
COLUMNS = 160  # image columns that are sampled: enough for a 5 cm grid, and cheap
DROP_M = 0.3  # what lies so far below the floor is seen through a hole in it: stairs, a shaft
MAX_SIDE_M = 200.0
MAX_CELL = 1e8  # a plan lies at most so many cells from the origin
SMALL_M2 = 2500.0  # a map smaller than this grows on all sides at once, a larger one only where it must
BINS = 720  # azimuth bins of half a degree
BESIDE = 3  # bins to each side of a ray without a reading that it speaks for, too: about the width of a pixel near by
LOOKS_THROUGH = 3  # frames that see through a top, without one that sees it, after which it is gone
SINK_M = 0.25  # and how far the height falls then
THROUGH_M = 0.15  # how much farther than the top a ray must end to have passed through it


class OccupancyMapper:
    """Grows a grid frame by frame. Memory depends on the area seen, not on the number of frames.

    ``exact`` depth is a simulator's of a home in which nothing moves: no reading means that nothing is there, and
    heights are the highest ever seen.
    """

    def __init__(self, config: OccupancyConfig = DEFAULT_CONFIG.occupancy, exact: bool = False) -> None:
        self.config, self.exact = config, exact
        self.resolution_m, self.robot_radius_m = config.resolution_m, config.robot_radius_m
        self._last_xy: npt.NDArray[np.float64] | None = None
        self._reach: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]] | None = None  # cells from, to (row, col)
        self._low = np.zeros(
            2, np.int64
        )  # (row, col) of the arrays' first cell, in units of cells from the world origin
        self._occupied = np.zeros((0, 0), np.uint32)
        self._floor = np.zeros((0, 0), np.uint32)
        self._passed = np.zeros((0, 0), np.uint32)
        self._height_m = np.zeros((0, 0), np.float16)
        self._through = np.zeros((0, 0), np.uint8)  # frames that looked through the top since one last saw it

    def add(self, frame: Frame) -> None:
        """Take in one frame with depth.

        Raises InputError if the pose lies so far from the others that the grid would exceed 200 m.
        """
        assert frame.depth_m is not None
        stride = max(1, frame.camera.width // COLUMNS)
        depth_m = frame.depth_m[::stride, ::stride]
        depth_m = np.where(depth_m <= MAX_SIDE_M, depth_m, np.float32(np.nan))  # what is no depth is as no reading
        z = depth_m.ravel()
        rays = backproject(np.broadcast_to(np.float32(1), frame.depth_m.shape), frame.camera, stride).reshape(-1, 3)
        near = (z > 0) & (z <= self.config.range_m)
        points = transform(frame.world_from_camera, rays[near] * z[near, None])
        camera_xy = frame.world_from_camera[:2, 3]
        self._cover(camera_xy, points[:, :2], frame.index)
        self._walk(camera_xy)
        if len(points):
            self._mark(points)
            if self.exact:
                self._cast(frame, points, np.full(BINS, np.inf, np.float32))
            else:
                self._sink(frame, points, depth_m, stride)
                self._cast(frame, points, self._drop(frame, rays, z, stride))

    def counts(self) -> dict[str, npt.NDArray[Any]] | None:
        """What the grid is made from, so that another recording can be added later; None before the first frame."""
        if not self._occupied.size:
            return None
        return {
            "occupied": self._occupied, "floor": self._floor, "passed": self._passed, "height_m": self._height_m,
            "low": self._low, "resolution_m": np.array(self.resolution_m),
        }  # fmt: skip

    def restore(self, counts: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from ``counts``. Raises InputError if they are none."""
        try:
            layers = [counts[name] for name in ("occupied", "floor", "passed")]
            height, low = counts["height_m"], counts["low"]
            if any(a.dtype != np.uint32 or a.ndim != 2 or a.shape != height.shape for a in layers) or low.shape != (2,):
                raise ValueError("arrays of another kind")
            if height.dtype != np.float16 or float(counts["resolution_m"]) != self.resolution_m:
                raise ValueError("another resolution")
            if not np.isfinite(height).all() or not (np.abs(low.astype(np.float64)) <= MAX_CELL).all():
                raise ValueError("a height or a place that is none")
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the counts of the floor plan are damaged ({error}): map the recording again") from error
        self._occupied, self._floor, self._passed = (layer.copy() for layer in layers)
        self._height_m, self._low = height.copy(), low.astype(np.int64)
        self._through = np.zeros(height.shape, np.uint8)
        known = np.argwhere(self._occupied + self._floor + self._passed > 0)
        self._reach = (self._low + known.min(0), self._low + known.max(0) + 1) if len(known) else None

    def grid(self) -> OccupancyGrid | None:
        """What is known so far, or None before the first frame."""
        if not self._occupied.size:
            return None
        cells = np.full(self._occupied.shape, UNKNOWN, np.int8)
        seen_free = self._floor + self._passed
        cells[seen_free > 0] = FREE
        solid = self._occupied * self.config.free_beats_occupied > self._floor
        cells[(self._occupied > 0) & solid] = OCCUPIED
        height_m = np.where((self._occupied > 0) & ~solid, np.float16(0), self._height_m)  # what stood there is gone
        return OccupancyGrid(cells, self.resolution_m, self._origin(), height_m)

    def _origin(self) -> tuple[float, float]:
        return float(self._low[1] * self.resolution_m), float(self._low[0] * self.resolution_m)

    def _cells(self, xy: npt.NDArray[np.floating]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        cells = np.floor(xy / self.resolution_m).astype(np.int64)
        return cells[:, 1] - self._low[0], cells[:, 0] - self._low[1]

    def _cover(self, camera_xy: npt.NDArray[np.float64], xy: npt.NDArray[np.floating], index: int) -> None:
        """Grow the arrays, in steps of a metre or more, so that they hold these points."""
        everything = np.concatenate([camera_xy[None] - self.robot_radius_m, camera_xy[None] + self.robot_radius_m, xy])
        y, x = everything[:, 1], everything[:, 0]  # one column at a time: numpy reduces short rows slowly
        low = np.floor(np.array([y.min(), x.min()]) / self.resolution_m).astype(np.int64)
        high = np.floor(np.array([y.max(), x.max()]) / self.resolution_m).astype(np.int64) + 1
        reach = low, high
        if self._reach is not None:
            reach = np.minimum(low, self._reach[0]), np.maximum(high, self._reach[1])
        if (reach[1] - reach[0]).max() > round(MAX_SIDE_M / self.resolution_m):
            raise InputError(
                f"frame {index}: its pose at ({camera_xy[0]:.1f}, {camera_xy[1]:.1f}) m would make the map larger than "
                f"{MAX_SIDE_M:.0f} m; is it an outlier, or in another unit?"
            )
        self._reach = reach
        shape, step = np.array(self._occupied.shape), max(1, round(1 / self.resolution_m))
        top = self._low + shape
        if self._occupied.size:
            if (low >= self._low).all() and (high <= top).all():
                return
            small = shape.prod() < SMALL_M2 / self.resolution_m**2
            low = np.where(small | (low < self._low), np.minimum(low, self._low) - step, self._low)
            high = np.where(small | (high > top), np.maximum(high, top) + step, top)
        else:
            low, high = low - step, high + step
        before: npt.NDArray[np.int64] = self._low - low if self._occupied.size else np.zeros(2, np.int64)
        after = high - low - before - shape
        pad = [(int(before[0]), int(after[0])), (int(before[1]), int(after[1]))]
        self._occupied, self._floor, self._passed = (
            np.pad(layer, pad) for layer in (self._occupied, self._floor, self._passed)
        )
        self._height_m, self._through = np.pad(self._height_m, pad), np.pad(self._through, pad)
        self._low = low

    def _walk(self, camera_xy: npt.NDArray[np.float64]) -> None:
        """Where the camera was carried, a body fitted: discs of the robot's radius along its way are free."""
        last = camera_xy if self._last_xy is None else self._last_xy
        length = float(np.linalg.norm(camera_xy - last))
        steps = math.ceil(length / self.resolution_m) + 1 if length <= STEP_M else 1
        way = np.linspace(camera_xy, last, steps)
        n = math.ceil(self.robot_radius_m / self.resolution_m)
        dy, dx = np.mgrid[-n : n + 1, -n : n + 1]
        inside = np.hypot(dx, dy) * self.resolution_m <= self.robot_radius_m
        rows, cols = self._cells(way)
        self._passed[(rows[:, None] + dy[inside]).ravel(), (cols[:, None] + dx[inside]).ravel()] += 1
        self._last_xy = camera_xy.copy()

    def _sink(
        self, frame: Frame, points: npt.NDArray[np.floating], depth_m: npt.NDArray[np.float32], stride: int
    ) -> None:
        """Lower the heights of cells through whose tops this frame sees: the obstacle there is gone.

        ``depth_m`` is every ``stride``-th pixel's. All pixels around a top must end beyond it, so that an edge is
        none.
        """
        rows, cols = self._cells(np.concatenate([frame.world_from_camera[None, :2, 3], points[:, :2]]))
        row, col = slice(rows.min(), rows.max() + 1), slice(cols.min(), cols.max() + 1)
        near = self._height_m[row, col]
        rows, cols = np.nonzero(near.view(np.uint16))  # faster than float16
        tops = near[rows, cols].astype(np.float32)
        xy = (np.stack([cols + col.start, rows + row.start], 1) + self._low[::-1] + 0.5) * self.resolution_m
        uv, z = project(np.column_stack([xy, tops]), frame.camera, frame.world_from_camera)
        shown = np.flatnonzero(z > THROUGH_M)
        at = np.rint(uv[shown] / stride).astype(np.intp) - 1  # of the 3x3 pixels around, the first
        height, width = depth_m.shape
        inside = ((at >= 0) & (at < (width - 2, height - 2))).all(1)
        shown, at = shown[inside], at[inside]
        ends = np.where(depth_m > 0, depth_m, 0)
        across = np.minimum(np.minimum(ends[:, :-2], ends[:, 1:-1]), ends[:, 2:])
        nearest = np.minimum(np.minimum(across[:-2], across[1:-1]), across[2:])
        through = shown[nearest[at[:, 1], at[:, 0]] > z[shown] + THROUGH_M]
        self._through[row, col][rows[through], cols[through]] += 1
        gone = through[self._through[row, col][rows[through], cols[through]] >= LOOKS_THROUGH]
        near[rows[gone], cols[gone]] = np.maximum(tops[gone] - SINK_M, 0)
        self._through[row, col][rows[gone], cols[gone]] = 0

    def _mark(self, points: npt.NDArray[np.floating]) -> None:
        """Count the cells in which this frame shows floor or obstacles, and keep how high the obstacles reach."""
        z = points[:, 2]
        rows, cols = self._cells(points[:, :2])
        flat = rows * self._occupied.shape[1] + cols
        floor, solid = np.abs(z) < self.config.floor_m, (z >= self.config.floor_m) & (z <= self.config.band_top_m)
        self._count(self._floor, flat[floor])
        self._count(self._occupied, flat[solid])
        tall = (z >= self.config.floor_m) & (z <= SIGHT_TOP_M)
        heights = self._height_m.reshape(-1)
        if self.exact:
            np.maximum.at(heights, flat[tall], z[tall].astype(np.float16))
            return
        # sorted by cell and millimetre; the second highest counts, as a single highest point may be a flying pixel
        order = np.sort(flat[tall] << 12 | (z[tall] * 1000).astype(np.int64))
        cells = order >> 12
        twice = cells[:-1] == cells[1:]
        second = np.flatnonzero(twice & np.append(cells[1:-1] != cells[2:], True)) if len(cells) > 1 else ()
        cells, tops = cells[second], ((order[second] & 4095) / 1000).astype(np.float16)
        self._through.reshape(-1)[cells[tops > heights[cells] - SINK_M]] = 0
        heights[cells] = np.maximum(heights[cells], tops)

    def _count(self, layer: npt.NDArray[np.uint32], flat: npt.NDArray[np.int64]) -> None:
        """One more frame for the cells in which enough points lie; ``flat`` (N,) are the points' cells."""
        cells, count = np.unique(flat, return_counts=True)
        layer.reshape(-1)[cells[count >= self.config.min_points]] += 1

    def _drop(
        self, frame: Frame, rays: npt.NDArray[np.float32], z: npt.NDArray[np.float32], stride: int
    ) -> npt.NDArray[np.float32]:
        """Count cells in which rays pass through the floor; returns how far the floor is reliable, per azimuth bin.

        ``rays`` (N, 3) are points of the rays at 1 m in the camera's frame, ``z`` (N,) their depths. It is to be
        trusted up to where the last ray met it before the first that reads nothing, or passes below it: (BINS,) m,
        infinite without one.
        """
        turn, eye_m = frame.world_from_camera[:3, :3].astype(np.float32), np.float32(frame.world_from_camera[2, 3])
        if eye_m <= self.config.floor_m:  # the floor is not at z = 0
            return np.full(BINS, np.inf, np.float32)
        fall = rays @ turn[2]
        end_m = fall * z + eye_m  # the height at which a ray ends
        lost = np.flatnonzero((fall < 0) & ~((z > 0) & (end_m >= -self.config.floor_m)))
        ways = rays[lost] @ turn[:2].T
        deep = end_m[lost] < -DROP_M
        rows, cols = self._cells(frame.world_from_camera[:2, 3] - ways[deep] * (eye_m / fall[lost][deep])[:, None])
        inside = (rows >= 0) & (cols >= 0) & (rows < self._occupied.shape[0]) & (cols < self._occupied.shape[1])
        self._count(self._occupied, rows[inside] * self._occupied.shape[1] + cols[inside])
        before = stride / frame.camera.fy - fall[lost]  # the slope of the ray one row lower
        first = np.full(BINS, np.inf, np.float32)
        np.minimum.at(first, _bins(ways), np.hypot(ways[:, 0], ways[:, 1]) * eye_m / before)
        return np.asarray(np.minimum.reduce([np.roll(first, k) for k in range(-BESIDE, BESIDE + 1)]))

    def _cast(self, frame: Frame, points: npt.NDArray[np.floating], trusted: npt.NDArray[np.float32]) -> None:
        """Free the cells that all rays from knee height up passed, per azimuth bin, up to the first obstacle.

        ``trusted`` (BINS,) is how far off the floor is to be trusted; where no ray reads below the first that is lost,
        not at all.
        """
        eye = frame.world_from_camera[:3, 3]
        offset = points[:, :2] - eye[:2].astype(np.float32)
        reach = np.hypot(offset[:, 0], offset[:, 1])
        bins = _bins(offset)
        slope = (points[:, 2] - np.float32(eye[2])) / np.maximum(reach, np.float32(1e-3))
        stop, floor_end, lowest = (
            np.full(BINS, np.inf, np.float32),
            np.zeros(BINS, np.float32),
            np.full(BINS, np.inf, np.float32),
        )
        solid = (points[:, 2] >= self.config.floor_m) & (points[:, 2] <= self.config.band_top_m)
        np.minimum.at(stop, bins[solid], reach[solid])
        np.maximum.at(floor_end, bins[~solid], np.where(np.abs(points[:, 2]) < self.config.floor_m, reach, 0)[~solid])
        np.minimum.at(lowest, bins, slope)
        down = -np.minimum(lowest, np.float32(-1e-6))
        begin = np.where(lowest < 0, (eye[2] - KNEE_M) / down, np.inf)
        end = np.where(np.isfinite(stop), stop - self.resolution_m, floor_end)
        end = np.where(trusted > eye[2] / down, np.minimum(end, trusted - self.resolution_m), 0)
        angles = (np.arange(BINS) + 0.5) * (math.tau / BINS) - math.pi
        steps = np.arange(0, self.config.range_m * 1.5, self.resolution_m / 2)
        seen = np.flatnonzero(begin < end)
        b, s = np.nonzero((steps >= begin[seen, None]) & (steps < end[seen, None]))
        b = seen[b]
        xy = eye[:2] + steps[s, None] * np.stack([np.cos(angles[b]), np.sin(angles[b])], 1)
        rows, cols = self._cells(xy)
        shape = self._passed.shape
        inside = (rows >= 0) & (cols >= 0) & (rows < shape[0]) & (cols < shape[1])
        crossed = np.zeros(shape, np.bool_)
        crossed[rows[inside], cols[inside]] = True
        self._passed += crossed


def _bins(offset: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """The azimuth bins of directions (N, 2 or more)."""
    turn = np.arctan2(offset[:, 1], offset[:, 0]) + np.float32(math.pi)
    return np.asarray((turn * np.float32(BINS / math.tau)).astype(np.intp) % BINS)
