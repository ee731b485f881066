"""Drives under random rules in true homes: each path is checked against the true polygons, point by point.

"Broken": points of a hard rule's area that the robot's centre enters without having asked. Where the planner asks
instead, a flood fill over the plan decides whether there was a way.
"""

from __future__ import annotations

import random
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from cartier.navigation.routes import RoutePlan, plan_route
from cartier.types import FREE, Place, RobotModel
from cartier.types.route_rules import RouteRule
from cartier_bench.predicates import fits
from cartier_bench.route_homes import Home, Points, margin_m, off_m, random_rules, true_home
from cartier_bench.suite import Progress, silent

VIA_M, SLOW_NEAR_M = 1.2, 1.0  # what docs/routes.md promises: passed at least so near; slow from so near on
POINT_M = 0.01
EDGE_M = 0.05  # a cell: rules are obeyed to within one
VERDICTS = ("obeyed", "weighed", "asked", "asked in vain", "told", "at an end", "worse", "broken")


def dense(path: Points) -> Points:
    """Points (k, 2) along a path, a centimetre apart."""
    parts = [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / POINT_M) + 1)) for a, b in pairwise(path)]
    return np.concatenate(parts) if parts else path


class Outcome(NamedTuple):
    """What came of a drive under rules: a verdict for each rule, and figures of the drive."""

    verdicts: list[tuple[str, str]]
    asked: bool
    collided: bool
    longer_m: float
    ms: float


class Drive(NamedTuple):
    """A drive to a place that can be reached, under rules; ``free`` is the route without them."""

    home: Home
    place: Place
    rules: Sequence[RouteRule]
    free: RoutePlan


def driven(drive: Drive) -> Outcome:
    """Plan a drive under its rules and check it."""
    home, place, rules, free = drive
    assert free.goal is not None
    begin = time.perf_counter()
    planned = plan_route(home.site, place, home.scene.start_xy, RobotModel(), rules)
    ms = (time.perf_counter() - begin) * 1e3
    if planned.goal is None:
        verdict = "asked" if _no_way(home, planned, free) else "asked in vain"
        return Outcome([(_name(rule), verdict) for rule in planned.blocking], True, False, 0.0, ms)
    points = dense(planned.goal.path)
    verdicts = [(_name(rule), _verdict(rule, home, points, planned, free)) for rule in rules]
    collided = not all(home.plan.free((x, y)) for x, y in points[::5])
    return Outcome(verdicts, False, collided, planned.goal.length_m - free.goal.length_m, ms)


def _name(rule: RouteRule) -> str:
    assert rule.target is not None
    return f"{rule.kind} {rule.target.kind}, {rule.strength}"


def _verdict(rule: RouteRule, home: Home, points: Points, planned: RoutePlan, free: RoutePlan) -> str:
    """Whether a path obeys a rule, by the truth; at a start or a goal within its area nothing can be asked."""
    assert planned.goal is not None and free.goal is not None
    far = off_m(rule, home)(points)
    if rule.kind == "slow-near":
        near = off_m(rule, home)(planned.goal.path) < SLOW_NEAR_M - EDGE_M
        route = planned.goal.route
        return "obeyed" if route is not None and (route.speed[near] < 1).all() else "broken"
    if rule.kind == "via":
        passed = float(far.min()) <= VIA_M + EDGE_M
        return "obeyed" if passed else "told" if planned.notes else "broken"
    crossed = far < margin_m(rule, home) - EDGE_M
    if rule.kind in ("prefer", "only-through"):
        crossed = far > EDGE_M
        before = float((off_m(rule, home)(dense(free.goal.path)) > EDGE_M).mean())
        return "weighed" if float(crossed.mean()) <= before + 0.02 else "worse"
    if rule.strength == "soft":
        free_points = dense(free.goal.path)
        inside_m = [float((off_m(rule, home)(p) < margin_m(rule, home) - EDGE_M).sum()) for p in (points, free_points)]
        return "weighed" if inside_m[0] <= inside_m[1] * 1.05 + 5 else "worse"
    inside = np.flatnonzero(crossed)
    outside = np.flatnonzero(~crossed)
    if not len(inside):
        return "obeyed"
    if not len(outside) or inside[-1] < outside[0] or inside[0] > outside[-1]:
        return "at an end"
    middle = inside[(inside > outside[0]) & (inside < outside[-1])]
    return "at an end" if not len(middle) else "broken"


def _no_way(home: Home, planned: RoutePlan, free: RoutePlan) -> bool:
    """Whether a flood fill, too, finds no way from the start to where the free way ends under the blocking rules."""
    assert free.goal is not None
    grid = home.site.grid
    open_cells = fits(grid, RobotModel().radius_m)
    cells = np.argwhere(open_cells)
    xy = grid.centre(cells)
    ends = np.array([free.goal.path[0], free.goal.path[-1]])
    for rule in planned.blocking:
        away = off_m(rule, home)
        shut = away(xy) > EDGE_M if rule.kind == "only-through" else away(xy) < margin_m(rule, home)
        near_end = np.min([np.hypot(*(xy - end).T) for end in ends], axis=0) < 0.3
        keep = ~shut | near_end
        open_cells[tuple(cells[~keep].T)] = False
    parts, _ = ndimage.label(open_cells & (grid.cells == FREE), np.ones((3, 3)))
    one, other = (parts[tuple(cell)] for cell in grid.cell(ends))
    return bool(one == 0 or other == 0 or one != other)


def drawn(names: Sequence[str], count: int, seed: int, progress: Progress = silent) -> list[Drive]:
    """Drives to random objects of homes in turn that can be reached, each under one to three random rules."""
    rng, homes = random.Random(seed), [true_home(name) for name in names if count]
    found, tried = list[Drive](), 0
    while len(found) < count and tried < 20 * count:
        home = homes[tried % len(homes)]
        tried += 1
        obj = rng.choice(home.site.objects)
        place = Place(obj.label, obj.position, 1.0, -1, box_min=obj.box_min, box_max=obj.box_max, object_id=obj.id)
        rules = random_rules(home, rng)
        free = plan_route(home.site, place, home.scene.start_xy, RobotModel())
        if free.goal is not None:
            found.append(Drive(home, place, rules, free))
            progress("drawing", len(found), count)
    return found


def figures(done: Sequence[Outcome]) -> dict[str, Any]:
    """What came of drives: how often each kind of rule had each verdict, and the totals."""
    verdicts: dict[str, Counter[str]] = defaultdict(Counter)
    for outcome in done:
        for name, verdict in outcome.verdicts:
            verdicts[name][verdict] += 1
    detours_m = [outcome.longer_m for outcome in done if outcome.longer_m > 0.05]
    spent_ms = [outcome.ms for outcome in done] or [0.0]
    return {
        "drives": len(done), "verdicts": {name: dict(verdicts[name]) for name in sorted(verdicts)},
        "hard_rules_broken": sum(found["broken"] for name, found in verdicts.items() if name.endswith("hard")),
        "collided": sum(outcome.collided for outcome in done), "asked": sum(outcome.asked for outcome in done),
        "detours": len(detours_m), "median_detour_m": round(statistics.median(detours_m or [0.0]), 2),
        "median_ms": round(statistics.median(spent_ms), 1), "most_ms": round(max(spent_ms), 1),
    }  # fmt: skip
