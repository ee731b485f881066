"""``ask`` and the operations' ``goal_for`` drive to one goal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cartier.home import Home
from cartier.navigation.planning import room_middle
from cartier.pipeline import serve
from cartier.reasoners.embedded import make
from cartier.serving.homes import Homes
from cartier.serving.operations import Operations
from cartier.serving.values import pose
from cartier.types import FREE, OCCUPIED, OccupancyGrid, Room, Selection


@pytest.fixture
def ops(home: Path) -> Operations:
    """Over a home whose only room is named the kitchen."""
    made = Operations(Homes([home]), make())
    made.correct("name", "room:0", "kitchen")
    return made


def test_a_room_has_one_goal(ops: Operations, home: Path) -> None:
    mapped = Home.load(home)
    (room,) = mapped.rooms
    asked = ops.ask("go to the kitchen")
    assert asked["goal"] is not None
    assert asked["goal"] == ops.goal_for("kitchen")["goal"] == ops.describe("room:0")["goal"]
    planned = ops.goal("kitchen")
    assert (round(planned.x, 3), round(planned.y, 3)) == (asked["goal"]["x"], asked["goal"]["y"])
    assert mapped.grid is not None
    x, y = room_middle(room, mapped.grid)
    assert (asked["x"], asked["y"]) == (round(x, 2), round(y, 2))


def test_each_object_has_one_goal(ops: Operations, home: Path) -> None:
    mapped = Home.load(home)
    objs = [obj for obj in mapped.objects if obj.confirmed]
    assert len(objs) >= 3
    for obj in objs:
        answer = serve(mapped, "go", Selection("found", obj.label, object_id=obj.id), "test", robot=ops.robot)
        assert answer.goal is not None
        assert ops.goal_for(str(obj.id))["goal"] == ops.describe(str(obj.id))["goal"] == pose(answer.goal)


def room(cells: list[tuple[int, int]]) -> Room:
    return Room(0, "room", "room", np.array(cells, np.int32))


def grid(picture: list[str]) -> OccupancyGrid:
    cells = np.array([[OCCUPIED if c == "#" else FREE for c in row] for row in picture], np.int8)
    return OccupancyGrid(cells, 1.0, (10.0, 20.0), np.zeros(cells.shape, np.float32))


def test_middle_is_where_most_is_free() -> None:
    plan = grid(["#########", "#...#####", "#...#####", "#.......#", "#...#####", "#########"])
    free = [(int(r), int(c)) for r, c in np.argwhere(plan.cells == FREE)]
    mean = np.mean(free, axis=0)
    assert room_middle(room(free), plan) == (12.5, 22.5)  # row 2, column 2: not the mean, which the corridor draws away
    assert mean[1] > 2.5


def test_middle_is_on_free_floor() -> None:
    plan = grid(["#######", "####..#", "####..#", "####..#", "#######"])
    inside = [(r, c) for r in range(1, 4) for c in range(1, 6)]  # a room with a wide cupboard
    x, y = room_middle(room(inside), plan)
    assert x in (14.5, 15.5) and plan.cells[tuple(plan.cell((x, y)))] == FREE


def test_middle_of_a_room_without_free_floor_lies_in_it() -> None:
    plan = grid(["####", "####", "####"])
    assert room_middle(room([(r, c) for r in range(3) for c in range(3)]), plan) == (11.5, 21.5)
