"""Simulated base with two wheels in a home: it drives in the true home, by what its odometry and its SLAM believe.

The odometry wanders off as it drives, and the robot's own map is as wrong as that until a loop is closed.
"""

from __future__ import annotations

import math

import numpy as np

from cartier_dollhouse.explore import RADIUS_M, standing_plan
from cartier_dollhouse.model import Scene

Pose = tuple[float, float, float]
"""x, y (m) and yaw (rad)."""

SPEED_UP_M_S2, TURN_UP_RAD_S2 = 1.0, 3.0
SHORT = 0.005  # by how much of the way its wheels are told wrong, at most
WANDER_RAD = 0.004  # how far its heading wanders in a metre
CLOSE_M, BACK_M, LOST_M = 4.0, 0.7, 10.0  # a loop is so long, and closed so near to where it was; at the latest after
NOTED_M = 0.5
PADDING_M = 0.03  # its ways are planned for a robot that is larger by this, as it is not quite where it believes to be
AHEAD_M = 0.08
ASIDE = (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9, 1.2, -1.2)


def compose(one: Pose, other: Pose) -> Pose:
    """The pose ``other``, which is told in the frame that lies at ``one``."""
    c, s = math.cos(one[2]), math.sin(one[2])
    x, y = one[0] + c * other[0] - s * other[1], one[1] + s * other[0] + c * other[1]
    return x, y, math.remainder(one[2] + other[2], math.tau)


def inverse(pose: Pose) -> Pose:
    """The frame that a pose is told in, as it lies in the frame at the pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return -c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]


class Base:
    """Where the robot is: ``true``, by its ``odom``, and in its map: ``map_from_odom`` with the odometry.

    Args:
        scene: The home.
        radius_m: The radius that its ways are planned for.
        seed: Of its odometry's errors.

    Raises:
        InputError: The robot does not fit at the home's start.
    """

    def __init__(self, scene: Scene, radius_m: float = RADIUS_M, seed: int = 0) -> None:
        self.plan, self.radius_m = standing_plan(scene, scene.start_xy, radius_m - PADDING_M), radius_m
        self.true: Pose = (*scene.start_xy, 0.0)
        self.odom: Pose = (0.0, 0.0, 0.0)
        self.map_from_odom: Pose = self.true
        self.speed_m_s = self.turn_rad_s = 0.0
        self._rng = np.random.default_rng(seed)
        self._scale = 1 + SHORT * float(self._rng.uniform(-1, 1))
        self._driven_m = self._closed_m = 0.0
        self._been: list[tuple[float, float, float]] = []  # x, y, and metres driven until there

    @property
    def believed(self) -> Pose:
        """Where its map says that it is."""
        return compose(self.map_from_odom, self.odom)

    def step(self, speed_m_s: float, turn_rad_s: float, step_s: float) -> bool:
        """Drive for a moment towards these speeds; False if something stands in the way, and stops it."""
        self.speed_m_s = _towards(self.speed_m_s, speed_m_s, SPEED_UP_M_S2 * step_s)
        self.turn_rad_s = _towards(self.turn_rad_s, turn_rad_s, TURN_UP_RAD_S2 * step_s)
        way_m, turn = self.speed_m_s * step_s, self.turn_rad_s * step_s
        moved = compose(self.true, (way_m * math.cos(turn / 2), way_m * math.sin(turn / 2), turn))
        if way_m and not self.plan.free(moved[:2]) and self._nearer(moved[:2]):
            self.speed_m_s, way_m = 0.0, 0.0
            self.true = (*self.true[:2], moved[2])
            self.odom = (*self.odom[:2], math.remainder(self.odom[2] + turn, math.tau))
            return False
        self.true = moved
        told_m, off = way_m * self._scale, WANDER_RAD * math.sqrt(abs(way_m)) * float(self._rng.standard_normal())
        self.odom = compose(self.odom, (told_m * math.cos(turn / 2), told_m * math.sin(turn / 2), turn + off))
        self._driven_m += abs(way_m)
        self._close_loops()
        return True

    def free_heading(self, off: float, ahead_m: float) -> float:
        """The heading (rad, from its own) nearest to a wanted one that is free for a moment, as its sensors see it."""
        x, y, yaw = self.true
        step_m = min(ahead_m, AHEAD_M)
        for aside in ASIDE:
            way = yaw + off + aside
            points = [(x + m * math.cos(way), y + m * math.sin(way)) for m in (step_m / 4, step_m / 2, step_m)]
            if all(self.plan.free(xy) or not self._nearer(xy) for xy in points):
                return math.remainder(off + aside, math.tau)
        return off

    def _nearer(self, xy: tuple[float, float]) -> bool:
        """Whether a move goes towards what is in the way: away from it the robot may drive even where it is tight."""
        return self.plan.clearance(xy) <= self.plan.clearance(self.true[:2])

    def relocalise(self) -> None:
        """Find out where it is: the transform above its odometry jumps."""
        self.map_from_odom = compose(self.true, inverse(self.odom))
        self._closed_m = self._driven_m

    def _close_loops(self) -> None:
        x, y, _ = self.true
        if not self._been or math.dist(self._been[-1][:2], (x, y)) >= NOTED_M:
            self._been.append((x, y, self._driven_m))
        since_m = self._driven_m - self._closed_m
        if since_m < CLOSE_M:
            return
        back = any(self._driven_m - at_m > CLOSE_M and math.dist((x, y), (a, b)) < BACK_M for a, b, at_m in self._been)
        if back or since_m > LOST_M:
            self.relocalise()


def _towards(now: float, wanted: float, most: float) -> float:
    return now + max(-most, min(most, wanted - now))
