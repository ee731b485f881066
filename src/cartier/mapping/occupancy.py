"""A floor plan from depth: free, occupied and unknown kept apart.

A cell is *occupied* where points were seen in the robot's height band, *free* where the floor was seen or where every
ray down to knee height passed, and *unknown* otherwise. Obstacles win over free space, unless the floor was seen far
more often: a chair that was moved does not haunt the map.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.types import FREE, OCCUPIED, UNKNOWN, Frame, OccupancyGrid

FLOOR_M = 0.10  # points up to this height are floor: depth noise at 4 m is about this large
BAND_TOP_M = 1.5  # what hangs higher does not stop the robot
SIGHT_TOP_M = 2.2  # ceilings and door lintels are no obstacles to sight
KNEE_M = 0.5  # rays clear a cell if everything from here up was seen to be empty; lower things must be seen to count
STEP_M = 1.0  # the way between two camera positions closer than this was walked
RANGE_M = 5.0  # depth cameras tell little beyond
COLUMNS = 160  # image columns that are looked at: enough for a 5 cm grid, and cheap
MIN_POINTS = 2  # one lone point in a cell and frame is a flying pixel
FREE_BEATS_OCCUPIED = 4  # frames in which the floor was seen for one in which an obstacle was
MAX_SIDE_M = 200.0
BINS = 720  # azimuth bins of half a degree


class OccupancyMapper:
    """Grows a grid frame by frame. Memory depends on the area seen, not on the number of frames."""

    def __init__(self, resolution_m: float = 0.05, robot_radius_m: float = 0.2) -> None:
        self.resolution_m = resolution_m
        self.robot_radius_m = robot_radius_m
        self._last_xy: npt.NDArray[np.float64] | None = None
        self._low = np.zeros(
            2, np.int64
        )  # (row, col) of the arrays' first cell, in units of cells from the world origin
        self._occupied = np.zeros((0, 0), np.uint32)
        self._floor = np.zeros((0, 0), np.uint32)
        self._passed = np.zeros((0, 0), np.uint32)
        self._height_m = np.zeros((0, 0), np.float16)

    def add(self, frame: Frame) -> None:
        """Take in one frame with depth.

        Raises InputError if the pose lies so far from the others that the grid would exceed 200 m.
        """
        camera_xy = frame.world_from_camera[:2, 3]
        assert frame.depth_m is not None
        near = backproject(frame.depth_m, frame.camera, max(1, frame.camera.width // COLUMNS)).reshape(-1, 3)
        near = near[(near[:, 2] > 0) & (near[:, 2] <= RANGE_M)]  # drops NaN too
        points = transform(frame.world_from_camera, near)
        self._cover(camera_xy, points[:, :2], frame.index)
        self._walk(camera_xy)
        if len(points):
            self._mark(points)
            self._cast(frame, points)

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
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the counts of the floor plan are damaged ({error}): map the recording again") from error
        self._occupied, self._floor, self._passed = (layer.copy() for layer in layers)
        self._height_m, self._low = height.copy(), low.astype(np.int64)

    def grid(self) -> OccupancyGrid | None:
        """What is known so far, or None before the first frame."""
        if not self._occupied.size:
            return None
        cells = np.full(self._occupied.shape, UNKNOWN, np.int8)
        seen_free = self._floor + self._passed
        cells[seen_free > 0] = FREE
        cells[(self._occupied > 0) & (self._occupied * FREE_BEATS_OCCUPIED > self._floor)] = OCCUPIED
        return OccupancyGrid(cells, self.resolution_m, self._origin(), self._height_m.copy())

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
        shape = np.array(self._occupied.shape)
        if self._occupied.size:
            if (low >= self._low).all() and (high <= self._low + shape).all():
                return
            low, high = np.minimum(low, self._low), np.maximum(high, self._low + shape)
        if (high - low).max() * self.resolution_m > MAX_SIDE_M:
            raise InputError(
                f"frame {index}: its pose at ({camera_xy[0]:.1f}, {camera_xy[1]:.1f}) m would make the map larger than "
                f"{MAX_SIDE_M:.0f} m; is it an outlier, or in another unit?"
            )
        step = max(1, round(1 / self.resolution_m))
        low, high = low - step, high + step
        before: npt.NDArray[np.int64] = self._low - low if self._occupied.size else np.zeros(2, np.int64)
        after = high - low - before - shape
        pad = [(int(before[0]), int(after[0])), (int(before[1]), int(after[1]))]
        self._occupied, self._floor, self._passed = (
            np.pad(layer, pad) for layer in (self._occupied, self._floor, self._passed)
        )
        self._height_m = np.pad(self._height_m, pad)
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

    def _mark(self, points: npt.NDArray[np.floating]) -> None:
        """Count the cells in which this frame shows floor or obstacles, and keep how high the obstacles reach."""
        z = points[:, 2]
        rows, cols = self._cells(points[:, :2])
        flat = rows * self._occupied.shape[1] + cols
        floor, solid = np.abs(z) < FLOOR_M, (z >= FLOOR_M) & (z <= BAND_TOP_M)
        for layer, which in ((self._floor, floor), (self._occupied, solid)):
            cells, count = np.unique(flat[which], return_counts=True)
            layer.reshape(-1)[cells[count >= MIN_POINTS]] += 1
        tall = (z >= FLOOR_M) & (z <= SIGHT_TOP_M)
        np.maximum.at(self._height_m.reshape(-1), flat[tall], z[tall].astype(np.float16))

    def _cast(self, frame: Frame, points: npt.NDArray[np.floating]) -> None:
        """Free the cells that every ray from knee height up passed, per half degree of azimuth, up to the first obstacle."""
        eye = frame.world_from_camera[:3, 3]
        offset = points[:, :2] - eye[:2].astype(np.float32)
        reach = np.hypot(offset[:, 0], offset[:, 1])
        bins = ((np.arctan2(offset[:, 1], offset[:, 0]) + np.float32(math.pi)) * np.float32(BINS / math.tau)).astype(
            np.intp
        ) % BINS
        slope = (points[:, 2] - np.float32(eye[2])) / np.maximum(reach, np.float32(1e-3))
        stop, floor_end, lowest = (
            np.full(BINS, np.inf, np.float32),
            np.zeros(BINS, np.float32),
            np.full(BINS, np.inf, np.float32),
        )
        solid = (points[:, 2] >= FLOOR_M) & (points[:, 2] <= BAND_TOP_M)
        np.minimum.at(stop, bins[solid], reach[solid])
        np.maximum.at(floor_end, bins[~solid], np.where(np.abs(points[:, 2]) < FLOOR_M, reach, 0)[~solid])
        np.minimum.at(lowest, bins, slope)
        begin = np.where(lowest < 0, (KNEE_M - eye[2]) / np.minimum(lowest, -1e-6), np.inf)
        end = np.where(np.isfinite(stop), stop - self.resolution_m, floor_end)
        angles = (np.arange(BINS) + 0.5) * (math.tau / BINS) - math.pi
        steps = np.arange(0, RANGE_M * 1.5, self.resolution_m / 2)
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
