"""A floor plan from depth: free, occupied and unknown kept apart; and its Nav2 map_server files.

A cell is *occupied* where points were seen in the robot's height band, *free* where the floor was seen or where every
ray down to knee height passed, and *unknown* otherwise. A ray that reads nothing, or passes below the floor, may have met
black leather, glass or a stairwell: rays above it clear nothing from there on. Obstacles win over free space, unless the
floor was seen far more often: a chair that was moved does not haunt the map, and neither does its height.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import backproject, invert, transform
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
FARTHEST_M = 1e5  # from the world's origin: beyond, cells and points in float32 tell nothing any more
WIDEST = 20.0  # slopes of rays that are looked at: what lenses there are see less than 87 degrees off their axis
BINS = 720  # azimuth bins of half a degree
BESIDE = 3  # bins to each side of a ray without a reading that it speaks for, too: about the width of a pixel near by
SINK_M = 0.25  # how far a height falls in a frame that looks through its top
THROUGH_M = 0.15  # how much farther than the top a ray must end to have passed through it


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

        Raises InputError if the pose lies so far from the others that the grid would exceed 200 m, or 100 km from the origin.
        """
        camera = frame.world_from_camera[:3, 3]
        if np.abs(camera).max() > FARTHEST_M:
            raise InputError(
                f"frame {frame.index}: its pose at ({camera[0]:.4g}, {camera[1]:.4g}, {camera[2]:.4g}) m is more than "
                f"{FARTHEST_M / 1000:.0f} km from the origin; is it in another unit, or geographic?"
            )
        rays, z = self._rays(frame)
        points = transform(frame.world_from_camera, rays * z[:, None])
        lost = np.isnan(z) | (points[:, 2] < -FLOOR_M)
        near = z <= RANGE_M  # no NaN either
        self._cover(camera[:2], points[near, :2], frame.index)
        self._walk(camera[:2])
        if near.any():
            self._sink(frame)
            self._mark(points[near])
            self._cast(frame, points[near], self._first_lost(frame, rays[lost]))

    def _rays(self, frame: Frame) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """The pixels that are looked at: points (N, 3) of their rays at 1 m, and z-depth (N,), NaN for what is no depth."""
        assert frame.depth_m is not None
        stride = max(1, frame.camera.width // COLUMNS)
        depth_m = frame.depth_m[::stride, ::stride].ravel()
        with np.errstate(over="ignore", invalid="ignore"):  # of an impossible lens, whose rays are dropped
            flat = np.broadcast_to(np.float32(1), frame.depth_m.shape)
            rays = backproject(flat, frame.camera, stride).reshape(-1, 3)
        sane = (np.abs(rays[:, 0]) <= WIDEST) & (np.abs(rays[:, 1]) <= WIDEST)
        rays, depth_m = rays[sane], depth_m[sane]
        return rays, np.where((depth_m > 0) & (depth_m <= MAX_SIDE_M), depth_m, np.float32(np.nan))

    def _first_lost(self, frame: Frame, rays: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Per azimuth bin how far off the first of some rays would meet the floor; infinite where none does."""
        ways = rays @ frame.world_from_camera[:3, :3].T.astype(np.float32)
        ways = ways[ways[:, 2] < 0]
        across = np.hypot(ways[:, 0], ways[:, 1])
        first = np.full(BINS, np.inf, np.float32)
        np.minimum.at(first, _bins(ways), across / -ways[:, 2] * np.float32(frame.world_from_camera[2, 3]))
        return np.minimum.reduce([np.roll(first, k) for k in range(-BESIDE, BESIDE + 1)])

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
        solid = self._occupied * FREE_BEATS_OCCUPIED > self._floor
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
        shape = np.array(self._occupied.shape)
        step = max(1, round(1 / self.resolution_m))
        if self._occupied.size:
            if (low >= self._low).all() and (high <= self._low + shape).all():
                return
            self._check_side(low, high, camera_xy, index)
            low = np.where(low < self._low, low - step, self._low)
            high = np.where(high > self._low + shape, high + step, self._low + shape)
        else:
            low, high = low - step, high + step
        before: npt.NDArray[np.int64] = self._low - low if self._occupied.size else np.zeros(2, np.int64)
        after = high - low - before - shape
        pad = [(int(before[0]), int(after[0])), (int(before[1]), int(after[1]))]
        self._occupied, self._floor, self._passed = (
            np.pad(layer, pad) for layer in (self._occupied, self._floor, self._passed)
        )
        self._height_m = np.pad(self._height_m, pad)
        self._low = low

    def _check_side(
        self, low: npt.NDArray[np.int64], high: npt.NDArray[np.int64], camera_xy: npt.NDArray[np.float64], index: int
    ) -> None:
        """Raise InputError if what is known and cells from ``low`` to ``high`` lie farther apart than a map may be wide."""
        known = (self._occupied > 0) | (self._floor > 0) | (self._passed > 0)
        for axis in (0, 1):
            cells = np.flatnonzero(known.any(1 - axis)) + self._low[axis]
            side = max(int(high[axis]), int(cells[-1]) + 1) - min(int(low[axis]), int(cells[0]))
            if side > round(MAX_SIDE_M / self.resolution_m):
                raise InputError(
                    f"frame {index}: its pose at ({camera_xy[0]:.1f}, {camera_xy[1]:.1f}) m would make the map larger than "
                    f"{MAX_SIDE_M:.0f} m; is it an outlier, or in another unit?"
                )

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

    def _sink(self, frame: Frame) -> None:
        """Lower the heights through whose tops this frame looks: what stood there is gone."""
        assert frame.depth_m is not None
        reach = math.ceil(RANGE_M / self.resolution_m)
        middle = self._cells(frame.world_from_camera[None, :2, 3])
        row, col = (slice(max(0, int(c[0]) - reach), int(c[0]) + reach) for c in middle)
        near = self._height_m[row, col]
        rows, cols = np.nonzero(near)
        tops = near[rows, cols].astype(np.float32)
        xy = (np.stack([cols + col.start, rows + row.start], 1) + self._low[::-1] + 0.5) * self.resolution_m
        camera = frame.camera
        x, y, z = transform(invert(frame.world_from_camera), np.column_stack([xy, tops]).astype(np.float64)).T
        z = np.where(z > THROUGH_M, z, np.nan)
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        seen = np.flatnonzero((u >= 0) & (u < camera.width - 1) & (v >= 0) & (v < camera.height - 1))
        ends = frame.depth_m[np.rint(v[seen]).astype(np.intp), np.rint(u[seen]).astype(np.intp)]
        gone = seen[ends > z[seen] + THROUGH_M]
        near[rows[gone], cols[gone]] = np.maximum(tops[gone] - SINK_M, 0)

    def _mark(self, points: npt.NDArray[np.floating]) -> None:
        """Count the cells in which this frame shows floor or obstacles, and keep how high the obstacles reach."""
        z = points[:, 2]
        rows, cols = self._cells(points[:, :2])
        flat = rows * self._occupied.shape[1] + cols
        floor, solid = np.abs(z) < FLOOR_M, (z >= FLOOR_M) & (z <= BAND_TOP_M)
        for layer, which in ((self._floor, floor), (self._occupied, solid)):
            cells, count = np.unique(flat[which], return_counts=True)
            layer.reshape(-1)[cells[count >= MIN_POINTS]] += 1
        tall = np.flatnonzero((z >= FLOOR_M) & (z <= SIGHT_TOP_M))
        tall = tall[np.lexsort((z[tall], flat[tall]))]
        cells = flat[tall]
        # the second highest of each cell: one point alone above the others is a flying pixel
        second = (
            np.flatnonzero(np.append(cells[1:-1] != cells[2:], True) & (cells[:-1] == cells[1:]))
            if len(tall) > 1
            else []
        )
        heights, cells = self._height_m.reshape(-1), cells[second]
        heights[cells] = np.maximum(heights[cells], z[tall[second]].astype(np.float16))

    def _cast(self, frame: Frame, points: npt.NDArray[np.floating], first_lost: npt.NDArray[np.float32]) -> None:
        """Free the cells that every ray from knee height up passed, per half degree of azimuth, up to the first obstacle.

        ``first_lost`` (BINS,) is how far off a ray that read nothing would have met the floor: nothing is known beyond.
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
        solid = (points[:, 2] >= FLOOR_M) & (points[:, 2] <= BAND_TOP_M)
        np.minimum.at(stop, bins[solid], reach[solid])
        np.maximum.at(floor_end, bins[~solid], np.where(np.abs(points[:, 2]) < FLOOR_M, reach, 0)[~solid])
        np.minimum.at(lowest, bins, slope)
        begin = np.where(lowest < 0, (KNEE_M - eye[2]) / np.minimum(lowest, -1e-6), np.inf)
        end = np.where(np.isfinite(stop), stop - self.resolution_m, floor_end)
        end = np.minimum(end, first_lost - self.resolution_m)
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


def _bins(offset: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """The azimuth bins of directions (N, 2 or more)."""
    turn = np.arctan2(offset[:, 1], offset[:, 0]) + np.float32(math.pi)
    return np.asarray((turn * np.float32(BINS / math.tau)).astype(np.intp) % BINS)


_PIXELS = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}


def save_map(grid: OccupancyGrid, folder: Path) -> None:
    """Write ``occupancy.pgm`` and ``occupancy.yaml`` as Nav2's map_server reads them, and the heights beside them.

    ``free_thresh`` is 0.196, not Nav2's default of 0.25: unknown is written as 205, that is 0.19608 occupied, which
    a threshold of 0.25 would take for free.
    """
    pixels = np.full(grid.cells.shape, _PIXELS[UNKNOWN], np.uint8)
    for value, pixel in _PIXELS.items():
        pixels[grid.cells == value] = pixel
    rows, cols = grid.cells.shape
    # The first image row is the largest y.
    (folder / "occupancy.pgm").write_bytes(b"P5\n%d %d\n255\n" % (cols, rows) + pixels[::-1].tobytes())
    # YAML takes 1e-05 for text
    resolution, x, y = (np.format_float_positional(v, trim="0") for v in (grid.resolution_m, *grid.origin_xy))
    (folder / "occupancy.yaml").write_text(
        f"image: occupancy.pgm\nmode: trinary\nresolution: {resolution}\norigin: [{x}, {y}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        encoding="utf-8",
    )
    np.save(folder / "occupancy_height_m.npy", grid.height_m, allow_pickle=False)


def load_map(folder: Path) -> OccupancyGrid:
    """The grid that ``save_map`` wrote. Raises InputError for a missing or damaged file."""
    file = folder / "occupancy.yaml"
    try:
        lines = (line.split(":", 1) for line in file.read_text(encoding="utf-8").splitlines() if ":" in line)
        fields = {key.strip(): value.strip() for key, value in lines}
        resolution_m, origin = float(fields["resolution"]), json.loads(fields["origin"])
        file = folder / "occupancy.pgm"
        magic, size, depth, pixels = file.read_bytes().split(b"\n", 3)
        cols, rows = (int(v) for v in size.split())
        if magic != b"P5" or depth != b"255" or len(pixels) != rows * cols:
            raise ValueError(f"{len(pixels)} pixels for a {cols}x{rows} P5 image")
        image = np.frombuffer(pixels, np.uint8).reshape(rows, cols)[::-1]
        cells = np.full(image.shape, UNKNOWN, np.int8)
        cells[image == _PIXELS[FREE]] = FREE
        cells[image == _PIXELS[OCCUPIED]] = OCCUPIED
        file = folder / "occupancy_height_m.npy"
        height_m = np.load(file, allow_pickle=False)
        return OccupancyGrid(cells, resolution_m, (float(origin[0]), float(origin[1])), height_m)
    except (OSError, EOFError, ValueError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"{file} is missing or damaged ({error}): map the recording again") from error
