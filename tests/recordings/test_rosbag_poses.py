"""Where the camera was: /tf at each image's own stamp, odometry, and what is left out and counted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bags import (
    FRAME,
    OPTICAL,
    START_NS,
    BagFile,
    opened,
    same,
    write_bag,
    write_images,
    write_transforms,
)
from layouts import room

from cartier.errors import InputError
from cartier.geometry import invert

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")
CAMERA = room().camera


def test_poses_are_interpolated_at_the_images_own_stamp(tmp_path: Path) -> None:
    """A robot that turns on the spot on a circle: closed form between the samples, however late the messages came."""
    with BagFile(tmp_path / "a") as bag:
        write_images(bag, room())
        m = bag.messages
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
        for step in range(-3, 12):
            ns = START_NS + step * 37_000_000
            a = 0.9 * step * 0.037
            base = np.array(
                [[np.cos(a), -np.sin(a), 0, step * 0.01], [np.sin(a), np.cos(a), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
            )
            bag.put("/tf", ns + 5 * 10**9, m.transforms((ns, "map", "base_link", base)))
    found = opened(tmp_path / "a")
    for i, frame in enumerate(found):
        a, along = 0.9 * i * 0.1, i * 0.1 / 0.037 * 0.01
        base = np.array([[np.cos(a), -np.sin(a), 0, along], [np.sin(a), np.cos(a), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        assert np.abs(frame.world_from_camera - base @ OPTICAL).max() < 1e-6


def transforms_at(path: Path, steps: list[int], extra: Callable[[BagFile], None] | None = None) -> None:
    """Images at 0, 1, 2, 3 tenths of a second, and map from base at the given tenths."""
    with BagFile(path) as bag:
        write_images(bag, room())
        m = bag.messages
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
        for step in steps:
            ns = START_NS + step * 10**8
            base = np.eye(4)
            base[0, 3] = step
            bag.put("/tf", ns, m.transforms((ns, "map", "base_link", base)))
        if extra is not None:
            extra(bag)


def test_what_lies_outside_of_the_transforms_is_left_out_and_counted(tmp_path: Path) -> None:
    transforms_at(tmp_path / "a", [1, 2])
    found = opened(tmp_path / "a")
    assert [frame.world_from_camera[0, 3] for frame in found] == pytest.approx([1.1, 2.1])
    assert "2 images left out: taken before the first or after the last of the transforms" in found.notes
    transforms_at(tmp_path / "b", [7, 8])
    with pytest.raises(InputError, match=r"no image of /camera/color/image_raw can be used: .*4 images left out"):
        opened(tmp_path / "b")


def test_a_gap_in_which_the_robot_moved_is_not_bridged(tmp_path: Path) -> None:
    transforms_at(tmp_path / "a", [0, 1, 20])
    found = opened(tmp_path / "a")
    assert len(found) == 2
    assert "2 images left out: the transforms have gaps of more than 1 s there" in found.notes


def two_parents(bag: BagFile) -> None:
    pose = np.eye(4)
    bag.put("/tf", START_NS, bag.messages.transforms((START_NS, "odom", "base_link", pose)))


def circle(bag: BagFile) -> None:
    bag.put("/tf_static", START_NS, bag.messages.transforms((START_NS, FRAME, "map", np.eye(4))))


def no_rotation(bag: BagFile) -> None:
    message = bag.messages.transforms((START_NS, "map", "base_link", np.eye(4)))
    message.transforms[0].transform.rotation.w = 0.0
    bag.put("/tf", START_NS, message)


@pytest.mark.parametrize(
    ("extra", "options", "fault"),
    [
        (two_parents, {}, "frame 'base_link' has two parents in /tf, .*: two programs publish it"),
        (circle, {}, "the transforms run in a circle: camera_color_optical_frame -> base_link -> map"),
        (no_rotation, {}, "the pose of 'base_link' holds NaN, infinity or a quaternion that is not of length 1"),
        (None, {"frame": "earth"}, "no transform leads from 'earth' to .*: above it are base_link, map"),
        (None, {"colour": "/nose"}, "no images on topic '/nose'; the image topics are /camera/aligned"),
        (None, {"depth": "/camera/color/image_raw"}, "holds colour, not depth"),
        (None, {"info": "/nose"}, "topic '/nose' has no CameraInfo; there are /camera/color/camera_info"),
        (None, {"odometry": "/nose"}, "has no topic '/nose' of type nav_msgs/msg/Odometry or .*; there are none"),
        (None, {"extrinsic": "1,2"}, "extrinsic must be x,y,z,qx,qy,qz,qw"),
        (None, {"extrinsic": "0,0,0,0,0,0,1"}, "an extrinsic was given, and there is no odometry topic either"),
    ],
)
def test_faults_are_one_clear_line(
    tmp_path: Path, extra: Callable[[BagFile], None] | None, options: dict[str, str], fault: str
) -> None:
    transforms_at(tmp_path / "a", [0, 1, 2, 3], extra)
    with pytest.raises(InputError, match=fault) as caught:
        opened(tmp_path / "a", **options)
    assert "\n" not in str(caught.value)


def test_without_a_map_the_world_is_odom_and_it_is_said(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write_images(bag, room())
        m = bag.messages
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "/base_link", "/" + FRAME, OPTICAL)))  # ROS 1 habit
        for i, pose in enumerate(room().poses):
            ns = START_NS + i * 10**8
            bag.put("/tf", ns, m.transforms((ns, "odom", "base_link", pose @ invert(OPTICAL))))
    found = opened(tmp_path / "a")
    same(found, room())
    assert "there is no frame 'map' above the camera: the world is 'odom'; choose with --frame NAME" in found.notes


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
def test_odometry_and_the_cameras_place_on_the_robot(tmp_path: Path, kind: str) -> None:
    def write(path: Path, static: bool) -> None:
        with BagFile(path, kind) as bag:
            write_images(bag, room())
            m = bag.messages
            if static:
                bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
            for i, pose in enumerate(room().poses):
                ns = START_NS + i * 10**8
                bag.put("/odom", ns, m.odometry(ns, "odom", "base_link", pose @ invert(OPTICAL)))

    write(tmp_path / "static", True)
    found = opened(tmp_path / "static")
    same(found, room())
    assert "poses from /odom, in frame 'odom'" in found.notes
    write(tmp_path / "none", False)
    with pytest.raises(InputError, match=r"not where the camera .* sits on it: give --extrinsic "):
        opened(tmp_path / "none")
    same(opened(tmp_path / "none", extrinsic="0.1,0.02,1.2,-0.5,0.5,-0.5,0.5"), room())


def test_poses_of_a_tracker_of_the_camera_itself(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        write_images(bag, room())
        m = bag.messages
        for i, pose in enumerate(room().poses):
            ns = START_NS + i * 10**8
            bag.put("/slam/pose", ns, m("geometry_msgs/msg/PoseStamped", m.header(ns, "map"), m.pose(pose)))
    same(opened(tmp_path / "a", extrinsic=(0, 0, 0, 0, 0, 0, 1)), room())


def test_a_level_that_is_given_is_obeyed(tmp_path: Path) -> None:
    write_bag(room(), tmp_path / "a")
    found = opened(tmp_path / "a", floor_m=-0.5)
    assert found[0].world_from_camera[2, 3] == pytest.approx(2.0)
    assert found.fingerprint() != opened(tmp_path / "a").fingerprint()


def test_stampless_images_take_the_recorders_time(tmp_path: Path) -> None:
    source = room(with_depth=False)
    with BagFile(tmp_path / "a") as bag:
        m = bag.messages
        write_transforms(bag, source.poses)
        for i in range(len(source)):
            ns = START_NS + i * 10**8
            bag.put("/camera/camera_info", ns, m.info(0, FRAME, CAMERA))
            bag.put("/camera/image_raw", ns, m.image(0, FRAME, source[i].rgb, "rgb8"))
    found = opened(tmp_path / "a")
    same(found, source)
    assert any("carry no time stamps" in note for note in found.notes)
