from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.navigation.planning import NEAREST_M, SNAP_M, line_of_sight, lines_of_sight, plan, reach
from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Place, RobotModel

RADIUS = 0.2


def world(*boxes: tuple[float, float, float, float, float], size: float = 6.0) -> OccupancyGrid:
    """A walled square room with boxes (x1, y1, x2, y2, height)."""
    n = round(size / 0.05)
    cells, height = np.full((n, n), FREE, np.int8), np.zeros((n, n), np.float16)
    walls = (
        (0, 0, size, 0.05, 2.2),
        (0, size - 0.05, size, size, 2.2),
        (0, 0, 0.05, size, 2.2),
        (size - 0.05, 0, size, size, 2.2),
    )
    for x1, y1, x2, y2, top in (*boxes, *walls):
        area = slice(round(y1 / 0.05), round(y2 / 0.05)), slice(round(x1 / 0.05), round(x2 / 0.05))
        cells[area], height[area] = OCCUPIED, top
    return OccupancyGrid(cells, 0.05, (0.0, 0.0), height)


def at(x: float, y: float, z: float = 0.5) -> Place:
    return Place("thing", (x, y, z), 1.0, 0)


def clearance(grid: OccupancyGrid, xy: np.ndarray) -> float:
    """Distance from a point to the nearest occupied cell's square: the slow way."""
    low = np.argwhere(grid.cells == OCCUPIED)[:, ::-1] * grid.resolution_m + grid.origin_xy
    outside = np.maximum(np.maximum(low - xy, xy - (low + grid.resolution_m)), 0)
    return float(np.linalg.norm(outside, axis=1).min())


def unseen(grid: OccupancyGrid, x1: float, x2: float) -> OccupancyGrid:
    grid.cells[:, round(x1 / 0.05) : round(x2 / 0.05)] = UNKNOWN
    return grid


MIDDLE, SHELF = at(3.0, 3.0, 0.5), Place("cup", (3.0, 3.0, 1.0), 1.0, 0)
FRIDGE = Place("fridge", (3.0, 3.0, 0.9), 1.0, 0, box_min=(2.7, 2.7, 0.0), box_max=(3.3, 3.3, 1.8))
VIEWPOINT = Place("door", (3.0, 3.0, 1.5), 1.0, 0, view_yaw=0.7)
PLINTH = [(2.9, 2.9, 3.1, 3.1, 1.2)]
CUPBOARD = [(2.4, 2.4, 3.6, 3.6, 2.0)]
THREE_WALLS = [(2.2, 2.2, 2.3, 3.8, 2.2), (2.2, 2.2, 3.6, 2.3, 2.2), (2.2, 3.7, 3.6, 3.8, 2.2)]
DEEP = [(2.2, 2.2, 4.6, 2.3, 2.2), (2.2, 3.7, 4.6, 3.8, 2.2), (2.2, 2.2, 2.3, 3.8, 2.2), (2.3, 2.3, 4.6, 3.7, 0.9)]

GOALS: dict[str, tuple[OccupancyGrid, Place, tuple[float, float], RobotModel, tuple[float, float] | None, bool]] = {
    # the grid, the place, the start, the robot, about where the goal is, and whether it sees the place
    "from the left": (world(), MIDDLE, (1.0, 3.0), RobotModel(RADIUS), (2.65, 3.0), True),
    "from the right": (world(), MIDDLE, (5.0, 3.0), RobotModel(RADIUS), (3.35, 3.0), True),
    "a fridge, from three quarters of a metre": (
        world(FRIDGE.box_min[:2] + FRIDGE.box_max[:2] + (1.8,)),  # type: ignore[index]
        FRIDGE, (1.0, 3.0), RobotModel(RADIUS), (1.9, 3.0), True,
    ),
    "on a plinth that it stands above": (
        world(*PLINTH), Place("bust", (3.0, 3.0, 0.6), 1.0, 0, box_min=(2.9, 2.9, 0.0), box_max=(3.1, 3.1, 1.2)),
        (1.0, 3.0), RobotModel(RADIUS), (2.35, 3.0), True,
    ),
    "within a cupboard": (world(*CUPBOARD), SHELF, (1.0, 3.0), RobotModel(RADIUS), (2.15, 3.0), False),
    "open to the right alone": (world(*THREE_WALLS), SHELF, (1.0, 3.0), RobotModel(RADIUS), (3.35, 3.0), True),
    "seen only from much farther away": (world(*DEEP), SHELF, (1.0, 3.0), RobotModel(RADIUS), (1.95, 3.0), False),
    "unseen floor is not driven over": (
        unseen(world(), 2.0, 2.5), at(2.0, 3.0), (1.0, 3.0), RobotModel(RADIUS), (1.65, 3.0), True,
    ),
    "all beyond unseen floor": (unseen(world(), 2.0, 2.5), at(4.5, 3.0), (1.0, 3.0), RobotModel(RADIUS), None, False),
    "a viewpoint": (world(), VIEWPOINT, (1.0, 3.0), RobotModel(RADIUS), (3.0, 3.0), True),
    "a viewpoint in a cupboard": (world(*CUPBOARD), VIEWPOINT, (1.0, 3.0), RobotModel(RADIUS), (3.0, 2.2), False),
    "a viewpoint out of reach": (
        unseen(world(), 0.0, 4.0), Place("door", (1.5, 3.0, 1.5), 1.0, 0, view_yaw=0.7), (5.0, 3.0), RobotModel(RADIUS),
        None, False,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("grid", "place", "start", "robot", "wanted", "sees"), GOALS.values(), ids=GOALS.keys())
def test_goal_of_a_place(
    grid: OccupancyGrid,
    place: Place,
    start: tuple[float, float],
    robot: RobotModel,
    wanted: tuple[float, float] | None,
    sees: bool,
) -> None:
    goal, why_not = plan(grid, place, start, robot)
    if wanted is None:
        assert goal is None and why_not
        return
    assert goal is not None and not why_not
    assert math.hypot(goal.x - wanted[0], goal.y - wanted[1]) < 0.3
    assert goal.line_of_sight is sees
    if place.view_yaw is None:
        assert goal.yaw == pytest.approx(math.atan2(place.position[1] - goal.y, place.position[0] - goal.x))
    else:
        assert goal.yaw == place.view_yaw


@pytest.mark.parametrize(("height_m", "sees"), [(1.5, True), (0.4, False)], ids=["tall", "low"])
def test_camera_height_decides_what_is_seen(height_m: float, sees: bool) -> None:
    grid = world((2.2, 0.05, 2.5, 5.95, 0.9))
    goal, _ = plan(grid, Place("cup", (3.0, 3.0, 0.7), 1.0, 0), (1.0, 3.0), RobotModel(RADIUS, height_m))
    assert goal is not None and goal.x < 2.2 and goal.line_of_sight is sees


def test_path_cuts_corners() -> None:
    goal, _ = plan(world(), at(5.0, 5.0), (1.0, 1.0), RobotModel(RADIUS))
    assert goal is not None
    straight_m = math.hypot(goal.x - 1.0, goal.y - 1.0)
    assert straight_m - 0.1 <= goal.length_m <= 1.03 * straight_m + 0.1


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_every_goal_is_free_reachable_and_faces_its_place(data: st.DataObject) -> None:
    coordinate = st.floats(0.3, 5.2)
    boxes = [
        (x, y, x + 0.5, y + 0.5, z)
        for x, y, z in data.draw(st.lists(st.tuples(coordinate, coordinate, st.floats(0.2, 2)), max_size=8))
    ]
    grid, place = world(*boxes), at(data.draw(coordinate), data.draw(coordinate))
    goal, why_not = plan(grid, place, (data.draw(coordinate), data.draw(coordinate)), RobotModel(RADIUS))
    assert (goal is None) == bool(why_not)
    if goal is None:
        return
    assert grid.value((goal.x, goal.y)) == FREE
    assert min(clearance(grid, xy) for xy in goal.path) >= RADIUS - 1e-9
    assert np.abs(np.diff(goal.path, axis=0)).max(initial=0) < 0.0501, "the path is connected"
    assert tuple(goal.path[-1]) == (goal.x, goal.y)
    assert np.linalg.norm(np.diff(goal.path, axis=0), axis=1).sum() == pytest.approx(goal.length_m)
    assert math.hypot(goal.x - place.position[0], goal.y - place.position[1]) >= NEAREST_M
    turn = goal.yaw - math.atan2(place.position[1] - goal.y, place.position[0] - goal.x)
    assert abs(math.remainder(turn, math.tau)) < 1e-6


def test_the_goal_is_on_the_side_that_sees_the_place() -> None:
    """The shelf hangs on a thin wall; the nearest floor lies behind that wall and sees nothing."""
    grid = world((0, 3, 4, 3.1, 2.2), (1, 2.4, 3, 3, 0.9))
    goal, _ = plan(grid, Place("cup", (2, 2.95, 1.0), 1.0, 0), (5, 5), RobotModel(RADIUS))
    assert goal is not None and goal.line_of_sight and goal.y < 2.4


@given(st.floats(0.1, 3), st.floats(0.1, 0.8))
@settings(max_examples=25, deadline=None)
def test_a_thing_is_faced_from_where_most_of_it_is_seen(height_m: float, half_m: float) -> None:
    """Not from 0.35 m if it is a fridge: 0.45 of its largest side away, and 0.8 m at most."""
    low, high = (3 - half_m, 3 - half_m, 0.0), (3 + half_m, 3 + half_m, height_m)
    place = Place("thing", (3, 3, height_m / 2), 1.0, 0, box_min=low, box_max=high)
    goal, _ = plan(world(), place, (0.5, 0.5), RobotModel(RADIUS))
    assert goal is not None and goal.line_of_sight
    off_m = float(box_distance(np.array([goal.x, goal.y]), np.array(low[:2]), np.array(high[:2])))
    wanted_m = min(0.45 * max(height_m, 2 * half_m), 0.8)
    assert wanted_m - 0.06 <= off_m <= max(wanted_m, NEAREST_M) + 0.06


def test_a_counter_can_be_looked_over_and_a_cupboard_cannot() -> None:
    low, high = world((2, 2, 3, 3, 0.9)), world((2, 2, 3, 3, 1.9))
    behind = Place("kettle", (2.5, 3.6, 1.0), 1.0, 0)
    assert line_of_sight(low, np.array([2.5, 1.0]), behind)
    assert not line_of_sight(high, np.array([2.5, 1.0]), behind)


def test_sight_from_many_points_is_that_from_each() -> None:
    grid = world((2, 2, 3, 3, 0.9), (4, 1, 4.2, 5, 1.9))
    kettle = Place("kettle", (2.5, 3.6, 1.0), 1.0, 0)
    points = np.random.default_rng(0).uniform(0.1, 5.9, (200, 2))
    seen = lines_of_sight(grid, points, kettle)
    assert seen.tolist() == [line_of_sight(grid, point, kettle) for point in points]
    assert 20 < seen.sum() < 180 and len(lines_of_sight(grid, points[:0], kettle)) == 0


def test_unreachable_and_far_are_said_and_not_guessed() -> None:
    closed = world((2, 2, 4, 2.1, 2), (2, 3.9, 4, 4, 2), (2, 2, 2.1, 4, 2), (3.9, 2, 4, 4, 2))
    goal, why_not = plan(closed, at(5.9, 3), (3, 3), RobotModel(RADIUS))
    assert goal is None and "no pose within" in why_not
    everywhere = OccupancyGrid(np.full((20, 20), UNKNOWN, np.int8), 0.05, (0, 0), np.zeros((20, 20), np.float16))
    goal, why_not = plan(everywhere, at(0.5, 0.5), (0.5, 0.5), RobotModel(RADIUS))
    assert goal is None and why_not.startswith("there is no known free floor")


def test_a_narrow_gap_stops_a_wide_robot_only() -> None:
    grid = world((0, 3, 2.7, 3.2, 2), (3.3, 3, 6, 3.2, 2))
    place = at(3, 5.5)
    slim, _ = plan(grid, place, (3, 1), RobotModel(0.2))
    wide, why_not = plan(grid, place, (3, 1), RobotModel(0.4))
    assert slim is not None and slim.y > 3.2
    assert wide is None and why_not


def test_a_viewpoint_is_stood_on_and_looked_along() -> None:
    grid = world()
    goal, _ = plan(grid, Place("tv", (2.02, 3.03, 1.5), 1.0, 0, view_yaw=1.2), (5, 1), RobotModel(RADIUS))
    assert goal is not None and goal.yaw == 1.2
    assert math.hypot(goal.x - 2.02, goal.y - 3.03) < 0.05


def half_mapped(wall: bool) -> OccupancyGrid:
    """A room of which nobody saw the left 2 m; a wall (or not) where the known part begins."""
    grid = world((2, 0, 2.1, 6, 2.2)) if wall else world()
    grid.cells[:, : round(2 / 0.05)] = UNKNOWN
    return grid


def test_no_start_is_moved_through_a_wall() -> None:
    goal, why_not = plan(half_mapped(wall=True), at(5, 3), (1.8, 3.0), RobotModel(RADIUS))
    assert goal is None and why_not.startswith("the start (1.80, 3.00) is cut off by a known obstacle")
    goal, _ = plan(half_mapped(wall=False), at(5, 3), (1.8, 3.0), RobotModel(RADIUS))
    assert goal is not None and tuple(goal.path[0]) == pytest.approx((2.025, 3.0), abs=0.03)
    goal, why_not = plan(half_mapped(wall=False), at(5, 3), (0.8, 3.0), RobotModel(RADIUS))
    assert goal is None and f"within {SNAP_M} m of the start" in why_not


def test_a_start_over_a_table_leaves_the_table_and_enters_nothing_else() -> None:
    table = (2.0, 2.0, 3.0, 3.0, 0.8)
    area = reach(world(table), (2.2, 2.5), RADIUS)
    assert area is not None and area.grid.centre(area.start)[0] < 2.0
    nearer_but_behind = world(table, (1.8, 0, 1.85, 6, 2.2))
    area = reach(nearer_but_behind, (2.1, 2.5), RADIUS)
    assert area is None or area.grid.centre(area.start)[0] > 1.85


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_nothing_known_stands_between_a_start_and_where_its_path_begins(data: st.DataObject) -> None:
    coordinate = st.floats(0.3, 5.2)
    boxes = [
        (x, y, x + 0.5, y + 0.1, 2.0) for x, y in data.draw(st.lists(st.tuples(coordinate, coordinate), max_size=8))
    ]
    grid = world(*boxes)
    grid.cells[:, : data.draw(st.integers(0, 100))] = UNKNOWN
    for x1, y1, x2, y2, _ in boxes:  # these are known nevertheless
        grid.cells[round(y1 / 0.05) : round(y2 / 0.05), round(x1 / 0.05) : round(x2 / 0.05)] = OCCUPIED
    start = np.array([data.draw(coordinate), data.draw(coordinate)])
    area = reach(grid, start, RADIUS)
    if area is None or grid.value(start) == OCCUPIED:
        return
    way = np.linspace(start, grid.centre(area.start), 500)
    assert OCCUPIED not in {grid.value(xy) for xy in way}


@pytest.mark.parametrize("start", [(math.nan, 1.0), (1.0, math.inf), (1.7e308, -1e300), (1.0, 2.0, 3.0), ()])
def test_a_start_that_is_no_point_is_refused(start: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="the start must be two finite numbers, x and y in metres"):
        plan(world(), at(3, 3), start, RobotModel(RADIUS))


@pytest.mark.parametrize("radius", [0.0, -0.2, math.nan, math.inf, 50.0])
def test_a_radius_that_no_robot_has_is_refused(radius: float) -> None:
    with pytest.raises(InputError, match="radius must be above 0 and at most 5 m"):
        plan(world(), at(3, 3), (1.0, 1.0), RobotModel(radius))


def chair_at_table(room: tuple[float, float] | None = None) -> tuple[OccupancyGrid, Place]:
    """A chair behind a table as seen from small y, and the floor of its room between two x."""
    grid = world((2.0, 2.6, 4.0, 3.4, 0.7), (2.8, 3.45, 3.2, 3.85, 0.8))
    columns = np.indices(grid.cells.shape)[1] * grid.resolution_m
    cells = None if room is None else np.argwhere((columns > room[0]) & (columns < room[1])).astype(np.int32)
    box_min, box_max = (2.8, 3.45, 0.0), (3.2, 3.85, 0.8)
    return grid, Place("chair", (3.0, 3.65, 0.4), 1.0, 0, box_min=box_min, box_max=box_max, room_cells=cells)


def test_no_goal_across_the_table() -> None:
    grid, chair = chair_at_table()
    goal, why = plan(grid, chair, (3.0, 1.0), RobotModel(RADIUS))
    assert goal is not None, why
    assert goal.y > 3.4, "from a free side of the chair, not over the table"


def test_goal_lies_in_the_room() -> None:
    grid, chair = chair_at_table((0.0, 2.4))
    goal, _ = plan(grid, chair, (3.0, 1.0), RobotModel(RADIUS))
    assert goal is not None and goal.x < 2.45
    nowhere = chair_at_table((6.0, 7.0))[1]
    assert plan(grid, nowhere, (3.0, 1.0), RobotModel(RADIUS))[0] is not None, "else another room serves"


def test_way_round_a_wall_is_its_length() -> None:
    grid = world((2.0, 0.0, 2.1, 5.0, 2.2))
    area = reach(grid, (1.0, 1.0), RADIUS)
    assert area is not None
    behind, before = (area.way_m((x, 0.8, 0.0), (x + 0.2, 1.0, 1.0)) for x in (3.5, 1.5))
    assert behind is not None and before is not None and before < 0.2 < 7.0 < behind
    assert area.way_m((-9.0, 0.0, 0.0), (-8.0, 1.0, 1.0)) is None
