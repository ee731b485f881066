from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cartier.mapping.rooms import find_rooms, rooms_of
from cartier.types import FREE, OCCUPIED, UNKNOWN, MapObject, OccupancyGrid, View
from plans import DOOR, LEFT, RIGHT, Box, Plan, flat


def obj(label: str, xy: Sequence[float], seen_from: Sequence[tuple[float, float]] = (), id: int = 0) -> MapObject:
    x, y = xy
    views = tuple(View(0, (0, 0, 1, 1), 0.9, label, 1.0, (*camera, 1.5), 0.0, (x, y, 1.0)) for camera in seen_from)
    low, high = (x - 0.1, y - 0.1, 0.0), (x + 0.1, y + 0.1, 0.5)
    return MapObject(id, label, ((label, 1.0),), (x, y, 0.2), low, high, 0.9, True, 3, 3, 0.0, 0.0, 0.0, views)


def covered(grid: OccupancyGrid, cells: np.ndarray, box: Box) -> float:
    """The share of a box that cells cover."""
    x, y = grid.centre(cells).T
    inside = (x > box[0]) & (x < box[2]) & (y > box[1]) & (y < box[3])
    return float(inside.sum() * grid.resolution_m**2 / ((box[2] - box[0]) * (box[3] - box[1])))


@pytest.mark.parametrize("lintel_m", [2.15, 0.0], ids=["with a lintel", "up to the ceiling"])
def test_a_doorway_parts_two_rooms_and_the_larger_one_comes_first(lintel_m: float) -> None:
    grid = flat(lintel_m).grid()
    rooms = find_rooms(grid, ())
    assert [room.id for room in rooms] == [0, 1]
    assert [room.name for room in rooms] == ["room", "room 2"]
    for room, mine, other in zip(rooms, (LEFT, RIGHT), (RIGHT, LEFT), strict=True):
        assert covered(grid, room.cells, mine) == pytest.approx(1, abs=0.01)
        assert covered(grid, room.cells, other) == 0


def test_rooms_that_are_wide_open_to_each_other_are_one() -> None:
    (room,) = find_rooms(Plan().rooms(LEFT, RIGHT).draw((4.0, 0.5, 4.1, 2.5), FREE).grid(), ())
    assert len(room.cells) * 0.05**2 == pytest.approx(12 + 8.7 + 0.2, abs=0.1)


@pytest.mark.parametrize("turned", [lambda a: a, lambda a: a.T.copy()], ids=["upright", "across"])
def test_wall_seen_less_high_parts_rooms(turned) -> None:
    plan = Plan().rooms((0.0, 0.0, 4.0, 5.0), (4.1, 0.0, 7.0, 5.0)).draw((4.0, 0.5, 4.1, 1.3), FREE)
    grid = plan.draw((4.0, 2.5, 4.1, 4.0), OCCUPIED, 1.5).grid()
    grid = OccupancyGrid(turned(grid.cells), 0.05, (-1.0, -1.0), turned(grid.height_m))
    assert len(find_rooms(grid, ())) == 2


def test_strip_without_a_door_is_no_room() -> None:
    """Floor under screens along the wall, of which little was seen."""
    strip = Plan().rooms(LEFT).draw((4.0, 2.0, 4.1, 3.0), FREE).draw((4.1, 2.0, 6.5, 2.6), FREE)
    assert (
        len(find_rooms(strip.draw((4.0, 3.0, 6.6, 3.1), OCCUPIED, 2.2).draw((4.0, 0.0, 4.1, 1.9), UNKNOWN).grid(), ()))
        == 1
    )


def test_furniture_parts_no_room() -> None:
    grid = Plan().rooms(LEFT).draw((1.8, 0.0, 2.2, 2.6), OCCUPIED, 1.8).grid()
    (room,) = find_rooms(grid, ())
    assert covered(grid, room.cells, LEFT) == pytest.approx(1, abs=0.01), "a shelf that leaves 40 cm parts nothing"


def test_unknown_floor_under_and_behind_furniture_belongs_to_its_room() -> None:
    bed = (0.0, 1.0, 1.6, 2.0)
    grid = flat().draw(bed, UNKNOWN).draw((0.0, 0.95, 1.6, 1.05), OCCUPIED, 0.5).grid()
    assert covered(grid, find_rooms(grid, ())[0].cells, bed) == pytest.approx(1, abs=0.02)


def test_where_nobody_looked_is_no_wall() -> None:
    strips = Plan().rooms(LEFT).draw((1.0, 0.0, 1.5, 3.0), UNKNOWN).draw((2.5, 1.0, 3.0, 3.0), UNKNOWN)
    assert len(find_rooms(strips.grid(), ())) == 1


def test_what_is_seen_through_a_doorway_is_a_room_of_its_own() -> None:
    seen = (4.1, 1.0, 5.0, 1.7)
    plan = Plan().rooms(LEFT).draw(DOOR, FREE, 2.15).draw(seen, FREE)
    grid = plan.grid()
    rooms = find_rooms(grid, ())
    assert len(rooms) == 2
    assert covered(grid, rooms[1].cells, seen) == pytest.approx(1)
    speck = Plan().rooms(LEFT).draw(DOOR, FREE, 2.15).draw((4.1, 1.0, 4.4, 1.4), FREE)
    assert len(find_rooms(speck.grid(), ())) == 1, "a few cells are none"


def test_the_inside_of_a_wardrobe_is_no_room() -> None:
    plan = Plan().rooms(LEFT).draw((0.0, 0.0, 1.5, 1.0), OCCUPIED, 2.2).draw((0.1, 0.1, 1.4, 0.9), OCCUPIED, 1.0)
    assert len(find_rooms(plan.grid(), ())) == 1


def test_a_camera_that_never_looks_up_tells_rooms_apart_by_what_it_saw_of_walls() -> None:
    assert len(find_rooms(flat(lintel_m=0.0, wall_m=1.5).grid(), ())) == 2
    tables = Plan().draw(LEFT, FREE).draw((1.9, 0.0, 2.0, 3.0), OCCUPIED, 0.8).grid()
    assert len(find_rooms(tables, ())) == 1, "a row of tables is no wall, though it is the highest that was seen"


@pytest.mark.parametrize("turned", [lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.T])
def test_a_mirrored_home_has_the_mirrored_rooms(turned) -> None:
    plan = flat().draw((1.0, 1.0, 2.0, 2.0), OCCUPIED, 0.7)
    grid = plan.grid()
    mirrored = OccupancyGrid(turned(grid.cells), 0.05, (0.0, 0.0), turned(grid.height_m))
    for before, after in zip(find_rooms(grid, ()), find_rooms(mirrored, ()), strict=True):
        mask = np.zeros(grid.cells.shape, bool)
        mask[tuple(before.cells.T)] = True
        assert {tuple(cell) for cell in np.argwhere(turned(mask))} == {tuple(cell) for cell in after.cells}


def test_nothing_seen_has_no_rooms() -> None:
    grid = Plan().grid()
    assert find_rooms(grid, [obj("bed", (1, 1))]) == ()
    assert rooms_of([obj("bed", (1, 1))], grid, ()) == [None]
    assert rooms_of([obj("bed", (1, 1))], None, find_rooms(flat().grid(), ())) == [None]


def test_what_hangs_on_a_wall_is_in_the_room_from_which_it_is_seen() -> None:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    on_the_wall = (4.05, 2.5)
    assert rooms_of([obj("painting", on_the_wall, [(2.0, 1.5)])], grid, rooms) == [0]
    assert rooms_of([obj("painting", on_the_wall, [(6.0, 1.5)])], grid, rooms) == [1]
    often_left = obj("painting", on_the_wall, [(6.0, 1.5), (2.0, 1.5), (1.0, 1.5)])
    assert rooms_of([often_left], grid, rooms) == [0], "the majority"


def test_what_is_seen_through_a_doorway_is_where_it_stands() -> None:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    assert rooms_of([obj("sofa", (6.5, 1.5), [(1.0, 1.4)])], grid, rooms) == [1]


def test_without_a_view_the_nearest_room_is_taken() -> None:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    cups = [obj("cup", xy) for xy in ((1, 1), (6, 1), (7.4, 1), (-0.9, 2))]
    assert rooms_of(cups, grid, rooms) == [0, 1, 1, 0]


def test_many_at_once_are_as_one_by_one() -> None:
    grid, rng = flat().grid(), np.random.default_rng(0)
    rooms = find_rooms(grid, ())
    objs = [obj("cup", rng.uniform(0, 7, 2), rng.uniform(0, 7, (k % 3, 2)).tolist()) for k in range(30)]
    assert rooms_of(objs, grid, rooms) == [rooms_of([one], grid, rooms)[0] for one in objs]
    assert rooms_of([], grid, rooms) == []


@pytest.mark.parametrize(
    ("labels", "kind"),
    [
        (["bed", "pillow", "desk"], "bedroom"), (["sofa", "television", "dining table"], "living room"),
        (["toilet", "sink"], "bathroom"), (["stove", "fridge", "dining table"], "kitchen"),
        (["desk", "laptop"], "study"), (["dining table", "chair"], "dining room"),
        (["stove", "fridge", "bed"], "living room"), (["cup"], "room"), ([], "room"),
    ],
)  # fmt: skip
def test_a_room_is_named_after_what_stands_in_it(labels: list[str], kind: str) -> None:
    (room,) = find_rooms(Plan().rooms(LEFT).grid(), [obj(label, (2, 1.5), id=k) for k, label in enumerate(labels)])
    assert (room.kind, room.name) == (kind, kind)


def test_four_stools_tell_no_more_than_one_and_what_is_unsure_tells_little() -> None:
    grid = Plan().rooms(LEFT).grid()
    burners = [obj("stove burner", (2, 1.5), id=k) for k in range(4)]
    (room,) = find_rooms(grid, [*burners, obj("bed", (1, 1), id=9)])
    assert room.kind == "bedroom"
    (room,) = find_rooms(grid, [replace(obj("bed", (1, 1)), confirmed=False, probability=0.3)])
    assert room.kind == "room"
    (room,) = find_rooms(grid, [replace(obj("bed", (1, 1)), confirmed=False, probability=0.6)])
    assert room.kind == "bedroom", "what is tentative speaks by its probability"
    (room,) = find_rooms(grid, [obj("dining table", (1, 1)), obj("television", (2, 1), id=1)])
    assert room.kind == "room", "a table for one and a television for another say nothing clearly"


def test_rooms_of_one_kind_are_numbered_and_a_corridor_is_a_hall() -> None:
    hall = (0.0, 3.1, 7.0, 4.1)
    plan = flat().rooms(hall).draw((1.0, 3.0, 1.9, 3.1), FREE, 2.15).draw((5.0, 3.0, 5.9, 3.1), FREE, 2.15)
    beds = [obj("bed", (1, 1), id=0), obj("bed", (6, 1), id=1)]
    assert [room.name for room in find_rooms(plan.grid(), beds)] == ["bedroom", "bedroom 2", "hall"]


HALL, SLIVER, LARGE = (0.0, 0.0, 4.0, 0.8), (0.0, 0.0, 3.4, 0.8), (0.0, 0.0, 7.0, 5.0)
SHAPES: dict[str, tuple[Plan, int, tuple[Box, float] | None]] = {
    "an unseen block beside a passage": (
        Plan().rooms((0.0, 0.0, 7.0, 3.2)).draw((2.5, 0.9, 4.5, 3.2), UNKNOWN), 1, None,
    ),
    "an obstacle beside a passage": (
        Plan().rooms((0.0, 0.0, 7.0, 3.2)).draw((2.5, 0.9, 4.5, 3.2), OCCUPIED, 2.2), 3, None,
    ),
    "a speck far away": (Plan().rooms(LEFT).draw((7.0, 1.0, 7.4, 1.6), FREE), 1, ((7.0, 1.0, 7.4, 1.6), 0.0)),
    "a patch far away": (Plan().rooms(LEFT).draw((7.0, 1.0, 8.0, 1.6), FREE), 2, None),
    "an alcove": (
        Plan().rooms(LEFT, (4.1, 1.0, 4.9, 1.7)).draw((4.0, 1.0, 4.1, 1.7), FREE), 1, ((4.1, 1.0, 4.9, 1.7), 1.0),
    ),
    "a narrow gap that nobody saw": (
        Plan().rooms(LARGE).draw((3.0, 0.0, 3.5, 5.0), UNKNOWN), 1, ((3.0, 0.0, 3.5, 5.0), 1.0),
    ),
    "a large hole that nobody saw": (
        Plan().rooms(LARGE).draw((2.0, 1.0, 5.0, 4.0), UNKNOWN), 1, ((2.5, 1.5, 4.5, 3.5), 0.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("plan", "count", "part"), SHAPES.values(), ids=SHAPES.keys())
def test_shape_of_rooms(plan: Plan, count: int, part: tuple[Box, float] | None) -> None:
    grid = plan.grid()
    rooms = find_rooms(grid, ())
    assert len(rooms) == count
    if part is not None:
        assert covered(grid, rooms[0].cells, part[0]) == pytest.approx(part[1], abs=0.07)


KINDS: dict[str, tuple[Box, list[str], str]] = {
    "a corridor": (HALL, [], "hall"),
    "a corridor with a sign of something": (HALL, ["desk"], "hall"),
    "a long bedroom": (HALL, ["bed"], "bedroom"),
    "a sliver": (SLIVER, [], "room"),
    "one towel": (LEFT, ["towel"], "room"),
    "a towel and a sink": (LEFT, ["towel", "sink"], "bathroom"),
}


@pytest.mark.parametrize(("box", "labels", "kind"), KINDS.values(), ids=KINDS.keys())
def test_kind_of_a_room(box: Box, labels: list[str], kind: str) -> None:
    objs = [obj(label, (1.5, 0.4), id=k) for k, label in enumerate(labels)]
    assert [room.kind for room in find_rooms(Plan().rooms(box).grid(), objs)] == [kind]


def test_views_vote_by_their_scores() -> None:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    one = obj("painting", (4.05, 2.5), [(2.0, 1.5), (6.0, 1.5), (6.0, 1.0)])
    weak = replace(one, views=(one.views[0], *(replace(view, score=0.2) for view in one.views[1:])))
    assert rooms_of([one, weak], grid, rooms) == [1, 0]
