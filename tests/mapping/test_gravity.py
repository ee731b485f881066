from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.mapping.gravity import Levelling, level, quarter_turns
from cartier.mapping.upright import turned_camera, turned_image
from synthetic import CAMERA, THINGS, look, render, walk

coordinate = st.floats(-10, 10)
component = st.floats(-1, 1)


def noisy(poses: list[np.ndarray], noise_m: float = 0.004) -> list[np.ndarray]:
    """Depth as a cheap sensor gives it: millimetres, noise that grows with distance squared, holes."""
    rng = np.random.default_rng(0)
    depths = []
    for pose in poses:
        depth = render(pose, CAMERA, THINGS)[0]
        depth = np.round(depth + rng.normal(0, noise_m, depth.shape) * depth**2 / 4, 3)
        depth[rng.random(depth.shape) < 0.05] = np.nan
        depths.append(depth.astype(np.float32))
    return depths


ROUND = list(walk().poses)
ROUND_DEPTHS = noisy(ROUND)
FIXED = [
    look((0.7 + 0.1 * i, 0.6, 1.4), (0.9 + 0.1 * i, 2.2, 0.2)) for i in range(10)
]  # always one way, 37 degrees down
FIXED_DEPTHS = noisy(FIXED)


def moved(quaternion: tuple[float, ...], shift: tuple[float, ...]) -> np.ndarray:
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    rotation = np.eye(3) + 2 * (w * cross(x, y, z) + cross(x, y, z) @ cross(x, y, z))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, shift
    return matrix


def cross(x: float, y: float, z: float) -> np.ndarray:
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def errors(levelling: Levelling, source_from_room: np.ndarray) -> tuple[float, float]:
    """How far (degrees, metres) the levelled world is from the room's up and floor."""
    level_from_room = levelling.level_from_world @ source_from_room
    tilt = math.degrees(math.acos(min(1.0, level_from_room[2, 2])))
    floor = level_from_room @ [2.5, 2.0, 0.0, 1.0]
    return tilt, float(floor[2])


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(component, component, component, component).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(coordinate, coordinate, coordinate),
    st.sampled_from([(ROUND, ROUND_DEPTHS), (FIXED, FIXED_DEPTHS)]),
)
def test_a_room_is_levelled_however_its_world_lies(
    quaternion: tuple[float, ...], shift: tuple[float, ...], seen: tuple[list[np.ndarray], list[np.ndarray]]
) -> None:
    source_from_room = moved(quaternion, shift)
    poses, depths = seen
    levelling = level(source_from_room @ np.array(poses), CAMERA, lambda i: depths[i])
    tilt, floor = errors(levelling, source_from_room)
    assert tilt < 0.5
    assert abs(floor) < 0.01
    rotation = levelling.level_from_world[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-9
    assert np.linalg.det(rotation) > 0


def test_a_world_upside_down_is_turned_over() -> None:
    upside_down = np.diag([1.0, -1.0, -1.0, 1.0])
    levelling = level(upside_down @ np.array(ROUND), CAMERA, up=(0, 0, -1), floor_m=0)
    assert errors(levelling, upside_down) == (0, 0)


@pytest.mark.parametrize("tilt", [0, 1e-15, 1e-12, 1e-8, 1e-4, 1.0])
def test_the_rotation_is_exact_near_straight_down(tilt: float) -> None:
    for up in ((0, tilt, -1), (tilt, 0, -1), (tilt, 0, 1)):
        levelling = level(np.array(ROUND), CAMERA, up=up, floor_m=0)
        rotation = levelling.level_from_world[:3, :3]
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-11
        assert np.abs(rotation @ levelling.up - (0, 0, 1)).max() < 1e-11


def test_readings_below_the_floor_do_not_lower_it() -> None:
    rng = np.random.default_rng(1)
    mirrored = [np.where(rng.random(d.shape) < 0.03, d * 1.6, d).astype(np.float32) for d in ROUND_DEPTHS]
    tilt, floor = errors(level(np.array(ROUND), CAMERA, lambda i: mirrored[i]), np.eye(4))
    assert tilt < 0.5
    assert abs(floor) < 0.01


def test_a_floor_that_was_never_in_view_is_doubted() -> None:
    table = look((1.5, 2.2, 1.5), (1.5, 3.4, 0.8))
    depth = noisy([table])[0]
    low = render(table, CAMERA, THINGS)[0]
    points = transform(table, backproject(low, CAMERA).astype(np.float64))
    depth[(points[..., 2] < 0.05)] = np.nan  # a floor that returns nothing
    assert "was the floor in view?" in level(np.array([table]), CAMERA, lambda i: depth).notes[1]
    assert "was the floor in view?" not in level(np.array(ROUND), CAMERA, lambda i: ROUND_DEPTHS[i]).notes[1]


def test_without_depth_level_cameras_that_look_around_give_up_away() -> None:
    source_from_room = moved((0.3, -0.5, 0.1, 0.4), (1, 2, 3))
    levelling = level(source_from_room @ np.array(ROUND), CAMERA)
    tilt, floor = errors(levelling, source_from_room)
    assert tilt < 0.1
    assert abs(floor) < 0.01  # the walk's cameras are 1.5 m up, which is what is assumed
    assert "there is no depth" in levelling.notes[0]
    assert "assumed 1.5 m below the cameras" in levelling.notes[1]


def test_without_depth_a_camera_that_never_turns_says_that_up_may_be_off() -> None:
    levelling = level(np.array(FIXED), CAMERA)
    assert "their mean up" in levelling.notes[0]
    assert errors(levelling, np.eye(4))[0] < 45


@pytest.mark.parametrize("depth", [np.nan, 2.0], ids=["nothing read", "one wall"])
def test_too_little_to_see_falls_back_to_the_cameras(depth: float) -> None:
    ahead = [look((1, 1, 1.2), (2, 1 + 0.3 * i, 1.2)) for i in range(5)]
    wall = np.full((CAMERA.height, CAMERA.width), depth, np.float32)
    levelling = level(np.array(ahead), CAMERA, lambda i: wall)
    assert "too few horizontal surfaces" in levelling.notes[0]
    assert "no horizontal surface was seen" in levelling.notes[1]
    assert errors(levelling, np.eye(4))[0] < 0.1


def test_what_is_given_is_not_estimated() -> None:
    def never(i: int) -> np.ndarray:
        raise AssertionError("no depth needs to be read")

    levelling = level(np.array(ROUND), CAMERA, never, up=(0, 0.1, 1), floor_m=0.3)
    assert levelling.notes == ("up given by the user", "floor given by the user")
    assert levelling.floor_m == 0.3
    assert np.allclose(levelling.level_from_world[:3, :3] @ levelling.up, (0, 0, 1))


def test_cameras_that_look_every_way_give_no_up() -> None:
    over = [np.diag([1.0, x, y, 1.0]) for x, y in ((1, 1), (-1, -1))]
    over += [np.diag([-1.0, x, -x, 1.0]) for x in (1.0, -1.0)]
    with pytest.raises(InputError, match="give it with --up X,Y,Z"):
        level(np.array(over), CAMERA)


def test_no_piece_of_an_upright_walk_is_turned() -> None:
    down_a_wall = [look((2.5, 2, 1.4), (2.5, 4, 2.4 - 0.2 * i)) for i in range(12)]
    pieces = [ROUND[at : at + length] for length in (2, 4, 8) for at in range(0, len(ROUND) - length, 3)]
    for piece in (down_a_wall, *pieces):
        for depths in (noisy(piece), None):
            poses = np.array(piece)
            levelling = level(poses, CAMERA, None if depths is None else lambda i, depths=depths: depths[i])
            assert quarter_turns(levelling.up @ poses[:, :3, :2].mean(axis=0)) == 0


@pytest.mark.parametrize(
    ("poses", "depths", "turns"),
    [(poses, depths, turns) for poses, depths in ((ROUND, ROUND_DEPTHS), (FIXED, FIXED_DEPTHS)) for turns in range(4)],
)
def test_floor_and_walls_tell_how_the_camera_was_held(
    poses: list[np.ndarray], depths: list[np.ndarray], turns: int
) -> None:
    camera, old_from_new = turned_camera(CAMERA, turns)
    source_from_room = moved((0.3, -0.5, 0.1, 0.4), (1, 2, 3))
    held = source_from_room @ np.array(poses) @ old_from_new
    levelling = level(held, camera, lambda i: turned_image(depths[i], turns))
    tilt, floor = errors(levelling, source_from_room)
    assert tilt < 0.5
    assert abs(floor) < 0.01
    assert quarter_turns(levelling.up @ held[:, :3, :2].mean(axis=0)) == (4 - turns) % 4
    assert ("the pictures lie on" in levelling.notes[0]) == (turns in (1, 3))


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_without_depth_cameras_that_walk_and_look_around_tell_how_they_were_held(turns: int) -> None:
    source_from_room = moved((0.3, -0.5, 0.1, 0.4), (1, 2, 3))
    held = source_from_room @ np.array(ROUND) @ turned_camera(CAMERA, turns)[1]
    levelling = level(held, CAMERA)
    assert errors(levelling, source_from_room)[0] < 0.1
    side = {0: "stand upright", 1: "lie on their left side", 3: "lie on their right side"}[turns]
    assert f"the pictures {side} then; override with" in levelling.notes[0]
