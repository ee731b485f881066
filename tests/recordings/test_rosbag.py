"""Bags that other programs wrote, and which of their topics are taken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bags import (
    FRAME,
    START_NS,
    BagFile,
    opened,
    png,
    same,
    write_bag,
    write_images,
    write_transforms,
)
from layouts import room

from cartier.errors import InputError
from cartier.types import Camera

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")
CAMERA = room().camera


@pytest.mark.parametrize(
    ("kind", "compression"),
    [("mcap", ""), ("mcap", "storage"), ("mcap", "message"), ("sqlite3", ""), ("sqlite3", "message"), ("ros1", "")],
)
def test_what_rosbags_writes_is_read(tmp_path: Path, kind: str, compression: str) -> None:
    write_bag(room(), tmp_path / "a", kind, compression)
    found = opened(tmp_path / "a")
    same(found, room())
    assert [frame.time_s for frame in found] == [START_NS / 1e9 + i / 10 for i in range(4)]
    assert list(found.notes) == [
        f"poses from /tf: 'map' to '{FRAME}'"
    ]  # nothing about the floor: it is measured in the depth


@pytest.mark.parametrize("chunks", ["none", "lz4", "zstd"])
def test_what_foxglove_writes_is_read(tmp_path: Path, chunks: str) -> None:
    """The container from other authors' writer, with compression that rosbags does not write."""
    mcap_writer = pytest.importorskip("mcap.writer", reason="needs Foxglove's mcap")
    write_bag(room(), tmp_path / "a")
    source = next((tmp_path / "a").glob("*.mcap"))
    from mcap.reader import make_reader

    kind = {"lz4": mcap_writer.CompressionType.LZ4, "zstd": mcap_writer.CompressionType.ZSTD}
    options = {"use_chunking": False} if chunks == "none" else {"compression": kind[chunks], "chunk_size": 1 << 16}
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = mcap_writer.Writer(file, **options)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(source.open("rb")).iter_messages():
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    same(opened(tmp_path / "b.mcap"), room())


def test_messages_that_foxglove_serialised_are_read(tmp_path: Path) -> None:
    """Not only the container but each message from another program's hand, and read by its reader too."""
    ros2 = pytest.importorskip("mcap_ros2.writer", reason="needs Foxglove's mcap-ros2-support")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    stamp = {"sec": START_NS // 10**9, "nanosec": 0}
    c = CAMERA
    k = [c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1]
    rgb = room()[0].rgb
    size = {"height": c.height, "width": c.width}
    head = {"stamp": stamp, "frame_id": FRAME}
    pose = {"translation": {"x": 1.0, "y": 2.0, "z": 1.5}, "rotation": {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}}
    moving = [
        {
            "header": {"stamp": {**stamp, "sec": stamp["sec"] + s}, "frame_id": "map"},
            "child_frame_id": FRAME,
            "transform": pose,
        }
        for s in (-1, 1)
    ]
    sent = {
        "/image": (
            "sensor_msgs/msg/Image",
            {"header": head, **size, "encoding": "rgb8", "step": 3 * c.width, "data": rgb.tobytes()},
        ),
        "/camera_info": (
            "sensor_msgs/msg/CameraInfo",
            {"header": head, **size, "distortion_model": "", "d": [], "k": k},
        ),
        "/tf": ("tf2_msgs/msg/TFMessage", {"transforms": moving}),
    }
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = ros2.Writer(file)
        for topic, (name, message) in sent.items():
            schema = writer.register_msgdef(name, store.generate_msgdef(name, ros_version=2)[0])
            writer.write_message(topic, schema, message, log_time=START_NS)
        writer.finish()
    found = opened(tmp_path / "a.mcap")
    assert np.array_equal(found[0].rgb, rgb)
    assert np.allclose(found[0].world_from_camera, [[0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    assert (found.camera, found[0].depth_m) == (c, None)


ROS1_WRITER = """
import sys, rosbag, rospy
from sensor_msgs.msg import Image, CameraInfo
from tf2_msgs.msg import TFMessage
from geometry_msgs.msg import TransformStamped
def transform(t, parent, child, xyz, q):
    m = TransformStamped(); m.header.stamp = t; m.header.frame_id = parent; m.child_frame_id = child
    m.transform.translation.x, m.transform.translation.y, m.transform.translation.z = xyz
    m.transform.rotation.x, m.transform.rotation.y, m.transform.rotation.z, m.transform.rotation.w = q
    return TFMessage([m])
with rosbag.Bag(sys.argv[1], 'w', compression=sys.argv[2], chunk_threshold=2000) as b:
    start = rospy.Time(1000)
    b.write('/tf_static', transform(start, 'base_link', 'cam', (0, 0, 1.5), (-.5, .5, -.5, .5)), start)
    for i in range(20):
        t = rospy.Time(1000 + i // 10, (i % 10) * 10**8)
        b.write('/tf', transform(t, 'map', 'base_link', (.1 * i, 0, 0), (0, 0, 0, 1)), t)
        im = Image(); im.header.stamp = t; im.header.frame_id = 'cam'
        im.height, im.width, im.encoding, im.step = 4, 6, 'rgb8', 20
        im.data = bytes([i] * 80)
        b.write('/camera/color/image_raw', im, t)
        d = Image(); d.header = im.header; d.height, d.width, d.encoding, d.step = 4, 6, '16UC1', 12
        d.data = (1000 + i).to_bytes(2, 'little') * 24
        b.write('/camera/depth/image_rect_raw', d, t)
        c = CameraInfo(); c.header = im.header; c.height, c.width = 4, 6; c.K = [5, 0, 3, 0, 5, 2, 0, 0, 1]
        b.write('/camera/color/camera_info', c, t)
"""


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_what_ros1_itself_writes_is_read(tmp_path: Path, compression: str) -> None:
    python = Path("/usr/bin/python3")
    has = (
        python.exists()
        and subprocess.run([python, "-c", "import rosbag, tf2_msgs"], capture_output=True).returncode == 0
    )
    if not has:
        pytest.skip("needs Debian's own ROS 1: apt-get install python3-rosbag python3-tf2-msgs")
    subprocess.run([python, "-c", ROS1_WRITER, tmp_path / "a.bag", compression], check=True, capture_output=True)
    found = opened(tmp_path / "a.bag")
    assert (len(found), found.camera) == (20, Camera(6, 4, 5.0, 5.0, 3.0, 2.0))
    for i, frame in enumerate(found):
        assert frame.depth_m is not None
        assert (frame.rgb == i).all() and (frame.depth_m == np.float32((1000 + i) / 1000)).all()
        expected = [[0, 0, 1, 0.1 * i], [-1, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]]
        assert np.allclose(frame.world_from_camera, expected, atol=1e-12)


def test_several_cameras_are_told_apart_and_said(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write_transforms(bag, room().poses)
        write_images(bag, room())
        m = bag.messages
        other = np.full((120, 160, 3), 7, np.uint8)
        bag.put("/rear/image_raw", START_NS, m.image(START_NS, "rear_frame", other, "rgb8"))
        bag.put("/rear/image_raw/compressed", START_NS, m.compressed(START_NS, "rear_frame", png(other), "png"))
        bag.put("/rear/camera_info", START_NS, m.info(START_NS, "rear_frame", CAMERA))
        bag.put("/infra1/image_raw", START_NS, m.image(START_NS, FRAME, other[..., 0], "mono8"))
    found = opened(tmp_path / "a")
    same(found, room())
    assert (
        "colour taken from /camera/color/image_raw; there are also /rear/image_raw: choose with --colour TOPIC"
        in found.notes
    )
    with pytest.raises(InputError, match="'rear_frame' hangs on nothing that moves in /tf"):
        opened(tmp_path / "a", colour="/rear/image_raw")


def test_a_bag_in_parts_is_one(tmp_path: Path) -> None:
    """As 'ros2 bag record --max-bag-size' and 'rosbag record --split' leave it."""
    for kind, suffix in (("mcap", ".mcap"), ("ros1", ".bag")):
        write_bag(room(), tmp_path / kind, kind)
        (tmp_path / f"{kind}-parts").mkdir()
        with BagFile(tmp_path / f"{kind}-a", kind) as bag:
            write_images(bag, room())
        with BagFile(tmp_path / f"{kind}-b", kind) as bag:
            write_transforms(bag, room().poses)
        for part in "ab":
            file = next((tmp_path / f"{kind}-{part}").glob(f"*{suffix}"))
            file.rename(tmp_path / f"{kind}-parts" / f"part_{part}{suffix}")
        same(opened(tmp_path / f"{kind}-parts"), room())


def test_opening_imports_nothing_heavy() -> None:
    code = "import sys, cartier_ros.rosbag; sys.exit('rosbags' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
