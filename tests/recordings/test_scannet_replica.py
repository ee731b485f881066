from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exports import save_depth, write_replica, write_scannet
from layouts import room

from cartier import plugins
from cartier.errors import InputError
from cartier.types import Camera
from cartier_bench.datasets import scannet
from synthetic import render

LEVEL = {"up": (0, 0, 1), "floor_m": 0}
WRITERS = {"scannet": write_scannet, "replica": write_replica}


@pytest.mark.parametrize(("name", "error_m"), [("scannet", 0.00051), ("replica", 0.8e-4)])
def test_poses_and_depth_come_back(tmp_path: Path, name: str, error_m: float) -> None:
    WRITERS[name](room(), tmp_path / "a")
    found = plugins.open_recording(tmp_path / "a", **LEVEL)
    assert found.camera == room().camera
    assert [frame.time_s for frame in found] == [i * (10 if name == "scannet" else 1) / 30 for i in range(4)]
    for i, frame in enumerate(found):
        assert frame.depth_m is not None
        assert np.abs(frame.depth_m - room()[i].depth_m).max() < error_m
        assert np.abs(frame.world_from_camera - room().poses[i]).max() < 1e-9


def test_scannets_depth_has_a_lens_of_its_own(tmp_path: Path) -> None:
    write_scannet(room(), tmp_path / "a")
    lens = Camera(100, 80, 70.0, 72.0, 50.0, 39.0)
    matrix = [[lens.fx, 0, lens.cx, 0], [0, lens.fy, lens.cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.savetxt(tmp_path / "a/intrinsic/intrinsic_depth.txt", matrix)
    for i, pose in enumerate(room().poses):
        save_depth(tmp_path / f"a/depth/{i * 10}.png", render(pose, lens, room().objects)[0])
    for i, frame in enumerate(plugins.open_recording(tmp_path / "a", **LEVEL)):
        assert frame.depth_m is not None
        seen = np.isfinite(frame.depth_m)
        off_m = np.abs(frame.depth_m - room()[i].depth_m)[seen]
        assert seen.mean() > 0.8
        assert np.median(off_m) < 0.01 and (off_m < 0.05).mean() > 0.95


def test_frames_that_lost_track_are_left_out_and_counted(tmp_path: Path) -> None:
    write_scannet(room(), tmp_path / "a")
    (tmp_path / "a/pose/20.txt").write_text("-inf -inf -inf -inf\n" * 4)
    found = plugins.open_recording(tmp_path / "a", **LEVEL)
    assert found.notes[0] == "1 images left out: they have no pose (tracking was lost)"
    assert [frame.time_s * 30 for frame in found] == pytest.approx([0, 10, 30])


def test_replicas_camera_may_lie_above_the_scene(tmp_path: Path) -> None:
    write_replica(room(), tmp_path / "room0")
    before = plugins.open_recording(tmp_path / "room0").fingerprint()
    (tmp_path / "room0/cam_params.json").rename(tmp_path / "cam_params.json")
    found = plugins.open_recording(tmp_path / "room0")
    assert found.camera == room().camera
    assert found.fingerprint() != before  # the file is no part of the scene, so its numbers are hashed instead
    head = json.loads((tmp_path / "cam_params.json").read_text())
    head["camera"]["scale"] = 1000
    (tmp_path / "cam_params.json").write_text(json.dumps(head))
    assert plugins.open_recording(tmp_path / "room0").fingerprint() != found.fingerprint()


def text(name: str, content: str) -> Callable[[Path], object]:
    return lambda root: (root / name).write_text(content)


DAMAGE: list[tuple[str, Callable[[Path], object], str]] = [
    ("scannet", text("intrinsic/intrinsic_color.txt", "1 2 3"), "must hold 4 lines of 4 numbers"),
    ("scannet", text("intrinsic/intrinsic_color.txt", "0 0 0 0\n" * 4), "focal lengths must be positive"),
    ("scannet", lambda root: (root / "pose/10.txt").unlink(), r"10\.txt is missing"),
    ("scannet", text("pose/10.txt", "1 0 0 0\n" * 4), r"10\.txt: the last row of a pose must be"),
    ("scannet", lambda root: (root / "depth/10.png").unlink(), r"10\.png is missing"),
    ("scannet", lambda root: [p.unlink() for p in (root / "color").iterdir()], r"color holds no image 0\.jpg"),
    (
        "scannet",
        lambda root: [p.write_text("-inf -inf -inf -inf\n" * 4) for p in (root / "pose").iterdir()],
        "no image can be used: 4 images left out",
    ),
    ("replica", lambda root: (root / "cam_params.json").unlink(), r"cam_params\.json is missing: write"),
    ("replica", text("cam_params.json", "[]"), "'camera' lacks w, h, fx"),
    ("replica", text("cam_params.json", '{"camera": {"w": 1}}'), "'camera' lacks h, fx, fy, cx, cy, scale"),
    ("replica", text("traj.txt", "1 2 3\n"), "line 1: a pose is 16 numbers, got 3"),
    ("replica", text("traj.txt", ""), r"4 images results/frame… but traj\.txt holds 0 poses"),
    ("replica", lambda root: (root / "results/depth000001.png").unlink(), r"depth000001\.png is missing"),
    ("replica", lambda root: (root / "results/frame000001.jpg").unlink(), "3 images .* 4 poses"),
]


@pytest.mark.parametrize("size", [(144, 108), (200, 149), (96, 72), (240, 180)])
def test_a_scan_resized_in_every_scale_takes_scaled_intrinsics(tmp_path: Path, size: tuple[int, int]) -> None:
    """The sensor's matrices with images of 0.8 to 1.5 times the sensor's size, here a tenth of ScanNet's."""
    sizes = {scannet.COLOUR_MATRIX: (130, 97), scannet.DEPTH_MATRIX: (160, 120)}
    sensor, lidar = Camera(130, 97, 117.0, 117.2, 64.8, 48.4), Camera(160, 120, 140.0, 140.0, 79.6, 59.4)
    source = replace(room(), camera=sensor.scaled(*size))
    write_scannet(source, tmp_path / "a")
    for kind, c in (("color", sensor), ("depth", lidar)):
        matrix = [[c.fx, 0, c.cx, 0], [0, c.fy, c.cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        np.savetxt(tmp_path / f"a/intrinsic/intrinsic_{kind}.txt", matrix)
    for i, pose in enumerate(source.poses):
        save_depth(tmp_path / f"a/depth/{i * 10}.png", render(pose, lidar.scaled(80, 60), source.objects)[0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scannet, "SIZES", sizes)
        found = plugins.open_recording(tmp_path / "a", **LEVEL)
    assert found.camera == sensor.scaled(*size)
    name = scannet.COLOUR_MATRIX
    assert f"{name} is for images of 130x97 px; it was scaled to {size[0]}x{size[1]}" in found.notes
    assert f"{scannet.DEPTH_MATRIX} is for images of 160x120 px; it was scaled to 80x60" in found.notes
    depth_m, true_m = found[0].depth_m, source[0].depth_m
    assert depth_m is not None and true_m is not None
    assert np.nanmedian(np.abs(depth_m - true_m)) < 0.02


@pytest.mark.parametrize(("name", "damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, name: str, damage: Callable[[Path], object], fault: str) -> None:
    WRITERS[name](room(), tmp_path / "a")
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "a", format=name)
    assert "\n" not in str(caught.value)


def test_resized_colour_takes_the_intrinsics_of_its_size(tmp_path: Path) -> None:
    """As the 25,000-frame subset has it: colour of 640x480 with the sensor's matrix for 1296x968."""
    write_scannet(room(), tmp_path / "a")
    sensor = Camera(1296, 968, 1170.19, 1170.19, 647.75, 483.75)
    matrix = [[sensor.fx, 0, sensor.cx, 0], [0, sensor.fy, sensor.cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.savetxt(tmp_path / "a/intrinsic/intrinsic_color.txt", matrix)
    found = plugins.open_recording(tmp_path / "a", **LEVEL)
    assert found.camera == sensor.scaled(160, 120)
    assert "intrinsic/intrinsic_color.txt is for images of 1296x968 px; it was scaled to 160x120" in found.notes
    for cx, cy in ((300.0, 59.5), (79.5, 10.0)):
        matrix[0][2], matrix[1][2] = cx, cy
        np.savetxt(tmp_path / "a/intrinsic/intrinsic_color.txt", matrix)
        with pytest.raises(InputError, match=rf"the principal point {cx:g}, {cy:g} is that of images of some"):
            plugins.open_recording(tmp_path / "a", **LEVEL)
