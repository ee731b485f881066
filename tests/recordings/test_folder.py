from __future__ import annotations

import json
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from layouts import room, seen, write_sevenscenes

from cartier import plugins
from cartier.errors import InputError
from cartier.recordings import folder
from cartier.recordings.common import poses
from cartier.types import Camera, Frame

number = st.floats(-1, 1)


def test_a_simulators_recording_comes_back(tmp_path: Path) -> None:
    source = room()
    steps: list[tuple[int, int]] = []
    folder.save(source, tmp_path / "a", progress=lambda done, total: steps.append((done, total)))
    back = plugins.open_recording(tmp_path / "a")
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert (back.name, back.camera, list(back.notes)) == (source.name, source.camera, list(source.notes))
    assert back.truth == list(source.truth)
    for i in range(len(source)):
        a, b = source[i], back[i]
        assert a.time_s == b.time_s
        assert np.abs(a.world_from_camera - b.world_from_camera).max() < 1e-14
        assert a.depth_m is not None and b.depth_m is not None
        assert np.abs(a.depth_m - b.depth_m).max() <= 0.00051
        assert np.array_equal(a.instances, b.instances)
        assert np.abs(a.rgb.astype(int) - b.rgb).mean() < 4


def test_depth_and_poses_no_longer_change_once_saved(tmp_path: Path) -> None:
    folder.save(seen(), tmp_path / "a")
    once = plugins.open_recording(tmp_path / "a")
    folder.save(once, tmp_path / "b")
    twice = plugins.open_recording(tmp_path / "b")
    assert once.truth is twice.truth is None
    for i in range(len(once)):
        assert np.array_equal(once[i].depth_m, twice[i].depth_m, equal_nan=True)
        assert np.abs(once[i].world_from_camera - twice[i].world_from_camera).max() < 1e-14


def test_from_sevenscenes_and_back(tmp_path: Path) -> None:
    write_sevenscenes(seen(), tmp_path / "scenes", colour="png")
    scenes = plugins.open_recording(tmp_path / "scenes")
    folder.save(scenes, tmp_path / "ours")
    ours = plugins.open_recording(tmp_path / "ours")
    write_sevenscenes(ours, tmp_path / "again")
    again = plugins.open_recording(tmp_path / "again", up=(0, 0, 1), floor_m=0)
    assert ours.notes == list(scenes.notes)
    for i in range(len(ours)):
        for other in (scenes[i], again[i]):
            assert np.abs(ours[i].world_from_camera - other.world_from_camera).max() < 1e-9
            assert np.array_equal(ours[i].depth_m, other.depth_m, equal_nan=True)


@given(st.tuples(number, number, number, number).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_any_rotation_survives_the_trajectory_file(quaternion: tuple[float, ...]) -> None:
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    rotation = poses.matrices(np.array([[0, 0, 0, *unit]]))[0]
    assert np.abs(rotation[:3, :3] @ rotation[:3, :3].T - np.eye(3)).max() < 1e-14
    again = np.array(poses.trajectory_line(0.1, rotation).split(), dtype=float)
    assert np.abs(poses.matrices(again[None, 1:])[0] - rotation).max() < 1e-14


def test_a_known_quaternion() -> None:
    quarter_about_z = poses.matrices(np.array([[1.0, 2.0, 3.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]]))[0]
    assert np.allclose(quarter_about_z, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_saving_holds_one_frame_at_a_time(tmp_path: Path) -> None:
    alive: weakref.WeakSet[Frame] = weakref.WeakSet()
    counts: list[int] = []

    class Watched(type(room())):  # type: ignore[misc]
        def __getitem__(self, index: int) -> Frame:
            frame: Frame = super().__getitem__(index)
            alive.add(frame)
            return frame

    source = room(frames=8)
    folder.save(Watched(source.poses, source.objects), tmp_path / "a", lambda *_: counts.append(len(alive)))
    assert max(counts) == 1


def test_saving_never_overwrites(tmp_path: Path) -> None:
    folder.save(seen(), tmp_path / "a")
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    with pytest.raises(InputError, match="exists: choose another folder"):
        folder.save(seen(), tmp_path / "a")
    (tmp_path / "file").write_text("precious")
    with pytest.raises(InputError, match="exists: choose another folder"):
        folder.save(seen(), tmp_path / "file")
    assert [p for p in before if p[0].stat().st_mtime_ns != p[1]] == []


def test_a_failed_save_leaves_nothing(tmp_path: Path) -> None:
    class Breaks(type(room())):  # type: ignore[misc]
        def __getitem__(self, index: int) -> Frame:
            if index == 2:
                raise InputError("the sensor fell off")
            frame: Frame = super().__getitem__(index)
            return frame

    source = room()
    with pytest.raises(InputError, match="fell off"):
        folder.save(Breaks(source.poses, source.objects), tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def test_frames_that_differ_in_kind_are_refused(tmp_path: Path) -> None:
    class Patchy(type(room())):  # type: ignore[misc]
        def __getitem__(self, index: int) -> Frame:
            frame: Frame = super().__getitem__(index)
            return replace(frame, depth_m=None) if index == 1 else frame

    source = room()
    with pytest.raises(InputError, match=r"frame 0 has rgb \+ depth \+ instances, but frame 1 rgb \+ instances"):
        folder.save(Patchy(source.poses, source.objects), tmp_path / "a")


def test_an_empty_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no frame"):
        folder.save(replace(room(), poses=[]), tmp_path / "a")


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_head_of_schema_name_and_camera_is_enough(tmp_path: Path, with_depth: bool) -> None:
    """As the README describes it; what truth.json holds is only true where recording.json says so."""
    folder.save(room(with_depth), tmp_path / "a")
    head = json.loads((tmp_path / "a/recording.json").read_text())
    short = {name: head[name] for name in ("schema", "name", "camera")}
    (tmp_path / "a/recording.json").write_text(json.dumps(short))
    found = folder.open(tmp_path / "a")
    assert (found.truth, tuple(found.notes)) == (None, ())
    for i in range(len(found)):
        depth_m, true_m = found[i].depth_m, room(with_depth)[i].depth_m
        assert (depth_m is None) == (true_m is None) == (not with_depth)
        if depth_m is not None and true_m is not None:
            assert np.abs(depth_m - true_m).max() < 0.00051
        assert np.array_equal(found[i].instances, room()[i].instances)
    (tmp_path / "a/recording.json").write_text(json.dumps(short | {"instances": False}))
    assert folder.open(tmp_path / "a")[0].instances is None


def edit(field: str, value: object) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        head = json.loads((root / "recording.json").read_text())
        inner = head["camera"] if field in head["camera"] else head
        inner[field] = value
        (root / "recording.json").write_text(json.dumps(head))

    return change


def line(number: int, text: str) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        lines = (root / "trajectory.txt").read_text().splitlines()
        lines[number - 1] = text
        (root / "trajectory.txt").write_text("\n".join(lines))

    return change


DAMAGE: list[tuple[Callable[[Path], object], str]] = [
    (lambda root: (root / "recording.json").write_text("{,"), r"recording\.json line 1: not valid JSON"),
    (lambda root: (root / "recording.json").write_text("[1]"), r"recording\.json must hold a JSON object"),
    (lambda root: (root / "recording.json").write_bytes(b"\xff\xfe\x00"), "UTF-8"),
    (edit("schema", 2), "has schema 2, this cartier reads 1: upgrade"),
    (edit("name", 5), "field 'name' must be of type str, got '5'"),
    (edit("camera", None), "field 'camera' must be of type dict"),
    (edit("width", True), "field 'width' must be of type int"),
    (edit("width", -4), r"recording\.json: camera size must be 1 to 32768 px"),
    (edit("fx", float("nan")), "field 'fx' must be a finite number"),
    (edit("fx", "525"), "field 'fx' must be a finite number"),
    (edit("fy", -525), r"recording\.json: camera focal lengths must be positive"),
    (
        edit("fx", 1e-30),
        r"recording\.json: camera focal lengths fx=1e-30, fy=120 are no lens's for images of 160x120 px",
    ),
    (edit("fy", 1e30), r"recording\.json: camera focal lengths fx=120, fy=1e\+30 are no lens's"),
    (edit("cy", -1e30), r"recording\.json: the camera's principal point cx=79.5, cy=-1e\+30 is nowhere near"),
    (edit("schema", 10**4000), "has schema 10000+…, this cartier reads 1"),
    (edit("cx", 10**400), "field 'cx' must be a finite number"),
    (edit("notes", None), "field 'notes' must be of type list"),
    (edit("depth", "yes"), "field 'depth' must be of type bool"),
    (edit("notes", [1]), "field 'notes' must be of type str"),
    (edit("notes", ["a\nb"]), "field 'notes' must be one line of 1000 characters at most"),
    (edit("name", "x" * 1001), "field 'name' must be one line"),
    (edit("name", "\x1b[2J"), "field 'name' must be one line"),
    (lambda root: (root / "trajectory.txt").unlink(), r"trajectory\.txt is missing"),
    (lambda root: (root / "trajectory.txt").write_text("# nothing\n"), "holds no pose"),
    (line(3, "1 2 3 4"), r"trajectory\.txt line 3: .* 8 numbers, got 4"),
    (line(3, "0 0 0 x 0 0 0 1"), r"trajectory\.txt line 3: could not convert"),
    (line(3, "0 0 0 0 0 0 0 2"), r"trajectory\.txt line 3: the quaternion's length must be 1, got 2"),
    (line(5, ""), r"rgb holds 4 images but trajectory\.txt holds 3 poses: 000003\.jpg has no pose"),
    (lambda root: (root / "depth/000002.png").unlink(), r"depth holds 3 images .* 4 poses: 000002\.png is missing"),
    (lambda root: [p.unlink() for p in (root / "depth").iterdir()], r"depth holds 0 images"),
    (lambda root: (root / "truth.json").unlink(), r"truth\.json is missing"),
    (lambda root: (root / "truth.json").write_text('{"objects": [{"id": "1"}]}'), "field 'id' must be of type int"),
    (
        lambda root: (root / "truth.json").write_text(
            '{"objects": [{"id": 1, "label": "cup", "box_min": [1, 2], "box_max": [1, 2, 3]}]}'
        ),
        "field 'box_min' must be 3 numbers, got 2",
    ),
]


@pytest.mark.parametrize(("damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, damage: Callable[[Path], object], fault: str) -> None:
    folder.save(room(), tmp_path / "a")
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "a")
    assert "\n" not in str(caught.value)


def test_an_image_of_another_size_is_named(tmp_path: Path) -> None:
    folder.save(room(), tmp_path / "a")
    edit("width", 200)(tmp_path / "a")
    with pytest.raises(InputError, match=r"000001\.jpg is 160x120 px, but the camera's images are 200x120"):
        plugins.open_recording(tmp_path / "a")[1]


def test_a_pose_or_depth_light_years_away_is_refused(tmp_path: Path) -> None:
    folder.save(room(), tmp_path / "a")
    line(3, "0 1e30 0 0 0 0 0 1")(tmp_path / "a")
    recording = plugins.open_recording(tmp_path / "a")
    with pytest.raises(InputError, match=r"frame 1: the pose is 1e\+30 m from the origin, .* are the units metres\?"):
        recording[1]
    view = recording[0]
    assert view.depth_m is not None
    for far in (1e30, -1e30):
        with pytest.raises(InputError, match=r"frame 0: its depth reaches beyond 100000 m, .* are the units metres\?"):
            replace(view, depth_m=np.where(view.depth_m > 1, np.float32(far), np.float32(np.nan)))
        few = view.depth_m.copy()
        few[:3] = far
        assert np.isnan(replace(view, depth_m=few).depth_m[:3]).all(), "some readings that are none are left out"
    beyond = replace(view, depth_m=np.full_like(view.depth_m, np.inf)).depth_m
    assert beyond is not None and np.isnan(beyond).all(), "out of range (REP-117)"


def test_hidden_files_do_no_harm(tmp_path: Path) -> None:
    folder.save(room(), tmp_path / "a")
    (tmp_path / "a/rgb/._000000.jpg").write_bytes(b"what a file manager leaves")
    assert len(plugins.open_recording(tmp_path / "a")) == 4


def test_numbers_of_a_foreign_kind_are_written(tmp_path: Path) -> None:
    source = replace(room(), camera=Camera(np.int64(160), np.int64(120), np.float32(120), 120, 79.5, 59.5))  # type: ignore[arg-type]
    folder.save(source, tmp_path / "a")
    assert plugins.open_recording(tmp_path / "a").camera == room().camera
