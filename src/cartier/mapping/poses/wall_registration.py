"""Registration of two floor plans by their walls: near a proposed motion, and whether another one does better."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.mapping.poses.registration import about_z
from cartier.mapping.walls import walls_yaw
from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Floats = npt.NDArray[np.float64]
SIGMA_M = 0.08  # how far a wall may lie from a wall and still be on it, mostly
BESIDE_M = 0.1
ON_FREE = -0.5  # what it costs that a wall of one plan is free floor in the other
STEPS_RAD = np.deg2rad(np.arange(-2, 2.1, 1.0))  # walls' directions are known to a degree
AS_GOOD = 0.9  # of the best score that any motion has
ON_WALLS, ON_FLOOR = 0.9, 0.8  # so much that both plans know must lie on its like, whichever is laid on the other
FEWEST_CELLS = 60  # of walls that both plans know


class ByWalls(NamedTuple):
    """The motion (4, 4), which shares of known walls and free floor lie on their like, whichever plan is laid on the
    other, and whether no other motion does better."""

    old_from_new: Floats
    on_walls: float
    on_floor: float
    best: bool

    @property
    def agree(self) -> bool:
        """Whether the two may be plans of one home."""
        return self.best and self.on_walls >= ON_WALLS and self.on_floor >= ON_FLOOR


def register_walls(old: OccupancyGrid, new: OccupancyGrid, proposed: Floats) -> ByWalls:
    """Refine a motion (4, 4) so that walls lie on walls, and compare it with the best motion that there is."""
    from scipy.optimize import minimize

    field, apart_m = _field(old)
    walls, floor = _centres(new, OCCUPIED), _centres(new, FREE)
    middle = walls.mean(axis=0) if len(walls) else np.zeros(2)
    start = proposed[:2, :2] @ middle + proposed[:2, 3]

    def cost(step: Floats) -> float:
        motion = _about(proposed, step, middle, start)
        return -_score(field, old, _placed(motion, walls), _placed(motion, floor))

    found = minimize(cost, np.zeros(3), method="Nelder-Mead", options={
        "initial_simplex": np.array([(0, 0, 0), (0.02, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]), "xatol": 1e-3, "fatol": 1e-2,
        "maxfev": 200,
    })  # fmt: skip
    refined = _about(proposed, found.x, middle, start)
    back, apart_of_new_m = np.asarray(np.linalg.inv(refined), np.float64), _field(new)[1]
    on_walls = min(_on(apart_m, old, new, refined, OCCUPIED), _on(apart_of_new_m, new, old, back, OCCUPIED))
    on_floor = min(_on(apart_m, old, new, refined, FREE), _on(apart_of_new_m, new, old, back, FREE))
    best = -float(found.fun) >= AS_GOOD * _best(field, old, new, walls, floor, proposed)
    return ByWalls(refined, on_walls, on_floor, best)


def _on(apart_m: Floats, grid: OccupancyGrid, laid: OccupancyGrid, motion: Floats, kind: int) -> float:
    """Which share of the walls or free cells of a plan that is laid on another one lies on its like, where both are
    known; 0 with too few. ``apart_m`` (H, W) is how far each cell of the other is from a wall."""
    at = grid.cell(_placed(motion, _centres(laid, kind)))
    at = at[((at >= 0) & (at < grid.cells.shape)).all(axis=1)]
    at = at[grid.cells[at[:, 0], at[:, 1]] != UNKNOWN]
    if len(at) < FEWEST_CELLS:
        return 0.0
    on = apart_m[at[:, 0], at[:, 1]] <= BESIDE_M if kind == OCCUPIED else grid.cells[at[:, 0], at[:, 1]] == FREE
    return float(on.mean())


def _field(grid: OccupancyGrid) -> tuple[Floats, Floats]:
    """What it is worth (H, W) that a wall lies in a cell, and how far each cell is from a wall (m)."""
    from scipy.ndimage import distance_transform_edt

    apart_m = distance_transform_edt(grid.cells != OCCUPIED) * grid.resolution_m
    on = np.exp(-np.square(apart_m / SIGMA_M) / 2)
    return np.where((grid.cells == FREE) & (on < 0.1), ON_FREE, on), apart_m


def _score(field: Floats, grid: OccupancyGrid, walls: Floats, floor: Floats) -> float:
    """What is gained where walls (n, 2) lie on walls, less what is lost where floor (m, 2) or walls lie wrong."""
    from scipy.ndimage import map_coordinates

    wall, free = (
        map_coordinates(field, ((points - grid.origin_xy) / grid.resolution_m - 0.5)[:, ::-1].T, order=1, cval=0.0)
        for points in (walls, floor)
    )
    return float(wall.sum() + ON_FREE * np.maximum(free, 0).sum())


def _best(
    field: Floats, old: OccupancyGrid, new: OccupancyGrid, walls: Floats, floor: Floats, proposed: Floats
) -> float:
    """The best score of any motion: all shifts, in the four directions that walls allow."""
    from scipy.signal import fftconvolve

    yaws = walls_yaw(old), walls_yaw(new)
    turn = float(np.arctan2(proposed[1, 0], proposed[0, 0]))
    if yaws[0] is not None and yaws[1] is not None:
        turn = yaws[0] - yaws[1]
    best, solid = 0.0, np.maximum(field, 0)
    for yaw in np.add.outer(np.arange(4) * np.pi / 2, STEPS_RAD).ravel() + turn:
        rotation = about_z(float(yaw))[:2, :2]
        turned = [points @ rotation.T / old.resolution_m for points in (walls, floor)]
        low = np.floor(np.concatenate(turned).min(axis=0)).astype(int)
        shape = np.ceil(np.concatenate(turned).max(axis=0)).astype(int) - low + 1
        images = []
        for points in turned:
            image = np.zeros(shape[::-1])
            cells = np.floor(points).astype(int) - low
            np.add.at(image, (cells[:, 1], cells[:, 0]), 1.0)
            images.append(image[::-1, ::-1])
        total = fftconvolve(field, images[0]) + ON_FREE * fftconvolve(solid, images[1])
        best = max(best, float(total.max()))
    return best


def _centres(grid: OccupancyGrid, kind: int) -> Floats:
    return np.asarray(grid.centre(np.argwhere(grid.cells == kind)), np.float64).reshape(-1, 2)


def _placed(motion: Floats, points: Floats) -> Floats:
    return np.asarray(points @ motion[:2, :2].T + motion[:2, 3])


def _about(proposed: Floats, step: Floats, middle: Floats, start: Floats) -> Floats:
    """The proposed motion, turned by ``step[0]`` about the middle of the walls and shifted by the rest."""
    motion = proposed.copy()
    motion[:3, :3] = about_z(float(step[0])) @ proposed[:3, :3]
    motion[:2, 3] = start + step[1:] - motion[:2, :2] @ middle
    return motion
