"""Simulated robot: drives to the goal in the dollhouse home that was mapped, and stops at obstacles."""

from __future__ import annotations

import math
from typing import Any

from cartier import plugins
from cartier.errors import BackendError, InputError, check_radius
from cartier.robots._pose import in_words
from cartier.types import Goal

WORLD = "dollhouse"


def make(home: str = "", radius_m: float = 0.2) -> Dollhouse:
    """``home`` is a home of the dollhouse (a name, a whole number or a .yaml file), or the name of a recording of one.

    ``radius_m`` is the robot's radius; use the one of the planner. Raises InputError for an unknown home or an
    impossible radius.
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
    return Dollhouse(scene, check_radius(radius_m))


class Dollhouse:
    """Obeys the Robot contract. It starts where the goal's path begins; the true home, not the map, stops it."""

    name = WORLD

    def __init__(self, scene: Any, radius_m: float) -> None:
        self._scene, self._radius_m = scene, radius_m

    def go_to(self, goal: Goal) -> str:
        """Raises InputError if the robot does not fit at the start or at the goal."""
        from cartier.worlds.dollhouse.drive import drive

        driven = drive(self._scene, goal.path[0], goal, self._radius_m)
        x, y, _ = driven.poses[-1].tolist()
        where = f"after {driven.length_m:.2f} m through {self._scene.name}"
        if not driven.arrived:
            short_m = math.dist((x, y), (goal.x, goal.y))
            return (
                f"bumped {where}: stopped at x {x:.2f} y {y:.2f} m, {short_m:.2f} m short of "
                f"the {goal.place.label}'s goal"
            )
        view = "in view" if driven.in_view else "not in view"
        return f"arrived {where} without a bump: {in_words(goal)}, with the {goal.place.label} {view}"
