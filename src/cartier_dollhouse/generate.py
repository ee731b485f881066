"""Generator of homes from a seed: rooms in two rows or along a hall, doors, windows and furniture."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cartier_dollhouse.furnish import Furnisher, Place

WALL_M = 0.1
DOOR_M = 0.9
CORNER_M = 0.65  # from the middle of a door to the end of its wall, at least
WIDTHS = {
    "kitchen": (3.2, 4.2),
    "living room": (4.2, 5.4),
    "studio": (5.4, 6.4),
    "bedroom": (3.5, 4.3),
    "bathroom": (2.3, 2.8),
}
FLOORS = {
    "kitchen": ("tiles:beige", "tiles:lightgrey", "tiles:terracotta"),
    "living room": ("planks:oak", "planks:walnut", "planks:pine"),
    "bedroom": ("planks:oak", "planks:pine", "carpet:sand", "carpet:grey"),
    "bathroom": ("tiles:white", "tiles:lightblue"),
    "hall": ("planks:oak", "tiles:lightgrey"),
}
WALLS = {
    "kitchen": ("paint:ivory", "paint:cream", "paint:white"),
    "living room": ("paint:cream", "paint:sage", "paint:wheat", "paint:white"),
    "bedroom": ("paint:lightsteelblue", "paint:mistyrose", "paint:honeydew", "paint:cream"),
    "bathroom": ("tiles:white", "tiles:lightblue", "tiles:sage"),
    "hall": ("paint:white", "paint:cream"),
}
# Rooms of the southern and of the northern row, and whether a hall lies between them.
PROGRAMMES: tuple[tuple[tuple[str, ...], tuple[str, ...], bool], ...] = (
    (("living room",), (), False),
    (("living room", "bathroom"), (), False),
    (("bedroom", "bathroom"), (), False),
    (("kitchen", "living room"), (), False),
    (("living room", "kitchen"), ("bedroom",), False),
    (("living room", "bedroom"), ("bathroom",), False),
    (("kitchen", "living room"), ("bathroom", "bedroom"), False),
    (("living room", "kitchen"), ("bedroom", "bathroom"), True),
    (("living room", "kitchen"), ("bedroom", "bathroom", "bedroom"), False),
)

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Door:
    """A gap between two rooms (their numbers); ``at`` is its middle along their wall, (x, y) its middle."""

    a: int
    b: int
    at: float
    xy: tuple[float, float]


def generate(seed: int) -> str:
    """The YAML text of a home with one to five rooms. The same seed gives the same bytes."""
    rng = random.Random(seed)
    south, north, hall = PROGRAMMES[rng.randrange(len(PROGRAMMES))]
    kinds, boxes = _rooms(rng, south, north, hall)
    names = [kind if kinds.count(kind) == 1 else f"{kind} {kinds[: i + 1].count(kind)}" for i, kind in enumerate(kinds)]
    doors = _doors(rng, kinds, boxes)
    places = [Place(name, kind, box) for name, kind, box in zip(names, kinds, boxes, strict=True)]
    for door in doors:
        places[door.a].add_door(door.xy, DOOR_M)
        places[door.b].add_door(door.xy, DOOR_M)
    front = _front_door(rng, places, kinds, boxes)
    windows = [window for place in places for window in _windows(rng, place, boxes)]
    furnisher = Furnisher(rng)
    things = [thing for place in places for thing in furnisher.furnish(place, _plan(place.kind, kinds))]
    rooms = [
        {"name": p.name, "kind": p.kind, "box": p.box,
         "floor": rng.choice(FLOORS[p.kind]), "walls": rng.choice(WALLS[p.kind])}
        for p in places
    ]  # fmt: skip
    gaps = [{"between": [names[d.a], names[d.b]], "at": d.at, "width": DOOR_M} for d in doors]
    about = f"A generated home: {', '.join(names)}."
    return _text(f"dollhouse {seed}", about, places[0].open_spot(), rooms, gaps, windows, front, things)


def _plan(kind: str, kinds: Sequence[str]) -> str:
    """What a room is furnished as: a living room is all of a home that has neither kitchen nor bedroom."""
    return "studio" if kind == "living room" and not {"kitchen", "bedroom"} & set(kinds) else kind


def _text(
    name: str,
    about: str,
    start: tuple[float, float],
    rooms: Sequence[Any],
    doors: Sequence[Any],
    windows: Sequence[Any],
    front_door: Any,
    things: Sequence[Any],
) -> str:
    """One line per room, door, window and piece of furniture; JSON's braces are YAML's too."""
    head = {"name": name, "about": about, "start": start, "front_door": front_door}
    lines = [f"{key}: {json.dumps(value)}" for key, value in head.items()]
    for key, values in (("rooms", rooms), ("doors", doors), ("windows", windows), ("things", things)):
        if values:
            lines += [f"{key}:", *(f"  - {json.dumps(value)}" for value in values)]
    return "\n".join(lines) + "\n"


def _rooms(rng: random.Random, south: Sequence[str], north: Sequence[str], hall: bool) -> tuple[list[str], list[Box]]:
    """Kinds and boxes of all rooms: row by row from the south, each row as wide as the widest where rooms may grow."""
    every = (*south, *north)
    widths = [[rng.uniform(*WIDTHS[_plan(kind, every)]) for kind in row] for row in (south, north)]
    total = max(sum(row) + WALL_M * (len(row) - 1) for row in widths if row)
    kinds: list[str] = []
    boxes: list[Box] = []
    y = 0.0
    for i, (row, wide) in enumerate(zip((south, north), widths, strict=True)):
        depth = _round(rng.uniform(3.6, 4.4))
        grow = [k for k, kind in enumerate(row) if kind != "bathroom"]
        spare = total - sum(wide) - WALL_M * (len(row) - 1)
        if row and spare > 0 and grow:
            wide = [w + spare / len(grow) * (k in grow) for k, w in enumerate(wide)]
        x = 0.0
        for k, kind in enumerate(row):
            end = _round(total) if k == len(row) - 1 and grow else _round(x + wide[k])
            kinds.append(kind)
            boxes.append((_round(x), _round(y), end, _round(y + depth)))
            x = end + WALL_M
        y += depth + WALL_M
        if hall and i == 0:
            kinds.append("hall")
            boxes.append((0.0, _round(y), _round(total), _round(y + 1.3)))
            y += 1.3 + WALL_M
    return kinds, boxes


def _round(metres: float) -> float:
    return round(metres * 20) / 20


def _doors(rng: random.Random, kinds: Sequence[str], boxes: Sequence[Box]) -> list[Door]:
    """A tree of doors over all rooms: halls and living rooms are walked through, bathrooms are not if it can be
    helped."""
    rank = {"hall": 0, "living room": 1, "kitchen": 2, "bedroom": 3, "bathroom": 4}
    joined, doors = [min(range(len(kinds)), key=lambda i: rank[kinds[i]])], list[Door]()
    while len(joined) < len(kinds):
        ways = [(rank[kinds[a]], rank[kinds[b]], a, b) for a in joined for b in range(len(kinds)) if b not in joined]
        a, b = next((a, b) for _, _, a, b in sorted(ways) if _shared(boxes[a], boxes[b]))
        vertical, middle, low, high = _shared(boxes[a], boxes[b]) or (False, 0.0, 0.0, 0.0)
        at = _round(rng.choice((low + CORNER_M, high - CORNER_M, rng.uniform(low + CORNER_M, high - CORNER_M))))
        doors.append(Door(a, b, at, (middle, at) if vertical else (at, middle)))
        joined.append(b)
    return doors


def _shared(a: Box, b: Box) -> tuple[bool, float, float, float] | None:
    """Whether the wall between two rooms runs along y, its middle line, and from where to where; None where no door
    fits."""
    for axis in (0, 1):
        low, high = max(a[1 - axis], b[1 - axis]), min(a[3 - axis], b[3 - axis])
        for first, second in ((a, b), (b, a)):
            if abs(second[axis] - first[axis + 2] - WALL_M) < 1e-6 and high - low >= 2 * CORNER_M:
                return axis == 0, round(first[axis + 2] + WALL_M / 2, 3), low, high
    return None


def _outer(box: Box, boxes: Sequence[Box]) -> list[str]:
    """The sides of a room that no other room lies behind."""
    sides = {"south": (1, -1), "north": (3, 1), "west": (0, -1), "east": (2, 1)}
    outer = []
    for side, (k, sign) in sides.items():
        along = 1 - k % 2
        behind = [
            other for other in boxes
            if abs(other[(k + 2) % 4] - box[k] - sign * WALL_M) < 1e-6
            and other[along] < box[along + 2] and other[along + 2] > box[along]
        ]  # fmt: skip
        if not behind:
            outer.append(side)
    return outer


def _front_door(
    rng: random.Random, places: Sequence[Place], kinds: Sequence[str], boxes: Sequence[Box]
) -> dict[str, Any]:
    """The home's closed door, in a hall if there is one, else in the first room."""
    place = places[kinds.index("hall") if "hall" in kinds else 0]
    sides = _outer(place.box, boxes)
    side = rng.choice(["west", "east"] if place.kind == "hall" else sides)
    low, high = place.span(side)
    at = (low + high) / 2 if place.kind == "hall" else rng.choice((low + CORNER_M, high - CORNER_M))
    at = round(at, 3)
    x1, y1, x2, y2 = place.box
    place.add_door({"south": (at, y1), "north": (at, y2), "west": (x1, at), "east": (x2, at)}[side], DOOR_M)
    place.mark(side, at, 1.1)
    return {"room": place.name, "side": side, "at": at}


def _windows(rng: random.Random, place: Place, boxes: Sequence[Box]) -> list[dict[str, Any]]:
    """A window in one or two outer walls; bathrooms and halls have small ones or none."""
    windows = []
    sides = _outer(place.box, boxes)
    rng.shuffle(sides)
    small = place.kind in ("bathroom", "hall")
    for side in sides[: 1 if small else rng.choice((1, 2))]:
        low, high = place.span(side)
        width = 0.8 if small else min(rng.choice((1.2, 1.4, 1.8)), high - low - 0.6)
        at = _round(rng.uniform(low + width / 2 + 0.2, high - width / 2 - 0.2))
        if high - low < width + 0.4 or not place.unmarked(side, at, width):
            continue
        sill, height = (1.4, 0.7) if small else (rng.choice((0.9, 1.0)), rng.choice((1.2, 1.3)))
        place.mark(side, at, width)
        windows.append(
            {"room": place.name, "side": side, "at": at, "width": round(width, 3), "sill": sill, "height": height}
        )
    return windows
