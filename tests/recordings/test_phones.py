"""Stray Scanner, Record3D and ARCore: LiDAR depth smaller than colour, confidence, y-up worlds, phones held upright."""

from __future__ import annotations

import json
import shutil
import stat
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exports import (
    save_colour,
    save_depth,
    small_depth,
    write_arcore,
    write_record3d,
    write_record3d_export,
    write_rtsm,
    write_stray,
    write_video,
)
from layouts import room
from PIL import Image

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError, MissingExtra
from cartier.types import Camera
from synthetic import RoomRecording

Write = Callable[[RoomRecording, Path], None]
WRITERS: dict[str, Write] = {
    "stray": write_stray,
    "record3d": write_record3d,
    "record3d-export": write_record3d_export,
    "arcore": write_arcore,
    "rtsm": write_rtsm,
}
phones = pytest.mark.parametrize("name", WRITERS)


def opened(root: Path, **options: Any) -> Recording:
    return plugins.open_recording(root, **options)


@phones
def test_poses_and_small_depth_come_back(tmp_path: Path, name: str) -> None:
    WRITERS[name](room(), tmp_path / "a")
    found = opened(tmp_path / "a", floor_m=0)
    assert found.camera == room().camera
    assert "up is (0.0, 1.0, 0.0) in this format's world; override with --up X,Y,Z" in found.notes
    for i, frame in enumerate(found):
        assert np.abs(frame.world_from_camera - room()[i].world_from_camera).max() < 1e-9
        small = small_depth(room(), i)
        assert frame.depth_m is not None
        assert np.abs(frame.depth_m - np.repeat(np.repeat(small, 2, 0), 2, 1)).max() < 0.00051


def upright(source: RoomRecording) -> RoomRecording:
    """The room by a phone held upright: its sensor's image lies on its side, as the app stores it."""
    roll = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return replace(source, poses=[pose @ roll for pose in source.poses])


@phones
def test_a_phone_held_upright_gives_upright_images(tmp_path: Path, name: str) -> None:
    source = room()
    WRITERS[name](upright(source), tmp_path / "a")
    found = opened(tmp_path / "a", floor_m=0)
    assert (found.camera.width, found.camera.height) == (120, 160)
    assert any(note.startswith("images turned by") for note in found.notes)
    turned = replace(source, camera=found.camera)
    for i, frame in enumerate(found):
        assert frame.world_from_camera[2, 1] < -0.8, "down in the image is down in the world"
        assert np.abs(frame.world_from_camera - source.poses[i]).max() < 1e-9
        expected = turned[i]
        assert frame.depth_m is not None
        assert np.median(np.abs(frame.depth_m - expected.depth_m)) < 0.01
        assert np.abs(frame.rgb.astype(int) - expected.rgb).mean() < 8


@pytest.mark.parametrize(("name", "levels"), [("stray", (0, 1, 2)), ("arcore", (0, 76, 255))])
def test_depth_of_little_confidence_is_dropped(tmp_path: Path, name: str, levels: tuple[int, ...]) -> None:
    WRITERS[name](room(), tmp_path / "a")
    sure = np.full((60, 80), levels[2], np.uint8)
    sure[:20], sure[20:40] = levels[0], levels[1]
    for path in (tmp_path / "a/confidence").iterdir():
        Image.fromarray(sure).save(path)

    def known(**options: int) -> list[bool]:
        depth = opened(tmp_path / "a", floor_m=0, **options)[0].depth_m
        assert depth is not None
        return [bool(np.isfinite(depth[rows]).all()) for rows in (slice(0, 40), slice(40, 80), slice(80, 120))]

    assert known() == ([False, True, True] if name == "stray" else [False, False, True])
    assert known(confidence=0) == [True, True, True]
    assert known(confidence=levels[2]) == [False, False, True]


def test_record3ds_confidence(tmp_path: Path) -> None:
    lzfse = pytest.importorskip("liblzfse", reason="a .r3d's depth needs pyliblzfse")
    write_record3d(room(), tmp_path / "a")
    sure = np.full((60, 80), 2, np.uint8)
    sure[:30] = 0
    (tmp_path / "a/rgbd/0.conf").write_bytes(lzfse.compress(sure.tobytes()))
    depth = opened(tmp_path / "a", floor_m=0)[0].depth_m
    assert depth is not None
    assert np.isnan(depth[:60]).all() and np.isfinite(depth[60:]).all()


def test_strays_video_gives_each_frame_in_any_order(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="a video needs PyAV")
    source = room(frames=16)
    write_stray(source, tmp_path / "a")
    shutil.rmtree(tmp_path / "a/rgb")
    greys = [np.full((120, 160, 3), 10 + 15 * i, np.uint8) for i in range(16)]
    write_video(tmp_path / "a/rgb.mp4", greys)
    found = opened(tmp_path / "a", floor_m=0)
    for i in (0, 1, 2, 9, 3, 3, 15, 0, 14):
        assert np.abs(found[i].rgb.astype(int) - greys[i]).max() < 6


def test_without_a_video_decoder_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_stray(room(), tmp_path / "a")
    (tmp_path / "a/rgb").rename(tmp_path / "gone")
    with pytest.raises(InputError, match=r"holds neither rgb\.mp4 nor a folder rgb/ of images"):
        opened(tmp_path / "a")
    (tmp_path / "a/rgb.mp4").write_bytes(b"no video")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtra, match=r"needs the package 'av': pip install .*\[phone\]'"):
        opened(tmp_path / "a")


@pytest.mark.parametrize(
    "content", [b"", b"no video", b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n", b"\0\0\0\x18ftypmp42" * 9]
)
def test_a_video_that_is_none(tmp_path: Path, content: bytes) -> None:
    pytest.importorskip("av", reason="a video needs PyAV")
    write_stray(room(), tmp_path / "a")
    shutil.rmtree(tmp_path / "a/rgb")
    (tmp_path / "a/rgb.mp4").write_bytes(content)
    with pytest.raises(InputError, match=r"rgb\.mp4 (is no readable MP4 video|holds no picture)") as caught:
        opened(tmp_path / "a")
    assert "\n" not in str(caught.value)


def test_a_video_of_a_codec_that_no_phone_writes(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="a video needs PyAV")
    write_stray(room(), tmp_path / "a", video=True)
    with av.open(str(tmp_path / "a/rgb.mp4"), "w") as container:
        stream = container.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((120, 160, 3), np.uint8), format="rgb24")))
        container.mux(stream.encode())
    with pytest.raises(InputError, match=r"no readable MP4 video .160x120 px of mpeg2video; cartier reads h264"):
        opened(tmp_path / "a")


def test_strays_own_intrinsics_of_each_frame(tmp_path: Path) -> None:
    write_stray(room(), tmp_path / "a")
    rows = (tmp_path / "a/odometry.csv").read_text().splitlines()
    rows = [rows[0] + ", fx, fy, cx, cy", *(f"{row}, {120 + i}, 120, 79.5, 59.5" for i, row in enumerate(rows[1:]))]
    (tmp_path / "a/odometry.csv").write_text("\n".join(rows))
    found = opened(tmp_path / "a")
    assert found.camera == Camera(160, 120, 120, 120, 79.5, 59.5)
    assert "the images' own intrinsics differ; all were resampled to those of the first" in found.notes


def test_strays_columns_that_nobody_wants_may_be_empty(tmp_path: Path) -> None:
    """What the app writes since 2026: the distortion's centre, left empty where the phone does not give it."""
    write_stray(room(), tmp_path / "a")
    rows = (tmp_path / "a/odometry.csv").read_text().splitlines()
    new = [
        rows[0] + ", fx, fy, cx, cy, distortion_center_x, distortion_center_y",
        *(f"{row}, 121, 122, 79.5, 59.5, , " for row in rows[1:]),
    ]
    (tmp_path / "a/odometry.csv").write_text("\n".join(new) + "\n")
    assert opened(tmp_path / "a").camera == Camera(160, 120, 121, 122, 79.5, 59.5)
    new[2] = new[2].replace("121, 122, 79.5, 59.5", ", , , ")
    (tmp_path / "a/odometry.csv").write_text("\n".join(new) + "\n")
    assert opened(tmp_path / "a").camera == room().camera, "intrinsics that are not in every row: those of the matrix"
    new[2] = rows[2].replace(rows[2].split(",")[3], " ", 1) + ", , , , , , "
    (tmp_path / "a/odometry.csv").write_text("\n".join(new) + "\n")
    with pytest.raises(InputError, match=r"odometry\.csv line 3: could not convert"):
        opened(tmp_path / "a")


def test_what_lacks_a_part_is_left_out_and_counted(tmp_path: Path) -> None:
    write_stray(room(), tmp_path / "stray")
    (tmp_path / "stray/depth/000001.png").unlink()
    (tmp_path / "stray/rgb/000002.png").unlink()
    assert "2 poses without an image or depth left out" in opened(tmp_path / "stray").notes
    write_arcore(room(), tmp_path / "arcore")
    rows = (tmp_path / "arcore/poses.csv").read_text().splitlines()
    (tmp_path / "arcore/poses.csv").write_text("\n".join(rows[:-1]))
    min((tmp_path / "arcore/depth").iterdir()).unlink()
    found = opened(tmp_path / "arcore", floor_m=0)
    assert found.notes[:2] == ["1 images without a pose left out", "1 images without depth left out"]
    assert np.abs(found[0].world_from_camera - room().poses[1]).max() < 1e-9
    write_record3d(room(with_depth=False), tmp_path / "record3d")
    (tmp_path / "record3d/rgbd/0.jpg").unlink()
    found = opened(tmp_path / "record3d", floor_m=0)
    assert found.notes[0] == "1 poses without an image left out"
    assert np.abs(found[0].world_from_camera - room().poses[1]).max() < 1e-9


def test_a_r3d_file_is_read_as_it_is(tmp_path: Path) -> None:
    write_record3d(room(), tmp_path / "a")
    with zipfile.ZipFile(tmp_path / "scan.r3d", "w") as box:
        for path in sorted((tmp_path / "a").rglob("*")):
            box.write(path, path.relative_to(tmp_path / "a"))
    packed, unpacked = opened(tmp_path / "scan.r3d", floor_m=0), opened(tmp_path / "a", floor_m=0)
    assert packed.name == "scan"
    for i in (2, 0):
        assert np.array_equal(packed[i].rgb, unpacked[i].rgb)
        assert np.array_equal(packed[i].depth_m, unpacked[i].depth_m)
        assert np.array_equal(packed[i].world_from_camera, unpacked[i].world_from_camera)
    assert len(packed.fingerprint()) == 64


def test_intrinsics_for_other_images_than_are_there_are_scaled(tmp_path: Path) -> None:
    write_record3d(room(with_depth=False), tmp_path / "a")
    for path in (tmp_path / "a/rgbd").iterdir():
        Image.open(path).resize((320, 240)).save(path)
    assert opened(tmp_path / "a").camera == room().camera.scaled(320, 240)


def test_without_lzfse_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_record3d(room(), tmp_path / "a")
    monkeypatch.setitem(sys.modules, "liblzfse", None)
    with pytest.raises(MissingExtra, match=r"pip install pyliblzfse .* or share the capture .* as 'EXR"):
        opened(tmp_path / "a")


def head(**changes: object) -> Callable[[Path], object]:
    def apply(root: Path) -> None:
        path = next(p for p in (root / "metadata", root / "intrinsics.json") if p.exists())
        path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))

    return apply


def text(name: str, content: str) -> Callable[[Path], object]:
    return lambda root: (root / name).write_text(content)


@pytest.mark.parametrize(("name", "file"), [("stray", "odometry.csv"), ("arcore", "poses.csv")])
def test_rows_of_too_many_or_too_few_cells_are_left_out_and_counted(tmp_path: Path, name: str, file: str) -> None:
    """A comma too many, and the last line of an app that was stopped while it wrote it."""
    WRITERS[name](room(), tmp_path / "a")
    rows = (tmp_path / "a" / file).read_text().splitlines()
    rows[2], rows[4] = rows[2] + ",", rows[4][: rows[4].index(",") + 3]
    (tmp_path / "a" / file).write_text("\n".join([rows[0], "", *rows[1:]]))
    found = opened(tmp_path / "a", floor_m=0)
    assert len(found) == 2
    columns = len(rows[0].split(","))
    assert f"2 rows of {file} left out: line 4 has {columns + 1} values for {columns} columns" in found.notes
    for frame, i in zip(found, (0, 2), strict=True):
        assert np.abs(frame.world_from_camera - room()[i].world_from_camera).max() < 1e-6


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    import OpenEXR

    OpenEXR.File({}, {name: values.astype(np.float32) for name, values in channels.items()}).write(str(path))


DAMAGE: list[tuple[str, Callable[[Path], object], str]] = [
    ("stray", text("camera_matrix.csv", "1,2\n"), r"camera_matrix\.csv must hold 3 lines of 3 numbers"),
    ("stray", text("camera_matrix.csv", "0,0,1\n0,0,1\n0,0,1"), "focal lengths must be positive"),
    ("stray", text("odometry.csv", ""), r"odometry\.csv: its first line must name the columns timestamp"),
    ("stray", text("odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz, qw\n"), r"odometry\.csv holds no row"),
    ("stray", text("odometry.csv", "timestamp,frame,x,y,z,qx,qy,qz,qw\n1,2\n"),
        "none of its 1 rows fits its first line: line 2 has 2"),
    ("stray", text("odometry.csv", "timestamp,frame,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,0,2\n"),
        "pose 0 has a quaternion"),
    ("stray", text("odometry.csv", "timestamp,frame,x,y,z,qx,qy,qz,qw\n0,9,0,0,0,0,0,0,1\n"), "none of the 1 poses"),
    ("stray", lambda root: save_depth(root / "depth/000000.png", np.ones((60, 60))),
        "60x60 px, which is not the shape"),
    ("stray", lambda root: save_colour(root / "depth/000000.png", room()[0].rgb), "must be a 16-bit grey PNG"),
    ("record3d", text("metadata", "{"), "metadata is not valid JSON"),
    ("record3d", text("metadata", "[]"), "metadata must hold a JSON object"),
    ("record3d", head(poses=[]), "'poses' must be a list of lists of 7 numbers"),
    ("record3d", head(poses=[[0] * 6]), "'poses' must be a list of lists of 7 numbers"),
    ("record3d", head(poses=[["x"] * 7]), "poses 0: could not convert"),
    ("record3d", head(K=[1]), "'K' must be a list of lists of 9 numbers"),
    ("record3d", head(dw=10**9), "'dw' must be a size in pixels"),
    ("record3d", head(dw=81), r"0\.depth is damaged \(it should unpack to 19440 bytes"),
    ("record3d", head(perFrameIntrinsicCoeffs=[[1, 1, 1, 1]]), "intrinsics for 1 frames, but images up to 3"),
    ("record3d", head(fps=0, frameTimestamps=None), "fps must be positive"),
    ("record3d", lambda root: (root / "rgbd/1.depth").unlink(), r"rgbd/1\.depth is missing"),
    ("record3d", lambda root: (root / "rgbd/0.depth").write_bytes(b"bvx2\xff\xff\xff\xff"), r"0\.depth is damaged"),
    ("record3d", lambda root: (root / "rgbd/0.depth").write_bytes(b"bvx2\0\0\0\0junk"), r"0\.depth is damaged"),
    ("record3d-export", lambda root: write_exr(root / "depth/0.exr", {"R": np.full((60, 80), 1e30)}),
        "depth reaches beyond 100000 m"),
    ("record3d-export", lambda root: write_exr(root / "depth/0.exr", dict.fromkeys("RGBAZ", np.ones((9, 9)))),
        "claims 9x9 px and 5 channels"),
    ("record3d-export", lambda root: write_exr(root / "depth/0.exr", {"R": np.ones((1, 5000))}),
        "claims 5000x1 px and 1 channels"),
    ("record3d-export", lambda root: (root / "depth/0.exr").write_bytes(b"v/1\1junk"), "no readable OpenEXR image"),
    ("rtsm", text("index.jsonl", '{"offset": 0}'), "line 1: offset and length must say where a message lies"),
    ("rtsm", text("index.jsonl", '{"offset": 1, "length": 900}'), "the message of line 1 is damaged"),
    ("rtsm", text("index.jsonl", "{"), "index.jsonl line 1"),
    ("arcore", text("intrinsics.json", "{}"), "lacks width, height, fx"),
    ("arcore", head(fx="wide"), r"intrinsics\.json: could not convert"),
    ("arcore", head(width=0), "camera size must be 1 to 32768 px"),
    ("arcore", text("poses.csv", "timestamp_ns,tx,ty,tz,qx,qy,qz\n"), "qw is missing"),
    ("arcore", text("poses.csv", "timestamp_ns,tx,ty,tz,qx,qy,qz,qw\n1.5,0,0,0,0,0,0,1"),
        "must be a whole number, got '1.5'"),
    ("arcore", text("poses.csv", "timestamp_ns,tx,ty,tz,qx,qy,qz,qw\n1,0,0,0,0,0,0,1"),
        "of 4 images none can be used: 4 "),
]  # fmt: skip


@pytest.mark.parametrize(("name", "damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, name: str, damage: Callable[[Path], object], fault: str) -> None:
    WRITERS[name](room(), tmp_path / "a")
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        opened(tmp_path / "a", format=name.split("-")[0])[0]
    assert "\n" not in str(caught.value)


def test_a_link_in_a_r3d_file_leads_nowhere(tmp_path: Path) -> None:
    write_record3d(room(with_depth=False), tmp_path / "a")
    secret = (tmp_path / "a/rgbd/1.jpg").rename(tmp_path / "secret.jpg")
    link = zipfile.ZipInfo("rgbd/1.jpg")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "scan.r3d", "w") as box:
        for path in (tmp_path / "a").rglob("*"):
            box.write(path, path.relative_to(tmp_path / "a"))
        box.writestr(link, str(secret))
    recording = opened(tmp_path / "scan.r3d", floor_m=0)
    assert recording[0].rgb.any()
    with pytest.raises(InputError, match=r"1\.jpg") as caught:
        recording[1]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no zip at all"])
def test_a_r3d_that_is_no_zip(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.r3d").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.r3d is no readable \.r3d file"):
        opened(tmp_path / "a.r3d")
