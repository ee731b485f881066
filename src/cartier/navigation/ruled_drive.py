"""One drive under route rules: the cheapest way to a pose at a place, with its alternatives.

Hard rules are walls, and areas to pass; soft ones are cost layers, which are summed (``layers.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cartier.geometry import yaw_towards
from cartier.navigation.landmarks import directions
from cartier.navigation.layers import SLOW, SOFT_AVOID, Cost, CostLayer, Mask, RouteMap, body_layer, total, wish_layer
from cartier.navigation.planning import SIGHT_DETOUR_M, lines_of_sight, poses_at
from cartier.navigation.search import cheapest
from cartier.types import Goal, Place, RobotModel, Route, RouteAlternative
from cartier.types.route_rules import RouteRule, RuleKind, called

LEAVING = 30.0  # per metre, for a robot that stands where it must not be: it leaves by the shortest way
BREACH = 20.0  # per metre, over what would have to be crossed against a rule
VIA_DETOUR_M = 8.0  # the most that a wish to pass something may cost
OTHER_WAY_M = 0.3  # from what difference of length on another way is told
SIGHTS, UNKNOWN = 48, -1  # poses that are looked from at once
WALLS = ("avoid", "keep-away", "only-through")


@dataclass(frozen=True, eq=False)
class Way:
    """A pose and a path (K, 2) of cells to it; ``off_m`` is how far the pose is off the best distance."""

    cells: npt.NDArray[np.intp]
    cost: float
    off_m: float
    seen: bool
    length_m: float


@dataclass(frozen=True, eq=False)
class Ruled:
    """A rule, the cells (rows, cols) that it is about, and for "only-through" those where the way may go.

    ``doubtful`` are the cells of which nobody knows whether an order about a kind of floor is about them.
    """

    rule: RouteRule
    area: Mask
    allowed: Mask | None = None
    doubtful: Mask | None = None

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


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive to plan: from a cell to a place, over the cells where the robot fits."""

    site: RouteMap
    place: Place
    robot: RobotModel
    open_cells: Mask
    start: tuple[int, int]
    layers: tuple[CostLayer, ...]

    @cached_property
    def sight(self) -> npt.NDArray[np.int8]:
        """For each cell (rows, cols) whether it sees the place: 1, 0, or UNKNOWN until it is asked for."""
        return np.full(self.open_cells.shape, UNKNOWN, np.int8)

    def wished(self, ruled: Sequence[Ruled], free: Way) -> tuple[Way | None, list[Ruled]]:
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

    def good(self, way: Way | None, free: Way) -> bool:
        """Whether a way ends about as well as the one without rules."""
        return way is not None and way.off_m <= free.off_m + SIGHT_DETOUR_M and (way.seen or not free.seen)

    def way(
        self, ruled: Sequence[Ruled], broken: Sequence[Ruled] = (), plain: bool = False, most_m: float = math.inf
    ) -> Way | None:
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
        return Way(found.cells, found.cost, off_m, seen, float(steps.sum()) * self.site.grid.resolution_m)

    def _layers(self, ruled: Sequence[Ruled], broken: Sequence[Ruled], walls: Mask) -> list[CostLayer]:
        wishes = [wish_layer(each.rule, each.area) for each in ruled if not each.wall]
        breaches = [BREACH * each.against for each in broken]
        body = [body_layer(walls, self.robot.radius_m)] if walls.any() else []
        doubts = [SOFT_AVOID * each.doubtful for each in ruled if each.doubtful is not None]
        extra = (_fixed(cost) for cost in (*breaches, *doubts[:1]))  # the cells are the same for all
        return [*self.layers, *(wish for wish in wishes if wish is not None), *body, *extra]

    def _trivial(self, each: Ruled, ends: Mask) -> bool:
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
        close = int(np.searchsorted(steps, steps[0] + SIGHT_DETOUR_M, "right"))
        begin = 0
        while begin < close:  # most often one of the first sees the place
            last = steps[min(begin + SIGHTS, close) - 1]
            end = int(np.searchsorted(steps, last, "right"))
            seeing = begin + np.flatnonzero(self._sees(poses.cells[begin:end]))
            if len(seeing):
                best = seeing[steps[seeing] == steps[seeing[0]]]
                return self._cells(poses.cells[best]), float(steps[best[0]]), True
            begin = end
        return self._cells(poses.cells[steps == steps[0]]), float(steps[0]), False

    def _sees(self, cells: npt.NDArray[np.intp]) -> Mask:
        """Which cells (N, 2) have a line of sight to the place; each is looked from once."""
        known = self.sight[tuple(cells.T)]
        new = cells[known == UNKNOWN]
        if len(new):
            xy, height_m = self.site.grid.centre(new), self.robot.camera_height_m
            self.sight[tuple(new.T)] = lines_of_sight(self.site.grid, xy, self.place, height_m)
        return np.asarray(self.sight[tuple(cells.T)] == 1)

    def _cells(self, cells: npt.NDArray[np.intp]) -> Mask:
        mask = np.zeros(self.open_cells.shape, bool)
        mask[tuple(cells.T)] = True
        return mask

    def goal(self, way: Way, ruled: Sequence[Ruled], free: Way, broken: Sequence[Ruled] = ()) -> Goal:
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

    def _others(self, way: Way, ruled: Sequence[Ruled], free: Way) -> tuple[RouteAlternative, ...]:
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

    def _other(self, other: Way, way: Way, ruled: Sequence[Ruled]) -> RouteAlternative:
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

    def crossed_m(self, way: Way, each: Ruled) -> float:
        """For how many metres a way goes against a rule to avoid, prefer or go only through something."""
        return self.over_m(way, each.against)

    def over_m(self, way: Way, area: Mask) -> float:
        """For how many metres a way goes over an area (rows, cols)."""
        inside = area[tuple(way.cells.T)]
        steps = np.linalg.norm(np.diff(way.cells, axis=0), axis=1) * self.site.grid.resolution_m
        return float((steps * (inside[1:] + inside[:-1].astype(float)) / 2).sum())


def _strict(each: Ruled) -> Ruled:
    """A wish to avoid or prefer an area as an order."""
    kind: RuleKind = "only-through" if each.rule.kind == "prefer" else each.rule.kind
    return Ruled(replace(each.rule, kind=kind, strength="hard"), each.area, ~each.against)


def _around(mask: Mask, cell: tuple[int, int]) -> Mask:
    """The cells of a mask that are joined with a cell."""
    from scipy.ndimage import label

    parts, _ = label(mask, np.ones((3, 3)))
    return np.asarray(parts == parts[cell]) if mask[cell] else np.zeros(mask.shape, bool)


def _fixed(cost: Cost) -> CostLayer:
    return lambda _: cost
