"""Drives under route rules in homes whose truth is known: is what a rule forbids crossed, and are detours as they should be?

The floor plan, rooms, objects and kinds of floor come from the simulator, and so does the truth. A drive is checked at
every centimetre against the true polygons (rooms, rugs, boxes), by predicates of its own, not by the planner's areas.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.evaluation.true_home import true_objects
from cartier.geometry import box_distance
from cartier.navigation.layers import SOFT_AVOID, RouteMap
from cartier.navigation.routes import RoutePlan, plan_route
from cartier.route_rules import FLOOR_KINDS, RouteRule, RouteTarget
from cartier.spatial.doors import find_doors
from cartier.types import MapObject, Place, RobotModel, Room
from cartier.worlds.dollhouse.floors import kinds_at
from cartier.worlds.dollhouse.model import Scene
from cartier.worlds.dollhouse.place import Plan

RADIUS_M = 0.2
STEP_M = 0.01
CELL_M = 0.05
NEAR_M = 0.6  # what "keep away" promises, less a cell
PAST_M = 1.2  # from how near something is passed, and a cell more
LEAST_DRIVE_M = 1.5
KINDS = ("avoid room", "avoid floor", "keep-away", "only-through", "via", "slow-near", "soft avoid")

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Driven:
    """One drive: what was asked, and what came of it.

    ``outcome`` is "driven", "asked" (the robot said which rule stands in the way) or "no goal". ``crossed`` counts the
    cells of 5 cm, of what a hard rule forbids, that it drove over without having asked; ``bumps`` whether it hit
    something; ``right`` whether it did what the rule says; ``needless`` that it asked though there is a way.
    """

    home: str
    rule: str
    sort: str
    outcome: str
    crossed: int
    bumps: bool
    right: bool
    needless: bool
    length_m: float
    shortest_m: float


def true_map(scene: Scene, radius_m: float = RADIUS_M) -> tuple[RouteMap, Plan]:
    """A scene as a perfect map would have it, and its true plan."""
    plan = Plan(scene, radius_m)
    grid = plan.grid()
    rows, cols = np.indices(grid.cells.shape)
    xy = grid.centre(np.stack([rows, cols], -1))
    grid = replace(grid, floor_kinds=kinds_at(scene, xy))
    rooms = []
    for number, room in enumerate(scene.rooms):
        x1, y1, x2, y2 = room.box
        inside = (xy[..., 0] > x1) & (xy[..., 0] < x2) & (xy[..., 1] > y1) & (xy[..., 1] < y2)
        rooms.append(Room(number, room.name, room.kind, np.argwhere(inside).astype(np.int32)))
    return RouteMap(grid, tuple(rooms), tuple(true_objects(scene)), find_doors(rooms, grid)), plan


def drives(scene: Scene, count: int, seed: int = 0) -> list[Driven]:
    """Drives from random places to random objects of a home, each with a rule about what its shortest way meets."""
    rng = np.random.default_rng(zlib.crc32(f"{scene.name} {seed}".encode()))
    site, plan = true_map(scene)
    places = site.grid.centre(np.argwhere(plan.reachable(scene.start_xy)))
    goals = [obj for obj in site.objects if obj.position[2] < 1.5]
    found, tried = list[Driven](), 0
    while len(found) < count and tried < 20 * count:
        tried += 1
        start = tuple(places[rng.integers(len(places))].tolist())
        place = place_of(goals[rng.integers(len(goals))])
        free = plan_route(site, place, start, RobotModel(RADIUS_M))
        if free.goal is None or free.goal.length_m < LEAST_DRIVE_M:
            continue
        rule = rule_for(KINDS[len(found) % len(KINDS)], scene, site, free.goal.path, place, rng)
        if rule is not None:
            found.append(_driven(scene, site, plan, place, start, rule, free))
    return found


def place_of(obj: MapObject) -> Place:
    """Where an object is."""
    return Place(obj.label, obj.position, 1.0, -1, box_min=obj.box_min, box_max=obj.box_max, object_id=obj.id)


def rule_for(
    sort: str, scene: Scene, site: RouteMap, path: Points, place: Place, rng: np.random.Generator
) -> RouteRule | None:
    """A rule of a sort about what lies on a path or, for what to pass, beside it; None if there is nothing."""
    names = [room_at(scene, xy) for xy in path]
    inner = sorted({name for name in names if name and name not in (names[0], names[-1])})
    ends = {int(kinds_at(scene, path[k])) for k in (0, -1)}
    floors = sorted({int(kind) for kind in kinds_at(scene, path)} - {0, *ends})
    others = sorted({room.name for room in scene.rooms} - set(names))
    tall = [o for o in site.objects if o.id != place.object_id and o.box_min[2] < 0.5 and _size(o) > 0.2]
    far = [o for o in tall if min(_away(o, path[0]), _away(o, path[-1])) > NEAR_M + 0.4]
    near = [o for o in far if min(_away(o, path)) < NEAR_M] if sort == "keep-away" else far
    target: RouteTarget | None = None
    kind = {"avoid room": "avoid", "avoid floor": "avoid", "soft avoid": "avoid"}.get(sort, sort)
    if sort == "avoid room" and inner:
        target = RouteTarget("room", (inner[rng.integers(len(inner))],))
    elif sort in ("avoid floor", "soft avoid") and floors:
        some = [FLOOR_KINDS.index("rug")] if FLOOR_KINDS.index("rug") in floors else floors
        target = RouteTarget("floor", (FLOOR_KINDS[some[rng.integers(len(some))]],))
    elif sort == "only-through" and inner:
        target = RouteTarget("room", tuple(inner))
    elif sort == "via" and (others or tall):
        if others and rng.random() < 0.5:
            target = RouteTarget("room", (others[rng.integers(len(others))],))
        elif tall:
            target = RouteTarget("object", ids=(tall[rng.integers(len(tall))].id,))
    elif sort in ("keep-away", "slow-near") and near:
        target = RouteTarget("object", ids=(near[rng.integers(len(near))].id,))
    if target is None:
        return None
    return RouteRule(kind, target, "soft" if sort == "soft avoid" else "hard")  # type: ignore[arg-type]


def room_at(scene: Scene, xy: Sequence[float] | Points) -> str:
    """The name of the room at a point, "" on a threshold."""
    boxes = ((room.name, room.box) for room in scene.rooms)
    return next((name for name, (x1, y1, x2, y2) in boxes if x1 < xy[0] < x2 and y1 < xy[1] < y2), "")


def dense(path: Points) -> Points:
    """The points of a path, a centimetre apart."""
    parts = [
        np.linspace(a, b, max(1, math.ceil(float(np.linalg.norm(b - a)) / STEP_M)), endpoint=False)
        for a, b in zip(path[:-1], path[1:], strict=True)
    ]
    return np.concatenate([*parts, path[-1:]])


def forbidden(
    rule: RouteRule, scene: Scene, points: Points, ends: Iterable[Points], slack_m: float = CELL_M
) -> npt.NDArray[np.bool_]:
    """Which points (N,) a hard rule forbids, by the true polygons.

    ``ends`` are the points where a drive begins and ends; ``slack_m`` is how much nearer than promised is near enough.
    """
    target = rule.target
    assert target is not None
    if rule.kind == "avoid" and target.kind == "floor":
        return np.asarray(kinds_at(scene, points) == FLOOR_KINDS.index(target.names[0]))
    if rule.kind == "keep-away":
        boxes = [obj for obj in true_objects(scene) if obj.id in target.ids]
        return np.asarray(np.min([_away(obj, points) for obj in boxes], axis=0) < NEAR_M - slack_m)
    names = [room_at(scene, xy) for xy in points]
    if rule.kind == "avoid":
        return np.isin(names, target.names)
    allowed = {"", *target.names, *(room_at(scene, xy) for xy in ends)}
    return np.array([name not in allowed for name in names])


def _driven(
    scene: Scene, site: RouteMap, plan: Plan, place: Place, start: tuple[float, ...], rule: RouteRule, free: RoutePlan
) -> Driven:
    planned = plan_route(site, place, start, RobotModel(RADIUS_M), [rule])
    assert free.goal is not None and rule.target is not None
    sort = f"{rule.strength} {rule.kind} {rule.target.kind}"
    crossed, bumps, right, needless = 0, False, True, False
    if planned.goal is None:
        needless = not planned.blocking or _there_is_a_way(scene, site, plan, place, start, rule)
        outcome = "asked" if planned.blocking and planned.breach is not None else "no goal"
        right = outcome == "asked" and not needless
    else:
        outcome, points = "driven", dense(planned.goal.path)
        bumps = not all(plan.clearance(xy) >= RADIUS_M - CELL_M for xy in points[5:])
        right, crossed = _kept(rule, scene, planned, free, points)
    length_m = planned.goal.length_m if planned.goal is not None else math.nan
    return Driven(
        scene.name,
        rule.text,
        sort,
        outcome,
        crossed,
        bumps,
        right and not bumps,
        needless,
        length_m,
        free.goal.length_m,
    )


def _kept(rule: RouteRule, scene: Scene, planned: RoutePlan, free: RoutePlan, points: Points) -> tuple[bool, int]:
    """Whether a drive keeps a rule, and how many forbidden cells it crosses."""
    assert planned.goal is not None and free.goal is not None and rule.target is not None
    if rule.strength == "soft":
        return _weighed(rule, scene, planned, free), 0
    if rule.kind == "via":
        return _passed(rule, scene, points), 0
    if rule.kind == "slow-near":
        assert planned.goal.route is not None
        boxes = [obj for obj in true_objects(scene) if obj.id in rule.target.ids]
        close = np.min([_away(obj, planned.goal.path) for obj in boxes], axis=0) < 1.0 - CELL_M
        return bool((planned.goal.route.speed[close] < 1).all()), 0
    wrong = forbidden(rule, scene, points, (points[0], points[-1]))
    cells = {tuple(cell) for cell in np.floor(points[wrong] / CELL_M).astype(int).tolist()}
    return not cells, len(cells)


def _passed(rule: RouteRule, scene: Scene, points: Points) -> bool:
    assert rule.target is not None
    if rule.target.kind == "room":
        return any(room_at(scene, xy) in rule.target.names for xy in points)
    boxes = [obj for obj in true_objects(scene) if obj.id in rule.target.ids]
    return min(float(np.min(_away(obj, points))) for obj in boxes) <= PAST_M + CELL_M


def _weighed(rule: RouteRule, scene: Scene, planned: RoutePlan, free: RoutePlan) -> bool:
    """Whether the way of a wish costs no more than the shortest one and than the one that takes the wish for an order."""
    assert planned.goal is not None and free.goal is not None
    others = planned.goal.route.alternatives if planned.goal.route else ()
    ways = [planned.goal.path, free.goal.path, *(other.path for other in others)]
    costs = []
    for way in ways:
        points = dense(way)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        over = forbidden(rule, scene, points, ())
        costs.append(float((steps * (1 + SOFT_AVOID * over[1:])).sum()))
    return (
        costs[0] <= min(costs) + (1 + SOFT_AVOID) * 2 * CELL_M
    )  # edges of areas and cells differ by a cell at each end


def _there_is_a_way(
    scene: Scene, site: RouteMap, plan: Plan, place: Place, start: tuple[float, ...], rule: RouteRule
) -> bool:
    """Whether a robot could get near the place though it keeps a rule: flood fill over the true floor."""
    from scipy import ndimage

    cells = np.argwhere(plan.reachable(start))
    if not len(cells) or rule.kind == "via":
        return False
    xy = site.grid.centre(cells)
    end = np.array(place.position[:2])
    wrong = forbidden(rule, scene, xy, (np.array(start), end), -CELL_M)
    usable = np.zeros(site.grid.cells.shape, bool)
    usable[tuple(cells[~wrong].T)] = True
    parts, _ = ndimage.label(usable, np.ones((3, 3)))
    mine = parts[tuple(site.grid.cell(start))]
    assert place.box_min is not None and place.box_max is not None
    close = box_distance(xy, np.array(place.box_min[:2]), np.array(place.box_max[:2])) < 0.6
    there = np.argwhere(usable)
    return bool(mine and len(there) and (parts[tuple(cells[close & ~wrong].T)] == mine).any())


def _away(obj: MapObject, points: Points | Sequence[float]) -> Any:
    return box_distance(np.asarray(points), np.array(obj.box_min[:2]), np.array(obj.box_max[:2]))


def _size(obj: MapObject) -> float:
    return float(max(np.subtract(obj.box_max, obj.box_min)))


def summary(found: Sequence[Driven]) -> str:
    """The drives as a Markdown table."""
    sorts = sorted({drive.sort for drive in found})
    rows = [
        "| rule | drives | driven | asked | asked needlessly | cells crossed | hit something | as the rule says | detour |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for sort in [*sorts, "all"]:
        some = [drive for drive in found if sort in (drive.sort, "all")]
        driven = [drive for drive in some if drive.outcome == "driven"]
        more = [drive.length_m - drive.shortest_m for drive in driven]
        rows.append(
            f"| {sort} | {len(some)} | {len(driven)} | {sum(d.outcome == 'asked' for d in some)} | "
            f"{sum(d.needless for d in some)} | {sum(d.crossed for d in some)} | {sum(d.bumps for d in some)} | "
            f"{sum(d.right for d in some) / len(some):.1%} | {np.mean(more) if more else math.nan:.2f} m |"
        )
    return "\n".join(rows)


def rows(found: Sequence[Driven]) -> list[dict[str, Any]]:
    """The drives as plain values."""
    return [asdict(drive) for drive in found]
