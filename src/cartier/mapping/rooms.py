"""Rooms from a floor plan: walls part them, doorways are the narrow places between; what stands in a room says its kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier.types import UNKNOWN, Array, MapObject, OccupancyGrid, Room

WALL_M = 1.9  # what reaches so high is a wall, or stands before one
DOOR_M = 1.1  # a narrower passage parts two rooms
LEAST_M2 = 1.0  # a smaller room is a corner of its neighbour
HOLE_M2 = 2.0  # unknown floor of this size inside of a home is hidden by furniture
KINDS = {
    "bathroom": {"toilet", "bathtub", "shower", "shower door", "shower head", "shower curtain", "toilet paper", "sink", "towel", "hand towel"},
    "kitchen": {"fridge", "refrigerator", "stove burner", "stove", "oven", "microwave", "toaster", "coffee machine", "kettle", "dish sponge", "sink"},
    "bedroom": {"bed", "alarm clock", "dresser", "pillow", "wardrobe"},
    "living room": {"sofa", "couch", "television", "tv", "tv stand", "arm chair", "coffee table", "ottoman"},
    "study": {"desk", "desktop", "laptop", "keyboard", "mouse"},
    "dining room": {"dining table"},
}  # fmt: skip
TELLING = {"toilet": 3, "bathtub": 3, "shower": 3, "shower door": 3, "bed": 3, "fridge": 3, "refrigerator": 3, "stove burner": 2, "stove": 3, "oven": 3, "sofa": 3,
           "couch": 3, "television": 2, "tv": 2, "desk": 2, "dining table": 2, "microwave": 2}  # fmt: skip
"""How much a thing tells more than others."""


def find_rooms(grid: OccupancyGrid, objects: Sequence[MapObject]) -> tuple[Room, ...]:
    """The rooms of a floor plan, the largest first, each named after its kind; those of one kind are numbered."""
    places = _segmented(grid)
    found = [np.argwhere(places == number).astype(np.int32) for number in np.unique(places[places > 0])]
    found.sort(key=len, reverse=True)
    unnamed = [Room(number, "", "", cells) for number, cells in enumerate(found)]
    standing = [room_of(thing, grid, unnamed) if thing.confirmed else None for thing in objects]
    kinds = [
        _kind([thing.label for thing, room in zip(objects, standing, strict=True) if room == number])
        for number in range(len(found))
    ]
    rooms, count = [], Counter[str]()
    for number, (cells, kind) in enumerate(zip(found, kinds, strict=True)):
        count[kind] += 1
        rooms.append(Room(number, kind if count[kind] == 1 else f"{kind} {count[kind]}", kind, cells))
    return tuple(rooms)


def room_of(thing: MapObject, grid: OccupancyGrid | None, rooms: Sequence[Room]) -> int | None:
    """The id of the room whose cells lie nearest to an object's middle, None where there is none."""
    if grid is None or not rooms:
        return None
    here = grid.cell(thing.position[:2])
    nearest = [float(np.abs(room.cells - here).max(1).min()) for room in rooms]
    return rooms[int(np.argmin(nearest))].id


def _segmented(grid: OccupancyGrid) -> npt.NDArray[np.int32]:
    """The number of each cell's room (rows, cols), 0 for none."""
    from scipy import ndimage

    area = grid.resolution_m**2
    wall = grid.height_m >= WALL_M
    holes, count = ndimage.label((grid.cells == UNKNOWN) & ~wall)
    sizes = np.bincount(holes.ravel(), minlength=count + 1)
    edge = np.unique(np.concatenate([holes[0], holes[-1], holes[:, 0], holes[:, -1]]))
    hidden = (sizes * area <= HOLE_M2) & ~np.isin(np.arange(count + 1), edge)
    hidden[0] = False
    inside = ((grid.cells != UNKNOWN) & ~wall) | hidden[holes]
    clear_m = ndimage.distance_transform_edt(inside) * grid.resolution_m
    cores, _ = ndimage.label(clear_m > DOOR_M / 2)
    depth = (clear_m.max(initial=0) - clear_m) / max(float(clear_m.max(initial=0)), 1e-6)
    markers = np.where(inside, cores, -1)  # -1 floods what is no floor
    flooded = ndimage.watershed_ift((depth * 60_000).astype(np.uint16), markers.astype(np.int32))
    places = np.where(inside, np.maximum(flooded, 0), 0)
    return _without_corners(np.asarray(places, np.int32), area)


def _without_corners(places: npt.NDArray[np.int32], area: float) -> npt.NDArray[np.int32]:
    """Rooms that are too small go to the neighbour that they touch most."""
    for number in np.argsort(np.bincount(places.ravel())):
        mine = places == number
        if number == 0 or not mine.any() or mine.sum() * area >= LEAST_M2:
            continue
        touching = Counter(_beside(places, mine).tolist())
        touching.pop(0, None), touching.pop(int(number), None)
        places[mine] = touching.most_common(1)[0][0] if touching else 0
    return places


def _beside(places: Array, mine: Array) -> Array:
    from scipy import ndimage

    return np.asarray(places[ndimage.binary_dilation(mine) & ~mine])


def _kind(labels: Sequence[str]) -> str:
    """What sort of room holds things of these labels; just "room" where nothing tells."""
    votes = Counter(
        {kind: sum(TELLING.get(label, 1) for label in labels if label in known) for kind, known in KINDS.items()}
    )
    kind, most = votes.most_common(1)[0]
    return kind if most >= 2 else "room"
