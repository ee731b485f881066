"""Driving a goal in the true home, and steering by keyboard."""

from __future__ import annotations

import math
import os
import pty
import threading
from pathlib import Path

import numpy as np
import pytest
from test_explore import CAMERA, HOME, RADIUS_M

from cartier.errors import InputError
from cartier.navigation.planning import goal_for, reach
from cartier.types import Goal, Place
from cartier_dollhouse.drive import Drive, drive
from cartier_dollhouse.explore import DOWN, STEP_M
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import pinhole
from cartier_dollhouse.scene import load_scene
from cartier_dollhouse.teleop import TURN, half_blocks, steer, terminal_keys


@pytest.fixture(scope="module")
def home() -> Scene:
    return load_scene(HOME)


def place_of(home: Scene, type: str) -> Place:
    box = next(t for t in home.truth() if t.label == type)
    middle = tuple((np.array(box.box_min) + box.box_max) / 2)
    return Place(type, middle, 1.0, 0, None, box.box_min, box.box_max)


def straight(x: float, y: float, place: Place, yaw: float = 0.0) -> Goal:
    return Goal(x, y, yaw, np.array([[x, y]]), 0.0, place, True)


def driven(home: Scene, goal: Goal) -> Drive:
    return drive(home, home.start_xy, goal, RADIUS_M, CAMERA)


@pytest.mark.parametrize("type", ["Bed", "GarbageCan", "Bowl"])
def test_a_planned_goal_is_reached_and_shows_the_place(home: Scene, type: str) -> None:
    place = place_of(home, type)
    area = reach(Plan(home, RADIUS_M).grid(), home.start_xy, RADIUS_M)
    assert area is not None
    goal = goal_for(area, place)
    assert goal is not None
    result = driven(home, goal)
    assert result.arrived
    assert result.collided_at is None
    assert result.in_view
    assert result.view.shape == (CAMERA.height, CAMERA.width, 3)
    assert np.allclose(result.poses[-1], (goal.x, goal.y, goal.yaw))
    assert result.length_m == pytest.approx(goal.length_m, abs=0.1)
    plan = Plan(home, RADIUS_M)
    assert all(plan.free(pose[:2]) for pose in result.poses)


def test_furniture_in_the_way_stops_it(home: Scene) -> None:
    result = driven(home, straight(3.4, 1.2, place_of(home, "Bed")))
    assert not result.arrived
    assert result.collided_at is not None
    x, y = result.collided_at
    assert 1.9 - RADIUS_M - 0.05 < x < 1.9 - RADIUS_M + 0.05  # where the table begins
    assert 1.0 < y < 1.2
    assert result.poses[-1][0] == x
    assert not result.in_view  # it looks east, and the wall hides the bed


def test_what_is_behind_a_wall_or_the_camera_is_not_seen(home: Scene) -> None:
    table, bed = place_of(home, "DiningTable"), place_of(home, "Bed")
    assert driven(home, straight(1.2, 1.2, table)).in_view
    assert not driven(home, straight(1.2, 1.2, table, math.pi)).in_view
    assert not driven(home, straight(1.2, 1.2, bed)).in_view


def test_a_goal_in_furniture_and_a_start_in_a_wall_are_refused(home: Scene) -> None:
    bed = place_of(home, "Bed")
    with pytest.raises(InputError, match=r"the goal \(5.90, 1.10\) for the Bed lies in a wall, in furniture"):
        driven(home, straight(5.9, 1.1, bed))
    with pytest.raises(InputError, match="the goal"):
        driven(home, straight(50, 1, bed))
    with pytest.raises(InputError, match=r"cannot start at \(4.05, 1.00\)"):
        drive(home, (4.05, 1.0), straight(1.0, 1.0, bed), RADIUS_M, CAMERA)


def test_keys_steer(home: Scene) -> None:
    shown: list[str] = []
    keys = ["w", "a", "\x1b[A", "S", "f", "x", "q", "w"]
    poses = steer(home, CAMERA, RADIUS_M, keys=keys, show=lambda rgb, line: shown.append(line))
    assert len(poses) == 6  # the start and five keys that changed the view; x is no key, and nothing counts after q
    assert np.allclose(poses[1][:2, 3], np.add(home.start_xy, (STEP_M, 0)))
    assert math.atan2(poses[2][1, 2], poses[2][0, 2]) == pytest.approx(TURN)
    assert np.linalg.norm(poses[3][:2, 3] - poses[2][:2, 3]) == pytest.approx(STEP_M)
    assert np.allclose(poses[4], poses[2])  # ahead and back again
    assert -math.asin(poses[5][2, 2]) > DOWN + 0.1
    assert len(shown) == 7


def test_a_colliding_step_is_refused(home: Scene) -> None:
    shown: list[str] = []
    poses = steer(home, CAMERA, RADIUS_M, keys="w" * 20, show=lambda rgb, line: shown.append(line))
    plan = Plan(home, RADIUS_M)
    assert all(plan.free(pose[:2, 3]) for pose in poses)
    assert len(poses) < 20
    assert "bump" in shown[-1]


def test_without_a_terminal_steering_says_so(home: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        with pytest.raises(InputError, match="leave out --drive"):
            steer(home, CAMERA)


def test_the_terminals_keys_are_read_raw_and_it_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    import termios

    ours, its = pty.openpty()
    with os.fdopen(its, "r") as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        before = termios.tcgetattr(its)
        keys = terminal_keys()
        # Going raw drops what was typed before, so the first key must come after the first read has begun.
        first = threading.Timer(0.3, os.write, (ours, b"w"))
        first.start()
        got = [next(keys)]
        for typed, count in ((b"\x1b[A\x1b[D", 2), (b"a\x1b[A", 2), (b"\x1b", 1), (b"\x03", 1)):
            os.write(ours, typed)
            got += [next(keys) for _ in range(count)]
        keys.close()
        assert got == ["w", "\x1b[A", "\x1b[D", "a", "\x1b[A", "\x1b", "\x03"]
        assert termios.tcgetattr(its) == before
    os.close(ours)


def test_the_picture_fits_the_terminal() -> None:
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[:24] = (255, 0, 0)
    text = half_blocks(rgb, columns=32, rows=40)
    lines = text.split("\r\n")
    assert len(lines) == 12
    assert all(line.count("▀") == 32 for line in lines)
    assert lines[0].startswith("\x1b[38;2;255;0;0;48;2;255;0;0m▀")
    assert lines[-1].startswith("\x1b[38;2;0;0;0;48;2;0;0;0m▀")
    assert len(half_blocks(rgb, columns=200, rows=5).split("\r\n")) == 5


def test_the_default_camera_is_the_papers() -> None:
    camera = pinhole()
    assert (camera.width, camera.height, camera.cx, camera.cy) == (640, 480, 319.5, 239.5)
    assert 2 * math.degrees(math.atan(240 / camera.fy)) == pytest.approx(62)
