"""The exploring robot in a tiny home that is built here: two rooms, a table between, a doorway."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.recordings.folder import save
from cartier.types import FREE
from cartier_dollhouse.explore import STEP_M, TURN, explore
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import DollhouseRecording, look, pinhole
from cartier_dollhouse.scene import load_scene
from cartier_dollhouse.sensor import Sensor

RADIUS_M = 0.2
HOME = """
name: tiny
about: Two rooms for tests.
start: [1.0, 1.0]
rooms:
  - {name: parlour, kind: living room, box: [0.0, 0.0, 4.0, 3.0], floor: "planks:oak", walls: "paint:cream"}
  - {name: chamber, kind: bedroom, box: [4.1, 0.0, 6.6, 3.0], floor: "planks:oak", walls: "paint:cream"}
doors:
  - {between: [parlour, chamber], at: 2.3, width: 0.9}
things:
  - type: DiningTable
    at: [2.4, 1.2]
    face: south
    size: [1.0, 0.8, 0.75]
    things: [{type: Bowl, at: [0.0, 0.0]}]
  - {type: Bed, at: [5.9, 1.1], face: west, size: [1.0, 1.0, 0.6]}
  - {type: GarbageCan, at: [4.5, 0.4], face: north, size: [0.3, 0.3, 0.5]}
"""
CAMERA = pinhole(96, 72)


@pytest.fixture(scope="module")
def home() -> Scene:
    return load_scene(HOME)


@pytest.fixture(scope="module")
def walk(home: Scene):
    return explore(home, CAMERA, RADIUS_M)


def test_all_floor_is_found_and_everything_is_seen_from_near(home: Scene, walk) -> None:
    assert walk.complete
    assert walk.coverage >= 0.95
    recording = DollhouseRecording(home, CAMERA, walk.poses)
    most = np.zeros(len(home.things) + 1, int)
    for i in range(len(recording)):
        instances = recording[i].instances
        assert instances is not None
        most = np.maximum(most, np.bincount(instances.ravel(), minlength=len(most)))
    assert (most[1:] >= 5).all()  # 200 pixels of a picture of 640x480


def test_no_step_is_too_long_or_through_anything(home: Scene, walk) -> None:
    plan = Plan(home, RADIUS_M)
    xy, yaw = walk.track[:, :2], walk.track[:, 2]
    assert np.linalg.norm(np.diff(xy, axis=0), axis=1).max() <= STEP_M + 1e-9
    turned = np.remainder(np.diff(yaw) + math.pi, math.tau) - math.pi
    assert np.abs(turned).max() <= TURN + 1e-9
    for a, b in itertools.pairwise(xy):
        assert all(plan.free(p) for p in np.linspace(a, b, 12))


def test_cameras_look_where_the_robot_does(walk) -> None:
    ahead = walk.poses[:, :3, 2]
    assert np.allclose(np.sin(np.arctan2(ahead[:, 1], ahead[:, 0]) - walk.track[:, 2]), 0)
    assert (np.cos(np.arctan2(ahead[:, 1], ahead[:, 0]) - walk.track[:, 2]) > 0).all()
    assert np.allclose(walk.poses[:, :2, 3], walk.track[:, :2])
    assert (walk.poses[:, 2, 3] == 1.5).all()
    down = -np.degrees(np.arcsin(ahead[:, 2]))
    assert {0, 22, 52} == set(np.floor(np.abs(down) + 1e-6).astype(int))


def test_the_robots_own_plan_tells_no_wall_for_floor(home: Scene, walk) -> None:
    truth = Plan(home, RADIUS_M)
    cells = np.argwhere(walk.grid.cells == FREE)
    blocked = [truth.clearance(xy) == 0 for xy in walk.grid.centre(cells)]
    assert np.mean(blocked) < 0.03  # what is hidden below a table top or thinner than a cell


def test_a_seed_is_a_walk(home: Scene, walk) -> None:
    assert np.array_equal(explore(home, CAMERA, RADIUS_M).poses, walk.poses)
    other = explore(home, CAMERA, RADIUS_M, seed=1)
    assert other.poses.shape != walk.poses.shape or not np.allclose(other.poses, walk.poses)
    assert other.coverage >= 0.95


def test_what_cannot_be_seen_stops_the_robot_until_it_knows(home: Scene, walk, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pillar that no depth shows, where the robot would drive: it is bumped into, remembered, and driven around."""
    away_m = np.linalg.norm(walk.track[:, :2] - home.start_xy, axis=1)
    pillar = walk.track[np.argmax(away_m > 0.7), :2]
    free = Plan.free
    monkeypatch.setattr(Plan, "free", lambda plan, xy: free(plan, xy) and math.dist(xy, pillar) > 0.35)
    bumped = explore(home, CAMERA, RADIUS_M)
    assert 1 <= bumped.bumps <= 12
    assert bumped.coverage >= 0.95
    assert np.linalg.norm(bumped.track[:, :2] - pillar, axis=1).min() > 0.35


def test_a_start_in_furniture_is_refused(home: Scene) -> None:
    inside = Scene(**(vars(home) | {"start_xy": (5.9, 1.1)}))
    with pytest.raises(InputError, match=r"cannot start at \(5.90, 1.10\) in tiny: it is inside"):
        explore(inside, CAMERA)


def test_it_can_be_stopped_and_bounded(home: Scene) -> None:
    asked = iter([False] * 5 + [True])
    with pytest.raises(InputError, match="stopped after 5 frames"):
        explore(home, CAMERA, stop=lambda: next(asked))
    walk = explore(home, CAMERA, max_frames=7)
    assert (len(walk.poses), walk.complete) == (7, False)


def test_a_recording_closed_while_it_is_saved_leaves_nothing(home: Scene, walk, tmp_path: Path) -> None:
    recording = DollhouseRecording(home, CAMERA, walk.poses[:6])

    def progress(done: int, total: int) -> None:
        if done == 3:
            recording.close()

    with pytest.raises(InputError, match="dollhouse tiny was closed"):
        save(recording, tmp_path / "out", progress)
    assert list(tmp_path.iterdir()) == []


def test_frames_agree_with_their_poses(home: Scene) -> None:
    """Depth unprojected through the pose lies in the true box of what the instance image names."""
    recording = DollhouseRecording(home, CAMERA, look((1.0, 1.0), 0.2, 0.4)[None])
    frame, boxes = recording[0], {t.id: t for t in recording.truth or ()}
    points = transform(frame.world_from_camera, backproject(frame.depth_m, frame.camera))
    assert frame.instances is not None
    table = points[frame.instances == 1]
    assert len(table) > 180
    assert (table > np.array(boxes[1].box_min) - 0.02).all()
    assert (table < np.array(boxes[1].box_max) + 0.02).all()


def test_the_fingerprint_covers_scene_poses_camera_and_sensor(home: Scene, walk) -> None:
    def fingerprint(poses=walk.poses, camera=CAMERA, sensor=None, scene=home) -> str:
        return DollhouseRecording(scene, camera, poses, sensor).fingerprint()

    other = load_scene(HOME.replace("[4.5, 0.4]", "[4.5, 0.5]"))
    prints = [
        fingerprint(), fingerprint(walk.poses[:-1]), fingerprint(camera=pinhole(96, 72, 63)),
        fingerprint(sensor=Sensor(1)), fingerprint(sensor=Sensor(2)), fingerprint(scene=other),
    ]  # fmt: skip
    assert len(set(prints)) == len(prints)
    assert fingerprint() == prints[0] == DollhouseRecording(load_scene(HOME), CAMERA, walk.poses).fingerprint()


def test_a_sensor_disturbs_what_is_told_and_says_so(home: Scene, walk) -> None:
    exact, rough = (DollhouseRecording(home, CAMERA, walk.poses, s) for s in (None, Sensor(3)))
    i = len(walk.poses) - 1
    a, b = exact[i], rough[i]
    assert np.array_equal(a.world_from_camera, walk.poses[i])
    assert 0 < np.abs(a.world_from_camera - b.world_from_camera).max() < 0.3
    assert not np.array_equal(a.depth_m, b.depth_m, equal_nan=True)
    assert not np.array_equal(a.rgb, b.rgb)
    assert any("disturbed" in note and "3" in note for note in rough.notes)
    assert any("sensor exact" in note for note in exact.notes)
