"""Exploration of an unknown home: the robot covers the floor, guided by the floor plan from its own depth.

It looks round where it wakes up, then goes again and again to where it would see most anew for the way (floor beside
the unknown, obstacles that it has not seen from near), until nothing of use is left. The true plan of the home only
stops it where it would collide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.navigation.planning import Reach, reach
from cartier.types import Camera, OccupancyGrid
from cartier_dollhouse.knowledge import AZIMUTHS, Knowledge, coverage
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import EYE_M, Poses, look
from cartier_dollhouse.render import Renderer

RADIUS_M = 0.2
STEP_M, TURN = 0.25, math.radians(30)  # at most so far between two frames
DOWN = math.radians(22.5)  # the camera's usual pitch
FEET = math.radians(52.5)  # and that which shows the floor around the robot's feet
LEVEL_EVERY = 3  # one frame in so many looks level, for what hangs on walls
SMALL = (160, 120)  # px: what the robot steers by
LOOK_ON = 80.0  # cells: a view that shows less anew is not worth a turn on the spot
USEFUL = 40.0  # cells per metre: nor is a place that shows less worth the way
WAY_M = 3.0  # added to each way, so that what is close at hand is not all that counts
FAR_M = 7.5  # what is worth so long a way is worth any
ENOUGH = 400.0  # cells: more than this is not better, so that a room is finished before the next
LATTICE = 7  # cells between places that are considered

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Exploration:
    """A walk: camera ``poses`` (N, 4, 4), the robot's ``track`` (N, 3) of x, y (m) and yaw (rad), and what came of it.

    ``grid`` is the robot's own floor plan at the end; ``coverage`` the share of the truly reachable floor that it knows
    to be free; ``complete`` tells whether it ended by itself.
    """

    poses: Poses
    track: Floats
    grid: OccupancyGrid
    bumps: int
    coverage: float
    complete: bool


def explore(
    scene: Scene,
    camera: Camera,
    radius_m: float = RADIUS_M,
    eye_m: float = EYE_M,
    seed: int = 0,
    max_frames: int = 800,
    stop: Callable[[], bool] | None = None,
) -> Exploration:
    """Cover all free space of a home from ``scene.start_xy``. Deterministic: another seed, another walk.

    ``stop`` is asked before each frame. Raises InputError if it says so, or if the robot does not fit where it wakes
    up.
    """
    return _Explorer(scene, camera, radius_m, eye_m, seed, max_frames, stop).run()


class _Full(Exception):
    """As many frames as were allowed."""


class _Explorer:
    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        radius_m: float,
        eye_m: float,
        seed: int,
        max_frames: int,
        stop: Callable[[], bool] | None,
    ) -> None:
        self._scene, self._radius_m, self._eye_m = scene, radius_m, eye_m
        self._max_frames, self._stop = max_frames, stop
        self._plan = standing_plan(scene, scene.start_xy, radius_m)
        small = camera.scaled(*SMALL)
        self._renderer = Renderer(scene, small, light=False)
        self._know = Knowledge(small, radius_m, eye_m)
        self._rng = np.random.default_rng(seed)
        self._xy = np.array(scene.start_xy, dtype=np.float64)
        self._yaw = float(self._rng.integers(12)) * TURN if seed else 0.0
        self._track: list[tuple[float, float, float]] = []
        self._poses: list[Poses] = []
        self._bumps = 0

    def run(self) -> Exploration:
        complete = True
        try:
            self._look_round()
            while self._go_on():
                self._look_about()
        except _Full:
            complete = False
        known = coverage(self._know.grid, self._plan.grid(), self._plan.reachable(self._scene.start_xy))
        return Exploration(
            np.array(self._poses), np.array(self._track), self._know.grid, self._bumps, known, complete
        )  # fmt: skip

    def _see(self, down: float | None = None) -> None:
        """One frame from where the robot stands, into its knowledge."""
        count = len(self._poses)
        if self._stop is not None and self._stop():
            raise InputError(f"exploring {self._scene.name} was stopped after {count} frames: nothing was kept")
        if count >= self._max_frames:
            raise _Full
        if down is None:
            down = 0.0 if count % LEVEL_EVERY == 0 else DOWN
        pose = look(self._xy, self._yaw, down, self._eye_m)
        self._know.add(count, pose, self._renderer.depth(pose))
        self._poses.append(pose)
        self._track.append((*self._xy.tolist(), self._yaw))
        self._know.give_up(self._xy, self._yaw, down, self._know.half_width)

    def _look_round(self) -> None:
        """One full turn; every other view shows the floor at the feet, which the usual pitch leaves out."""
        for i in range(round(math.tau / TURN)):
            self._see(DOWN if i % 2 == 0 else FEET)
            self._yaw += TURN

    def _look_about(self) -> None:
        """Turn on the spot, towards what is worth a look, as long as there is something."""
        for _ in range(2 * round(math.tau / TURN)):
            views = _wedges(self._know.gains(self._xy[None]), self._know.half_width)[0]
            turns = _angle(np.arange(AZIMUTHS) * (math.tau / AZIMUTHS) - self._yaw)
            best = int(np.argmax(views / (1 + np.abs(turns) / math.pi)))
            if views[best] < LOOK_ON:
                return
            self._yaw += float(np.clip(turns[best], -TURN, TURN))
            self._see()

    def _go_on(self) -> bool:
        """Drive to the place from which most would be seen anew for the way; False if there is none worth it."""
        area = reach(self._know.grid, self._xy, self._radius_m)
        if area is None:
            return False
        for spacing in (LATTICE, 2):  # the second time more closely, before it is called done
            row, col = self._rng.integers(spacing, size=2)
            lattice = np.zeros(area.length_m.shape, bool)
            lattice[row::spacing, col::spacing] = True
            cells = np.argwhere(lattice & np.isfinite(area.length_m))
            if not len(cells):
                continue
            xy = area.grid.centre(cells)
            gains = np.concatenate([self._know.gains(part).sum(1) for part in np.array_split(xy, 1 + len(xy) // 200)])
            ahead = np.arctan2(xy[:, 1] - self._xy[1], xy[:, 0] - self._xy[0])
            turns = np.abs(_angle(ahead - self._yaw)) / TURN
            way_m = area.length_m[tuple(cells.T)] + STEP_M * turns + WAY_M
            score = np.where(gains >= USEFUL * np.minimum(way_m, FAR_M), np.minimum(gains, ENOUGH) / way_m, 0)
            best = int(score.argmax())
            if score[best] > 0:
                self._visit(area, tuple(cells[best].tolist()), float(gains[best]))
                return True
        return False

    def _visit(self, area: Reach, cell: tuple[int, int], gain: float) -> None:
        """Drive to a cell, as long as it is worth it; what cannot be seen from there either is given up in time."""
        before = len(self._poses)
        goal = area.grid.centre(cell)
        way = _way(area, cell)
        i = 0
        while i < len(way):
            while i + 1 < len(way) and self._know.straight(self._xy, way[i + 1]):
                i += 1
            if not self._drive(way[i], first=i == 0):
                break
            i += 1
            if self._know.gains(goal[None]).sum() < gain / 3:
                break
        if len(self._poses) == before:
            self._know.give_up(goal, 0.0, DOWN, math.pi)

    def _drive(self, target: Floats, first: bool) -> bool:
        """Straight to a point in steps, a frame after each; False if an obstacle came up or was bumped into."""
        while (left := float(np.linalg.norm(target - self._xy))) > 0.02:
            ahead = math.atan2(target[1] - self._xy[1], target[0] - self._xy[0])
            turn = float(_angle(ahead - self._yaw))
            self._yaw += float(np.clip(turn, -TURN, TURN))
            if abs(turn) > TURN:
                self._see()
                continue
            step = self._xy + (target - self._xy) * min(1.0, STEP_M / left)
            if not first and not self._know.straight(self._xy, step):
                return False
            self._xy, free = advance(self._plan, self._xy, step)
            if not free:
                self._bumps += 1
                self._know.bump(self._xy, ahead)
            self._see()
            if not free:
                return False
        return True


def standing_plan(scene: Scene, xy: tuple[float, float], radius_m: float) -> Plan:
    """The true plan of a home in which a robot wakes up at a point. Raises InputError if it does not fit there."""
    plan = Plan(scene, radius_m)
    if not plan.free(xy):
        clear = plan.clearance(xy)
        why = "it is inside of a wall or furniture" if clear == 0 else f"only {clear:.2f} m are clear there"
        raise InputError(
            f"a robot of radius {radius_m:g} m cannot start at ({xy[0]:.2f}, {xy[1]:.2f}) in {scene.name}: {why}"
        )
    return plan


def advance(plan: Plan, start: Floats, end: Floats) -> tuple[Floats, bool]:
    """How far a robot gets straight from a free point to another in the true home, and whether it gets there."""
    last = start
    for xy in np.linspace(start, end, max(2, math.ceil(float(np.linalg.norm(end - start)) / 0.01) + 1))[1:]:
        if not plan.free(xy):
            return last, False
        last = xy
    return end, True


def _angle(angle: npt.ArrayLike) -> Floats:
    """Angles within -pi to pi."""
    return np.asarray(np.remainder(np.asarray(angle) + math.pi, math.tau) - math.pi)


def _wedges(gains: Floats, half_width: float) -> Floats:
    """The sum over the camera's width around each azimuth, of gains (K, AZIMUTHS)."""
    half = int(half_width / (math.tau / AZIMUTHS))
    return np.asarray(sum(np.roll(gains, k, axis=1) for k in range(-half, half + 1)))


def _way(area: Reach, cell: tuple[int, int]) -> Floats:
    """Points (K, 2) along the shortest path to a cell."""
    columns = area.length_m.shape[1]
    flat = [cell[0] * columns + cell[1]]
    while (before := int(area.previous[divmod(flat[-1], columns)])) >= 0:
        flat.append(before)
    return area.grid.centre(np.array([divmod(f, columns) for f in reversed(flat)]))
