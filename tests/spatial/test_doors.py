"""Doors of a floor plan: where rooms meet in a narrow place, and as landmarks of what is asked for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from cartier.mapping.rooms import find_rooms
from cartier.reasoners import embedded
from cartier.spatial.doors import distance_to, find_doors, widest_way
from cartier.types import OCCUPIED, Inventory, MapObject
from plans import DOOR, LEFT, RIGHT, Plan, flat


def test_doorway_joins_its_rooms() -> None:
    grid = flat().grid()
    (door,) = find_doors(find_rooms(grid, []), grid)
    x1, y1, x2, y2 = DOOR
    assert door.xy == pytest.approx(((x1 + x2) / 2, (y1 + y2) / 2), abs=0.15)
    assert door.rooms == (0, 1)
    assert door.width_m == pytest.approx(y2 - y1, abs=0.15)


def test_what_stands_beside_a_door_makes_it_narrower() -> None:
    _, y1, x2, y2 = DOOR
    free, blocked = flat().grid(), flat().draw((x2, y1 - 0.2, x2 + 0.3, y1 + 0.4), OCCUPIED, 0.6).grid()
    (door,), (beside,) = (find_doors(find_rooms(free, []), grid) for grid in (free, blocked))
    assert door.narrowest_m == pytest.approx(y2 - y1, abs=0.11) and door.narrowest_m <= door.width_m
    assert beside.narrowest_m < door.narrowest_m - 0.05


def test_two_doorways_are_two_doors() -> None:
    grid = flat().draw((4.0, 2.2, 4.1, 2.9), 0, 2.15).grid()
    assert len(find_doors(find_rooms(grid, []), grid)) == 2


def test_wide_opening_is_no_door() -> None:
    grid = Plan().rooms(LEFT, RIGHT).draw((4.0, 0.2, 4.1, 2.8), 0, 2.15).grid()
    assert find_doors(find_rooms(grid, []), grid) == ()


def _box(number: int, label: str, x: float, y: float, room: int) -> MapObject:
    low, high = (x - 0.2, y - 0.2, 0.0), (x + 0.2, y + 0.2, 0.8)
    return MapObject(
        number, label, ((label, 1.0),), (x, y, 0.4), low, high, 1.0, True, 3, 3, 0.0, 0.0, 0.0, (), room=room
    )


@pytest.fixture(scope="module")
def home() -> Inventory:
    grid = flat().grid()
    rooms = find_rooms(grid, [])
    objects = (_box(1, "chair", 3.4, 1.4, 0), _box(2, "chair", 0.5, 0.5, 0), _box(3, "sofa", 6.0, 2.0, 1))
    return Inventory(objects, rooms, from_xy=(0.6, 0.6), doors=find_doors(rooms, grid))


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("take me to the chair by the door", 1),
        ("go to the chair nearest to the door", 1),
        ("go to the chair that is farthest from the door", 2),
    ],
)
def test_door_is_a_landmark(home: Inventory, words: str, meant: int) -> None:
    assert embedded.make().select(words, home).object_id == meant


def test_doors_are_counted_but_never_served(home: Inventory) -> None:
    reasoner = embedded.make()
    told = reasoner.select("how many doors are there?", home)
    assert told.fact is not None
    assert (told.fact.kind, told.fact.value, told.fact.objects) == ("count", 1, ())
    assert reasoner.select("which of them is nearer to the door, the sofa or the chair?", home).object_id != -1


def test_home_without_rooms_has_no_door(home: Inventory) -> None:
    told = embedded.make().select("how many doors are there?", Inventory(home.objects))
    assert told.fact is not None
    assert told.fact.value == 0


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solid = rng.random(tuple(rng.integers(2, 40, 2))) < 0.1
    solid[0, 1] = True
    np.testing.assert_allclose(distance_to(solid), ndimage.distance_transform_edt(~solid))
    assert np.isinf(distance_to(np.zeros((3, 4), bool))).all()


@pytest.mark.parametrize("seed", range(5))
def test_widest_way_is_the_last_that_joins_both_ends(seed: int) -> None:
    clear = np.random.default_rng(seed).integers(0, 9, (12, 15)).astype(float)
    start, end = np.zeros(clear.shape, bool), np.zeros(clear.shape, bool)
    start[:, 0] = end[:, -1] = True
    joined = []
    for reach in range(9):
        parts, _ = ndimage.label(clear >= reach, np.ones((3, 3)))
        joined.append(bool((set(parts[start]) & set(parts[end])) - {0}))
    assert widest_way(clear, start, end) == max(reach for reach in range(9) if joined[reach])
    assert widest_way(clear, start, np.zeros(clear.shape, bool)) == -np.inf
