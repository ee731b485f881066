"""Openings in walls: doorways between rooms, windows and the front door."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.errors import InputError
from cartier_dollhouse.model import Opening, Room

OUTER_M = 0.1  # thickness of outer walls
GAP_M = (0.05, 0.25)  # how far apart two rooms must lie to share a wall
REACH_M = 0.13  # from a wall's middle line: further than half the thickest wall
NORMALS = {"north": (1, 1), "south": (1, -1), "east": (0, 1), "west": (0, -1)}  # axis of the wall's normal, its sign

Box2 = tuple[float, float, float, float]


def face_of(room: Room, side: str) -> float:
    """The coordinate of a wall's inner face: y of the north and south walls, x of the others."""
    axis, sign = NORMALS[side]
    return room.box[axis + 2] if sign > 0 else room.box[axis]


def span_of(room: Room, side: str) -> tuple[float, float]:
    """From where to where a wall runs, along x or y."""
    along = 1 - NORMALS[side][0]
    return room.box[along], room.box[along + 2]


def doorway(a: Room, b: Room, at: float, width: float, height: float) -> Opening:
    """The gap in the wall that two rooms share; ``at`` is its middle along the wall.

    Raises InputError (without a place) if they share no wall there.
    """
    shared = shared_wall(a, b)
    if shared is None:
        raise InputError(
            f"the door leads nowhere: {a.name!r} and {b.name!r} share no wall "
            f"(their boxes must lie {GAP_M[0]} to {GAP_M[1]} m apart)"
        )
    axis, middle, low, high = shared
    if at - width / 2 < low - 1e-6 or at + width / 2 > high + 1e-6:
        raise InputError(
            f"the door leads nowhere: {a.name!r} and {b.name!r} share their wall from {low:g} to {high:g} m, "
            f"the door reaches from {at - width / 2:g} to {at + width / 2:g}"
        )
    return _opening("door", axis, middle, at, width, 0.0, height)


def hole(
    kind: str, room: Room, rooms: Sequence[Room], side: str, at: float, width: float, z: tuple[float, float]
) -> Opening:
    """A window or a front door in an outer wall. Raises InputError (without a place) if it is none there."""
    (low, high), (axis, sign), name = span_of(room, side), NORMALS[side], kind.replace("_", " ")
    if at - width / 2 < low - 1e-6 or at + width / 2 > high + 1e-6:
        raise InputError(f"the {name} does not fit into the {side} wall of {room.name!r} ({low:g} to {high:g} m)")
    for other in rooms:
        shared = None if other is room else shared_wall(room, other)
        if shared is None or shared[0] != axis or abs(shared[1] - face_of(room, side)) > REACH_M:
            continue
        if at - width / 2 < shared[3] and at + width / 2 > shared[2]:
            raise InputError(f"the {name} looks into {other.name!r}: it needs an outer wall")
    return _opening(kind, axis, face_of(room, side) + sign * OUTER_M / 2, at, width, *z)


def shared_wall(a: Room, b: Room) -> tuple[int, float, float, float] | None:
    """(axis of the normal, its middle line, from, to) of the wall between two rooms, or None."""
    for axis in (0, 1):
        along = 1 - axis
        low, high = max(a.box[along], b.box[along]), min(a.box[along + 2], b.box[along + 2])
        for first, second in ((a, b), (b, a)):
            gap = second.box[axis] - first.box[axis + 2]
            if GAP_M[0] - 1e-6 <= gap <= GAP_M[1] + 1e-6 and low < high:
                return axis, (second.box[axis] + first.box[axis + 2]) / 2, low, high
    return None


def hole_box(opening: Opening, reach: float = REACH_M) -> Box2:
    """The footprint (x1, y1, x2, y2) of an opening, ``reach`` to both sides of the wall's middle line."""
    axis = axis_of(opening)
    x, y = (reach, 0.0) if axis == 0 else (0.0, reach)
    (x1, y1), (x2, y2) = opening.start, opening.end
    return min(x1, x2) - x, min(y1, y2) - y, max(x1, x2) + x, max(y1, y2) + y


def faces_of(opening: Opening, rooms: Sequence[Room]) -> tuple[float, float]:
    """The coordinates of both faces of the wall that an opening is in."""
    axis = axis_of(opening)
    middle = opening.start[axis]
    half = min(
        abs(room.box[side] - middle)
        for room in rooms
        for side in (axis, axis + 2)
        if room.box[1 - axis] - 1e-6 <= opening.start[1 - axis] <= room.box[3 - axis] + 1e-6
    )
    return middle - half, middle + half


def _opening(kind: str, axis: int, middle: float, at: float, width: float, bottom: float, top: float) -> Opening:
    ends = [(middle, at + half) if axis == 0 else (at + half, middle) for half in (-width / 2, width / 2)]
    return Opening(kind, ends[0], ends[1], bottom, top)


def axis_of(opening: Opening) -> int:
    return 0 if opening.start[0] == opening.end[0] else 1
