"""The true floor plan: a robot fits where nothing is, and only there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cartier.types import FREE, OCCUPIED, UNKNOWN
from cartier_dollhouse.place import Plan
from cartier_dollhouse.scene import load_scene
from dollhouse.toy import HEAD, home, toys  # noqa: F401

pytestmark = pytest.mark.usefixtures("toys")
CELL = 0.017  # the plan is exact to one fine cell, the robot's position to another


def _distance(x: float, y: float, box: tuple[float, float, float, float]) -> float:
    return math.hypot(max(box[0] - x, 0, x - box[2]), max(box[1] - y, 0, y - box[3]))


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.floats(1.3, 2.7), st.floats(1.2, 2.0), st.floats(-180, 180), st.floats(0.1, 0.4),
    st.lists(st.tuples(st.floats(0.1, 3.9), st.floats(0.1, 2.9)), min_size=5, max_size=20),
)  # fmt: skip
def test_free_is_the_distance_to_the_nearest_thing_or_wall(at_x, at_y, face, radius, points):
    plan = Plan(load_scene(home(f"{{type: Block, at: [{at_x}, {at_y}], face: {face:.6f}, size: [0.9, 0.4, 1], "
                                "height: 0}",
                                head=HEAD.replace("[0.5, 0.5]", "[0.3, 2.7]"))), radius)  # fmt: skip
    c, s = math.cos(math.radians(face)), math.sin(math.radians(face))
    for x, y in points:
        dx, dy = x - at_x, y - at_y
        own = (c * dx + s * dy, -s * dx + c * dy)
        if abs(own[0]) < 0.45 and abs(own[1]) < 0.2:
            assert not plan.free((x, y))
            continue
        # The doorway is no wall, but its jambs are; skirting boards stand 12 mm before the walls.
        walls = min(x, y, 3 - y, _distance(x, y, (4, -1, 4, 0.55)), _distance(x, y, (4, 1.45, 4, 4)))
        distance = min(walls, _distance(*own, (-0.45, -0.2, 0.45, 0.2)))
        if distance > radius + 2 * CELL + 0.015:
            assert plan.free((x, y))
        if distance < radius - 2 * CELL:
            assert not plan.free((x, y))


def test_what_is_low_or_high_does_not_stop_the_robot():
    plan = Plan(load_scene(home("{type: Rug, at: [2, 1.5], size: [2, 2, 0.04]}", "{type: Lamp, at: [2, 1.5]}")), 0.3)
    assert plan.free((2, 1.5))


def test_a_robot_does_not_fit_between_the_legs_but_a_small_one_stands_before_them():
    table = load_scene(home("{type: Table, at: [2, 1.5]}"))
    assert not Plan(table, 0.05).free((2, 1.5))  # the top is lower than the robot
    assert Plan(table, 0.2).free((2, 0.85)) and not Plan(table, 0.3).free((2, 0.85))


def test_the_inside_of_a_closed_cupboard_is_not_free():
    plan = Plan(load_scene(home("{type: Block, at: [2, 1.5], size: [1.5, 1.5, 2], height: 0}")), 0.2)
    assert not plan.free((2, 1.5))
    assert plan.grid().value((2, 1.5)) == UNKNOWN


def test_glass_and_outside_are_not_free():
    plan = Plan(load_scene(home()), 0.1)
    assert not any(plan.free(xy) for xy in [(2, 3.05), (2, 3.6), (-1, -1), (99, 99), (5, 2.5)])


def test_the_grid_is_the_true_floor_plan():
    scene = load_scene(home("{type: Table, at: [2, 1.5]}"))
    plan = Plan(scene, 0.2)
    grid = plan.grid()
    assert grid.resolution_m == 0.05
    assert grid.value((2, 1.5)) == OCCUPIED and math.isclose(
        float(grid.height_m[tuple(grid.cell((2, 1.5)))]), 0.75, abs_tol=1e-3
    )
    assert grid.value((1, 1)) == FREE and grid.value((4.05, 1)) == FREE and grid.value((5, 2.6)) == UNKNOWN
    floor = 4 * 3 + 1.9 * 2 + 0.1 * 0.9
    assert math.isclose((grid.cells != UNKNOWN).sum() * 0.05**2, floor + 0.1 * 18, rel_tol=0.1)


def test_reachable_goes_through_doors_and_no_walls():
    open_home = load_scene(home())
    plan = Plan(open_home, 0.2)
    reached, grid = plan.reachable(open_home.start_xy), plan.grid()
    assert reached.shape == grid.cells.shape
    assert reached[tuple(grid.cell((5, 1)))] and not reached[tuple(grid.cell((4.05, 0.3)))]
    for row, col in np.argwhere(reached)[::50]:
        assert plan.free(grid.centre((row, col)))
    assert not Plan(open_home, 0.5).reachable(open_home.start_xy)[tuple(grid.cell((5, 1)))]
    assert not plan.reachable((4.05, 0.3)).any()
