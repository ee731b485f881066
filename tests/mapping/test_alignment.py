"""Alignment: a moved walk through the same room is found, other rooms are refused, and labels may be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cartier
from another_day import ANOTHER_DAY, MOVED, OTHER_THINGS, ROOM_THINGS, mapped, motion, rounds
from cartier.errors import InputError
from cartier.mapping.poses.alignment import Alignment, align, by_objects
from cartier.mapping.poses.wall_registration import register_walls
from cartier.render.mapped_frames import as_mapped
from cartier.types import FREE, OCCUPIED, UNKNOWN, MapObject, OccupancyGrid
from synthetic import TrueBoxes


@pytest.fixture(scope="module")
def old() -> cartier.Home:
    return mapped(rounds(ROOM_THINGS, 0.0, 1.1), ROOM_THINGS)


@pytest.fixture(scope="module")
def new() -> cartier.Home:
    return mapped(ANOTHER_DAY, ROOM_THINGS)


def off(found: np.ndarray) -> tuple[float, float]:
    """How far (m, degrees) the middle of the room is off."""
    error = found @ MOVED
    middle = np.array([2.5, 2.0, 1.0, 1.0])
    turned = np.degrees(np.arctan2(error[1, 0], error[0, 0]))
    return float(np.linalg.norm((error @ middle - middle)[:3])), abs(float(turned))


def test_another_day_is_found(old: cartier.Home, new: cartier.Home) -> None:
    found = align(old, new)
    off_m, off_deg = off(found.old_from_new)
    assert off_m < 0.05 and off_deg < 1.0
    assert found.objects >= 6 and found.on_walls > 0.9
    np.testing.assert_allclose(Alignment.of_row(found.row()).old_from_new, found.old_from_new, atol=1e-4)


def test_wrong_labels_do_not_matter(old: cartier.Home, new: cartier.Home) -> None:
    wrong = [replace(o, label="thing", labels=(("thing", 1.0),)) if k % 2 else o for k, o in enumerate(new.objects)]
    off_m, off_deg = off(align(old, replace(new, objects=tuple(wrong))).old_from_new)
    assert off_m < 0.05 and off_deg < 1.0


def test_another_room_is_refused_in_one_line(old: cartier.Home) -> None:
    other = mapped(rounds(OTHER_THINGS, 0.1, 0.9), OTHER_THINGS)
    with pytest.raises(InputError, match=r"cannot be aligned.*map it apart") as refused:
        align(old, other)
    assert "\n" not in str(refused.value)


def test_objects_alone_are_not_believed(old: cartier.Home, new: cartier.Home) -> None:
    assert new.grid is not None
    turned = replace(new.grid, cells=np.ascontiguousarray(new.grid.cells[:, ::-1]))  # other walls around the objects
    with pytest.raises(InputError, match=r"walls"):
        align(old, replace(new, grid=turned))
    with pytest.raises(InputError, match="no floor plan"):
        align(old, replace(new, grid=None))


def test_what_fits_in_two_places_is_refused(old: cartier.Home, new: cartier.Home) -> None:
    there = [replace(o, id=100 + o.id, position=(o.position[0] + 9, *o.position[1:])) for o in old.objects]
    with pytest.raises(InputError, match="more than one place"):
        align(replace(old, objects=(*old.objects, *there)), new)


def test_few_objects_are_refused(old: cartier.Home, new: cartier.Home) -> None:
    with pytest.raises(InputError, match="fewer than 5 objects"):
        align(old, replace(new, objects=new.objects[:4]))


def test_an_aligned_recording_grows_the_home(old: cartier.Home) -> None:
    apart = cartier.map_home(ANOTHER_DAY, TrueBoxes(ROOM_THINGS), every=1, mend_poses=False, onto=old)
    grown = cartier.map_home(ANOTHER_DAY, TrueBoxes(ROOM_THINGS), every=1, mend_poses=False, onto=old, align=True)
    assert len(apart.objects) > len(old.objects) >= len(grown.objects)
    known = {obj.id: obj for obj in old.objects}
    assert {obj.id for obj in grown.objects} <= known.keys(), "nothing is there twice"
    for obj in grown.objects:
        assert obj.label == known[obj.id].label
        np.testing.assert_allclose(obj.position, known[obj.id].position, atol=0.2)
    row = grown.settings["recordings"][1]
    assert row["sha256"] == ANOTHER_DAY.fingerprint() and len(row["moved"]) == 4
    again = as_mapped(grown, ANOTHER_DAY)
    np.testing.assert_allclose(again[3].world_from_camera, rounds(ROOM_THINGS, 0.1, 0.9).poses[3], atol=0.06)
    with pytest.raises(InputError, match="needs a home"):
        cartier.map_home(ANOTHER_DAY, TrueBoxes(ROOM_THINGS), align=True)


def objects_at(points: np.ndarray) -> list[MapObject]:
    sizes = 0.2 + 0.1 * np.arange(len(points))
    return [
        MapObject(
            k, f"kind {k}", ((f"kind {k}", 1.0),), tuple(map(float, p)), tuple(map(float, p - s / 2)),
            tuple(map(float, p + s / 2)), 1.0, True, 9, 9, 0.0, 0.0, 0.0, (),
        )
        for k, (p, s) in enumerate(zip(points, sizes, strict=True))
    ]  # fmt: skip


@settings(max_examples=30, deadline=None)
@given(turn=st.floats(-3.1, 3.1), x=st.floats(-20, 20), y=st.floats(-20, 20), seed=st.integers(0, 10**6))
def test_any_motion_of_objects_is_found(turn: float, x: float, y: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(4) * 1.6, np.arange(3) * 1.6), -1).reshape(-1, 2)
    points = np.column_stack([grid + rng.uniform(-0.4, 0.4, grid.shape), rng.uniform(0.3, 1.2, len(grid))])
    by = motion(turn, x, y)
    there = points @ by[:3, :3].T + by[:3, 3]
    kept = rng.permutation(len(points))[:8]
    found = by_objects(objects_at(points), [objects_at(there)[k] for k in kept])
    assert not isinstance(found, str) and found[1] == 8
    np.testing.assert_allclose(found[0] @ by, np.eye(4), atol=0.01)


def plan(flip: bool = False) -> OccupancyGrid:
    cells = np.full((80, 100), UNKNOWN, np.int8)
    cells[10:70, 10:90] = FREE
    cells[10:12, 10:90] = cells[68:70, 10:90] = cells[10:70, 10:12] = cells[10:70, 88:90] = OCCUPIED
    cells[10:50, 40:42] = cells[30:32, 40:60] = OCCUPIED
    return OccupancyGrid(
        np.ascontiguousarray(cells[::-1] if flip else cells), 0.05, (0.0, 0.0), np.zeros(cells.shape, np.float16)
    )


def test_walls_refine_and_judge() -> None:
    found = register_walls(plan(), plan(), motion(0.02, 0.06, -0.05))
    assert found.best and found.on_walls > 0.95
    np.testing.assert_allclose(found.old_from_new[:2, 3], 0, atol=0.04)
    assert abs(found.old_from_new[1, 0]) < 0.01
    half_turn = motion(np.pi, 5.0, 4.0)  # onto itself, but for the walls within
    assert not register_walls(plan(), plan(), half_turn).best
    assert not register_walls(plan(), plan(flip=True), np.eye(4)).on_walls > 0.95


def test_each_plan_has_the_walls_and_the_floor_of_the_other() -> None:
    cells = plan().cells.copy()
    cells[12:68, 12:88] = FREE  # all of its walls are walls of the other one, which has more
    bare = replace(plan(), cells=cells)
    for old, new in ((plan(), bare), (bare, plan())):
        assert not register_walls(old, new, np.eye(4)).agree
    filled = cells.copy()
    filled[20:60, 60:80] = OCCUPIED
    for old, new in ((bare, replace(bare, cells=filled)), (replace(bare, cells=filled), bare)):
        assert register_walls(old, new, np.eye(4)).on_floor < 0.9
    assert register_walls(plan(), plan(), np.eye(4)).agree


def test_walls_within_something_solid_lie_on_no_walls() -> None:
    cells = np.hstack([plan().cells, np.full((80, 100), OCCUPIED, np.int8)])
    solid = OccupancyGrid(cells, 0.05, (0.0, 0.0), np.zeros(cells.shape, np.float16))
    assert register_walls(solid, plan(), np.eye(4)).best
    assert not register_walls(solid, plan(), motion(0.0, 5.0, 0.0)).best
