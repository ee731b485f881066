"""Rooms that people join or divide: cells, objects and route rules follow; undo takes it back."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.home import Home
from cartier.home.room_changes import halves
from cartier.pipeline import map_home
from cartier.types import FREE, OCCUPIED, OccupancyGrid, Room
from synthetic import THINGS, TrueBoxes
from synthetic import small_walk as walk


def two_halls() -> tuple[OccupancyGrid, np.ndarray]:
    """A floor of 4 m x 2 m with a wall in the middle that leaves an opening of 0.8 m, and its free cells."""
    cells = np.full((20, 40), FREE, np.int8)
    cells[:6, 20] = cells[14:, 20] = OCCUPIED
    height_m = np.where(cells == OCCUPIED, 2.5, 0.0).astype(np.float32)
    return OccupancyGrid(cells, 0.1, (0.0, 0.0), height_m), np.argwhere(cells == FREE).astype(np.int32)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rooms") / "home"
    map_home(walk(), TrueBoxes(THINGS)).save(folder)
    return folder


@pytest.fixture
def home(mapped: Path, tmp_path: Path) -> Home:
    Home.load(mapped).save(tmp_path / "home")
    return Home.load(tmp_path / "home")


@pytest.mark.parametrize("point", [(2.05, 1.0), (2.0, 0.8), (2.1, 1.3)])
def test_cut_runs_from_jamb_to_jamb(point: tuple[float, float]) -> None:
    grid, cells = two_halls()
    found = halves(cells, point, grid)
    assert found is not None
    left, right = sorted(found, key=lambda part: part[:, 1].mean())
    assert len(left) + len(right) == len(cells)
    assert abs(len(left) - 400) <= 16 and abs(len(right) - 380) <= 16
    assert left[:, 1].max() <= 22 and right[:, 1].min() >= 18


def test_no_cut_outside() -> None:
    grid, cells = two_halls()
    assert halves(cells, (5.0, 1.0), grid) is None


def test_split_and_merge_undo(home: Home) -> None:
    room = home.rooms[0]
    middle = home.grid.centre(room.cells).mean(0) if home.grid is not None else None
    assert middle is not None
    two, done = home.correct("split", f"room:{room.id}", to_xy=tuple(middle), name="pantry", who="Ayo")
    assert "is two: the other is pantry" in done
    assert len(two.rooms) == len(home.rooms) + 1
    first, second = two.rooms[0], next(each for each in two.rooms if each.name == "pantry")
    assert len(first.cells) + len(second.cells) == len(room.cells)
    assert {obj.room for obj in two.objects} == {first.id, second.id}
    for obj in two.objects:
        nearest = {each.id: away_m(each, obj.position, two) for each in (first, second)}
        assert obj.room is not None and nearest[obj.room] == min(nearest.values())
    named, _ = two.correct("name", "pantry", name="larder")
    one, done = named.correct("merge", f"room:{room.id}", other="larder")
    assert done.endswith("are one")
    assert len(one.rooms) == len(home.rooms) and len(one.rooms[0].cells) == len(room.cells)
    assert {obj.room for obj in one.objects} == {room.id}
    again = one
    for _ in range(3):
        again, _ = again.correct("undo")
    assert [(each.name, len(each.cells)) for each in again.rooms] == [(r.name, len(r.cells)) for r in home.rooms]


def away_m(room: Room, position: tuple[float, ...], home: Home) -> float:
    assert home.grid is not None
    return float(np.linalg.norm(home.grid.centre(room.cells) - position[:2], axis=1).min())


def test_rules_follow_joined_rooms(home: Home) -> None:
    assert home.grid is not None
    room = home.rooms[0]
    two, _ = home.correct("split", room.name, to_xy=tuple(home.grid.centre(room.cells).mean(0)), name="pantry")
    ruled, _ = two.correct("rule", "avoid room:pantry hard standing")
    joined, _ = ruled.correct("merge", room.name, other="pantry")
    assert joined.corrected is not None
    assert [rule.target.names for rule in joined.corrected.rules if rule.target] == [(room.name,)]


@pytest.mark.parametrize(
    ("what", "entity", "more", "says"),
    [
        ("split", "room:0", {}, "where"),
        ("split", "room:0", {"to_xy": (0.0, -0.9)}, "no straight cut"),
        ("merge", "room:0", {"other": "room:0"}, "one room"),
        ("merge", "room:0", {"other": "mug"}, "an object and a room"),
        ("move", "room:0", {"to_xy": (1.0, 1.0)}, "only objects"),
    ],
)
def test_impossible_changes_are_refused(home: Home, what: str, entity: str, more: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        home.correct(what, entity, **more)  # type: ignore[arg-type]


def test_rooms_change_after_growth_too(home: Home) -> None:
    """A correction finds its room by place: with other ids it is the same room."""
    from cartier.home.corrected import apply

    room = home.rooms[0]
    assert home.grid is not None and home.corrected is not None
    two, _ = home.correct("split", room.name, to_xy=tuple(home.grid.centre(room.cells).mean(0)), name="pantry")
    assert two.corrected is not None
    other_ids = tuple(replace(each, id=each.id + 1) for each in home.corrected.mapped_rooms)
    found = apply(two.corrected.log, home.corrected.mapped_objects, other_ids, home.grid)
    assert sorted(len(each.cells) for each in found.rooms) == sorted(len(each.cells) for each in two.rooms)
    assert len({each.id for each in found.rooms}) == len(found.rooms) and not found.notes
    assert math.isclose(sum(len(each.cells) for each in found.rooms), sum(len(each.cells) for each in home.rooms))
