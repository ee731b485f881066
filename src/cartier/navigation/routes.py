"""Route planning under rules: a goal whose path obeys them, or the rule that stands in the way and what it costs.

Hard rules are walls, and areas to pass; soft ones are cost layers, which are summed. The path is the cheapest one,
exactly (``search.py``). A robot that stands where it must not be leaves, and does not come back in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np

from cartier.errors import InputError, check_radius
from cartier.navigation.layers import (
    CostLayer,
    Mask,
    RouteMap,
    area_of,
    ruled_area,
)
from cartier.navigation.planning import (
    check_start,
    no_pose,
    no_start,
    start_cell,
    traversable,
)
from cartier.navigation.ruled_drive import OTHER_WAY_M, WALLS, Drive, Ruled, Way
from cartier.types import Goal, OccupancyGrid, Place, RobotModel
from cartier.types.route_rules import RouteRule, called

MOST_TRIED = 64  # sets of rules that are tried as what stands in the way


@dataclass(frozen=True, eq=False)
class RoutePlan:
    """The outcome of planning under rules.

    ``goal`` is the pose and the way there, or None; ``why_not`` says why there is none. Where hard rules alone stand in
    the way, ``blocking`` is a smallest set of them that would have to be broken, and ``breach`` the goal if they are:
    whoever drives it must have asked. ``doubts`` are orders about a kind of floor, each with the metres of the way over
    floor whose kind is unknown. ``notes`` are lines for the person, one for each doubt among them.
    """

    goal: Goal | None
    why_not: str = ""
    blocking: tuple[RouteRule, ...] = ()
    breach: Goal | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[tuple[RouteRule, float], ...] = ()


def plan_route(
    site: RouteMap,
    place: Place,
    start_xy: Sequence[float],
    robot: RobotModel,
    rules: Sequence[RouteRule] = (),
    layers: Sequence[CostLayer] = (),
) -> RoutePlan:
    """A goal for a place whose path obeys the hard rules and weighs the soft ones and the further cost layers.

    A rule about what the home lacks is left out, and ``notes`` say so. Raises InputError for an invalid start or
    radius.
    """
    start_xy, radius_m = check_start(start_xy), check_radius(robot.radius_m)
    open_cells = _open_cells(site.grid, radius_m)
    start = start_cell(site.grid, open_cells, start_xy)
    if start is None:
        return RoutePlan(None, no_start(site.grid, open_cells, start_xy, radius_m))
    drive = Drive(site, place, robot, open_cells, start, tuple(layers))
    free = drive.way((), plain=True)
    if free is None:
        return RoutePlan(None, no_pose(place, start_xy))
    ruled, notes = _ruled(rules, site, free)
    if any(each.rule.kind == "shortest" for each in ruled):
        weighed = [each for each in ruled if each.rule.strength == "hard"]
        notes += [f"not weighed, to take the short way: {each.rule.wish}" for each in ruled if each not in weighed]
        drive, ruled = replace(drive, layers=()), weighed
    way, left_out = drive.wished(ruled, free)
    if way is None:
        return _blocked(drive, ruled, free, notes)
    notes += [
        f"not past {called(each.rule.target)}: that would be a long detour" for each in left_out if each.rule.target
    ]
    kept = [each for each in ruled if each not in left_out]
    doubts = _doubts(drive, way, kept)
    told = (_unsure(rule, over_m) for rule, over_m in doubts)
    return RoutePlan(drive.goal(way, kept, free), notes=(*notes, *_detour(way, free, kept), *told), doubts=doubts)


@lru_cache(maxsize=4)  # many drives go over one floor plan
def _open_cells(grid: OccupancyGrid, radius_m: float) -> Mask:
    return traversable(grid, radius_m)


def _ruled(rules: Iterable[RouteRule], site: RouteMap, free: Way) -> tuple[list[Ruled], list[str]]:
    """The rules with their cells, and a note for each that is about nothing in this home."""
    found, notes = list[Ruled](), list[str]()
    for rule in rules:
        try:
            found.append(Ruled(rule, ruled_area(rule, site), doubtful=_doubtful(rule, site)))
        except InputError as error:
            notes.append(f"a rule is left out ({rule.in_words()}): {error}")
    for k, each in enumerate(found):
        if each.rule.kind == "only-through":
            found[k] = replace(each, allowed=each.area | _ends(each.rule, site, free))
    return found, notes


def _doubtful(rule: RouteRule, site: RouteMap) -> Mask | None:
    """The cells whose kind of floor is unknown, for an order about a kind of floor."""
    kinds = site.grid.floor_kinds
    if kinds is None or rule.target is None or rule.target.kind != "floor":
        return None
    return np.asarray(kinds == 0) if rule.kind in WALLS and rule.strength == "hard" else None


def _doubts(drive: Drive, way: Way, ruled: Sequence[Ruled]) -> tuple[tuple[RouteRule, float], ...]:
    over = ((each.rule, drive.over_m(way, each.doubtful)) for each in ruled if each.doubtful is not None)
    return tuple((rule, over_m) for rule, over_m in over if over_m > 0)


def _unsure(rule: RouteRule, over_m: float) -> str:
    assert rule.target is not None
    may = "not be" if rule.kind == "only-through" else "be"
    return f"{over_m:.1f} m of the way are over floor that was not seen well enough: it may {may} {called(rule.target)}"


def _ends(rule: RouteRule, site: RouteMap, free: Way) -> Mask:
    """Where a drive "only through" something may be, besides: the rooms where it begins and ends; for a door all but
    the other doors, and for a kind of floor what nobody knows to be of another kind."""
    assert rule.target is not None
    if rule.target.kind == "floor":
        kinds = site.grid.floor_kinds
        return np.zeros(site.grid.cells.shape, bool) if kinds is None else np.asarray(kinds == 0)
    if rule.target.kind == "door":
        return ~_other_doors(rule, site)
    numbers = site.room_numbers
    ends = [numbers[tuple(end)] for end in (free.cells[0], free.cells[-1])]
    return np.isin(numbers, [-1, *ends])  # thresholds are of no room


def _other_doors(rule: RouteRule, site: RouteMap) -> Mask:
    assert rule.target is not None
    mine = area_of(rule.target, site)
    every = np.zeros(mine.shape, bool)
    names = {room.id: room.name for room in site.rooms}
    for door in site.doors:
        pair = tuple(names[number] for number in door.rooms)
        every |= area_of(replace(rule.target, names=pair, said=""), site)
    return every & ~mine


def _blocked(drive: Drive, ruled: Sequence[Ruled], free: Way, notes: Sequence[str]) -> RoutePlan:
    """Which hard rules stand in the way, as few as can be, and the way that breaks them as little as can be."""
    hard = [each for each in ruled if each.rule.strength == "hard" and (each.wall or each.via)]
    tried = 0
    for size in range(1, len(hard) + 1):
        found = []
        for out in combinations(hard, size):
            tried += 1
            way = drive.way([each for each in ruled if each not in out], out) if tried <= MOST_TRIED else None
            if way is not None and drive.good(way, free):
                found.append((way, out))
        if found:
            way, out = min(found, key=lambda each: each[0].cost)
            break
    else:
        way, out = free, tuple(hard)
    kept = [each for each in ruled if each not in out]
    breach = drive.goal(way, kept, free, out)
    return RoutePlan(None, _why(drive, way, out), tuple(each.rule for each in out), breach, tuple(notes))


def _why(drive: Drive, way: Way, out: Sequence[Ruled]) -> str:
    """What a person is told of the rules in the way: "that takes 1.2 m over the carpet, and you said “…”"."""
    told = []
    for each in out:
        said = f" (“{each.rule.said}”)" if each.rule.said else ""
        over_m = drive.crossed_m(way, each)
        target = "" if each.rule.target is None else called(each.rule.target)
        if each.rule.kind == "via":
            told.append(f"I cannot pass {target}{said}")
        elif each.rule.kind == "only-through":
            told.append(f"it takes {over_m:.1f} m elsewhere than {each.rule.wish.removeprefix('go only ')}{said}")
        else:
            by = "near" if each.rule.kind == "keep-away" else "through" if "stay out" in each.rule.wish else "over"
            told.append(f"it takes {over_m:.1f} m {by} {target}, where I must not go{said}")
    return f"to the {drive.place.label}: {' and '.join(told)}; the way would be {way.length_m:.1f} m"


def _detour(way: Way, free: Way, ruled: Sequence[Ruled]) -> list[str]:
    more_m = way.length_m - free.length_m
    made_by = [each.rule.wish for each in ruled if each.rule.kind not in ("shortest", "slow-near")]
    if more_m < OTHER_WAY_M or not made_by or not math.isfinite(more_m):
        return []
    return [f"the way is {more_m:.1f} m longer than the shortest, to {' and to '.join(made_by)}"]
