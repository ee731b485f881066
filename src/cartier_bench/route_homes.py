"""True homes with rugs and narrow doors, random rules for drives in them, and how far points are off a rule's area."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.geometry import box_distance
from cartier.navigation.layers import RouteMap
from cartier.spatial.doors import find_doors
from cartier.types import RobotModel, Room
from cartier.types.route_rules import FLOOR_KINDS, RouteRule, RouteTarget
from cartier_bench.true_home import true_objects
from cartier_dollhouse import Dollhouse
from cartier_dollhouse.floors import kinds_at
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan

FIRST_GENERATED, GENERATED = 70_001, 6
OPTIONS = "+rugs+narrow"
KINDS = ("avoid", "keep-away", "slow-near", "prefer", "via", "only-through")
KEEP_AWAY_M, AVOID_OBJECT_M, FLAT_M = 0.6, 0.3, 0.06
"""What docs/routes.md promises: never nearer to what is kept away from, or to what is avoided and not flat."""
Points = npt.NDArray[np.float64]


def home_names(asked: Sequence[str] = ()) -> tuple[str, ...]:
    """The homes that are driven in: those asked for, else the built-in ones and six generated ones, all with rugs and
    narrow doors."""
    world = plugins.make("worlds", "dollhouse")
    names = asked or (*world.homes(), *(str(FIRST_GENERATED + k) for k in range(GENERATED)))
    return tuple(name if "+" in name else name + OPTIONS for name in names)


class Home(NamedTuple):
    """A home's truth: the scene, what a perfect map of it would show, and where a robot fits."""

    scene: Scene
    site: RouteMap
    plan: Plan


def true_home(name: str) -> Home:
    """The true floor plan with its kinds of floor, rooms, doors and objects."""
    world = plugins.make("worlds", "dollhouse")
    assert isinstance(world, Dollhouse)
    scene = world.scene(name)
    plan = Plan(scene, RobotModel.radius_m)
    grid = plan.grid()
    xy = grid.centre(np.argwhere(np.ones(grid.cells.shape, bool))).reshape(*grid.cells.shape, 2)
    grid = replace(grid, floor_kinds=kinds_at(scene, xy))
    rooms = []
    for number, room in enumerate(scene.rooms):
        x1, y1, x2, y2 = room.box
        inside = (xy[..., 0] > x1) & (xy[..., 0] < x2) & (xy[..., 1] > y1) & (xy[..., 1] < y2)
        rooms.append(Room(number, room.name, room.kind, np.argwhere(inside).astype(np.int32)))
    return Home(scene, RouteMap(grid, rooms, true_objects(scene), find_doors(rooms, grid)), plan)


def random_rules(home: Home, rng: random.Random) -> list[RouteRule]:
    """One to three rules about random rooms, kinds of floor and objects."""
    scene = home.scene
    floors = {room.floor.partition(":")[0] for room in scene.rooms} & set(FLOOR_KINDS)
    floors |= {"rug"} if scene.rugs else set()
    found = []
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.choice(KINDS)
        targets: list[RouteTarget] = []
        if kind in ("avoid", "prefer", "via", "only-through"):
            targets += [RouteTarget("room", (room.name,)) for room in scene.rooms]
        if kind in ("avoid", "prefer"):
            targets += [RouteTarget("floor", (floor,)) for floor in sorted(floors)] * 2
        if kind in ("avoid", "keep-away", "slow-near", "via"):
            low = [obj.id for obj in home.site.objects if obj.box_min[2] < 0.4]
            targets += [RouteTarget("object", ids=(number,)) for number in rng.sample(low, min(6, len(low)))]
        strength = "soft" if kind == "prefer" else rng.choice(("hard", "hard", "soft"))
        found.append(RouteRule(kind, rng.choice(targets), strength))  # type: ignore[arg-type]
    return found


def off_m(rule: RouteRule, home: Home) -> Callable[[Points], Points]:
    """How far points (k, 2) are from the true area of a rule (m), negative inside, without its margin."""
    target, scene = rule.target, home.scene
    assert target is not None
    if target.kind == "object":
        boxes = [obj for obj in home.site.objects if obj.id in target.ids]
        areas = np.array([[*obj.box_min[:2], *obj.box_max[:2]] for obj in boxes])
    elif target.kind == "room":
        areas = np.array([room.box for room in scene.rooms if room.name in target.names])
    elif target.names == ("rug",):
        areas = np.array([rug.box for rug in scene.rugs])
    else:
        areas = np.array([room.box for room in scene.rooms if room.floor.partition(":")[0] in target.names])

    def away(points: Points) -> Points:
        outside = np.stack([box_distance(points, area[:2], area[2:]) for area in areas]).min(0)
        x, y = points.T
        depth = np.max([np.min([x - a[0], a[2] - x, y - a[1], a[3] - y], axis=0) for a in areas], axis=0)
        if target.kind == "floor" and target.names != ("rug",) and scene.rugs:  # a rug hides what it lies on
            on_rug = kinds_at(scene, points) == FLOOR_KINDS.index("rug")
            depth = np.where(on_rug, -1.0, depth)
            outside = np.where(on_rug, 1.0, outside)
        far: Points = np.where(outside > 0, outside, -depth)
        return far

    return away


def margin_m(rule: RouteRule, home: Home) -> float:
    """How far from its true area a rule to avoid or to keep away reaches."""
    if rule.kind == "keep-away":
        return KEEP_AWAY_M
    tall = [obj for obj in home.site.objects if rule.target and obj.id in rule.target.ids and obj.box_max[2] > FLAT_M]
    return AVOID_OBJECT_M if tall else 0.0
