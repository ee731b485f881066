"""Share of the floor that was looked at, on floor plans whose open ends are known."""

from __future__ import annotations

import pytest

from cartier.spatial.floor_seen import BEHIND_M, floor_seen
from cartier.types import FREE, OCCUPIED, UNKNOWN
from plans import DOOR, LEFT, RIGHT, Plan, flat

ROOM_M2 = (LEFT[2] - LEFT[0]) * (LEFT[3] - LEFT[1])


def test_without_a_floor_nothing_was_seen() -> None:
    assert floor_seen(None) == 0
    assert floor_seen(Plan().grid()) == 0


def test_rooms_with_walls_all_around_are_seen_whole() -> None:
    assert floor_seen(flat().grid()) == 1


def test_an_open_side_goes_on_for_a_metre() -> None:
    half = Plan().rooms(LEFT).draw((2.0, 0.0, 4.1, 3.0), UNKNOWN)  # the right half was not seen
    seen_m2, behind_m2 = 2.0 * 3.0, BEHIND_M * 3.0
    assert floor_seen(half.grid()) == pytest.approx(seen_m2 / (seen_m2 + behind_m2), rel=0.01)


def test_a_door_that_nobody_went_through_is_an_open_end_and_a_gap_is_none() -> None:
    door = Plan().rooms(LEFT).draw(DOOR, FREE)
    assert 0.85 < floor_seen(door.grid()) < 0.95
    gap = Plan().rooms(LEFT).draw((4.0, 1.0, 4.1, 1.3), FREE)
    assert floor_seen(gap.grid()) == 1


def test_what_is_unknown_beside_two_ends_counts_once() -> None:
    hole = Plan().rooms(LEFT).draw((1.5, 1.0, 2.1, 1.6), UNKNOWN)  # under a table, seen from all sides
    seen_m2 = ROOM_M2 - 0.36
    assert floor_seen(hole.grid()) == pytest.approx(seen_m2 / ROOM_M2, rel=0.01)
    two = Plan().rooms(LEFT, RIGHT).draw((1.5, 0.0, 2.1, 3.0), UNKNOWN)  # a strip between two seen parts of a room
    area_m2 = ROOM_M2 + (RIGHT[2] - RIGHT[0]) * (RIGHT[3] - RIGHT[1])
    assert floor_seen(two.grid()) == pytest.approx((area_m2 - 1.8) / area_m2, rel=0.01)


def test_a_wall_ends_what_is_behind() -> None:
    shut = Plan().rooms(LEFT).draw((2.0, 0.0, 4.0, 3.0), UNKNOWN).draw((2.2, 0.0, 2.3, 3.0), OCCUPIED, 2.2)
    assert floor_seen(shut.grid()) == pytest.approx(6.0 / 6.6, rel=0.01)
