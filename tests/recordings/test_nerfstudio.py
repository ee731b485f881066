from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exports import OPTICAL_FROM_GL, save_colour, save_depth, write_nerfstudio
from layouts import room
from PIL import Image

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError, MissingExtra
from cartier.types import Camera

LEVEL = {"up": (0, 0, 1), "floor_m": 0}


def opened(root: Path, **options: object) -> Recording:
    return plugins.open_recording(root, format="nerfstudio", **options)


def edit(root: Path, change: Callable[[dict[str, Any]], object]) -> None:
    head = json.loads((root / "transforms.json").read_text())
    change(head)
    (root / "transforms.json").write_text(json.dumps(head))


def test_poses_intrinsics_and_depth_come_back(tmp_path: Path) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    found = opened(tmp_path / "a", **LEVEL)
    assert found.camera == room().camera
    for i, frame in enumerate(found):
        assert frame.depth_m is not None
        assert np.abs(frame.world_from_camera - room()[i].world_from_camera).max() < 1e-12
        assert np.abs(frame.depth_m - room()[i].depth_m).max() < 0.00051


def test_each_frames_own_intrinsics_are_brought_to_one_camera(tmp_path: Path) -> None:
    """As phones with autofocus write them: each image is rendered with a focal length and centre of its own."""
    source = room()
    root = tmp_path / "a"
    write_nerfstudio(source, root)
    cameras = [replace(source.camera, fx=120 + 3 * i, fy=120 + 2 * i, cx=79.5 + i, cy=59.5 - i) for i in range(4)]
    for i, camera in enumerate(cameras):
        frame = replace(source, camera=camera)[i]
        save_colour(root / f"images/frame_{i + 1:05d}.png", frame.rgb)
        assert frame.depth_m is not None
        save_depth(root / f"depth/frame_{i + 1:05d}.png", frame.depth_m)

    def own(head: dict[str, Any]) -> None:
        for frame, c in zip(head["frames"], cameras, strict=True):
            frame |= {"fl_x": c.fx, "fl_y": c.fy, "cx": c.cx + 0.5, "cy": c.cy + 0.5}

    edit(root, own)
    found = opened(root, **LEVEL)
    assert "the images' own intrinsics differ; all were resampled to those of the first" in found.notes
    for i, frame in enumerate(found):
        assert frame.camera == source.camera
        assert frame.depth_m is not None
        inner = (slice(8, -8), slice(8, -8))
        off_m = np.abs(frame.depth_m - source[i].depth_m)[inner]
        assert np.median(off_m) < 0.01 and (off_m < 0.05).mean() > 0.95
        assert (frame.rgb == source[i].rgb)[inner].mean() > 0.95


def test_frames_are_in_the_order_of_their_names_and_missing_images_are_counted(tmp_path: Path) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    edit(tmp_path / "a", lambda head: head["frames"].reverse())
    (tmp_path / "a/images/frame_00002.png").unlink()
    found = opened(tmp_path / "a", **LEVEL)
    assert "1 frames left out: their images are missing" in found.notes
    for frame, i in zip(found, (0, 2, 3), strict=True):
        assert np.abs(frame.world_from_camera - room()[i].world_from_camera).max() < 1e-12


ELSEWHERE = {
    "backslashes": lambda name, root: name.replace("/", "\\"),
    "windows": lambda name, root: "C:\\Users\\me\\scan\\" + name.replace("/", "\\"),
    "share": lambda name, root: "\\\\server\\scan\\" + name.replace("/", "\\"),
    "here": lambda name, root: str(root / name),
    "linux": lambda name, root: f"/home/me/scan/{name}",
    "no suffix": lambda name, root: f"D:/scan/{name}".removesuffix(".png"),
}


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_names_written_elsewhere(tmp_path: Path, kind: str) -> None:
    root = tmp_path / "a"
    write_nerfstudio(room(), root)

    def elsewhere(head: dict[str, Any]) -> None:
        for frame in head["frames"]:
            frame["file_path"] = ELSEWHERE[kind](frame["file_path"], root)
            frame["depth_file_path"] = ELSEWHERE[kind if kind != "no suffix" else "linux"](
                frame["depth_file_path"], root
            )

    edit(root, elsewhere)
    (root / "images/frame_00002.png").unlink()
    found = opened(root, **LEVEL)
    assert len(found) == 3 and found[0].depth_m is not None
    assert "1 frames left out: their images are missing" in found.notes
    noted = [note for note in found.notes if note.startswith("transforms.json has absolute paths, such as")]
    assert bool(noted) == (kind != "backslashes")


def test_instant_ngps_habits(tmp_path: Path) -> None:
    """camera_angle_x in place of a focal length, names without a suffix, no sizes."""
    source = room(with_depth=False)
    root = tmp_path / "a"
    root.mkdir()
    frames = []
    for i in range(len(source)):
        save_colour(root / "images" / f"{i}.png", source[i].rgb)
        pose = source[i].world_from_camera @ OPTICAL_FROM_GL
        frames.append({"file_path": f"./images/{i}", "transform_matrix": pose.tolist()})
    (root / "transforms.json").write_text(json.dumps({"camera_angle_x": 2 * np.arctan(80 / 120), "frames": frames}))
    camera = opened(root).camera
    assert (camera.width, camera.height, camera.cx, camera.cy) == (160, 120, 79.5, 59.5)
    assert camera.fx == pytest.approx(120) and camera.fy == pytest.approx(120)


def test_large_images_are_reduced_and_said(tmp_path: Path) -> None:
    source = replace(room(), camera=Camera(1601, 1203, 1200.0, 1200.0, 800.0, 601.0))
    source = replace(source, poses=source.poses[:1])
    write_nerfstudio(source, tmp_path / "a")
    found = opened(tmp_path / "a", **LEVEL)
    assert found.camera == Camera(800, 601, 600.0, 600.0, 399.75, 300.25)
    assert "images of 1601x1203 px reduced by 2" in found.notes
    expected = replace(source, camera=found.camera)[0]
    depth = found[0].depth_m
    assert depth is not None and (np.abs(depth - expected.depth_m) < 0.02).mean() > 0.98


def test_a_fisheye_is_straightened(tmp_path: Path) -> None:
    source = room(with_depth=False, frames=1)
    write_nerfstudio(source, tmp_path / "a")
    c = source.camera
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    x, y = (u - c.cx) / c.fx, (v - c.cy) / c.fy
    theta = np.hypot(x, y)  # an ideal fisheye: the radius is the angle
    scale = np.tan(theta) / np.maximum(theta, 1e-9)
    columns, rows = np.rint(x * scale * c.fx + c.cx).astype(int), np.rint(y * scale * c.fy + c.cy).astype(int)
    inside = (columns >= 0) & (columns < c.width) & (rows >= 0) & (rows < c.height)
    bent = np.zeros((c.height, c.width, 3), np.uint8)
    bent[inside] = source[0].rgb[rows[inside], columns[inside]]
    save_colour(tmp_path / "a/images/frame_00001.png", bent)
    edit(tmp_path / "a", lambda head: head.update(camera_model="OPENCV_FISHEYE", k3=0.0, k4=0.0))
    found = opened(tmp_path / "a")[0].rgb
    assert (found == source[0].rgb)[15:-15, 15:-15].mean() > 0.97


def test_depth_as_instant_ngp_names_it(tmp_path: Path) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    for path in (tmp_path / "a/depth").iterdir():
        Image.fromarray((np.asarray(Image.open(path)).astype(float) * 2).astype(np.uint16)).save(path)

    def renamed(head: dict[str, Any]) -> None:
        head["integer_depth_scale"] = 0.0005
        for frame in head["frames"]:
            frame["depth_path"] = frame.pop("depth_file_path")

    edit(tmp_path / "a", renamed)
    found = opened(tmp_path / "a", **LEVEL)[1].depth_m
    assert found is not None and np.abs(found - room()[1].depth_m).max() < 0.00051
    edit(tmp_path / "a", lambda head: head.pop("integer_depth_scale"))
    assert (
        "transforms.json does not say integer_depth_scale: depth is taken in units of 0.001 m"
        in opened(tmp_path / "a").notes
    )


def as_npy(root: Path, unit_m: float, kind: type) -> None:
    for i in range(len(room())):
        path = root / f"depth/frame_{i + 1:05d}.npy"
        np.save(path, (room()[i].depth_m / unit_m).astype(kind)[..., None])
        path.with_suffix(".png").unlink(missing_ok=True)

    def renamed(head: dict[str, Any]) -> None:
        for frame in head["frames"]:
            frame["depth_file_path"] = frame["depth_file_path"].replace(".png", ".npy")

    edit(root, renamed)


@pytest.mark.parametrize(("unit_m", "kind"), [(0.001, np.uint16), (0.001, np.float32), (1.0, np.float64)])
def test_depth_as_an_array(tmp_path: Path, unit_m: float, kind: type) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    as_npy(tmp_path / "a", unit_m, kind)
    if unit_m == 1:
        with pytest.raises(InputError, match=r'npy: its depth is 0\.00\d+ m .* write "depth_unit_scale_factor": 1\.0'):
            opened(tmp_path / "a", **LEVEL)[0]
        edit(tmp_path / "a", lambda head: head.update(depth_unit_scale_factor=1.0))
    found = opened(tmp_path / "a", **LEVEL)[2].depth_m
    assert found is not None and np.abs(found - room()[2].depth_m).max() < 0.0011


def test_depth_as_exr(tmp_path: Path) -> None:
    exr = pytest.importorskip("OpenEXR", reason="EXR depth needs OpenEXR")
    write_nerfstudio(room(), tmp_path / "a")

    def renamed(head: dict[str, Any]) -> None:
        head["depth_unit_scale_factor"] = 1.0
        for i, frame in enumerate(head["frames"]):
            frame["depth_file_path"] = f"depth/{i}.exr"
            exr.File({}, {"Y": np.nan_to_num(room()[i].depth_m)}).write(str(tmp_path / f"a/depth/{i}.exr"))

    edit(tmp_path / "a", renamed)
    found = opened(tmp_path / "a", **LEVEL)[2].depth_m
    assert found is not None and np.array_equal(found, room()[2].depth_m)


def test_exr_depth_without_its_package_is_one_line_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    edit(tmp_path / "a", lambda head: [frame.update(depth_file_path="depth/a.exr") for frame in head["frames"]])
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(MissingExtra, match="'nerfstudio' needs the package 'OpenEXR': pip install 'OpenEXR'"):
        opened(tmp_path / "a", **LEVEL)


def test_an_array_that_is_no_depth(tmp_path: Path) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    as_npy(tmp_path / "a", 0.001, np.uint16)
    for bad, fault in ((np.zeros(9), "must hold an image of depths"), (np.array([object()]), "is damaged")):
        np.save(tmp_path / "a/depth/frame_00001.npy", bad, allow_pickle=True)
        with pytest.raises(InputError, match=fault):
            opened(tmp_path / "a", **LEVEL)[0]


DAMAGE: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda head: head.pop("frames"), "must hold an object with a list 'frames'"),
    (lambda head: head.update(frames=[]), "names 0 frames, but none of their images is there"),
    (lambda head: head.pop("fl_x"), "no intrinsics, neither fl_x nor camera_angle_x"),
    (lambda head: head.update(fl_x="wide"), "fl_x must be a number"),
    (lambda head: head.update(fl_x=float("nan")), "fl_x: NaN"),
    (lambda head: head.update(fl_y=-1), "focal lengths must be positive"),
    (
        lambda head: head.update(depth_unit_scale_factor=0),
        "depth_unit_scale_factor must be from a millionth to 1 metre",
    ),
    (lambda head: head.update(depth_unit_scale_factor=1e20), "must be from a millionth to 1 metre, got 1e"),
    (lambda head: head.update(fl_x=1e-30), "focal lengths fx=1e-30, fy=120 are no lens's for images of 160x120 px"),
    (lambda head: head.update(w=10**400, h=120), r"w and h must be 1 to 32768 px, got \(1000"),
    (
        lambda head: [head.pop("fl_x"), head.update(camera_angle_x=0)],
        "camera_angle_x must be above 0 and below pi, got 0",
    ),
    (
        lambda head: head.update(camera_model="EQUIRECTANGULAR"),
        "camera_model 'EQUIRECTANGULAR' is not read; .* OPENCV_FISHEYE: reproject its panoramas to perspective images",
    ),
    (
        lambda head: head.update(camera_model="FISHEYE624"),
        "camera_model 'FISHEYE624' is not read; cartier reads OPENCV,",
    ),
    (lambda head: head.update(camera_model=7), "camera_model '7' is not read"),
    (lambda head: head.update(cx=161), "the principal point 160.5, 59.5 is that of images of some"),
    (lambda head: head.update(k1=1e9), "plumb_bob distortion needs .* sane numbers"),
    (lambda head: head["frames"][2].update(file_path="x" * 300), "frame 2: 'xxxx+…' is no file name"),
    (lambda head: head["frames"][2].update(file_path="\ud800"), "frame 2: ' ?' is no file name"),
    (lambda head: head["frames"][2].update(depth_file_path=["a"] * 10**5), "frame 2: .*…. is no file name"),
    (
        lambda head: [row.__setitem__(3, 1e29) for row in head["frames"][2]["transform_matrix"][:3]],
        "frame 2: the pose is 1e.29 m from the origin",
    ),
    (lambda head: head["frames"][2].pop("file_path"), "frame 2: 'None' is no file name"),
    (lambda head: head["frames"][2].update(file_path="../x.png"), "frame 2: '../x.png' leads out"),
    (lambda head: head["frames"][2].update(depth_file_path="/x.png"), "frame 2: '/x.png' leads out"),
    (lambda head: head["frames"][2].pop("depth_file_path"), "1 of 4 frames have no depth_file_path"),
    (lambda head: head["frames"][2].update(transform_matrix=[1]), "frame 2: transform_matrix must be 4x4"),
    (
        lambda head: head["frames"][2]["transform_matrix"][0].__setitem__(0, 9.0),
        "frame 2: the rotation is not orthonormal",
    ),
]


@pytest.mark.parametrize(("damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, damage: Callable[[dict[str, Any]], object], fault: str) -> None:
    write_nerfstudio(room(), tmp_path / "a")
    edit(tmp_path / "a", damage)
    with pytest.raises(InputError, match=fault) as caught:
        opened(tmp_path / "a")
    assert "\n" not in str(caught.value)


def test_without_depth_a_scale_that_cannot_be_metres_is_guessed(tmp_path: Path) -> None:
    write_nerfstudio(room(with_depth=False), tmp_path / "a")
    metric = plugins.open_recording(tmp_path / "a")
    assert getattr(metric, "scale_guessed", False) and any("are taken as metres" in note for note in metric.notes)
    for times in (50.0, 4000.0):
        folder = Path(shutil.copytree(tmp_path / "a", tmp_path / f"{times:g}"))
        told = json.loads((folder / "transforms.json").read_text())
        for frame in told["frames"]:
            for row in frame["transform_matrix"][:3]:
                row[3] *= times
        (folder / "transforms.json").write_text(json.dumps(told))
        found = plugins.open_recording(folder)
        away = np.array([found[i].world_from_camera[:3, 3] for i in range(len(found))])
        assert np.median(np.linalg.norm(away - np.median(away, axis=0), axis=1)) == pytest.approx(0.6, rel=0.05)
        assert any("0.6 m from their middle" in note for note in found.notes)
