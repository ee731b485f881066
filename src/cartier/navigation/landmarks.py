"""Directions: a path as steps that a person could follow, by turns, doors, rooms and the objects on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cartier.navigation.layers import RouteMap
from cartier.types import Array, MapObject, Place

STRAIGHT_M = 0.3  # how far a path may stray from a straight line that stands for it
TURN_RAD = math.radians(40)
BACK_RAD = math.radians(150)
BESIDE_M = 1.5  # from how near an object is a landmark
LEAST_SIDE_M = 0.25  # of an object that people would notice
CLOSE_M = 0.6  # turns closer than this are one


def directions(path: npt.NDArray[np.float64], site: RouteMap, place: Place) -> tuple[str, ...]:
    """The steps along a path (K, 2) in metres: "past the sofa on your left, through the door into the hall".

    Only confirmed objects of some size are named; of one that shares its name with another in its room, only the room.
    """
    marks = _marks(site, place)
    corners = _corners(path)
    told, named = list[str](), set[int]()
    for k, (begin, end) in enumerate(pairwise(corners)):
        step = []
        turn = _turn(path, corners, k) if k else ""
        if turn:
            at = _nearest(path[begin], marks, named)
            step.append(f"{turn} at the {at.label}" if at is not None else turn)
            named |= {at.id} if at is not None else set()
        step += _along(path[begin : end + 1], site, marks, named, path[max(begin - 1, 0)])
        if step:
            told.append(", ".join(step))
    told.append(_arrival(path, place))
    return tuple(told)


def _marks(site: RouteMap, place: Place) -> list[MapObject]:
    """The objects by which a person finds the way: each the only one of its name in its room."""
    seen = [
        obj for obj in site.objects
        if obj.confirmed and obj.id != place.object_id and obj.box_max[2] > LEAST_SIDE_M
        and max(np.subtract(obj.box_max, obj.box_min)[:2]) >= LEAST_SIDE_M
    ]  # fmt: skip
    count: dict[tuple[str, int | None], int] = {}
    for obj in seen:
        count[obj.label, obj.room] = count.get((obj.label, obj.room), 0) + 1
    return [obj for obj in seen if count[obj.label, obj.room] == 1]


def _corners(path: npt.NDArray[np.float64]) -> list[int]:
    """The indices of the points between which a path is nearly straight (Douglas and Peucker 1973)."""
    kept, open_parts = {0, len(path) - 1}, [(0, len(path) - 1)]
    while open_parts:
        begin, end = open_parts.pop()
        if end - begin < 2:
            continue
        line, rest = path[end] - path[begin], path[begin + 1 : end] - path[begin]
        length = float(np.linalg.norm(line))
        off = np.abs(line[0] * rest[:, 1] - line[1] * rest[:, 0]) / length if length else np.linalg.norm(rest, axis=1)
        if off.max() > STRAIGHT_M:
            middle = begin + 1 + int(off.argmax())
            kept.add(middle)
            open_parts += [(begin, middle), (middle, end)]
    corners = [0]
    for corner in sorted(kept)[1:-1]:
        far = min(np.linalg.norm(path[corner] - path[corners[-1]]), np.linalg.norm(path[corner] - path[-1]))
        if far >= CLOSE_M:
            corners.append(corner)
    return [*corners, len(path) - 1] if len(path) > 1 else corners


def _turn(path: Array, corners: Sequence[int], k: int) -> str:
    before, here, after = (path[corners[i]] for i in (k - 1, k, k + 1))
    one, two = here - before, after - here
    angle = math.atan2(one[0] * two[1] - one[1] * two[0], float(one @ two))
    if abs(angle) < TURN_RAD:
        return ""
    return "turn back" if abs(angle) > BACK_RAD else "left" if angle > 0 else "right"


def _nearest(xy: Array, marks: Sequence[MapObject], named: set[int]) -> MapObject | None:
    near = [(float(_away_m(xy, obj)), obj.id, obj) for obj in marks if obj.id not in named]
    return min((each for each in near if each[0] <= BESIDE_M), default=(0.0, 0, None))[2]


def _away_m(xy: Array, obj: MapObject) -> float:
    outside = np.maximum(np.maximum(np.array(obj.box_min)[:2] - xy, xy - np.array(obj.box_max)[:2]), 0)
    return float(np.linalg.norm(outside))


def _along(
    part: npt.NDArray[np.float64], site: RouteMap, marks: Sequence[MapObject], named: set[int], before: Array
) -> Iterator[str]:
    """What one straight part passes, in order: objects on either side, and doors into other rooms."""
    found = list[tuple[int, str]]()
    way = part[-1] - part[0]
    for obj in marks:
        far = np.array([_away_m(xy, obj) for xy in part])
        k = int(far.argmin())
        if obj.id not in named and far[k] <= BESIDE_M and 0 < k < len(part) - 1:
            to = np.array(obj.position)[:2] - part[k]
            side = "left" if way[0] * to[1] - way[1] * to[0] > 0 else "right"
            found.append((k, f"past the {obj.label} on your {side}"))
            named.add(obj.id)
    found += _rooms_entered(part, site, before)
    yield from (words for _, words in sorted(found, key=lambda each: each[0]))


def _rooms_entered(part: npt.NDArray[np.float64], site: RouteMap, before: Array) -> Iterator[tuple[int, str]]:
    rooms = np.full(site.grid.cells.shape, -1)
    for number, room in enumerate(site.rooms):
        rooms[tuple(room.cells.T)] = number
    cells = site.grid.cell(np.vstack([before[None], part]))
    inside = rooms[tuple(cells.T)]
    last = int(inside[0])
    for k, number in enumerate(inside[1:]):
        if number >= 0 and number != last:
            if last >= 0:
                pair = {site.rooms[last].id, site.rooms[number].id}
                door = any(set(door.rooms) == pair for door in site.doors)
                yield k, f"{'through the door ' if door else ''}into the {site.rooms[number].name}"
            last = int(number)


def _arrival(path: npt.NDArray[np.float64], place: Place) -> str:
    if len(path) < 2:
        return f"the {place.label} is right here"
    way, to = path[-1] - path[max(len(path) - 8, 0)], np.array(place.position)[:2] - path[-1]
    angle = math.atan2(way[0] * to[1] - way[1] * to[0], float(way @ to))
    side = "in front of you" if abs(angle) < TURN_RAD else "behind you" if abs(angle) > BACK_RAD else ""
    return f"the {place.label} is {side or ('on your left' if angle > 0 else 'on your right')}"
