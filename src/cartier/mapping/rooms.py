"""Room segmentation of a floor plan: walls and lintels divide it, doorways are narrow; objects give a room its kind.

The narrow places are found by distance to the walls, as in "distance transform-based segmentation" (Bormann et al.,
Room segmentation: survey, implementation, and analysis, ICRA 2016), with furniture removed first: nothing lower than a
person divides rooms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cartier.mapping.config import DEFAULT_CONFIG, RoomsConfig
from cartier.types import FREE, OCCUPIED, UNKNOWN, Array, MapObject, OccupancyGrid, Room

BELOW_M = 0.15  # below the highest obstacle: what reaches so high is a wall, a lintel, or furniture against a wall
SEEN_M2 = 0.4  # least floor of a room without a neighbour, which nobody entered and a doorway shows
OPEN = 0.25  # of a room's floor at least that is free, else it is the inside of a cupboard
HOLE_M2, GAP_M = 2.0, 0.6  # unknown floor of this size inside of a home, or between what is known, is floor as well
SMALL_M2, JAMB_M = 4.0, 0.3  # what is smaller and no room of its own behind a door is part of another
GAP_IN_WALL_M = 1.0  # on both sides of a cell where a wall is not seen up to its top, the wall is so near
STEPS_M = np.arange(0.1, 0.65, 0.05)  # from an object towards who sees it
TENTATIVE = 0.1  # probability from which an object speaks for a kind of room, by its probability
LEAST_VOTES, LEAD = 2.0, 0.5  # of a kind of room, and over the next one, before it names a room
HALL_VOTES, STUDIO_VOTES = 4.0, 3.0  # fewer leave a corridor a hall; a kitchen with so many for living is a living room
HALL, HALL_M2 = 2.2, 3.0  # a corridor is so many times as long as wide, and no mere sliver
TELLING: Mapping[str, Mapping[str, int]] = {
    "bathroom": {
        "toilet": 4, "bathtub": 4, "shower": 4, "shower door": 3, "shower head": 2, "shower curtain": 2, "sink": 1,
        "towel": 1, "hand towel": 1, "toilet paper": 1, "toothbrush": 1,
    },
    "kitchen": {
        "fridge": 3, "refrigerator": 3, "stove": 3, "stove burner": 3, "oven": 3, "microwave": 2, "toaster": 1,
        "coffee machine": 1, "kettle": 1, "dish sponge": 1, "sink": 1, "dishwasher": 3,
    },
    "bedroom": {"bed": 4, "wardrobe": 2, "dresser": 1, "pillow": 1, "alarm clock": 1, "nightstand": 1},
    "living room": {
        "sofa": 3, "couch": 3, "television": 2, "tv": 2, "tv stand": 1, "arm chair": 1, "armchair": 1,
        "coffee table": 1, "ottoman": 1, "fireplace": 2,
    },
    "study": {"desk": 2, "desktop": 1, "laptop": 1, "monitor": 1, "keyboard": 1, "mouse": 1, "printer": 1},
    "dining room": {"dining table": 2},
}  # fmt: skip
"""How much the label of an object is evidence for each kind of room."""


def find_rooms(
    grid: OccupancyGrid, objects: Sequence[MapObject], config: RoomsConfig = DEFAULT_CONFIG.rooms
) -> tuple[Room, ...]:
    """The rooms of a floor plan, the largest first, each named after its kind; those of one kind are numbered."""
    places = _segmented(grid, config)
    sizes = np.bincount(places.ravel())[1:]
    order = np.argsort(-sizes, kind="stable")[: int((sizes > 0).sum())] + 1
    unnamed = [
        Room(number, "", "", np.argwhere(places == place).astype(np.int32))
        for number, place in enumerate(order.tolist())
    ]
    speaking = [obj for obj in objects if obj.confirmed or obj.probability >= TENTATIVE]
    labels: list[dict[str, float]] = [{} for _ in unnamed]
    for obj, number in zip(speaking, rooms_of(speaking, grid, unnamed), strict=True):
        if number is not None:
            likely = 1.0 if obj.confirmed else obj.probability
            labels[number][obj.label] = max(likely, labels[number].get(obj.label, 0.0))
    rooms, count = [], Counter[str]()
    for room, inside in zip(unnamed, labels, strict=True):
        kind = _kind(inside, _long(room.cells, grid.resolution_m))
        count[kind] += 1
        rooms.append(replace(room, name=kind if count[kind] == 1 else f"{kind} {count[kind]}", kind=kind))
    return tuple(rooms)


def rooms_of(objects: Sequence[MapObject], grid: OccupancyGrid | None, rooms: Sequence[Room]) -> list[int | None]:
    """The id of each object's room; for an object on a wall, the room from which it is seen. None without rooms.

    Each view votes for the first room that lies between the object's surface and the camera; where there is none, the
    room nearest to the object is taken.
    """
    if grid is None or not rooms:
        return [None] * len(objects)
    places = np.zeros(grid.cells.shape, np.int32)
    for number, room in enumerate(rooms, 1):
        places[room.cells[:, 0], room.cells[:, 1]] = number
    seen = [(k, view.surface or obj.position, view) for k, obj in enumerate(objects) for view in obj.views]
    owners = np.array([k for k, _, _ in seen], np.intp)
    surfaces = np.array([surface[:2] for _, surface, _ in seen], np.float64).reshape(-1, 2)
    ways = np.array([view.camera[:2] for _, _, view in seen], np.float64).reshape(-1, 2) - surfaces
    far = np.maximum(np.linalg.norm(ways, axis=1), 1e-6)[:, None]
    on_the_way = surfaces[:, None] + np.minimum(STEPS_M / far, 1)[..., None] * ways[:, None]
    met = _at(places, grid.cell(on_the_way))
    first = met[np.arange(len(met)), (met > 0).argmax(1)]
    votes = np.zeros((len(objects), len(rooms) + 1))
    np.add.at(votes, (owners, first), [view.score for _, _, view in seen])
    return [
        rooms[int(row.argmax())].id if row.any() else _nearest(grid.cell(obj.position[:2]), rooms)
        for row, obj in zip(votes[:, 1:], objects, strict=True)
    ]


def _nearest(cell: Array, rooms: Sequence[Room]) -> int:
    return rooms[int(np.argmin([np.abs(room.cells - cell).max(1).min() for room in rooms]))].id


def _at(places: npt.NDArray[np.int32], cells: Array) -> npt.NDArray[np.int32]:
    """The numbers of the rooms at cells (..., 2), 0 for none."""
    inside = np.asarray(((cells >= 0) & (cells < places.shape)).all(-1))
    row, col = np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0)
    return np.asarray(np.where(inside, places[row, col], 0), np.int32)


def _segmented(grid: OccupancyGrid, config: RoomsConfig) -> npt.NDArray[np.int32]:
    """The number of each cell's room (rows, cols), 0 for none."""
    from scipy import ndimage

    cell_m2, margin = grid.resolution_m**2, config.door_width_m / 2 / grid.resolution_m
    wall = _walls(grid, config.min_wall_height_m)
    floor = ~wall & _seen(grid, wall)
    wide = floor & (
        np.asarray(ndimage.distance_transform_edt(~wall)) > margin
    )  # unknown cells do not make a passage narrow
    reached = np.asarray(ndimage.distance_transform_edt(~wide)) <= margin + 1 if wide.any() else wide
    cores, count = ndimage.label(wide)
    narrow, _ = ndimage.label(floor & ~reached)  # corridors, doorways, and what one sees of a room from outside
    some = np.flatnonzero(np.bincount(narrow.ravel()) * cell_m2 >= SEEN_M2)
    cores = np.where((narrow > 0) & np.isin(narrow, some), narrow + count, cores)
    return _without_corners(_grown(np.asarray(cores, np.int32), floor), wall, grid, config.min_area_m2)


def _walls(grid: OccupancyGrid, min_height_m: float) -> npt.NDArray[np.bool_]:
    """Walls and lintels: what is nearly as high as the highest that was seen, and what is seen less high in a wall."""
    heights = grid.height_m[grid.cells == OCCUPIED]
    highest = float(np.quantile(heights.astype(np.float32), 0.95)) if len(heights) else np.inf
    wall = np.asarray(grid.height_m >= max(highest - BELOW_M, min_height_m), bool)
    return wall | _gaps(wall, (grid.cells == OCCUPIED) & (grid.height_m >= min_height_m), grid.resolution_m)


def _gaps(wall: npt.NDArray[np.bool_], tall: npt.NDArray[np.bool_], resolution_m: float) -> npt.NDArray[np.bool_]:
    """The tall cells between two ends of a wall, in a line with both: no picture showed the wall's top there."""
    gaps, cells = np.zeros(wall.shape, bool), np.argwhere(tall & ~wall)
    steps = np.arange(1, round(GAP_IN_WALL_M / resolution_m))[:, None]
    for angle_rad in np.deg2rad(np.arange(0, 180, 15)):
        way, ends = np.array([np.sin(angle_rad), np.cos(angle_rad)]), np.ones(len(cells), bool)
        for sign in (1, -1):
            row, col = np.moveaxis(cells[:, None] + np.round(sign * steps * way).astype(int), -1, 0)
            inside = (row >= 0) & (col >= 0) & (row < wall.shape[0]) & (col < wall.shape[1])
            row, col = np.where(inside, row, 0), np.where(inside, col, 0)
            met, open_cells = wall[row, col] & inside, ~((wall | tall)[row, col] & inside)
            ends &= met.any(1) & (met.argmax(1) < np.where(open_cells.any(1), open_cells.argmax(1), len(steps)))
        gaps[tuple(cells[ends].T)] = True
    return gaps


def _seen(grid: OccupancyGrid, wall: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The known cells, and the unknown ones between them: under and behind furniture, and where few frames looked."""
    from scipy import ndimage

    known = grid.cells != UNKNOWN
    holes, count = ndimage.label(~known & ~wall)
    small = np.bincount(holes.ravel(), minlength=count + 1) * grid.resolution_m**2 <= HOLE_M2
    small[np.concatenate([[0], holes[0], holes[-1], holes[:, 0], holes[:, -1]])] = False
    near = ndimage.binary_closing(known & ~wall, iterations=max(1, round(GAP_M / 2 / grid.resolution_m)))
    return np.asarray(known | small[holes] | near, bool)


def _grown(places: npt.NDArray[np.int32], floor: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Rooms spread over the floor step by step, until they meet."""
    places = np.pad(places, 1)
    empty = np.pad(floor, 1) & (places == 0)
    while True:
        beside = np.maximum.reduce([np.roll(places, step, axis) for axis in (0, 1) for step in (-1, 1)])
        new = empty & (beside > 0)
        if not new.any():
            return places[1:-1, 1:-1]
        places[new] = beside[new]
        empty &= ~new


def _without_corners(
    places: npt.NDArray[np.int32], wall: npt.NDArray[np.bool_], grid: OccupancyGrid, min_area_m2: float
) -> npt.NDArray[np.int32]:
    """What is too small to be a room, shows too little free floor, or is small and has no door, goes to the neighbour
    that it touches most."""
    from scipy import ndimage

    sizes = np.bincount(places.ravel()) * grid.resolution_m**2
    for number in np.argsort(sizes, kind="stable"):
        mine = places == number
        area, open_floor = mine.sum() * grid.resolution_m**2, (grid.cells[mine] == FREE).sum() >= OPEN * mine.sum()
        beside = ndimage.binary_dilation(mine) & ~mine & (places > 0)
        small = area < SMALL_M2 and beside.any() and not _is_doorway(beside, wall, grid.resolution_m)
        if number == 0 or not area or (area >= min_area_m2 and open_floor and not small):
            continue
        touching = np.bincount(places[beside], minlength=len(sizes))
        if touching.any():
            places[mine] = touching.argmax()
        elif area < SEEN_M2 or not open_floor:
            places[mine] = 0
    return places


def _is_doorway(border: npt.NDArray[np.bool_], wall: npt.NDArray[np.bool_], resolution_m: float) -> bool:
    """Whether walls stand at both ends of the cells in which two rooms meet; else only unseen floor makes it narrow."""
    cells = np.argwhere(border) * resolution_m
    low, high = cells.min(0) - JAMB_M, cells.max(0) + JAMB_M
    walls = np.argwhere(wall) * resolution_m
    walls = walls[((walls >= low) & (walls <= high)).all(1)]
    middle, along = cells.mean(0), np.linalg.svd(cells - cells.mean(0), full_matrices=False)[2][0]
    ends, beside = (cells - middle) @ along, (walls - middle) @ along
    return bool(len(walls) and beside.min() <= ends.min() and beside.max() >= ends.max())


def _long(cells: npt.NDArray[np.int32], resolution_m: float) -> bool:
    """Whether a room is as long and narrow as a corridor."""
    narrow, long = np.sort(np.ptp(cells, axis=0) + 1)
    return bool(long >= HALL * narrow and len(cells) >= max(narrow * long / 2, HALL_M2 / resolution_m**2))


def _kind(labels: Mapping[str, float], long: bool) -> str:
    """What sort of room holds things of these labels, each as likely as told; "room" where nothing tells clearly."""
    votes = {kind: sum(telling.get(label, 0) * labels[label] for label in labels) for kind, telling in TELLING.items()}
    second, best = sorted(votes.values())[-2:]
    kind = max(votes, key=lambda kind: votes[kind])
    if best < HALL_VOTES and long:
        return "hall"
    if kind == "kitchen" and max(votes["bedroom"], votes["living room"]) >= STUDIO_VOTES:
        return "living room"
    return kind if best >= LEAST_VOTES and best - second >= LEAD else "room"
