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
import numpy.typing as npt

from cartier.errors import InputError, check_radius
from cartier.geometry import yaw_towards
from cartier.navigation.landmarks import directions
from cartier.navigation.layers import (
    SLOW,
    Cost,
    CostLayer,
    Mask,
    RouteMap,
    area_of,
    body_layer,
    ruled_area,
    total,
    wish_layer,
)
from cartier.navigation.planning import (
    SIGHT_DETOUR_M,
    check_start,
    line_of_sight,
    no_pose,
    no_start,
    poses_at,
    start_cell,
    traversable,
)
from cartier.navigation.search import cheapest
from cartier.route_rules import RouteRule, RuleKind, called
from cartier.types import Goal, OccupancyGrid, Place, RobotModel, Route, RouteAlternative

LEAVING = 30.0  # per metre, for a robot that stands where it must not be: it leaves by the shortest way
BREACH = 20.0  # per metre, over what would have to be crossed against a rule
VIA_DETOUR_M = 8.0  # the most that a wish to pass something may cost
OTHER_WAY_M = 0.3  # from what difference of length on another way is told
MOST_TRIED = 64  # sets of rules that are tried as what stands in the way
WALLS = ("avoid", "keep-away", "only-through")


@dataclass(frozen=True, eq=False)
class RoutePlan:
    """The outcome of planning under rules.

    ``goal`` is the pose and the way there, or None; ``why_not`` says why there is none. Where hard rules alone stand in
    the way, ``blocking`` is a smallest set of them that would have to be broken, and ``breach`` the goal if they are:
    whoever drives it must have asked. ``notes`` are lines for the person.
    """

    goal: Goal | None
    why_not: str = ""
    blocking: tuple[RouteRule, ...] = ()
    breach: Goal | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Way:
    """A pose and a path (K, 2) of cells to it; ``off_m`` is how far the pose is off the best distance."""

    cells: npt.NDArray[np.intp]
    cost: float
    off_m: float
    seen: bool
    length_m: float


@dataclass(frozen=True, eq=False)
class _Ruled:
    """A rule, the cells (rows, cols) that it is about, and for "only-through" those where the way may go."""

    rule: RouteRule
    area: Mask
    allowed: Mask | None = None

    @property
    def against(self) -> Mask:
        """The cells where a path goes against it."""
        if self.allowed is not None:
            return ~self.allowed
        return ~self.area if self.rule.kind in ("prefer", "only-through") else self.area

    @property
    def wall(self) -> bool:
        return self.rule.kind in WALLS and self.rule.strength == "hard"

    @property
    def via(self) -> bool:
        return self.rule.kind in ("via", "only-through") and (self.rule.strength == "hard" or self.rule.kind == "via")


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
    drive = _Drive(site, place, robot, open_cells, start, tuple(layers))
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
    return RoutePlan(drive.goal(way, kept, free), notes=(*notes, *_detour(way, free, kept)))


@lru_cache(maxsize=4)  # many drives go over one floor plan
def _open_cells(grid: OccupancyGrid, radius_m: float) -> Mask:
    return traversable(grid, radius_m)


def _ruled(rules: Iterable[RouteRule], site: RouteMap, free: _Way) -> tuple[list[_Ruled], list[str]]:
    """The rules with their cells, and a note for each that is about nothing in this home."""
    found, notes = list[_Ruled](), list[str]()
    for rule in rules:
        try:
            found.append(_Ruled(rule, ruled_area(rule, site)))
        except InputError as error:
            notes.append(f"a rule is left out ({rule.in_words()}): {error}")
    for k, each in enumerate(found):
        if each.rule.kind == "only-through":
            found[k] = _Ruled(each.rule, each.area, each.area | _ends(each.rule, site, free))
    return found, notes


def _ends(rule: RouteRule, site: RouteMap, free: _Way) -> Mask:
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


@dataclass(frozen=True, eq=False)
class _Drive:
    """One drive to plan: from a cell to a place, over the cells where the robot fits."""

    site: RouteMap
    place: Place
    robot: RobotModel
    open_cells: Mask
    start: tuple[int, int]
    layers: tuple[CostLayer, ...]

    def wished(self, ruled: Sequence[_Ruled], free: _Way) -> tuple[_Way | None, list[_Ruled]]:
        """The way under all rules, or without the wishes to pass something that would be too long a detour."""
        wishes = [each for each in ruled if each.rule.kind == "via" and each.rule.strength == "soft"]
        without = self.way([each for each in ruled if each not in wishes])
        if not wishes or not self.good(without, free):
            return (without if self.good(without, free) else None), wishes
        assert without is not None
        way = self.way(ruled)
        most = without.cost + VIA_DETOUR_M / self.site.grid.resolution_m
        if way is not None and self.good(way, free) and way.cost <= most:
            return way, []
        return without, wishes

    def good(self, way: _Way | None, free: _Way) -> bool:
        """Whether a way ends about as well as the one without rules."""
        return way is not None and way.off_m <= free.off_m + SIGHT_DETOUR_M and (way.seen or not free.seen)

    def way(
        self, ruled: Sequence[_Ruled], broken: Sequence[_Ruled] = (), plain: bool = False, most_m: float = math.inf
    ) -> _Way | None:
        """The cheapest way under rules, or None; ``broken`` ones are crossed as little as can be.

        ``plain``: no layer but length counts. No way that costs more than ``most_m`` is searched for.
        """
        walls = np.zeros(self.open_cells.shape, bool)
        for each in ruled:
            if each.wall:
                walls |= each.against
        leaving = _around(self.open_cells & walls, self.start) if walls[self.start] else np.zeros(walls.shape, bool)
        usable = self.open_cells & (~walls | leaving)
        reachable = _around(usable, self.start) & ~walls
        targets = self._poses(reachable)
        if targets is None:
            return None
        ends, off_m, seen = targets
        passes = [each.area & reachable for each in ruled if each.via and not self._trivial(each, ends)]
        cost = np.ones(walls.shape) if plain else total(self._layers(ruled, broken, walls), self.site)
        cost[leaving] += LEAVING
        most = most_m / self.site.grid.resolution_m
        found = cheapest(np.where(usable, cost, np.inf), self.start, [*passes, ends], most)
        if found is None:
            return None
        crossed = walls[tuple(found.cells.T)]
        if crossed[int(np.argmin(crossed)) :].any():
            return None  # it comes back in
        steps = np.linalg.norm(np.diff(found.cells, axis=0), axis=1)
        return _Way(found.cells, found.cost, off_m, seen, float(steps.sum()) * self.site.grid.resolution_m)

    def _layers(self, ruled: Sequence[_Ruled], broken: Sequence[_Ruled], walls: Mask) -> list[CostLayer]:
        wishes = [wish_layer(each.rule, each.area) for each in ruled if not each.wall]
        breaches = [BREACH * each.against for each in broken]
        body = [body_layer(walls, self.robot.radius_m)] if walls.any() else []
        return [*self.layers, *(wish for wish in wishes if wish is not None), *body, *(_fixed(b) for b in breaches)]

    def _trivial(self, each: _Ruled, ends: Mask) -> bool:
        """Whether "only through" something asks for nothing: the drive stays in one room."""
        if each.rule.kind != "only-through":
            return False
        numbers = self.site.room_numbers
        return bool(numbers[self.start] >= 0 and (numbers[ends] == numbers[self.start]).any())

    def _poses(self, reachable: Mask) -> tuple[Mask, float, bool] | None:
        """The cells of the best poses, of equal worth, how far off the best distance they are, and whether they see
        the place; see ``planning.goal_for``."""
        poses = poses_at(self.site.grid, reachable, self.place)
        if not len(poses.cells):
            return None
        if self.place.view_yaw is not None:
            return self._cells(poses.cells), float(poses.off_m[0]), bool(poses.off_m[0] < 0.5)
        steps = np.round(poses.off_m, 2)
        xy, height_m = self.site.grid.centre(poses.cells), self.robot.camera_height_m
        for step in np.unique(steps[poses.off_m <= poses.off_m[0] + SIGHT_DETOUR_M]):
            near = np.flatnonzero(steps == step)
            seeing = [i for i in near if line_of_sight(self.site.grid, xy[i], self.place, height_m)]
            if seeing:
                return self._cells(poses.cells[seeing]), float(step), True
        return self._cells(poses.cells[steps == steps[0]]), float(steps[0]), False

    def _cells(self, cells: npt.NDArray[np.intp]) -> Mask:
        mask = np.zeros(self.open_cells.shape, bool)
        mask[tuple(cells.T)] = True
        return mask

    def goal(self, way: _Way, ruled: Sequence[_Ruled], free: _Way, broken: Sequence[_Ruled] = ()) -> Goal:
        """The goal of a way, with its route."""
        path, shortest = (self.site.grid.centre(each.cells) for each in (way, free))
        (x, y), target = path[-1].tolist(), self.place.position
        yaw = yaw_towards(x, y, *target[:2]) if self.place.view_yaw is None else self.place.view_yaw
        speed = np.ones(len(path))
        for each in ruled:
            if each.rule.kind == "slow-near":
                share = SLOW if each.rule.strength == "hard" else (1 + SLOW) / 2
                speed = np.minimum(speed, np.where(each.area[tuple(way.cells.T)], share, 1.0))
        told = directions(path, self.site, self.place)
        rules, breaks = tuple(each.rule for each in ruled), tuple(each.rule for each in broken)
        others = () if broken else self._others(way, ruled, free)
        route = Route(rules, free.length_m, told, speed, shortest, others, breaks)
        return Goal(x, y, float(yaw), path, way.length_m, self.place, way.seen, route)

    def _others(self, way: _Way, ruled: Sequence[_Ruled], free: _Way) -> tuple[RouteAlternative, ...]:
        """The way that takes wishes for orders, where this one does not, and the shortest one."""
        found = []
        soft = [each for each in ruled if each.rule.strength == "soft" and each.rule.kind in ("avoid", "prefer")]
        unmet = [each for each in soft if self.crossed_m(way, each) >= OTHER_WAY_M]
        if unmet:
            strict = [_strict(each) if each in unmet else each for each in ruled]
            other = self.way(strict, most_m=2 * way.length_m + VIA_DETOUR_M)
            if other is not None and self.good(other, free):
                found.append(self._other(other, way, strict))
        if way.length_m - free.length_m >= OTHER_WAY_M:
            found.append(self._other(free, way, ruled))
        return tuple(sorted(found, key=lambda other: other.length_m))

    def _other(self, other: _Way, way: _Way, ruled: Sequence[_Ruled]) -> RouteAlternative:
        more_m = other.length_m - way.length_m
        words = [f"{abs(more_m):.1f} m {'longer' if more_m > 0 else 'shorter'}"]
        for each in ruled:
            if each.rule.target is None or each.rule.kind not in (*WALLS, "prefer"):
                continue
            over_m = self.crossed_m(other, each)
            name, beside = called(each.rule.target), each.rule.kind in ("prefer", "only-through")
            if over_m >= self.site.grid.resolution_m:
                words.append(f"{over_m:.1f} m of it {'not ' if beside else ''}{'over' if not beside else 'on'} {name}")
            elif self.crossed_m(way, each) > 0:
                words.append(f"all on {name}" if beside else f"none of it over {name}")
        for each in ruled:
            if each.rule.kind == "via" and not each.area[tuple(other.cells.T)].any() and each.rule.target is not None:
                words.append(f"not past {called(each.rule.target)}")
        return RouteAlternative(", ".join(words), other.length_m, self.site.grid.centre(other.cells))

    def crossed_m(self, way: _Way, each: _Ruled) -> float:
        """For how many metres a way goes against a rule to avoid, prefer or go only through something."""
        against = each.against[tuple(way.cells.T)]
        steps = np.linalg.norm(np.diff(way.cells, axis=0), axis=1) * self.site.grid.resolution_m
        return float((steps * (against[1:] + against[:-1].astype(float)) / 2).sum())


def _strict(each: _Ruled) -> _Ruled:
    """A wish to avoid or prefer an area as an order."""
    kind: RuleKind = "only-through" if each.rule.kind == "prefer" else each.rule.kind
    return _Ruled(replace(each.rule, kind=kind, strength="hard"), each.area, ~each.against)


def _around(mask: Mask, cell: tuple[int, int]) -> Mask:
    """The cells of a mask that are joined with a cell."""
    from scipy.ndimage import label

    parts, _ = label(mask, np.ones((3, 3)))
    return np.asarray(parts == parts[cell]) if mask[cell] else np.zeros(mask.shape, bool)


def _fixed(cost: Cost) -> CostLayer:
    return lambda _: cost


def _blocked(drive: _Drive, ruled: Sequence[_Ruled], free: _Way, notes: Sequence[str]) -> RoutePlan:
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


def _why(drive: _Drive, way: _Way, out: Sequence[_Ruled]) -> str:
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


def _detour(way: _Way, free: _Way, ruled: Sequence[_Ruled]) -> list[str]:
    more_m = way.length_m - free.length_m
    made_by = [each.rule.wish for each in ruled if each.rule.kind not in ("shortest", "slow-near")]
    if more_m < OTHER_WAY_M or not made_by or not math.isfinite(more_m):
        return []
    return [f"the way is {more_m:.1f} m longer than the shortest, to {' and to '.join(made_by)}"]
