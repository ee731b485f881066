"""What is nearest is what the robot reaches by the shortest way."""

from __future__ import annotations

from cartier.spatial.query import Scene
from cartier.types import Inventory
from flat import obj

SIZE = (0.1, 0.1, 0.1)
NEAR, FAR = obj(1, "cup", (1.0, 0.0, 0.5), SIZE), obj(2, "cup", (2.0, 0.0, 0.5), SIZE)


def test_nearest_is_by_the_way() -> None:
    beside_the_wall = Scene(Inventory((NEAR, FAR), from_xy=(0.0, 0.0), way_m={1: 9.0, 2: 2.5}.get))
    assert beside_the_wall.most([NEAR, FAR], "nearest") == [FAR]
    assert beside_the_wall.most([NEAR, FAR], "farthest") == [NEAR]


def test_without_a_way_it_comes_last() -> None:
    shut_in = Scene(Inventory((NEAR, FAR), from_xy=(0.0, 0.0), way_m={2: 2.5}.get))
    assert shut_in.most([NEAR, FAR], "nearest") == [FAR]
    unknown = Scene(Inventory((NEAR, FAR), from_xy=(0.0, 0.0)))
    assert unknown.most([NEAR, FAR], "nearest") == [NEAR], "where no way is known, by distance"
