"""Knowledge of the exploring robot: its own floor plan from depth, its collisions, and what it has not yet seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from cartier.geometry import backproject, transform
from cartier.mapping.config import OccupancyConfig
from cartier.mapping.occupancy import OccupancyMapper
from cartier.navigation.planning import traversable
from cartier.types import FREE, OCCUPIED, UNKNOWN, Camera, Frame, OccupancyGrid

NEAR_M = 2.5  # an obstacle counts as seen from no farther than this
SIGHT_M = 2.3  # how far ahead a view is worth something: less, so that what it promises it keeps
TRIES = 2  # a cell that so many views did not settle is given up
FRONTIER = 20.0  # worth of an unknown cell that may lead on, in cells of obstacles not yet seen from near
AZIMUTHS = 72
STEP_M = 0.05
TOP_M = 1.2  # what is lower has a top that can be looked at

Layer = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]


class Knowledge:
    """Grows frame by frame, from depth and bumps alone. What it knows is there after the first frame.

    ``grid`` is the floor plan with the bumps in it, ``open`` (rows, cols) where the robot may drive, ``worth`` (rows,
    cols) what each cell is worth looking at.
    """

    def __init__(self, camera: Camera, radius_m: float, eye_m: float) -> None:
        self._camera, self._radius_m, self._eye_m = camera, radius_m, eye_m
        self._config = OccupancyConfig(robot_radius_m=radius_m)
        self._mapper = OccupancyMapper(self._config, exact=True)
        self._black = np.zeros((camera.height, camera.width, 3), np.uint8)
        self._near = self._tries = self._bumps = np.zeros((0, 0), np.uint8)
        self._at_m = np.arange(0.3, SIGHT_M, STEP_M)
        turn = np.arange(AZIMUTHS) * (math.tau / AZIMUTHS)
        self._rays = self._at_m[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)[:, None]  # (azimuth, step, 2)
        self.half_width = math.atan((camera.width / 2) / camera.fx)
        self._half_height = math.atan((camera.height / 2) / camera.fy)
        self.grid: OccupancyGrid
        self.open: npt.NDArray[np.bool_]
        self.worth: Floats
        self._height_m: npt.NDArray[np.float32]
        self._tops: npt.NDArray[np.float32]

    def add(self, index: int, world_from_camera: Floats, depth_m: npt.NDArray[np.float32]) -> None:
        """Take in one view: extend the floor plan, and note which obstacles were seen from near."""
        self._mapper.add(Frame(index, 0.0, self._black, depth_m, world_from_camera, self._camera))
        self._settle()
        points = backproject(depth_m, self._camera, 2).reshape(-1, 3)
        points = points[(points[:, 2] > 0) & (points[:, 2] <= NEAR_M)]
        xyz = transform(world_from_camera, points)
        solid = (xyz[:, 2] > self._config.floor_m) & (xyz[:, 2] < self._config.band_top_m)
        rows, cols = self.grid.cell(xyz[solid, :2]).T
        self._near[rows, cols] = 1
        self._weigh(world_from_camera[:2, 3])

    def bump(self, xy: Floats, heading: float) -> None:
        """Something stopped the robot ahead: an obstacle at its rim, although nothing was seen there."""
        turn = heading + np.linspace(-0.6, 0.6, 9)
        rim = xy + (self._radius_m + 0.5 * self.grid.resolution_m) * np.stack([np.cos(turn), np.sin(turn)], 1)
        rows, cols = self.grid.cell(rim).T
        self._bumps[rows, cols] = 1
        self._settle()
        self._weigh(xy)

    def gains(self, xy: Floats) -> Floats:
        """(K, AZIMUTHS): what would be seen anew in each direction from points (K, 2), in cells."""
        rows, cols, seen = self._visible(xy)
        area = self._at_m * (math.tau / AZIMUTHS) * STEP_M / self.grid.resolution_m**2
        return np.asarray((self.worth[rows, cols] * seen * area).sum(2))

    def give_up(self, xy: Floats, yaw: float, down: float, half_width: float) -> None:
        """Count one more try for all that a view from here should have settled, and did not."""
        rows, cols, seen = self._visible(xy[None], down)
        off = np.remainder(np.arange(AZIMUTHS) * (math.tau / AZIMUTHS) - yaw + math.pi, math.tau) - math.pi
        seen = seen[0] & (np.abs(off) <= half_width)[:, None]
        tried = np.zeros(self.worth.shape, bool)
        tried[rows[0][seen], cols[0][seen]] = True
        tried &= self.worth > 0
        self._tries += tried.astype(np.uint8)
        self.worth[self._tries >= TRIES] = 0

    def straight(self, a: Floats, b: Floats) -> bool:
        """Whether the robot may drive straight from a to b, as far as it knows."""
        steps = max(2, math.ceil(float(np.linalg.norm(b - a)) / 0.02))
        rows, cols = self.grid.cell(np.linspace(a, b, steps)).T
        return bool(self.open[rows, cols].all())

    def _visible(
        self, xy: Floats, down: float = math.radians(22.5)
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Rows, columns (K, azimuth, step) along rays from points, and which of these cells can be seen over what is
        known."""
        grid = self.grid
        cells = grid.cell(xy[:, None, None] + self._rays)
        shape = np.array(grid.cells.shape)
        inside = ((cells >= 0) & (cells < shape)).all(-1)
        rows, cols = np.moveaxis(np.clip(cells, 0, shape - 1), -1, 0)
        slope = (self._height_m[rows, cols] - self._eye_m) / self._at_m
        highest = np.maximum.accumulate(slope, axis=2)
        lowest = -math.tan(min(down + self._half_height, 1.5))
        before = np.concatenate([np.full_like(slope[..., :1], lowest), np.maximum(highest[..., :-1], lowest)], 2)
        return rows, cols, inside & (slope >= before - 1e-6)

    def _settle(self) -> None:
        """The mapper's grid with the bumps in it; layers follow as it grows."""
        old, grid = getattr(self, "grid", None), self._mapper.grid()
        assert grid is not None
        if old is None or old.cells.shape != grid.cells.shape or old.origin_xy != grid.origin_xy:
            self._near, self._tries, self._bumps = (
                _moved(layer, old, grid) for layer in (self._near, self._tries, self._bumps)
            )
        grid.cells[self._bumps > 0] = OCCUPIED
        self.grid, self.open = grid, traversable(grid, self._radius_m)
        # Lintels and lamps above free floor hide nothing; a table top goes on behind its edge.
        self._height_m = np.where(grid.cells == OCCUPIED, grid.height_m, 0).astype(np.float32)
        tops = np.where(self._height_m < TOP_M, self._height_m, 0)
        self._tops = np.where(grid.cells == UNKNOWN, ndimage.grey_dilation(tops, (3, 3)), 0)
        self._height_m += self._tops

    def _weigh(self, xy: Sequence[float] | Floats) -> None:
        """What each cell is worth looking at: unknown cells beside floor that can be reached, obstacles not seen from
        near."""
        parts, _ = ndimage.label(self.open, np.ones((3, 3)))
        cells = np.argwhere(self.open)
        reached = self.open
        if len(cells):
            here = cells[np.linalg.norm(cells - self.grid.cell(xy), axis=1).argmin()]
            reached = parts == parts[tuple(here)]
        self.worth = np.zeros(self.open.shape)
        self.worth[((self.grid.cells == OCCUPIED) & (self._near == 0)) | (self._tops > 0)] = 1.0
        self.worth[(self.grid.cells == UNKNOWN) & ndimage.binary_dilation(reached)] = FRONTIER
        self.worth[(self._tries >= TRIES) | (self._bumps > 0)] = 0


def _moved(layer: Layer, old: OccupancyGrid | None, new: OccupancyGrid) -> Layer:
    """A layer of the old grid's shape, in that of the new one, which holds the old."""
    grown = np.zeros(new.cells.shape, np.uint8)
    if old is not None:
        row, col = np.rint((np.array(old.origin_xy) - new.origin_xy) / new.resolution_m).astype(int)[::-1]
        grown[row : row + layer.shape[0], col : col + layer.shape[1]] = layer
    return grown


def coverage(grid: OccupancyGrid, truth: OccupancyGrid, reachable: npt.NDArray[np.bool_]) -> float:
    """Share of the truly reachable cells that a grid knows to be free."""
    xy = truth.centre(np.argwhere(reachable))
    rows, cols = grid.cell(xy).T
    inside = (rows >= 0) & (cols >= 0) & (rows < grid.cells.shape[0]) & (cols < grid.cells.shape[1])
    return float((grid.cells[rows[inside], cols[inside]] == FREE).sum() / max(1, len(xy)))
