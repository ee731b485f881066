"""Goal planning: a reachable, collision-free pose near a place that faces it and, where possible, sees it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief, check_radius
from cartier.geometry import box_distance, yaw_towards
from cartier.navigation.search import shortest
from cartier.types import FREE, OCCUPIED, Array, Goal, OccupancyGrid, Place, RobotModel, Room

CAMERA_HEIGHT_M = RobotModel.camera_height_m
NEAREST_M = 0.35  # from closer to an object's centre, its direction is ambiguous
FARTHEST_M = 2.0  # from farther away, the object counts as out of reach
VIEWING_DISTANCE = 0.45  # preferred distance, in largest sides of the object: from nearer a fridge looks like a wall
MAX_VIEWING_DISTANCE_M = 0.8
SIGHT_DETOUR_M = 0.75  # how much worse the distance of a pose with line of sight may be than that of the best without
OWN_M = 0.15  # around the box of an object, what is occupied is taken for the object
OWN_HEIGHT_M = 0.4  # how far an object of unknown size may reach above its centre
MAX_START_M = 1e6  # from the map's origin
SNAP_M = 1.0  # how far the start may be moved to floor that the robot fits on


@dataclass(frozen=True, eq=False)
class Reach:
    """Where a robot of one radius can get from one start: path lengths (rows, cols) in metres, inf where it cannot."""

    grid: OccupancyGrid
    start: tuple[int, int]
    length_m: npt.NDArray[np.float64]
    previous: npt.NDArray[np.int32]

    def way_m(self, box_min: Sequence[float], box_max: Sequence[float]) -> float | None:
        """The length (m) of the way to the nearest cell beside a box; None where none within 2 m can be reached."""
        for near_m in (MAX_VIEWING_DISTANCE_M, FARTHEST_M):
            first = np.maximum(self.grid.cell(np.array(box_min[:2]) - near_m), 0)
            last = np.maximum(self.grid.cell(np.array(box_max[:2]) + near_m) + 1, 0)
            shortest = float(self.length_m[first[0] : last[0], first[1] : last[1]].min(initial=np.inf))
            if np.isfinite(shortest):
                return shortest
        return None

    def path(self, cell: tuple[int, ...]) -> npt.NDArray[np.float64]:
        """The shortest path (K, 2) of xy from the start to a reachable cell (row, col)."""
        columns = self.length_m.shape[1]
        flat = [int(cell[0]) * columns + int(cell[1])]
        while (before := int(self.previous[divmod(flat[-1], columns)])) >= 0:
            flat.append(before)
        return self.grid.centre(np.array([divmod(f, columns) for f in reversed(flat)]))


def traversable(grid: OccupancyGrid, radius_m: float) -> npt.NDArray[np.bool_]:
    """Cells (rows, cols) that the robot's centre may occupy: known free, and no occupied cell within the radius.

    Unknown cells count as free of obstacles at the robot's rim, but its centre never enters one.
    """
    occupied: npt.NDArray[np.bool_] = grid.cells == OCCUPIED
    near_cells = radius_m / grid.resolution_m + math.sqrt(0.5)  # a cell reaches up to half its diagonal from its centre
    high = math.ceil(near_cells) - 1
    rows, cols = occupied.shape
    before = np.cumsum(np.pad(occupied, ((high, high), (high + 1, high))), axis=1, dtype=np.int32)
    blocked = np.zeros(occupied.shape, bool)
    for down in range(-high, high + 1):  # the disc, row by row
        wide = math.ceil(math.sqrt(max(near_cells**2 - down**2, 0))) - 1
        counts = before[high + down : high + down + rows]
        blocked |= counts[:, high + wide + 1 : high + wide + 1 + cols] > counts[:, high - wide : high - wide + cols]
    return np.asarray((grid.cells == FREE) & ~blocked)


def start_cell(
    grid: OccupancyGrid, open_cells: npt.NDArray[np.bool_], start_xy: Sequence[float]
) -> tuple[int, int] | None:
    """The cell (row, col) where a drive from a start begins; see ``reach``. None if no floor fits the robot near it."""
    here = np.asarray(start_xy, dtype=np.float64)
    return _way_in(grid, here, _near(grid, open_cells, here))


def check_start(start_xy: Sequence[float] | Array) -> tuple[float, float]:
    """A start as (x, y) in metres, or an InputError unless it is two finite numbers."""
    try:
        start = np.asarray(start_xy, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):  # no numbers, or one of hundreds of digits
        start = np.empty(0)
    if start.shape != (2,) or not (np.abs(start) <= MAX_START_M).all():  # NaN is not
        raise InputError(f"the start must be two finite numbers, x and y in metres, got {brief(start_xy)}")
    return float(start[0]), float(start[1])


def reach(grid: OccupancyGrid, start_xy: Sequence[float] | Array, radius_m: float) -> Reach | None:
    """Shortest paths from a start to everywhere (Dijkstra, 8-connected), or None if no floor fits the robot near it.

    A start where the robot does not fit, or that is unknown, is moved to the nearest floor that no known obstacle
    separates from it. Raises InputError for an invalid start or radius.
    """
    return _reach(grid, check_start(start_xy), check_radius(radius_m))


@lru_cache(maxsize=8)  # many requests come from one start
def _reach(grid: OccupancyGrid, start_xy: tuple[float, float], radius_m: float) -> Reach | None:
    open_cells = traversable(grid, radius_m)
    start = start_cell(grid, open_cells, start_xy)
    if start is None:
        return None
    length_m, before = shortest(open_cells, start, grid.resolution_m)
    return Reach(grid, start, length_m, before)


def plan(grid: OccupancyGrid, place: Place, start_xy: Sequence[float], robot: RobotModel) -> tuple[Goal | None, str]:
    """A goal for a place, and an empty string; or None, and one line that says why there is none.

    Raises InputError for an invalid start or radius.
    """
    radius_m = robot.radius_m
    area = reach(grid, start_xy, radius_m)
    if area is None:
        return None, no_start(grid, traversable(grid, radius_m), start_xy, radius_m)
    goal = goal_for(area, place, robot.camera_height_m)
    return goal, no_pose(place, start_xy) if goal is None else ""


def no_start(grid: OccupancyGrid, open_cells: npt.NDArray[np.bool_], start_xy: Sequence[float], radius_m: float) -> str:
    """Why no drive can begin at a start."""
    at, fits = _in_words(start_xy), f"known free floor that fits a robot of radius {radius_m} m"
    if len(_near(grid, open_cells, np.asarray(start_xy))):
        return f"the start {at} is cut off by a known obstacle from all {fits} within {SNAP_M} m"
    return f"there is no {fits} within {SNAP_M} m of the start {at}"


def no_pose(place: Place, start_xy: Sequence[float]) -> str:
    """Why a drive from a start ends nowhere."""
    return f"no pose within {FARTHEST_M} m of the {place.label} can be reached from {_in_words(start_xy)}"


def _in_words(xy: Sequence[float]) -> str:
    return f"({xy[0]:.2f}, {xy[1]:.2f})"


def goal_for(area: Reach, place: Place, camera_height_m: float = CAMERA_HEIGHT_M) -> Goal | None:
    """The reachable pose at the best distance from a place, preferably one with line of sight; None if all are too far.

    The best distance is 0 for a place of unknown size, otherwise ``VIEWING_DISTANCE`` times the largest side. A pose
    with line of sight is chosen if its distance is at most ``SIGHT_DETOUR_M`` worse than the best.
    """
    reachable = np.isfinite(area.length_m)
    poses = poses_at(area.grid, reachable, place, area.length_m)
    if not len(poses.cells):
        return None
    if place.view_yaw is not None:
        return _goal(area, tuple(poses.cells[0]), place.view_yaw, place, bool(poses.off_m[0] < 0.5))
    near = np.flatnonzero(poses.off_m <= poses.off_m[0] + SIGHT_DETOUR_M)
    xy = area.grid.centre(poses.cells)
    seen = next((i for i in near if line_of_sight(area.grid, xy[i], place, camera_height_m)), None)
    chosen = near[0] if seen is None else seen
    yaw = yaw_towards(*xy[chosen], *place.position[:2])
    return _goal(area, tuple(poses.cells[chosen]), yaw, place, seen is not None)


class Poses(NamedTuple):
    """Cells (N, 2) where a robot may stand at a place, best first, and how far (m) each is off the best distance."""

    cells: npt.NDArray[np.intp]
    off_m: npt.NDArray[np.float64]


def poses_at(
    grid: OccupancyGrid, reachable: npt.NDArray[np.bool_], place: Place, length_m: npt.NDArray[np.float64] | None = None
) -> Poses:
    """The reachable cells (rows, cols) at a place: by distance, in steps of 1 cm, then by the length of the way.

    Cells of the place's room come alone if there are any. What stands between a cell and the object counts as distance:
    a chair is used from its free side, not across the table. At a viewpoint it is the nearest cell alone.
    """
    target, wanted_m = np.array(place.position), 0.0
    low = high = target
    if place.box_min is not None and place.box_max is not None:
        low, high = np.array(place.box_min), np.array(place.box_max)
        wanted_m = min(VIEWING_DISTANCE * float((high - low).max()), MAX_VIEWING_DISTANCE_M)
    reach_m = FARTHEST_M + grid.resolution_m
    top_left = np.maximum(grid.cell(np.minimum(low, target)[:2] - reach_m), 0)
    bottom_right = np.maximum(grid.cell(np.maximum(high, target)[:2] + reach_m) + 1, 0)
    window = slice(top_left[0], bottom_right[0]), slice(top_left[1], bottom_right[1])
    cells = np.argwhere(reachable[window]) + top_left
    xy = grid.centre(cells)
    distance = box_distance(xy, low[:2], high[:2])
    if place.view_yaw is not None:  # the place is a viewpoint: stand there, with the same heading
        best = np.argsort(distance, kind="stable")[:1]
        best = best[distance[best] <= FARTHEST_M]
        return Poses(cells[best], distance[best])
    if place.room_cells is not None:
        floor = np.zeros(grid.cells.shape, bool)
        floor[tuple(place.room_cells.T)] = True
        inside = floor[tuple(cells.T)] & (distance <= FARTHEST_M)
        if inside.any():
            cells, xy, distance = cells[inside], xy[inside], distance[inside]
    off_m = np.abs(distance - wanted_m)
    if place.box_min is not None:
        off_m += _across_m(grid, xy, low[:2], high[:2])
    far = np.zeros(len(cells)) if length_m is None else length_m[tuple(cells.T)]
    order = np.lexsort((far, np.round(off_m, 2)))
    near = (np.linalg.norm(xy - target[:2], axis=1)[order] >= NEAREST_M) & (distance[order] <= FARTHEST_M)
    return Poses(cells[order[near]], off_m[order[near]])


def _across_m(grid: OccupancyGrid, xy: Array, low: Array, high: Array) -> npt.NDArray[np.float64]:
    """How much (N,) of the straight lines from points (N, 2) to a box is occupied by other things (m)."""
    step_m = 2 * grid.resolution_m
    steps = np.arange(0.0, FARTHEST_M, step_m)
    ways = np.clip(xy, low, high) - xy
    lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-6)
    rows, cols = np.moveaxis(grid.cell(xy[:, None] + (steps / lengths[:, None])[..., None] * ways[:, None]), -1, 0)
    checked = (steps < lengths[:, None] - OWN_M) & (rows >= 0) & (cols >= 0)
    checked &= (rows < grid.cells.shape[0]) & (cols < grid.cells.shape[1])
    met = grid.cells[np.where(checked, rows, 0), np.where(checked, cols, 0)] == OCCUPIED
    return np.asarray((met & checked).sum(1) * step_m, np.float64)


def line_of_sight(
    grid: OccupancyGrid, from_xy: npt.NDArray[np.float64], place: Place, camera_height_m: float = CAMERA_HEIGHT_M
) -> bool:
    """Whether the line from the robot's camera to the place passes over everything known, in the 2.5-D grid.

    Within 0.3 m of the place, surfaces no higher than the object are the object itself; the last 0.1 m are not checked.
    """
    return bool(lines_of_sight(grid, from_xy[None], place, camera_height_m)[0])


def lines_of_sight(
    grid: OccupancyGrid, from_xy: npt.NDArray[np.float64], place: Place, camera_height_m: float = CAMERA_HEIGHT_M
) -> npt.NDArray[np.bool_]:
    """``line_of_sight`` (N,) from each of some points (N, 2)."""
    target = np.array(place.position)
    own_top_m = (place.box_max[2] if place.box_max else target[2] + OWN_HEIGHT_M) + 0.1
    spans = target[:2] - from_xy
    lengths = np.hypot(*spans.T)[:, None]
    counts = np.ceil((lengths - 0.1 - grid.resolution_m) / (grid.resolution_m / 2))
    steps = grid.resolution_m * (1 + np.arange(max(int(counts.max(initial=0)), 0)) / 2)
    far = steps / np.maximum(lengths, grid.resolution_m)  # (N, steps), as shares of the way
    rows, cols = (
        np.floor((from_xy[:, k, None] + far * spans[:, k, None] - grid.origin_xy[k]) / grid.resolution_m).astype(
            np.intp
        )
        for k in (1, 0)
    )
    checked = (np.arange(len(steps)) < counts) & (rows >= 0) & (cols >= 0)
    checked &= (rows < grid.cells.shape[0]) & (cols < grid.cells.shape[1])
    line_m = camera_height_m + (target[2] - camera_height_m) * far + 0.05
    line_m = np.where(lengths - steps < 0.3, np.maximum(line_m, own_top_m), line_m)
    tops_m = grid.height_m[np.where(checked, rows, 0), np.where(checked, cols, 0)]
    return np.asarray(~((tops_m > line_m) & checked).any(1))


def _near(
    grid: OccupancyGrid, open_cells: npt.NDArray[np.bool_], start_xy: npt.NDArray[np.float64]
) -> npt.NDArray[np.intp]:
    """The open cells (N, 2) to which a start may be moved, nearest first."""
    top_left = np.maximum(grid.cell(start_xy - SNAP_M - grid.resolution_m), 0)
    bottom_right = np.maximum(grid.cell(start_xy + SNAP_M + grid.resolution_m) + 1, 0)
    cells = np.argwhere(open_cells[top_left[0] : bottom_right[0], top_left[1] : bottom_right[1]]) + top_left
    distance_m = np.hypot(*(grid.centre(cells) - start_xy).T)
    order = np.argsort(distance_m, kind="stable")
    return np.asarray(cells[order[distance_m[order] <= SNAP_M]])


def _way_in(
    grid: OccupancyGrid, start_xy: npt.NDArray[np.float64], cells: npt.NDArray[np.intp]
) -> tuple[int, int] | None:
    """The first of some cells to which a straight line from the start crosses no occupied cell.

    A start inside an obstacle (a camera held over a table) may leave that obstacle, but not enter another.
    """
    for cell in cells:
        end = grid.centre(cell)
        steps = max(2, math.ceil(float(np.linalg.norm(end - start_xy)) / grid.resolution_m * 8))
        rows, cols = grid.cell(np.linspace(start_xy, end, steps)).T
        inside = (rows >= 0) & (cols >= 0) & (rows < grid.cells.shape[0]) & (cols < grid.cells.shape[1])
        met = grid.cells[rows[inside], cols[inside]] == OCCUPIED
        out = int(np.argmin(met)) if inside[0] else 0  # where the line leaves the obstacle that it starts in
        if not met[out:].any():
            return int(cell[0]), int(cell[1])
    return None


def _goal(area: Reach, cell: tuple[int, ...], yaw: float, place: Place, seen: bool) -> Goal:
    path = area.path(cell)
    x, y = path[-1]
    return Goal(float(x), float(y), float(yaw), path, float(area.length_m[cell]), place, seen)


def room_middle(room: Room, grid: OccupancyGrid) -> tuple[float, float]:
    """Where to drive to be in a room: (x, y) of the cell of its free floor that is farthest from all else, in metres.

    It is a cell of the room. Of a room without any free floor it is the one in the middle of all of its cells.
    """
    from scipy.ndimage import distance_transform_edt

    rows, cols = room.cells.T
    free = np.zeros(np.add(grid.cells.shape, 2), bool)
    free[rows + 1, cols + 1] = grid.cells[rows, cols] == FREE
    if not free.any():
        free[rows + 1, cols + 1] = True
    open_cells = np.asarray(distance_transform_edt(free))[1:-1, 1:-1]
    x, y = grid.centre(np.array(np.unravel_index(int(open_cells.argmax()), open_cells.shape))).tolist()
    return x, y
