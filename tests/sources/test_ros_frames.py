"""Streams of strangers, message by message: which frame is mapped, circles, odometry, rates, broken messages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import FRAME, MAP_FROM_ODOM, OPTICAL, START_NS, BagFile, Messages, write_images

from cartier.geometry import invert
from cartier.live.sent_poses import SentPoses
from cartier.sources import open_source
from cartier.types.streams import Event, Fault, PoseUpdate, Stamped
from cartier_ros.bags.graphs import PATH
from cartier_ros.streams.messages import Message
from cartier_ros.streams.ros_frames import RosFrames, RosOptions
from synthetic import walk

pytest.importorskip("rosbags", reason="needs cartier[ros]")
WALK = walk()
STEP_S, COUNT = 0.1, 60
COLOUR, DEPTH, INFO = "/camera/color/image_raw", "/camera/depth/image_raw", "/camera/color/camera_info"
M = Messages()


def pose(k: int) -> np.ndarray:
    slid = np.array(WALK.poses[0])
    slid[0, 3] += 0.03 * k
    return slid


class Robot:
    """Sends a walk to a receiver; parts of it can be replaced."""

    def __init__(self, **options: Any) -> None:
        self.frames = RosFrames("a robot", RosOptions(**options))
        self.events: list[Event] = []
        self.has_map: Callable[[int], bool] = lambda k: True
        self.has_depth: Callable[[int], bool] = lambda k: True
        self.extra: Callable[[int, int], list[tuple[str, Any]]] = lambda k, ns: []
        self.moves = True

    def send(self, topic: str, message: Any, now_s: float, data: bytes | None = None) -> None:
        data = M.bytes_of(message) if data is None else data
        self.frames.feed(Message(topic, message.__msgtype__, data), now_s)

    def drive(self) -> Robot:
        depth_mm = np.rint(np.nan_to_num(WALK[0].depth_m) * 1000).astype(np.uint16)
        self.send("/tf_static", M.transforms((START_NS, "base_link", FRAME, OPTICAL)), 0.0)
        for k in range(COUNT):
            now_s, ns = 5.0 + k * STEP_S, START_NS + round(k * STEP_S * 1e9)
            odom_from_base = invert(MAP_FROM_ODOM) @ pose(k) @ invert(OPTICAL)
            if self.moves:
                self.send("/tf", M.transforms((ns, "odom", "base_link", odom_from_base)), now_s)
            if self.has_map(k):
                self.send("/tf", M.transforms((ns, "map", "odom", MAP_FROM_ODOM)), now_s)
            for topic, message in self.extra(k, ns):
                self.send(topic, message, now_s)
            self.send(INFO, M.info(ns, FRAME, WALK.camera), now_s)
            self.send(COLOUR, M.image(ns, FRAME, WALK[0].rgb, "rgb8"), now_s)
            if self.has_depth(k):
                self.send(DEPTH, M.image(ns, FRAME, depth_mm, "16UC1"), now_s)
            self.events += self.frames.poll(now_s)
        self.events += self.frames.poll(now_s + 1.0)
        return self

    def faults(self, reason: str) -> list[Fault]:
        return [event for event in self.events if isinstance(event, Fault) and event.reason == reason]

    def stamped(self) -> list[Stamped]:
        return [event for event in self.events if isinstance(event, Stamped)]

    def check_poses(self, off_m: float = 1e-6) -> None:
        """All poses are those of the walk in the map, by what is known in the end."""
        poses = SentPoses()
        for event in self.events:
            if isinstance(event, Stamped):
                poses.add(event.stamp_ns, event.frame.world_from_camera)
            elif isinstance(event, PoseUpdate):
                poses.correct(event.poses)
        assert self.stamped()
        for each in self.stamped():
            k = round((each.stamp_ns - START_NS) / 1e9 / STEP_S)
            np.testing.assert_allclose(poses.pose(each.stamp_ns, each.frame.world_from_camera), pose(k), atol=off_m)


def test_a_sound_robot_loses_nothing() -> None:
    robot = Robot().drive()
    assert len(robot.stamped()) == COUNT and not [e for e in robot.events if isinstance(e, Fault)]
    robot.check_poses()


def test_a_late_map_takes_over_what_was_sent() -> None:
    robot = Robot()
    robot.has_map = lambda k: k > 40
    robot.drive()
    assert robot.frames.world_frame == "map"
    assert "'map' appeared above 'odom'" in robot.faults("frame")[0].text
    robot.check_poses()


def test_a_named_frame_stays() -> None:
    robot = Robot(frame="odom")
    robot.has_map = lambda k: k > 40
    robot.drive()
    assert robot.frames.world_frame == "odom" and not robot.faults("frame")


def test_corrections_in_another_frame_are_told_once() -> None:
    robot = Robot(frame="odom")
    robot.extra = lambda k, ns: [("/path", M(PATH, M.header(ns, "map"), []))] if k > 20 else []
    (fault,) = robot.drive().faults("frame")
    assert "/path corrects poses in 'map', and 'odom' is mapped" in fault.text


@pytest.mark.parametrize("circle", [(("odom", "map"),), ((FRAME, FRAME),), (("a", "b"), ("b", "c"), ("c", "a"))])
def test_a_circle_is_left_out(circle: tuple[tuple[str, str], ...]) -> None:
    robot = Robot()
    robot.extra = lambda k, ns: [("/tf", M.transforms(*((ns, a, b, np.eye(4)) for a, b in circle)))] if k == 30 else []
    robot.drive()
    assert len(robot.faults("circle")) == 1 and len(robot.stamped()) == COUNT
    robot.check_poses()


def test_of_a_message_the_sound_transforms_are_taken() -> None:
    robot = Robot()
    robot.has_map = lambda k: False
    robot.extra = lambda k, ns: [
        ("/tf", _with_nan(M.transforms((ns, "x", "y", np.eye(4)), (ns, "map", "odom", MAP_FROM_ODOM))))
    ]
    assert len(robot.drive().stamped()) == COUNT
    assert len(robot.faults("unreadable")) == COUNT


def _with_nan(message: Any) -> Any:
    message.transforms[0].transform.translation.x = float("nan")
    return message


def test_no_message_ends_a_session(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot()

    def breaks(self: RosFrames, message: Message) -> None:
        raise ZeroDivisionError("of nobody's making")

    monkeypatch.setattr(RosFrames, "_graph", breaks)
    robot.extra = lambda k, ns: [("/path", M(PATH, M.header(ns, "map"), []))] if k == 30 else []
    (fault,) = robot.drive().faults("unreadable")
    assert "a message of /path: ZeroDivisionError: of nobody's making" in fault.text
    assert len(robot.stamped()) == COUNT


@pytest.mark.parametrize("mount", [None, OPTICAL])
def test_odometry_of_the_camera_itself(mount: np.ndarray | None) -> None:
    extrinsic = None if mount is None else (0.1, 0.02, 1.2, -0.5, 0.5, -0.5, 0.5)
    robot = Robot(odometry="/odom", extrinsic=extrinsic)
    robot.moves, robot.has_map = False, lambda k: False
    moved = np.eye(4) if mount is None else invert(OPTICAL)
    robot.extra = lambda k, ns: [("/odom", M.odometry(ns, "map", FRAME, pose(k) @ moved))]
    robot.drive()
    assert len(robot.stamped()) >= COUNT - 1 and not robot.faults("circle")
    robot.check_poses(1e-5)


def test_odometry_replaces_the_same_transform() -> None:
    robot = Robot(odometry="/odom")
    robot.has_map = lambda k: False
    robot.extra = lambda k, ns: [
        ("/odom", M.odometry(ns - 10**7, "odom", "base_link", invert(MAP_FROM_ODOM) @ pose(k) @ invert(OPTICAL)))
    ]
    robot.drive()
    assert len(robot.stamped()) >= COUNT - 2 and not robot.faults("clock")
    assert robot.frames.world_frame == "odom"


@pytest.mark.parametrize("every", [2, 3])
def test_slower_depth_is_sound(every: int) -> None:
    robot = Robot()
    robot.has_depth = lambda k: k % every == 0
    robot.drive()
    assert len(robot.stamped()) == COUNT // every
    assert sum(fault.frames for fault in robot.faults("no_depth")) <= 8  # before the rates are known, and at the end
    assert any("depth comes at a lower rate" in note for note in robot.frames.notes)


def test_missing_depth_is_told() -> None:
    robot = Robot()
    robot.has_depth = lambda k: k % 10 < 6
    assert sum(fault.frames for fault in robot.drive().faults("no_depth")) == COUNT - len(robot.stamped())


@pytest.mark.parametrize("late_s", [0.067, 0.25])
def test_an_image_out_of_order_costs_itself_at_most(late_s: float) -> None:
    from cartier_ros.streams.pairing import Pairer
    from cartier_ros.streams.transforms import Lookup

    pairer = Pairer(lambda ns: Lookup(np.eye(4)), False, lambda: None)
    sent = [(k * 0.066 + (late_s if k == 20 else 0.0), k) for k in range(40)]
    found: list[Any] = []
    for now_s, k in sorted(sent):
        pairer.colour(round(k * 0.066 * 1e9), k, now_s)
        found += pairer.poll(now_s)
    kept = [each.colour for each in found if not isinstance(each, Fault)]
    assert kept == [k for k in range(40) if k != 20]
    assert [fault.reason for fault in found if isinstance(fault, Fault)] == ["late"]


def test_an_image_out_of_order_is_sorted_in() -> None:
    robot = Robot()
    robot.has_depth = lambda k: k not in (30, 31)  # so that both wait
    depth_mm = np.rint(np.nan_to_num(WALK[0].depth_m) * 1000).astype(np.uint16)

    def swapped(k: int, ns: int) -> list[tuple[str, Any]]:
        step = round(STEP_S * 1e9)
        if k != 32:
            return []
        return [(DEPTH, M.image(ns - n * step, FRAME, depth_mm, "16UC1")) for n in (1, 2)]

    robot.extra = swapped
    robot.drive()
    assert len(robot.stamped()) == COUNT and not robot.faults("clock")


def test_a_bag_is_mapped_in_its_readers_frame(tmp_path: Path) -> None:
    with BagFile(tmp_path / "walk") as bag:
        m = bag.messages
        write_images(bag, WALK)
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
        for k in range(len(WALK)):
            ns = START_NS + k * 10**8
            bag.put(
                "/tf", ns, m.transforms((ns, "odom", "base_link", invert(MAP_FROM_ODOM) @ pose(k) @ invert(OPTICAL)))
            )
            if k > len(WALK) - 8:
                bag.put("/tf", ns, m.transforms((ns, "map", "odom", MAP_FROM_ODOM)))
    source = open_source(f"bag:{tmp_path / 'walk'}@max")
    sent = [event for event in source if isinstance(event, Stamped)]
    assert source.world_frame == "map" and len(sent) == 7
    np.testing.assert_allclose(sent[0].frame.world_from_camera, pose(len(WALK) - 7), atol=1e-6)
