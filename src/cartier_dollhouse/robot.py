"""Simulated robot: drives to the goal in the dollhouse home that was mapped, and stops at obstacles."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from cartier import plugins
from cartier.errors import BackendError, InputError, check_radius
from cartier.robots.common.drives import Drives
from cartier.robots.common.pose import Pose, in_words, pose_of
from cartier.types import DriveProgress, Goal

if TYPE_CHECKING:
    from cartier_dollhouse.drive import Drive

WORLD = "dollhouse"
FASTEST_M_S = 10.0
STEP_M, TOLD_EVERY = 0.05, 5  # between two poses of a drive; a quarter of a metre between two reports


def make(home: str = "", radius_m: float = 0.2, speed_m_s: float = 1.0) -> Dollhouse:
    """``home`` is a home of the dollhouse (a name, a whole number or a .yaml file), or the name of a recording of one.

    ``radius_m`` is the robot's radius; use the one of the planner. ``speed_m_s`` is that of a drive that is watched, 0
    for as fast as it goes. Raises InputError for an unknown home, or an impossible radius or speed.
    """
    if not home:
        raise BackendError("robot dollhouse: which home does it drive in? give option home, for example home=studio")
    name = home
    while name.startswith(f"{WORLD} "):  # of recordings: "dollhouse studio", or "dollhouse dollhouse 7" if generated
        name = name.removeprefix(f"{WORLD} ")
    try:
        world: Any = plugins.make("worlds", WORLD)
        scene = world.scene(name)
    except InputError as error:
        raise InputError(f"robot dollhouse drives in homes of the dollhouse, and {home!r} is none ({error})") from error
    if not 0 <= speed_m_s <= FASTEST_M_S:
        raise InputError(f"robot dollhouse: speed_m_s must be 0 to {FASTEST_M_S:g}, got {speed_m_s:g}")
    return Dollhouse(scene, check_radius(radius_m), speed_m_s)


class Dollhouse:
    """Obeys the contract DrivingRobot. It starts where a goal's path begins; the true home, not the map, stops it."""

    name = WORLD

    def __init__(self, scene: Any, radius_m: float, speed_m_s: float) -> None:
        self._scene, self._radius_m, self._speed_m_s = scene, radius_m, speed_m_s
        self._pose: Pose | None = None
        self._drives = Drives(self._steps, self._stands)

    def go_to(self, goal: Goal) -> str:
        """Raises InputError if the robot does not fit at the start or at the goal."""
        driven = self._driven(goal)
        self._pose = _pose(driven, -1)
        return self._ended(driven, goal).text

    def drive(self, goal: Goal) -> Iterator[DriveProgress]:
        """Raises InputError if the robot does not fit at the start or at the goal."""
        return self._drives.watch(goal)

    def pose(self) -> Pose | None:
        """None before the first goal."""
        return self._pose

    def stop(self) -> DriveProgress:
        return self._drives.stop()

    def _steps(self, goal: Goal, asked: threading.Event) -> Iterator[DriveProgress]:
        driven = self._driven(goal)
        for at in range(0, len(driven.poses) - 1, TOLD_EVERY):
            self._pose = pose = _pose(driven, at)
            left_m = math.dist(pose[:2], (goal.x, goal.y))
            yield DriveProgress("driving", f"{left_m:.1f} m to the {goal.place.label}", pose, left_m)
            step_m = STEP_M * TOLD_EVERY
            if asked.wait(step_m / self._speed_m_s if self._speed_m_s else 0):
                yield DriveProgress("stopped", f"the drive was stopped at {in_words(pose)}", pose, left_m)
                return
        self._pose = _pose(driven, -1)
        yield self._ended(driven, goal)

    def _stands(self) -> DriveProgress:
        return DriveProgress("stopped", "the robot in the dollhouse stands", self._pose)

    def _driven(self, goal: Goal) -> Drive:
        from cartier_dollhouse.drive import drive

        return drive(self._scene, goal.path[0], goal, self._radius_m)

    def _ended(self, driven: Drive, goal: Goal) -> DriveProgress:
        x, y, yaw = _pose(driven, -1)
        where = f"after {driven.length_m:.2f} m through {self._scene.name}"
        if not driven.arrived:
            short_m = math.dist((x, y), (goal.x, goal.y))
            stopped = f"stopped at x {x:.2f} y {y:.2f} m, {short_m:.2f} m short of the {goal.place.label}'s goal"
            return DriveProgress("failed", f"bumped {where}: {stopped}", (x, y, yaw), short_m)
        view = "in view" if driven.in_view else "not in view"
        there = f"{in_words(pose_of(goal))}, with the {goal.place.label} {view}"
        return DriveProgress("arrived", f"arrived {where} without a bump: {there}", (x, y, yaw), 0.0)


def _pose(driven: Drive, at: int) -> Pose:
    x, y, yaw = driven.poses[at].tolist()
    return x, y, yaw
