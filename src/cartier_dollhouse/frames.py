"""Trim of walls: door frames, windows with their panes, the front door, skirting boards."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from cartier_dollhouse.mesh import box
from cartier_dollhouse.model import Opening, Part, Room
from cartier_dollhouse.openings import NORMALS, REACH_M, axis_of, face_of, faces_of, span_of

FRAME_M, FRAME_DEPTH_M = 0.07, 0.015
SKIRTING_M, SKIRTING_DEPTH_M = 0.07, 0.012
TRIM, LEAF = "paint:white", "walnut"


def _sides(opening: Opening, rooms: Sequence[Room]) -> Iterator[tuple[float, int]]:
    """Per side of the wall on which a room lies: the coordinate of its face, and in which direction the room is."""
    low, high = faces_of(opening, rooms)
    axis = axis_of(opening)
    along = (opening.start[1 - axis] + opening.end[1 - axis]) / 2
    for face, sign in ((low, -1), (high, 1)):
        point = (face + sign * 0.01, along) if axis == 0 else (along, face + sign * 0.01)
        if any(r.box[0] < point[0] < r.box[2] and r.box[1] < point[1] < r.box[3] for r in rooms):
            yield face, sign


def _block(axis: int, n: Iterable[float], along: Iterable[float], z: tuple[float, float], material: str) -> Part:
    """A box by its extent along a wall's normal, along the wall, and in height."""
    (n1, n2), (a1, a2) = sorted(n), sorted(along)
    if axis == 0:
        return box((n1, a1, z[0]), (n2, a2, z[1]), material)
    return box((a1, n1, z[0]), (a2, n2, z[1]), material)


def _border(
    opening: Opening, n: tuple[float, float], wide: float, material: str, outside: bool, bottom: bool
) -> Iterator[Part]:
    """Bars around an opening (or just inside of it): two jambs, a head and, if asked for, a bottom rail."""
    axis = axis_of(opening)
    a, b, low, high = opening.start[1 - axis], opening.end[1 - axis], opening.bottom_m, opening.top_m
    if outside:
        a, b, high = a - wide, b + wide, high + wide
    rail = low + wide if bottom else low
    yield _block(axis, n, (a, a + wide), (low, high), material)
    yield _block(axis, n, (b - wide, b), (low, high), material)
    yield _block(axis, n, (a + wide, b - wide), (high - wide, high), material)
    if bottom:
        yield _block(axis, n, (a + wide, b - wide), (low, rail), material)


def _door_frame(opening: Opening, rooms: Sequence[Room]) -> Iterator[Part]:
    for face, sign in _sides(opening, rooms):
        yield from _border(opening, (face, face + sign * FRAME_DEPTH_M), FRAME_M, TRIM, outside=True, bottom=False)


def _window(opening: Opening, rooms: Sequence[Room]) -> Iterator[Part]:
    axis, low, high = axis_of(opening), opening.bottom_m, opening.top_m
    middle, start, end = opening.start[axis], opening.start[1 - axis], opening.end[1 - axis]
    bar = 0.05
    yield from _border(opening, (middle - 0.025, middle + 0.025), bar, TRIM, outside=False, bottom=True)
    yield _block(axis, (middle - 0.003, middle + 0.003), (start + bar, end - bar), (low + bar, high - bar), "glass")
    panes = max(1, round((end - start) / 0.8))
    for post in np.linspace(start, end, panes + 1)[1:-1].tolist():
        yield _block(axis, (middle - 0.02, middle + 0.02), (post - 0.03, post + 0.03), (low + bar, high - bar), TRIM)
    for face, sign in _sides(opening, rooms):
        yield _block(axis, (face, face + sign * 0.03), (start - 0.04, end + 0.04), (low - 0.02, low), TRIM)


def _front_door(opening: Opening, rooms: Sequence[Room]) -> Iterator[Part]:
    yield from _door_frame(opening, rooms)
    axis, top = axis_of(opening), opening.top_m
    start, end = opening.start[1 - axis], opening.end[1 - axis]
    for face, sign in _sides(opening, rooms):
        leaf = face - sign * 0.02
        yield _block(axis, (leaf, leaf - sign * 0.045), (start, end), (0.0, top), LEAF)
        inset = 0.14
        for z1, z2 in ((0.2, 0.45 * top), (0.45 * top + inset, top - inset)):
            yield _block(axis, (leaf, leaf + sign * 0.008), (start + inset, end - inset), (z1, z2), LEAF)
        knob = end - 0.08
        yield _block(axis, (leaf, leaf + sign * 0.01), (knob - 0.02, knob + 0.02), (0.95, 1.12), "brass")
        yield _block(axis, (leaf + sign * 0.04, leaf + sign * 0.06), (knob - 0.12, knob + 0.01), (1.04, 1.06), "brass")
        yield _block(axis, (leaf, leaf + sign * 0.06), (knob - 0.01, knob + 0.01), (1.04, 1.06), "brass")


FRAMES = {"door": _door_frame, "window": _window, "front_door": _front_door}


def skirting(room: Room, openings: Sequence[Opening]) -> Iterator[Part]:
    if room.walls.startswith("tiles"):
        return
    for side, (axis, sign) in NORMALS.items():
        face, (low, high) = face_of(room, side), span_of(room, side)
        gaps = sorted(
            (opening.start[1 - axis] - FRAME_M, opening.end[1 - axis] + FRAME_M)
            for opening in openings
            if opening.bottom_m < SKIRTING_M
            and axis_of(opening) == axis
            and abs(opening.start[axis] - face) < REACH_M
            and low < opening.end[1 - axis]
            and opening.start[1 - axis] < high
        )
        for end, after in [*gaps, (high, high)]:
            if end > low + 0.01:
                yield _block(axis, (face, face - sign * SKIRTING_DEPTH_M), (low, end), (0.0, SKIRTING_M), TRIM)
            low = max(low, after)
