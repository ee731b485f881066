"""Drive of a simulated base to a pose in its map: route, following and recoveries, at the speeds of Nav2."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from enum import Enum

import numpy as np
import numpy.typing as npt

from cartier.navigation.planning import MAX_START_M, Reach, reach
from cartier_dollhouse.base import AHEAD_M, Base, Pose

SPEED_M_S, TURN_RAD_S = 0.5, 1.0  # those of Nav2's own robots
MARGIN_M = 0.07  # kept free beside the robot where there is room
TOLERANCE_M = 0.2  # a goal may be missed by so much: Nav2's goal checker allows 0.25 m
THERE_M, THERE_RAD, PASSED_M = 0.04, 0.04, 0.08
SHIM_RAD, STRAIGHT_RAD = 0.4, 0.1  # from so far aside on it turns on the spot; where it is tight, sooner
BACK_M_S, BACK_S = -0.15, 1.5
RECOVERIES = 6  # as many as Nav2 tries

Floats = npt.NDArray[np.float64]


class Ending(Enum):
    """How a drive ended."""

    ARRIVED = "arrived"
    OUTSIDE = "the goal lies outside of the map"
    OCCUPIED = "the goal lies in an obstacle"
    NO_PATH = "no path leads to the goal"
    STUCK = "the robot does not get on"


def route(base: Base, goal: Pose) -> list[Pose] | Ending:
    """Where to drive to reach a goal in the map, or why there is no way.

    A goal on which the robot does not quite fit is driven to as near as the tolerance of Nav2's goal checker allows.
    """
    plan, grid = base.plan, base.plan.grid()
    if not all(abs(value) < MAX_START_M for value in goal):  # NaN is not
        return Ending.OUTSIDE
    row, col = grid.cell(goal[:2]).tolist()
    if not (0 <= row < grid.cells.shape[0] and 0 <= col < grid.cells.shape[1]):
        return Ending.OUTSIDE
    if plan.clearance(goal[:2]) == 0:
        return Ending.OCCUPIED
    for margin_m in (MARGIN_M, 0.0):
        area = reach(grid, base.believed[:2], base.radius_m + margin_m)
        way = None if area is None else _way_to(area, goal)
        if way is not None:
            return _short(base, way, goal, base.radius_m + margin_m)
    return Ending.NO_PATH


def _way_to(area: Reach, goal: Pose) -> Floats | None:
    cells = np.argwhere(np.isfinite(area.length_m))
    off_m = np.linalg.norm(area.grid.centre(cells) - goal[:2], axis=1)
    nearest = int(off_m.argmin())
    return area.path(tuple(cells[nearest].tolist())) if off_m[nearest] <= TOLERANCE_M else None


def _short(base: Base, way: Floats, goal: Pose, radius_m: float) -> list[Pose]:
    """The path with straight lines where they are free, and the goal itself at its end where the robot fits."""
    points = [base.believed[:2], *map(tuple, way.tolist())]
    if base.plan.free(goal[:2]):
        points.append(goal[:2])
    kept, at = [], 0
    while at < len(points) - 1:
        far = next(
            (k for k in range(len(points) - 1, at + 1, -1) if _straight(base, points[at], points[k], radius_m)), at + 1
        )
        kept.append(points[far])
        at = far
    return [*((x, y, math.nan) for x, y in kept[:-1]), (*(kept or points)[-1], goal[2])]


def _straight(base: Base, one: Sequence[float], other: Sequence[float], radius_m: float) -> bool:
    steps = max(2, math.ceil(math.dist(one, other) / 0.05))
    return all(base.plan.clearance(xy) >= radius_m for xy in np.linspace(one, other, steps))


class Drive:
    """A drive to a pose in the base's map.

    Args:
        base: The robot.
        way: Poses (x, y, yaw) to drive to one after the other; a yaw that is not a number does not matter.
        goal: Where the way leads, if it may be planned anew.
    """

    def __init__(self, base: Base, way: list[Pose], goal: Pose | None = None) -> None:
        self._base, self._way, self._goal = base, list(way), goal
        self._back_s = 0.0
        self.recoveries = 0

    @property
    def left_m(self) -> float:
        """How long the rest of the way is."""
        points = [self._base.believed[:2], *(pose[:2] for pose in self._way)]
        return sum(math.dist(a, b) for a, b in itertools.pairwise(points))

    def step(self, step_s: float) -> Ending | None:
        """Drive on for a moment; how it ended, or None."""
        if self._back_s > 0:
            self._back_s -= step_s
            self._base.step(BACK_M_S, 0.0, step_s)
            return self._anew() if self._back_s <= 0 else None
        x, y, yaw = self._base.believed
        while math.dist((x, y), self._way[0][:2]) < PASSED_M and len(self._way) > 1 and math.isnan(self._way[0][2]):
            del self._way[0]
        target = self._way[0]
        off_m = math.dist((x, y), target[:2])
        if off_m < THERE_M:
            return self._turned(math.remainder(target[2] - yaw, math.tau), step_s)
        off = self._base.free_heading(math.remainder(math.atan2(target[1] - y, target[0] - x) - yaw, math.tau), off_m)
        speed = min(SPEED_M_S, math.sqrt(off_m)) * max(0.0, math.cos(off))
        ahead = self._base.free_heading(0.0, AHEAD_M) == 0.0
        if abs(off) > (SHIM_RAD if ahead else STRAIGHT_RAD):
            speed = 0.0
        if self._base.step(speed, _turn(off), step_s) or abs(off) > STRAIGHT_RAD:
            return None
        self.recoveries += 1
        if self.recoveries > RECOVERIES:
            return Ending.STUCK
        self._back_s = BACK_S
        return None

    def _turned(self, off: float, step_s: float) -> Ending | None:
        self._base.step(0.0, _turn(off), step_s)
        still = abs(self._base.speed_m_s) < 1e-3 and abs(self._base.turn_rad_s) < 0.1
        if abs(off) >= THERE_RAD or not still:
            return None
        if len(self._way) == 1:
            return Ending.ARRIVED
        del self._way[0]
        return None

    def _anew(self) -> Ending | None:
        self._base.relocalise()
        if self._goal is None:
            return None
        way = route(self._base, self._goal)
        if isinstance(way, Ending):
            return way
        self._way = way
        return None


def _turn(off: float) -> float:
    return max(-TURN_RAD_S, min(TURN_RAD_S, 2.5 * off))
