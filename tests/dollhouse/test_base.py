"""Simulated base: it arrives where its map says, never within an obstacle, and its map is as wrong as its odometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartier.types import OCCUPIED
from cartier_dollhouse.base import CLOSE_M, PADDING_M, Base, compose, inverse
from cartier_dollhouse.explore import RADIUS_M
from cartier_dollhouse.navigator import Drive, Ending, Pose, route
from cartier_dollhouse.scene import load_home

STEP_S = 0.05


def driven(base: Base, goal: Pose, seconds: float = 120.0) -> Ending | None:
    way = route(base, goal)
    if isinstance(way, Ending):
        return way
    drive, ended = Drive(base, way, goal), None
    for _ in range(int(seconds / STEP_S)):
        before = base.true
        ended = drive.step(STEP_S)
        assert base.plan.clearance(base.true[:2]) >= min(RADIUS_M - PADDING_M, base.plan.clearance(before[:2]))
        assert math.dist(before[:2], base.true[:2]) <= 0.5 * STEP_S + 1e-9
        if ended is not None:
            break
    return ended


@pytest.mark.parametrize("home", ["studio", "kitchen_diner", "old_couple"])
def test_drives_arrive_and_hit_nothing(home: str) -> None:
    base, chance = Base(load_home(home), seed=2), np.random.default_rng(4)
    grid, cells = base.plan.grid(), np.argwhere(base.plan.reachable(base.true[:2]))
    ended = []
    for cell in cells[chance.integers(len(cells), size=4)]:
        x, y = grid.centre(cell).tolist()
        goal = (x, y, float(chance.uniform(-3, 3)))
        ended.append(driven(base, goal))
        if ended[-1] is Ending.ARRIVED:
            assert math.dist(base.believed[:2], goal[:2]) < 0.25
            assert abs(math.remainder(base.believed[2] - goal[2], math.tau)) < 0.25
            assert math.dist(base.believed[:2], base.true[:2]) < 0.15
    assert ended.count(Ending.ARRIVED) >= 3


def test_goals_that_cannot_be_reached() -> None:
    base = Base(load_home("studio"))
    grid = base.plan.grid()
    solid = grid.centre(np.argwhere(grid.cells == OCCUPIED)[0]).tolist()
    assert route(base, (500.0, 0.0, 0.0)) is Ending.OUTSIDE
    assert route(base, (math.nan, 0.0, 0.0)) is Ending.OUTSIDE
    assert route(base, (solid[0], solid[1], 0.0)) is Ending.OCCUPIED


def test_a_wall_stops_it_and_it_gets_away() -> None:
    base = Base(load_home("studio"))
    went = [base.step(0.5, 0.0, STEP_S) for _ in range(300)]
    assert not went[-1] and base.plan.free(base.true[:2]) and base.speed_m_s == 0.0
    before = base.true
    for _ in range(20):
        base.step(-0.2, 0.0, STEP_S)
    assert math.dist(before[:2], base.true[:2]) > 0.1


def test_odometry_wanders_and_loops_close_it() -> None:
    base, off_m, jumps = Base(load_home("studio"), seed=1), 0.0, 0
    start, turned = base.true, 0.0
    while base.speed_m_s == 0.0 or math.dist(base.true[:2], start[:2]) < 0.6:
        assert base.step(0.3, 0.0, STEP_S)
    for _ in range(400):  # round in a circle
        before = base.map_from_odom
        base.step(0.3, 1.5, STEP_S)
        turned += STEP_S
        jumps += before != base.map_from_odom
        off_m = max(off_m, math.dist(base.believed[:2], base.true[:2]))
        if before != base.map_from_odom:
            assert math.dist(base.believed[:2], base.true[:2]) < 1e-9
    assert 0.001 < off_m < 0.2
    assert 1 <= jumps <= turned * 0.3 / CLOSE_M + 1


def test_frames_are_composed_and_undone() -> None:
    chance = np.random.default_rng(1)
    for one, other in chance.uniform(-3, 3, (20, 2, 3)).tolist():
        back = compose(inverse(tuple(one)), compose(tuple(one), tuple(other)))
        assert np.allclose([math.remainder(v, math.tau) if k == 2 else v for k, v in enumerate(back)], other)
