"""Directions: a path as steps that a person could follow, by turns, doors, rooms and the objects on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cartier.navigation.layers import RouteMap
from cartier.types import Array, MapObject, Place
from cartier.types.route_rules import with_article

STRAIGHT_M = 0.3  # how far a path may stray from a straight line that stands for it
TURN_RAD = math.radians(40)
BACK_RAD = math.radians(150)
BESIDE_M = 1.5  # from how near an object is a landmark
MOST_PASSED = 2  # objects told along one straight part: the biggest
LEAST_SIDE_M = 0.25  # of an object that people would notice
CLOSE_M = 0.6  # turns closer than this are one


def directions(path: npt.NDArray[np.float64], site: RouteMap, place: Place) -> tuple[str, ...]:
    """The steps along a path (K, 2) in metres: "past the sofa on your left, through the door into the hall".

    Only confirmed objects of some size are named, from the room that they are in; of those that share a name in one
    room, none.
    """
    way = _Walk(path, site, _marks(site, place))
    corners, told = _corners(path), list[str]()
    for k, (begin, end) in enumerate(pairwise(corners)):
        turn = _turn(path, corners, k) if k else ""
        at = way.landmark(begin) if turn else None
        step = [f"{turn} at the {at.label}" if at is not None else turn] if turn else []
        step += way.along(begin, end)
        if step:
            told.append(", ".join(step))
    told.append(_arrival(path, place))
    return tuple(told)


class _Walk:
    """A path with the objects around it that may still be named, and the room of each of its points (-1: none)."""

    def __init__(self, path: npt.NDArray[np.float64], site: RouteMap, marks: Sequence[MapObject]) -> None:
        self.path, self.site, self.marks, self.named = path, site, marks, set[int]()
        self.rooms = site.room_numbers[tuple(site.grid.cell(path).T)]
        low, high = (
            np.array([getattr(o, side)[:2] for o in marks]).reshape(-1, 1, 2) for side in ("box_min", "box_max")
        )
        self.away_m = np.linalg.norm(np.maximum(np.maximum(low - path, path - high), 0), axis=-1)
        for k, obj in enumerate(marks):
            own = next((n for n, room in enumerate(site.rooms) if room.id == obj.room), -1)
            self.away_m[k, (self.rooms >= 0) & (self.rooms != own)] = np.inf  # behind a wall

    def landmark(self, point: int) -> MapObject | None:
        """The nearest object to a point of the path that was not named yet."""
        near = [(float(far), obj.id, obj) for far, obj in zip(self.away_m[:, point], self.marks, strict=True)]
        near = [each for each in near if each[0] <= BESIDE_M and each[1] not in self.named]
        found = min(near, default=(0.0, 0, None))[2]
        self.named |= {found.id} if found is not None else set()
        return found

    def along(self, begin: int, end: int) -> Iterator[str]:
        """What a straight part passes, in order: objects on either side, and doors into other rooms."""
        found = list(self._entered(begin, end))
        for obj, far in sorted(
            zip(self.marks, self.away_m[:, begin : end + 1], strict=True), key=lambda m: -m[0].volume_m3
        ):
            k = begin + int(far.argmin())
            if obj.id not in self.named and far.min() <= BESIDE_M and begin < k < end:
                way, to = self.path[end] - self.path[begin], np.array(obj.position)[:2] - self.path[k]
                side = "left" if way[0] * to[1] - way[1] * to[0] > 0 else "right"
                found.append((k, f"past the {obj.label} on your {side}"))
                self.named.add(obj.id)
                if len(found) >= MOST_PASSED:
                    break
        yield from (words for _, words in sorted(found, key=lambda each: each[0]))

    def _entered(self, begin: int, end: int) -> Iterator[tuple[int, str]]:
        known = [(k, int(room)) for k, room in enumerate(self.rooms[: end + 1]) if room >= 0]
        for (_, before), (k, now) in pairwise(known):
            if now != before and begin < k <= end:
                pair = {self.site.rooms[before].id, self.site.rooms[now].id}
                door = any(set(door.rooms) == pair for door in self.site.doors)
                yield k, f"{'through the door ' if door else ''}into {with_article(self.site.rooms[now].name)}"


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


def _arrival(path: npt.NDArray[np.float64], place: Place) -> str:
    if len(path) < 2:
        return f"the {place.label} is right here"
    way, to = path[-1] - path[max(len(path) - 8, 0)], np.array(place.position)[:2] - path[-1]
    angle = math.atan2(way[0] * to[1] - way[1] * to[0], float(way @ to))
    side = "in front of you" if abs(angle) < TURN_RAD else "behind you" if abs(angle) > BACK_RAD else ""
    return f"the {place.label} is {side or ('on your left' if angle > 0 else 'on your right')}"
