"""Every encoding of colour and depth in a bag, depth of another camera, distortion, another resolution."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import (
    FRAME,
    START_NS,
    BagFile,
    Messages,
    compressed_depth,
    opened,
    png,
    same,
    write_images,
    write_transforms,
)
from layouts import room
from PIL import Image

from cartier.errors import InputError
from cartier.recordings.common.lens import Lens
from cartier.types import Camera
from cartier_ros.bags.images import lens_of
from synthetic import look

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")
CAMERA = room().camera


def test_depth_that_belongs_to_no_image_is_counted(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, room().poses)
        write_images(bag, room(with_depth=False))
        m = bag.messages
        for i in (0, 2, 3):
            ns = START_NS + i * 10**8 + 20_000_000
            bag.put(
                "/camera/depth_registered/image_raw",
                ns,
                m.image(ns, FRAME, np.full((120, 160), 1.5, np.float32), "32FC1"),
            )
    found = opened(tmp_path / "a")
    assert "1 images left out: no depth within 50 ms of them" in found.notes
    assert [frame.depth_m[0, 0] for frame in found if frame.depth_m is not None] == [1.5] * 3


def jpeg(rgb: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, "JPEG", quality=95)
    return out.getvalue()


def with_alpha(rgb: np.ndarray) -> np.ndarray:
    return np.dstack([rgb, np.full(rgb.shape[:2], 9, np.uint8)])


COLOURS: list[tuple[str, Callable[[Messages, int, np.ndarray], Any], float]] = [
    ("rgb8", lambda m, ns, rgb: m.image(ns, FRAME, rgb, "rgb8", padding=5), 0),
    ("bgr8", lambda m, ns, rgb: m.image(ns, FRAME, rgb[..., ::-1], "bgr8"), 0),
    ("8UC3", lambda m, ns, rgb: m.image(ns, FRAME, rgb[..., ::-1], "8UC3"), 0),
    ("rgba8", lambda m, ns, rgb: m.image(ns, FRAME, with_alpha(rgb), "rgba8"), 0),
    ("bgra8", lambda m, ns, rgb: m.image(ns, FRAME, with_alpha(rgb[..., ::-1]), "bgra8", padding=3), 0),
    ("jpeg", lambda m, ns, rgb: m.compressed(ns, FRAME, jpeg(rgb), "rgb8; jpeg compressed bgr8"), 4),
    ("png", lambda m, ns, rgb: m.compressed(ns, FRAME, png(rgb), "png"), 0),
]


@pytest.mark.parametrize(("encoding", "message", "rgb"), COLOURS, ids=[c[0] for c in COLOURS])
def test_every_colour_encoding(tmp_path: Path, encoding: str, message: Callable[..., Any], rgb: float) -> None:
    source = room(with_depth=False)
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, source.poses)
        topic = "/camera/image_raw/compressed" if encoding in ("jpeg", "png") else "/camera/image_raw"
        for i in range(len(source)):
            ns = START_NS + i * 10**8
            bag.put("/camera/camera_info", ns, bag.messages.info(ns, FRAME, CAMERA))
            bag.put(topic, ns, message(bag.messages, ns, source[i].rgb))
    same(opened(tmp_path / "a"), source, rgb)


def test_grey_images_are_taken_where_there_is_nothing_better(tmp_path: Path) -> None:
    grey = np.arange(120 * 160).astype(np.uint8).reshape(120, 160)
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, room().poses)
        bag.put("/camera/camera_info", START_NS, bag.messages.info(START_NS, FRAME, CAMERA))
        bag.put("/camera/image_raw", START_NS, bag.messages.image(START_NS, FRAME, grey, "mono8", padding=1))
    assert np.array_equal(opened(tmp_path / "a")[0].rgb, np.dstack([grey] * 3))


def big_endian(m: Messages, ns: int, depth: np.ndarray) -> Any:
    message = m.image(ns, FRAME, np.rint(depth * 1000).astype(">u2"), "16UC1")
    message.is_bigendian = 1
    return message


DEPTHS: list[tuple[str, Callable[[Messages, int, np.ndarray], Any], float]] = [
    ("16UC1", lambda m, ns, z: m.image(ns, FRAME, np.rint(z * 1000).astype(np.uint16), "16UC1", padding=6), 0.00051),
    ("mono16", lambda m, ns, z: m.image(ns, FRAME, np.rint(z * 1000).astype(np.uint16), "mono16"), 0.00051),
    ("16UC1-big-endian", big_endian, 0.00051),
    ("32FC1", lambda m, ns, z: m.image(ns, FRAME, z, "32FC1"), 0),
    ("png", lambda m, ns, z: m.compressed(ns, FRAME, png(np.rint(z * 1000).astype(np.uint16)), "16UC1; png compressed"),
        0.00051),
    ("compressedDepth-16UC1",
        lambda m, ns, z: m.compressed(ns, FRAME, compressed_depth(z, "16UC1"), "16UC1; compressedDepth png"), 0.00051),
    ("compressedDepth-32FC1",
        lambda m, ns, z: m.compressed(ns, FRAME, compressed_depth(z, "32FC1"), "32FC1; compressedDepth"), 0.0013),
]  # fmt: skip


@pytest.mark.parametrize(("encoding", "message", "error_m"), DEPTHS, ids=[d[0] for d in DEPTHS])
def test_every_depth_encoding(tmp_path: Path, encoding: str, message: Callable[..., Any], error_m: float) -> None:
    source = room()
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, source.poses)
        write_images(bag, room(with_depth=False))
        for i in range(len(source)):
            ns, depth = START_NS + i * 10**8, source[i].depth_m.copy()
            depth[0, :3] = 0
            suffix = encoding.split("-")[0] if "compressed" in encoding else ""
            bag.put(f"/camera/depth/image_raw/{suffix}".rstrip("/"), ns, message(bag.messages, ns, depth))
    for i, frame in enumerate(opened(tmp_path / "a")):
        assert frame.depth_m is not None
        assert np.isnan(frame.depth_m[0, :3]).all()
        assert np.abs(frame.depth_m - source[i].depth_m)[1:].max() <= error_m * 1.0001


@pytest.mark.parametrize(
    ("encoding", "fault"), [("bayer_rggb8", "encoded as 'bayer_rggb8'; cartier reads rgb8"), ("yuv422", "yuv422")]
)
def test_an_unknown_encoding_is_named(tmp_path: Path, encoding: str, fault: str) -> None:
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, room().poses)
        bag.put("/camera/camera_info", START_NS, bag.messages.info(START_NS, FRAME, CAMERA))
        bag.put(
            "/camera/image_raw", START_NS, bag.messages.image(START_NS, FRAME, np.zeros((120, 160), np.uint8), encoding)
        )
    with pytest.raises(InputError, match=fault):
        opened(tmp_path / "a")[0]


def test_depth_of_a_camera_beside_is_reprojected(tmp_path: Path) -> None:
    """The depth camera sits 5 cm to the left, is turned a little, and has another lens and fewer pixels."""
    from synthetic import render

    source = room()
    lens = Camera(100, 80, 70.0, 70.0, 49.5, 39.5)
    colour_from_depth = look((0, 0, 0), (1, 0.05, 0.03))
    colour_from_depth[:3, :3] = look((0, 0, 0), (1, 0, 0))[:3, :3].T @ colour_from_depth[:3, :3]
    colour_from_depth[0, 3] = -0.05
    with BagFile(tmp_path / "a") as bag:
        m = bag.messages
        write_transforms(bag, source.poses)
        write_images(bag, room(with_depth=False))
        bag.put("/tf_static", START_NS, m.transforms((START_NS, FRAME, "depth_frame", colour_from_depth)))
        bag.put("/camera/depth/camera_info", START_NS, m.info(START_NS, "depth_frame", lens))
        for i, pose in enumerate(source.poses):
            ns = START_NS + i * 10**8
            depth = render(pose @ colour_from_depth, lens, source.objects)[0]
            bag.put("/camera/depth/image_raw", ns, m.image(ns, "depth_frame", depth, "32FC1"))
    found = opened(tmp_path / "a")
    assert "depth of /camera/depth/image_raw is reprojected into the colour camera" in found.notes
    for i, frame in enumerate(found):
        assert frame.depth_m is not None
        seen = ~np.isnan(frame.depth_m)
        off_m = np.abs(frame.depth_m - source[i].depth_m)[seen]
        assert seen.mean() > 0.9
        assert np.median(off_m) < 0.015 and (off_m < 0.06).mean() > 0.95


def test_distortion_is_taken_out(tmp_path: Path) -> None:
    """The distorted images are made by OpenCV's own formula, inverted by iteration."""
    source = room(with_depth=False)
    d = np.array([-0.25, 0.06, 0.001, -0.002, 0.0])
    c = CAMERA
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    goal = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy])
    x, y = goal
    for _ in range(30):
        r2 = x * x + y * y
        radial = 1 + d[0] * r2 + d[1] * r2 * r2
        bend = np.stack([2 * d[2] * x * y + d[3] * (r2 + 2 * x * x), d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y])
        x, y = (goal - bend) / radial
    columns, rows = np.rint(x * c.fx + c.cx).astype(int), np.rint(y * c.fy + c.cy).astype(int)
    inside = (columns >= 0) & (columns < c.width) & (rows >= 0) & (rows < c.height)
    with BagFile(tmp_path / "a") as bag:
        m = bag.messages
        write_transforms(bag, source.poses)
        for i in range(len(source)):
            ns, bent = START_NS + i * 10**8, np.zeros((c.height, c.width, 3), np.uint8)
            bent[inside] = source[i].rgb[rows[inside], columns[inside]]
            bag.put("/camera/camera_info", ns, m.info(ns, FRAME, c, d))
            bag.put("/camera/image_raw", ns, m.image(ns, FRAME, bent, "rgb8"))
    found = opened(tmp_path / "a")
    assert "lens distortion (plumb_bob) is taken out of the images" in found.notes
    for i, frame in enumerate(found):
        assert (np.abs(frame.rgb.astype(int) - source[i].rgb).max(axis=2) == 0)[10:-10, 10:-10].mean() > 0.97


def test_intrinsics_of_another_resolution_are_scaled_and_said(tmp_path: Path) -> None:
    source = replace(room(), camera=CAMERA.scaled(80, 60))
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, source.poses)
        m = bag.messages
        bag.put("/camera/camera_info", START_NS, m.info(START_NS, FRAME, CAMERA))
        bag.put("/camera/image_raw", START_NS, m.image(START_NS, FRAME, source[0].rgb, "rgb8"))
    found = opened(tmp_path / "a")
    assert found.camera == source.camera
    assert (
        "/camera/camera_info is of another resolution than /camera/image_raw; its intrinsics were scaled" in found.notes
    )


def with_info(path: Path, info: Camera) -> None:
    """A bag whose CameraInfo says ``info`` of images of the room."""
    source = room()
    with BagFile(path) as bag:
        write_transforms(bag, source.poses)
        m = bag.messages
        bag.put("/camera/camera_info", START_NS, m.info(START_NS, FRAME, info))
        bag.put("/camera/image_raw", START_NS, m.image(START_NS, FRAME, source[0].rgb, "rgb8"))


def test_intrinsics_of_the_images_own_size_are_taken_where_the_camera_info_says_another(tmp_path: Path) -> None:
    with_info(tmp_path / "a", replace(CAMERA, width=320, height=240))
    found = opened(tmp_path / "a")
    assert found.camera == CAMERA
    says = "/camera/camera_info says 320x240 px, but its intrinsics are those of /camera/image_raw's 160x120"
    assert says in found.notes


def test_intrinsics_of_neither_size_name_both(tmp_path: Path) -> None:
    with_info(tmp_path / "a", replace(CAMERA.scaled(1000, 750), width=320, height=240))
    with pytest.raises(
        InputError, match=r"camera_info \(of 320x240 px, for images of 160x120\): the principal point 499\."
    ):
        opened(tmp_path / "a")
    with_info(tmp_path / "b", Camera(200, 120, 120.0, 120.0, 99.5, 59.5))
    with pytest.raises(InputError, match=r"is for images of 200x120 px, but those of /camera/image_raw have 160x120"):
        opened(tmp_path / "b")


SENSOR = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
CUT = {  # what the CameraInfo says, and the camera of images of that region
    "in the middle": (SENSOR, (160, 120, 320, 240), (0, 0), Camera(320, 240, 500.0, 500.0, 159.5, 119.5)),
    "at the edge": (SENSOR, (0, 240, 320, 240), (1, 1), Camera(320, 240, 500.0, 500.0, 319.5, -0.5)),
    "binned": (SENSOR, (0, 0, 0, 0), (2, 2), SENSOR.scaled(320, 240)),
    "binned across": (SENSOR, (0, 0, 0, 0), (2, 1), SENSOR.scaled(320, 480)),
    "region and binned": (SENSOR, (320, 0, 320, 480), (2, 2), Camera(160, 240, 250.0, 250.0, -0.5, 119.5)),
    "moved already": (
        Camera(640, 480, 500.0, 500.0, 19.5, 119.5), (300, 120, 320, 240), (0, 0),
        Camera(320, 240, 500.0, 500.0, 19.5, 119.5),
    ),
    "size of the region": (
        Camera(320, 240, 500.0, 500.0, 319.5, 239.5), (160, 120, 320, 240), (0, 0),
        Camera(320, 240, 500.0, 500.0, 159.5, 119.5),
    ),
    "not cut": (SENSOR, (160, 120, 320, 240), (0, 0), SENSOR),
    "whole": (SENSOR, (0, 0, 640, 480), (1, 1), SENSOR),
}  # fmt: skip


@pytest.mark.parametrize("name", CUT)
@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("rectified", [False, True])
def test_region_of_interest_moves_intrinsics(name: str, ros1: bool, rectified: bool) -> None:
    said, region, binning, right = CUT[name]
    info = Messages(ros1).info(0, FRAME, said, region=region, binning=binning)
    lens, note = lens_of(info, rectified, (right.width, right.height), "/camera_info")
    assert lens.scaled(right.width, right.height).camera == right
    assert bool(note) == (name not in ("not cut", "whole", "binned"))


def test_region_of_interest_of_a_bag(tmp_path: Path) -> None:
    source = room()
    c = source.camera
    whole = replace(c, width=c.width + 60, height=c.height + 40, cx=c.cx + 60, cy=c.cy + 10)
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, source.poses)
        m, region = bag.messages, (60, 10, c.width, c.height)
        bag.put("/camera/camera_info", START_NS, m.info(START_NS, FRAME, whole, region=region))
        bag.put("/camera/image_raw", START_NS, m.image(START_NS, FRAME, source[0].rgb, "rgb8"))
    found = opened(tmp_path / "a")
    assert found.camera == c
    assert [note for note in found.notes if "160x120 px of the sensor from 60, 10 on" in note]


@pytest.mark.parametrize("model", ["equidistant", "fisheye", "Kannala_Brandt4"])
def test_fisheye_bends_without_coefficients(model: str) -> None:
    lens, _ = lens_of(Messages().info(0, FRAME, SENSOR, (0.0,) * 4, model), False, (640, 480), "")
    assert lens == Lens(SENSOR, "equidistant", (0.0,) * 4)


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
@pytest.mark.parametrize("form", ["raw", "packed"])
def test_empty_images_are_left_out_and_counted(tmp_path: Path, kind: str, form: str) -> None:
    """An empty message among good ones (of colour the first), and a topic of nothing else."""
    source = room()
    with BagFile(tmp_path / "a", kind) as bag:
        m = bag.messages

        def put(topic: str, ns: int, rgb: np.ndarray) -> None:
            image = (
                m.image(ns, FRAME, rgb, "rgb8")
                if form == "raw"
                else m.compressed(ns, FRAME, jpeg(rgb) if rgb.size else b"", "jpeg")
            )
            bag.put(topic, ns, image)

        write_transforms(bag, source.poses)
        bag.put("/camera/camera_info", START_NS, m.info(START_NS, FRAME, CAMERA))
        for i in range(len(source)):
            empty = np.zeros((0, 0, 3), np.uint8)
            put("/camera/image", START_NS + i * 10**8, empty if i == 0 else source[i].rgb)
            put("/none/image", START_NS + i * 10**8, empty)
            depth = np.rint(source[i].depth_m * 1000).astype(np.uint16)[: 0 if i == 2 else None]
            bag.put("/depth/image", START_NS + i * 10**8, m.image(START_NS + i * 10**8, FRAME, depth, "16UC1"))
    found = opened(tmp_path / "a")
    assert "1 messages of /camera/image left out: their images are empty" in found.notes
    assert "1 messages of /depth/image left out: their images are empty" in found.notes
    assert "left out: topic /none/image: its images are empty (no pixels)" in found.notes
    assert [round(frame.time_s - START_NS / 1e9, 3) for frame in found] == [0.1, 0.3]
    assert np.abs(found[1].depth_m - source[3].depth_m).max() < 0.00051
    with pytest.raises(InputError, match="topic /none/image: its images are empty"):
        opened(tmp_path / "a", colour="/none/image")


def test_a_topic_that_cannot_be_read_does_not_stop_the_others(tmp_path: Path) -> None:
    source = room()
    with BagFile(tmp_path / "a") as bag:
        write_images(bag, source)
        write_transforms(bag, source.poses)
        m = bag.messages
        bag.put("/front/image/compressed", START_NS, m.compressed(START_NS, FRAME, b"\0\0\0\1\x67junk", "h264"))
        bag.put("/rear/image/compressed", START_NS, m.compressed(START_NS, FRAME, b"", "jpeg"))
        bag.put("/side/image/compressed", START_NS, m.compressed(START_NS, FRAME, b"\xff\xd8junk", "jpeg"))
    found = opened(tmp_path / "a")
    same(found, source)
    left_out = [note for note in found.notes if note.startswith("left out: topic")]
    assert [note.split(":")[1].split()[1] for note in left_out] == [
        f"/{where}/image/compressed" for where in ("front", "rear", "side")
    ]
    assert "a video stream (h264)" in left_out[0] and "0x" not in " ".join(found.notes)
    same(opened(tmp_path / "a", colour="/camera/color/image_raw"), source)
    with pytest.raises(InputError, match="its images are a video stream"):
        opened(tmp_path / "a", colour="/front/image/compressed")


def test_where_no_topic_can_be_read_the_first_says_why(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        m = bag.messages
        bag.put("/front/image/compressed", START_NS, m.compressed(START_NS, FRAME, b"\0\0\0\1\x67junk", "h264"))
    with pytest.raises(InputError, match="topic /front/image/compressed: its images are a video"):
        opened(tmp_path / "a")
