"""Cost layers of routes: functions from the floor plan to the extra cost of each cell, and the areas of route rules.

A path costs its length times 1 plus the sum of all layers. So a layer of 2 says that a metre there is as bad as three
elsewhere, and ``inf`` makes a wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.types import Door, MapObject, OccupancyGrid, Room
from cartier.types.route_rules import FLOOR_KINDS, RouteRule, RouteTarget, called

Mask = npt.NDArray[np.bool_]
Cost = npt.NDArray[np.floating[Any]]

SOFT_AVOID = 4.0  # a metre over what should be avoided is as bad as five elsewhere
SOFT_PREFER = 1.0  # a metre beside what is preferred is as bad as two on it
HARD_PREFER = 4.0
KEEP_AWAY_M, KEEP_WELL_AWAY_M = 0.6, 1.2  # from the box: the robot's centre never nearer; and rather not
BODY = 3.0  # per metre whose cells the robot's rim, not its centre, has over what is forbidden
AVOID_OBJECT_M = 0.3  # around an object that stands on the floor
FLAT_M = 0.06  # what a robot can drive over
VIA_M = 1.2  # from how near something is passed
SLOW_NEAR_M, SLOW = 1.0, 0.4  # from the box; the share of full speed
DOOR_REACH_M = 0.15  # beyond the width of a passage
MATS = {"carpet": ("carpet", "rug", "mat"), "rug": ("rug", "mat", "carpet")}
"""Kinds of floor that are also objects, by labels that end so."""
SAME_FLOOR = {"carpet": "rug", "rug": "carpet"}
"""What people call by the other's name: it is meant where the home has none of the very kind."""


@dataclass(frozen=True, eq=False)
class RouteMap:
    """What route rules are about: the floor plan (with its kinds of floor), rooms, objects and doors of a home."""

    grid: OccupancyGrid
    rooms: Sequence[Room] = ()
    objects: Sequence[MapObject] = ()
    doors: Sequence[Door] = ()

    @cached_property
    def room_numbers(self) -> npt.NDArray[np.int16]:
        """For each cell (rows, cols) the place of its room in ``rooms``, -1 where there is none."""
        numbers = np.full(self.grid.cells.shape, -1, np.int16)
        for number, room in enumerate(self.rooms):
            numbers[tuple(room.cells.T)] = number
        return numbers


CostLayer = Callable[[RouteMap], Cost]
"""The extra cost (rows, cols) of each cell, per metre: 0 or more, inf for a wall."""


def area_of(target: RouteTarget, site: RouteMap, margin_m: float = 0.0) -> Mask:
    """The cells (rows, cols) that a target covers, objects with a margin around their boxes.

    Raises InputError if the home has nothing of what the target names.
    """
    ways = {"room": _rooms, "floor": _floor, "object": _objects, "door": _doors, "zone": _zone}
    area = ways[target.kind](target, site, margin_m) if target.kind in ways else np.zeros(site.grid.cells.shape, bool)
    if not area.any():
        raise InputError(f"this home's map shows nothing of {called(target)}")
    return area


def ruled_area(rule: RouteRule, site: RouteMap) -> Mask:
    """The cells (rows, cols) that a rule is about: what it avoids, prefers or passes, and where it wants to be slow.

    Raises InputError if the home has nothing of what it names.
    """
    if rule.target is None:
        return np.zeros(site.grid.cells.shape, bool)
    if rule.kind == "avoid":
        return _avoided(rule.target, site)
    if rule.kind == "via":
        return _passed(rule.target, site)
    margin_m = {"keep-away": KEEP_AWAY_M, "slow-near": SLOW_NEAR_M, "prefer": VIA_M, "only-through": VIA_M}[rule.kind]
    return area_of(rule.target, site, margin_m)


def _avoided(target: RouteTarget, site: RouteMap) -> Mask:
    """The cells of what must not be crossed, and a little around objects that stand there."""
    area = area_of(target, site)
    if target.kind != "object":
        return area
    tall = tuple(obj.id for obj in _meant(target, site) if obj.box_max[2] > FLAT_M)
    return area | area_of(RouteTarget("object", ids=tall), site, AVOID_OBJECT_M) if tall else area


def _passed(target: RouteTarget, site: RouteMap) -> Mask:
    """The cells from which a robot passes something; objects only from the rooms that they are in."""
    area = area_of(target, site, VIA_M)
    if target.kind != "object":
        return area
    rooms = {obj.room for obj in _meant(target, site) if obj.room is not None}
    inside = np.isin(site.room_numbers, [k for k, room in enumerate(site.rooms) if room.id in rooms])
    return area & inside if (area & inside).any() else area


def wish_layer(rule: RouteRule, area: Mask) -> CostLayer | None:
    """The layer of a wish to avoid, keep away from or prefer an area (rows, cols), or None for other kinds of rules."""
    if rule.kind == "avoid":
        return lambda _: SOFT_AVOID * area
    if rule.kind == "keep-away":
        return lambda site: SOFT_AVOID * _nearness(rule, site)
    if rule.kind in ("prefer", "only-through"):
        most = HARD_PREFER if rule.strength == "hard" or rule.kind == "only-through" else SOFT_PREFER
        return lambda _: most * ~area
    return None


def body_layer(walls: Mask, radius_m: float) -> CostLayer:
    """The layer that keeps the robot's rim, too, off what its centre must not cross, where there is room for it."""
    return lambda site: BODY * within(walls, radius_m / site.grid.resolution_m)


def total(layers: Sequence[CostLayer], site: RouteMap) -> Cost:
    """The cost (rows, cols) of a metre in each cell: 1 and all layers."""
    cost = np.ones(site.grid.cells.shape)
    for layer in layers:
        cost += layer(site)
    return cost


def within(mask: Mask, radius_cells: float) -> Mask:
    """The cells whose centre is at most a radius from a cell of a mask."""
    high = math.ceil(radius_cells + math.sqrt(0.5)) - 1
    rows, cols = mask.shape
    before = np.cumsum(np.pad(mask, ((high, high), (high + 1, high))), axis=1, dtype=np.int32)
    near = np.zeros(mask.shape, bool)
    for down in range(-high, high + 1):  # the disc, row by row
        wide = math.ceil(math.sqrt(max((radius_cells + math.sqrt(0.5)) ** 2 - down**2, 0))) - 1
        counts = before[high + down : high + down + rows]
        near |= counts[:, high + wide + 1 : high + wide + 1 + cols] > counts[:, high - wide : high - wide + cols]
    return near


def _meant(target: RouteTarget, site: RouteMap) -> list[MapObject]:
    return [obj for obj in site.objects if not set(target.ids).isdisjoint((obj.id, *obj.aliases))]


def _rooms(target: RouteTarget, site: RouteMap, margin_m: float) -> Mask:
    names = {name.casefold() for name in target.names}
    return np.isin(site.room_numbers, [k for k, room in enumerate(site.rooms) if room.name.casefold() in names])


def _floor(target: RouteTarget, site: RouteMap, margin_m: float) -> Mask:
    area = np.zeros(site.grid.cells.shape, bool)
    for kind in target.names:
        seen = _floor_cells(kind, site)
        area |= seen if seen.any() else _floor_cells(SAME_FLOOR.get(kind, kind), site)
    return area


def _floor_cells(kind: str, site: RouteMap) -> Mask:
    """The cells of a kind of floor: as the map's cameras saw it, else under listed rugs and mats."""
    kinds = site.grid.floor_kinds
    if kinds is not None and (seen := kinds == FLOOR_KINDS.index(kind)).any():
        return np.asarray(seen)
    mats = [o.id for o in site.objects if o.confirmed and o.label.split()[-1] in MATS.get(kind, ())]
    return (
        _objects(RouteTarget("object", ids=tuple(mats)), site, 0.0) if mats else np.zeros(site.grid.cells.shape, bool)
    )


def _objects(target: RouteTarget, site: RouteMap, margin_m: float) -> Mask:
    return _distance_m(target, site, margin_m) <= margin_m


def _distance_m(target: RouteTarget, site: RouteMap, most_m: float) -> Cost:
    """The distance (rows, cols) of each cell's centre to the nearest box of a target's objects; inf beyond a limit."""
    grid = site.grid
    far = np.full(grid.cells.shape, np.inf)
    for obj in _meant(target, site):
        low, high = np.array(obj.box_min[:2]), np.array(obj.box_max[:2])
        (top, left), (bottom, right) = grid.cell(low - most_m), grid.cell(high + most_m) + 1
        window = slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, 0))
        if not far[window].size:
            continue
        rows, cols = np.mgrid[window[0].start : window[0].start + far[window].shape[0],
                              window[1].start : window[1].start + far[window].shape[1]]  # fmt: skip
        there = box_distance(grid.centre(np.stack([rows, cols], -1)).reshape(-1, 2), low, high)
        far[window] = np.minimum(far[window], there.reshape(rows.shape))
    return far


def _nearness(rule: RouteRule, site: RouteMap) -> Cost:
    """From 1 at what is to be kept away from down to 0 at a good distance."""
    assert rule.target is not None
    if rule.target.kind != "object":
        return area_of(rule.target, site).astype(np.float64)
    area_of(rule.target, site, KEEP_WELL_AWAY_M)  # raises if there is none
    far = _distance_m(rule.target, site, KEEP_WELL_AWAY_M)
    return np.asarray(np.clip(1 - far / KEEP_WELL_AWAY_M, 0, None))


def _doors(target: RouteTarget, site: RouteMap, margin_m: float) -> Mask:
    ids = {room.name.casefold(): room.id for room in site.rooms}
    pairs = zip(target.names[::2], target.names[1::2], strict=True)
    wanted = [{ids.get(one.casefold()), ids.get(other.casefold())} for one, other in pairs]
    area = np.zeros(site.grid.cells.shape, bool)
    for door in site.doors:
        if set(door.rooms) in wanted:
            half_m = door.width_m / 2 + DOOR_REACH_M
            area |= _disc(site.grid, door.xy, half_m)
    return area


def _disc(grid: OccupancyGrid, xy: Sequence[float], radius_m: float) -> Mask:
    area = np.zeros(grid.cells.shape, bool)
    rows, cols = np.arange(grid.cells.shape[0])[:, None], np.arange(grid.cells.shape[1])[None]
    row, col = ((np.asarray(xy) - grid.origin_xy) / grid.resolution_m - 0.5)[::-1]
    area |= (rows - row) ** 2 + (cols - col) ** 2 <= (radius_m / grid.resolution_m) ** 2
    return area


def _zone(target: RouteTarget, site: RouteMap, margin_m: float) -> Mask:
    """The cells whose centre lies in a polygon (even-odd rule)."""
    grid, corners = site.grid, target.polygon_xy
    area = np.zeros(grid.cells.shape, bool)
    top_left = np.maximum(grid.cell(np.min(corners, axis=0)), 0)
    bottom_right = np.maximum(grid.cell(np.max(corners, axis=0)) + 1, 0)
    window = slice(top_left[0], bottom_right[0]), slice(top_left[1], bottom_right[1])
    cells = np.moveaxis(np.indices(area[window].shape), 0, -1) + top_left
    x, y = np.moveaxis(grid.centre(cells), -1, 0)
    inside = np.zeros(x.shape, bool)
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if y1 != y2:
            inside ^= ((y1 > y) != (y2 > y)) & (x < (x2 - x1) * (y - y1) / (y2 - y1) + x1)
    area[window] = inside
    return area
