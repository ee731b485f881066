from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from layouts import room, write_sevenscenes

from cartier import plugins
from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.io.images import read_depth
from cartier.recordings.common.edges import zoomed
from cartier.types import Camera

KITCHEN = Path(__file__).parents[1] / "data" / "sevenscenes"


def rewrite(name: str, change: Callable[[np.ndarray], None]) -> Callable[[Path], None]:
    def apply(root: Path) -> None:
        matrix = np.loadtxt(root / name)
        change(matrix)
        np.savetxt(root / name, matrix)

    return apply


def put(row: int, column: int, value: float) -> Callable[[np.ndarray], None]:
    return lambda matrix: matrix.__setitem__((row, column), value)


POSE, INTRINSICS = "frame-000020.pose.txt", "camera-intrinsics.txt"
DAMAGE: list[tuple[Callable[[Path], object], str]] = [
    (
        lambda root: (root / INTRINSICS).unlink(),
        r"camera-intrinsics\.txt is missing: write the camera's 3x3 matrix there",
    ),
    (
        lambda root: (root / INTRINSICS).write_text("585 585\n"),
        r"camera-intrinsics\.txt must hold 3 lines of 3 numbers",
    ),
    (rewrite(INTRINSICS, put(0, 1, 3.0)), "skew is not supported"),
    (rewrite(INTRINSICS, put(0, 0, 0.0)), r"camera-intrinsics\.txt: camera focal lengths must be positive"),
    (rewrite(INTRINSICS, put(0, 2, np.nan)), "finite"),
    (rewrite(INTRINSICS, put(0, 0, np.inf)), "finite"),
    (rewrite(INTRINSICS, put(1, 1, 1e-30)), "are no lens's"),
    (rewrite(POSE, put(3, 3, 2.0)), r"frame-000020\.pose\.txt: the last row of a pose must be 0 0 0 1"),
    (rewrite(POSE, lambda m: m.__imul__(np.array([[1.1]] * 3 + [[1]]))), r"frame-000020\.pose\.txt: .*not orthonormal"),
    (rewrite(POSE, lambda m: m.__imul__([[-1]] * 3 + [[1]])), r"frame-000020\.pose\.txt: the rotation mirrors"),
    (lambda root: (root / POSE).write_text("1 0 0 0\n"), r"frame-000020\.pose\.txt must hold 4 lines of 4 numbers"),
    (lambda root: (root / POSE).write_text("1 0 0 here\n" * 4), r"frame-000020\.pose\.txt line 1: could not convert"),
    (lambda root: (root / POSE).write_bytes(b"\xff\xfe" * 40), r"frame-000020\.pose\.txt line 1: not UTF-8 text"),
    (
        lambda root: (root / POSE).unlink(),
        r"4 colour images but 3 \.pose\.txt files: frame-000020\.pose\.txt is missing",
    ),
    (
        lambda root: (root / "frame-000020.depth.png").unlink(),
        r"3 \.depth\.png files: frame-000020\.depth\.png is missing",
    ),
    (lambda root: (root / "frame-000040.color.jpg").unlink(), r"3 colour images but 4 .*frame-000040\.color\.jpg or"),
    (
        lambda root: (root / "frame-000040.color.png").write_bytes(b""),
        r"frame-000040\.color is there as \.jpg and as \.png",
    ),
]


@pytest.mark.parametrize(("damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, damage: Callable[[Path], object], fault: str) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "a")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"up": (0, 0, 0)}, "up must be three finite numbers"),
        ({"up": (0, 1)}, "up must be three finite numbers"),
        ({"up": "z"}, "up must be three finite numbers"),
        ({"floor_m": float("nan")}, "floor_m must be a finite height"),
        ({"floor_m": "low"}, "floor_m must be a finite height"),
    ],
)
def test_a_senseless_override_is_refused(tmp_path: Path, options: dict[str, object], fault: str) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    with pytest.raises(InputError, match=fault):
        plugins.open_recording(tmp_path / "a", **options)


def test_a_folder_of_something_else_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"")
    with pytest.raises(InputError, match="is no recording that cartier knows"):
        plugins.open_recording(tmp_path)
    with pytest.raises(InputError, match=r"holds no frame-000000\.color"):
        plugins.open_recording(tmp_path, format="sevenscenes")


def test_the_world_comes_out_level_and_the_overrides_are_obeyed(tmp_path: Path) -> None:
    tilted = np.eye(4)
    tilted[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # the source's -y is our z
    tilted[:3, 3] = (5, -7, 2)
    write_sevenscenes(room(), tmp_path / "a", source_from_world=tilted)
    estimated = plugins.open_recording(tmp_path / "a")
    given = plugins.open_recording(tmp_path / "a", up=(0, -2, 0), floor_m=7.0)
    raised = plugins.open_recording(tmp_path / "a", up=(0, -2, 0), floor_m=6.0)
    assert [note.split(" ")[1] for note in estimated.notes[1:3]] == ["estimated", "estimated"]
    assert [note.split(" ")[1] for note in given.notes[1:3]] == ["given", "given"]
    assert len({r.fingerprint() for r in (estimated, given, raised)}) == 3
    for i in range(len(given)):
        heights = [r[i].world_from_camera[2, 3] for r in (estimated, given, raised)]
        assert np.abs(np.subtract(heights, (1.5, 1.5, 2.5))).max() < 0.01
        assert abs(heights[1] - 1.5) < 1e-9


def test_a_rotation_that_is_slightly_off_is_mended(tmp_path: Path) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    rewrite(POSE, lambda m: m.__imul__(np.array([[1.002]] * 3 + [[1]])))(tmp_path / "a")
    rotation = plugins.open_recording(tmp_path / "a")[1].world_from_camera[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12


def test_frames_are_in_the_order_of_their_numbers_and_timed_by_them(tmp_path: Path) -> None:
    write_sevenscenes(room(), tmp_path / "a", colour="png")
    times = [frame.time_s for frame in plugins.open_recording(tmp_path / "a")]
    assert times == [0, 20 / 30, 40 / 30, 60 / 30]


def test_floor_table_and_counter_come_out_level() -> None:
    """A noisy kitchen whose world hangs on the first camera: its table is 0.75 m high, its counters are 0.90 m."""
    recording = plugins.open_recording(KITCHEN)
    heights = []
    for i in range(len(recording)):
        frame = recording[i]
        assert frame.depth_m is not None
        points = transform(frame.world_from_camera, backproject(frame.depth_m, frame.camera, 2).astype(np.float64))
        normals = np.cross(np.diff(points, axis=0)[:, :-1], np.diff(points, axis=1)[:-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.abs(normals[..., 2]) / np.linalg.norm(normals, axis=-1) > np.cos(np.radians(20))
        heights.append(points[:-1, :-1][level][:, 2])
    height = np.concatenate(heights)
    for true, spread in ((0.0, 0.02), (0.75, 0.025), (0.90, 0.03)):
        layer = height[np.abs(height - true) < 0.07]
        assert len(layer) > 100
        assert abs(np.median(layer) - true) < 0.015
        assert layer.std() < spread


def test_ten_published_frames_are_read_as_they_are() -> None:
    recording = plugins.open_recording(KITCHEN)
    assert len(recording) == 10 and [round(recording[i].time_s * 30) for i in (0, 1, 9)] == [0, 120, 1080]
    frame = recording[3]
    assert frame.rgb.shape == (120, 160, 3) and frame.rgb.std() > 20
    assert frame.depth_m is not None and 0.35 < np.nanmin(frame.depth_m) < np.nanmax(frame.depth_m) < 6.1
    assert 0.02 < np.isnan(frame.depth_m).mean() < 0.5  # 65535 is no reading
    assert recording.camera.fx == pytest.approx(99.857, abs=0.01)  # the colour camera's lens: depth is moved onto it
    assert "depth zoomed by 0.91 and moved by (-8, -2) px onto the colour images" in recording.notes[1]


def test_raw_depth_and_its_camera_are_moved_onto_the_colour_images() -> None:
    recording, name = plugins.open_recording(KITCHEN), sorted(KITCHEN.glob("*.depth.png"))[3]
    raw = Camera(160, 120, 109.733, 109.733, 79.5, 59.5)
    moved = zoomed(read_depth(name, raw), 0.91, -8 / 640, -2 / 640)
    depth_m = recording[3].depth_m
    assert depth_m is not None and np.array_equal(depth_m, moved, equal_nan=True)
    assert recording.camera.cx == pytest.approx(77.5)
    assert recording.camera.cy == pytest.approx(59.0)
