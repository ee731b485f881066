"""Traction: carpet costs small wheels more, so that they go round; a user's file; files that are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.navigation.layers import RouteMap
from cartier.navigation.routes import plan_route
from cartier.navigation.traction import traction_layer, traction_of
from cartier.types import FREE, OccupancyGrid, Place, RobotModel
from cartier.types.route_rules import FLOOR_KINDS

CARPET = FLOOR_KINDS.index("carpet")


def plan(robot: RobotModel) -> tuple[float, float]:
    """The length of a way across a hall with a carpet in its middle, and how much of it is on the carpet."""
    kinds = np.full((60, 100), FLOOR_KINDS.index("tiles"), np.uint8)
    kinds[20:40, 30:70] = CARPET
    grid = OccupancyGrid(np.full((60, 100), FREE, np.int8), 0.05, (0.0, 0.0), np.zeros((60, 100), np.float16), kinds)
    place = Place("lamp", (4.9, 1.5, 0.5), 1.0, -1)
    goal = plan_route(RouteMap(grid), place, (0.3, 1.5), robot, (), [traction_layer(robot)]).goal
    assert goal is not None
    rows, cols = grid.cell(goal.path).T
    return goal.length_m, float((kinds[rows, cols] == CARPET).mean())


def test_small_wheels_go_round_the_carpet() -> None:
    straight, over = plan(RobotModel())
    longer, beside = plan(RobotModel(traction=traction_of("small")))
    assert over > 0.3 and beside < 0.05 and straight < longer < 1.5 * straight
    assert plan(RobotModel(traction=traction_of("large")))[1] > 0.3


def test_a_file_of_the_users(tmp_path: Path) -> None:
    file = tmp_path / "wheels.toml"
    file.write_text("carpet = 3\nunknown = 0.5\n")
    robot = RobotModel(traction=traction_of(str(file)))
    assert robot.traction == (("carpet", 3.0), ("unknown", 0.5))
    grid = OccupancyGrid(np.zeros((2, 2), np.int8), 0.05, (0, 0), np.zeros((2, 2), np.float16))
    assert (traction_layer(robot)(RouteMap(grid)) == 0.5).all()
    kinds = np.array([[0, CARPET], [1, 2]], np.uint8)
    assert traction_layer(robot)(RouteMap(replace(grid, floor_kinds=kinds))).tolist() == [[0.5, 3.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("carpet = -1", "costs 0 to 100"), ("lava = 1", "a kind of floor is"), ("carpet = true", "must be a number"),
        ("carpet = nan", "costs 0 to 100"), ("[small]\ncarpet = 1", "must be a number"), ("carpet", "wheels.toml"),
    ],
)  # fmt: skip
def test_files_that_are_none(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "wheels.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=told):
        traction_of(str(file))


def test_unknown_wheels() -> None:
    with pytest.raises(InputError, match="known are small, large, tracks"):
        traction_of("skis")
