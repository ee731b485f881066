"""ROS 2 topics over real DDS: robots in other processes, another vendor's too, a bag that is played, and trouble."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peers import LOOPBACK, any_domain, fastdds_program, peer
from typer.testing import CliRunner

from cartier.cli import app
from cartier.contracts import Source
from cartier.errors import BackendError, InputError, MissingExtra
from cartier.sources import open_source
from cartier.testing import check_source
from cartier.types.streams import Fault, Stamped
from cartier_ros.streams.gaps import Gaps
from studio import studio
from synthetic import THINGS, TrueBoxes, walk

pytest.importorskip("cyclonedds", reason="needs cyclonedds: pip install 'cartier[ros]'")
ros_camera = pytest.importorskip("ros_camera")

CAMERA = Path(ros_camera.__file__)
FASTDDS = Path(__file__).parent / "fastdds_camera"
WALK = walk()


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags: pip install 'cartier[ros]'")
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)


def some_frames(domain: int | None, count: int = 8, **options: Any) -> list[Stamped]:
    """So many frames, which obey the laws; a stream that brings fewer in 40 s is closed, and that breaks them."""
    source = open_source("ros2", domain=domain, **options)
    patience = threading.Timer(40, source.close)
    patience.start()
    try:
        return check_source(lambda: source, most=count, ends=False)
    finally:
        patience.cancel()


def seen_by_the_camera(frames: list[Stamped], count: int = 8) -> None:
    """The frames are what tests/robots/ros_camera.py and the C++ peer send."""
    assert len(frames) >= count
    for each in frames:
        k = round(each.frame.time_s * 10) - ros_camera.START_S * 10
        assert each.stamp_ns == ros_camera.START_S * 10**9 + k * 10**8
        np.testing.assert_array_equal(each.frame.rgb, ros_camera.rgb())
        assert each.frame.depth_m is not None
        np.testing.assert_allclose(each.frame.depth_m, ros_camera.depth_mm() / 1000, atol=1e-6)
        forward_right_down = [[0, 0, 1, 1.1 + 0.1 * k], [-1, 0, 0, 2], [0, -1, 0, 1.2], [0, 0, 0, 1]]
        np.testing.assert_allclose(each.frame.world_from_camera, forward_right_down, atol=1e-9)
        assert each.odom_from_camera is not None
        np.testing.assert_allclose(each.odom_from_camera[:3, 3], [0.1 + 0.1 * k, 0, 1.2], atol=1e-9)


@pytest.mark.parametrize("form", ["raw", "compressed"])
def test_a_robot_in_another_process_is_heard(form: str) -> None:
    domain = any_domain()
    with peer(sys.executable, CAMERA, domain, form, 400):
        seen_by_the_camera(some_frames(domain))


def test_a_robot_on_fast_dds_is_heard(pytestconfig: pytest.Config) -> None:
    domain = any_domain()
    with peer(fastdds_program(pytestconfig, FASTDDS), domain, 400):
        seen_by_the_camera(some_frames(domain))


def test_topics_can_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = any_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    names = {
        "colour": "camera/color/image_raw",
        "depth": "/camera/depth/image_raw",
        "info": "/camera/color/camera_info",
    }
    with peer(sys.executable, CAMERA, domain, "raw", 400):
        seen_by_the_camera(some_frames(None, **names))  # the domain is this shell's
        assert "nobody publishes /left/image in domain" in first_fault(domain, colour="/left/image").text


def first_fault(
    domain: int, skip: Callable[[Fault], bool] = lambda fault: "nobody publishes in" in fault.text, **options: Any
) -> Fault:
    """What the source says first once it has found somebody."""
    source, until_s = open_source("ros2", domain=domain, **options), time.monotonic() + 20
    try:
        for event in source:
            assert time.monotonic() < until_s
            if isinstance(event, Fault) and not skip(event):
                return event
        raise AssertionError("it ended")
    finally:
        source.close()


def test_an_empty_domain_is_told_within_a_second() -> None:
    begin, domain = time.monotonic(), any_domain()
    fault = first_fault(domain, skip=lambda _: False)
    assert fault.reason == "silent"
    assert f"nobody publishes in domain {domain}: is the robot on" in fault.text
    assert time.monotonic() - begin < 3


@pytest.mark.parametrize(
    ("form", "says"),
    [
        ("no_images", "is published and matches, but nothing comes: does it send?"),
        ("no_tf", "no transforms lead to the camera's frame 'camera_optical'"),
    ],
)
def test_what_a_robot_lacks_is_told(form: str, says: str) -> None:
    domain = any_domain()
    with peer(sys.executable, CAMERA, domain, form, 400):
        patience = lambda fault: says not in fault.text  # noqa: E731  # it may speak once before it has heard enough
        assert first_fault(domain, skip=patience).reason == "silent"


def test_a_domain_without_a_camera_is_told() -> None:
    from cartier_ros.dds.topics import Writer, participant

    domain = any_domain()
    ours = participant(domain)
    scan = Writer(ours, "/chatter", "std_msgs/msg/String")
    assert "1 topics are published" in first_fault(domain).text
    del scan


HEARD = "/camera/color/image_raw", "sensor_msgs/msg/Image"


@pytest.mark.parametrize(
    ("qos", "says"),
    [
        ({"partition": "elsewhere"}, "does not match: it is in the DDS partition 'elsewhere'"),
        ({"ownership": True}, "does not match: its writer claims exclusive ownership"),
        ({}, "is published and matches, but nothing comes: no data of anybody arrives"),
    ],
)
def test_what_cannot_be_heard_is_told_with_its_cause(qos: dict[str, Any], says: str) -> None:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.pub import DataWriter, Publisher
    from cyclonedds.topic import Topic

    from cartier_ros.dds.topics import participant
    from cartier_ros.dds.types import topic_type

    domain = any_domain()
    ours = participant(domain)
    publisher = Publisher(ours, qos=Qos(Policy.Partition([qos["partition"]])) if "partition" in qos else Qos())
    told = [Policy.Ownership.Exclusive] if "ownership" in qos else []
    writer = DataWriter(publisher, Topic(ours, f"rt{HEARD[0]}", topic_type(HEARD[1])), qos=Qos(*told))
    fault = first_fault(domain, skip=lambda fault: says not in fault.text)
    assert fault.reason == "silent" and HEARD[0] in fault.text
    del writer


def test_programs_without_topics_are_told() -> None:
    from cartier_ros.dds.topics import participant

    domain = any_domain()
    ours = participant(domain)
    fault = first_fault(domain)
    assert f"1 programs are in domain {domain}, and publish nothing that is heard" in fault.text
    del ours


def test_who_is_gone_was_there() -> None:
    from cartier_ros.dds.topics import Writer, participant

    domain = any_domain()
    others = [Writer(participant(domain), "/chatter", "std_msgs/msg/String")]
    told = list[str]()

    def skip(fault: Fault) -> bool:
        told.append(fault.text)
        if "1 topics are published" in fault.text:
            others.clear()
            gc.collect()  # a participant leaves when nothing refers to it any more
        return "is gone" not in fault.text

    text = first_fault(domain, skip=skip).text
    assert "is gone; before that: 1 topics are published" in text and "nobody publishes" not in told[-1]


def test_pictures_of_other_types_are_named() -> None:
    from cartier_ros.dds.topics import Writer, participant

    domain = any_domain()
    cloud = Writer(participant(domain), "/points", "sensor_msgs/msg/PointCloud2")
    assert "these are not read: /points (sensor_msgs/msg/PointCloud2)" in first_fault(domain).text
    del cloud


@pytest.mark.parametrize(
    ("name", "needed", "options"),
    [
        ("/camera/color/image_raw", "must be sensor_msgs/msg/Image or sensor_msgs/msg/CompressedImage", {}),
        ("/camera/color/camera_info", "must be sensor_msgs/msg/CameraInfo", {}),
        ("/tf", "must be tf2_msgs/msg/TFMessage", {}),
        ("/wheels", "must be nav_msgs/msg/Odometry or geometry_msgs/msg/PoseStamped", {"odometry": "wheels"}),
    ],
)
def test_topics_of_wrong_types_are_named(name: str, needed: str, options: dict[str, Any]) -> None:
    from cartier_ros.dds.topics import Writer, participant

    domain = any_domain()
    wrong = Writer(participant(domain), name, "std_msgs/msg/String")
    fault = first_fault(
        domain, skip=lambda fault: f"{name} is std_msgs/msg/String, and {needed}" not in fault.text, **options
    )
    assert fault.reason == "silent"
    del wrong


def test_a_range_of_discovery_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier_ros.dds.domain import RANGE

    def told() -> str:
        text = first_fault(any_domain(), skip=lambda _: False).text
        return text if "nobody publishes in" in text else told()  # another test may be there

    for name in RANGE:
        monkeypatch.delenv(name, raising=False)
    assert "This shell has" not in told()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.7")
    text = told()
    assert "This shell has ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, ROS_STATIC_PEERS=10.0.0.7" in text
    assert "name the peers in CYCLONEDDS_URI" in text


def test_images_that_are_lost_are_counted() -> None:
    domain = any_domain()
    with peer(sys.executable, CAMERA, domain, "gaps", 400):
        fault = first_fault(domain, skip=lambda fault: fault.reason != "lost")
    assert fault.frames == 5
    assert "did not arrive" in fault.text


def test_gaps_are_counted_by_the_usual_step() -> None:
    gaps = Gaps()
    stamps = [k * 33_000_000 + k % 3 * 4_000_000 for k in range(40)]
    assert not any(gaps.add(ns) for ns in stamps)
    assert gaps.add(stamps[-1] + 4 * 33_000_000) == 3
    assert gaps.add(stamps[-1] + 20 * 10**9) == 0  # a pause
    assert gaps.add(0) == 0  # the clock went back
    assert Gaps().add(5) == 0


def test_rubbish_on_a_topic_is_left_out() -> None:
    from bags import Messages

    from cartier_ros.dds.topics import Writer, participant

    domain, m = any_domain(), Messages()
    with peer(sys.executable, CAMERA, domain, "raw", 400):
        ours = participant(domain)
        images = Writer(ours, "/camera/color/image_raw", "sensor_msgs/msg/Image")
        transforms = Writer(ours, "/tf", "tf2_msgs/msg/TFMessage")
        frames, faults = 0, list[Fault]()
        source = open_source("ros2", domain=domain)
        patience = threading.Timer(40, source.close)
        patience.start()
        for event in source:
            if isinstance(event, Fault):
                faults.append(event)
                continue
            frames += 1
            images.write(m.bytes_of(m.image(event.stamp_ns + 10**7, "camera_optical", np.zeros((0, 0)), "rgb8")))
            transforms.write(m.bytes_of(m.transforms((event.stamp_ns, "odom", "\x1b[31mbase", np.eye(4)))))
            if frames >= 30:
                source.close()
    patience.cancel()
    assert frames == 30
    told = [fault.text for fault in faults if fault.reason == "unreadable"]
    assert any("an image of /camera/color/image_raw is empty" in text for text in told)
    assert any("no name of a topic or a frame" in text for text in told)
    assert not any("\x1b" in text for text in told)


def test_bytes_that_are_no_message_do_not_leave() -> None:
    from cartier_ros.dds.topics import Writer, participant

    writer = Writer(participant(any_domain()), "/tf", "tf2_msgs/msg/TFMessage")
    with pytest.raises(BackendError, match="DDS did not take a message of tf2_msgs"):
        writer.write(b"\0\1\0\0\xff\xff\xff\xff")


@pytest.mark.parametrize("domain", [-1, 233, "home"])
def test_an_impossible_domain_is_refused(domain: Any) -> None:
    with pytest.raises(BackendError, match=r"source ros2: the domain .* 0 to 232"):
        open_source("ros2", domain=domain)


def test_without_cyclonedds_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    with pytest.raises(MissingExtra, match=r"\[ros\]"):
        open_source("ros2")


@contextmanager
def cartier(*words: object) -> Iterator[subprocess.Popen[str]]:
    """The command in a process of its own, ended when the block is left."""
    command = [sys.executable, "-m", "cartier", *map(str, words)]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module", params=["mcap", "ros1"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("rosbags", reason="needs cartier[ros]")
    from bags import write_bag

    path = tmp_path_factory.mktemp("walk") / "room"
    write_bag(WALK, path, request.param)
    return path


def test_a_bag_that_is_played_is_heard_whole(bag: Path) -> None:
    domain = any_domain()
    with cartier("play", bag, "--domain", domain) as player:
        frames = some_frames(domain, len(WALK))
        out, err = player.communicate(timeout=20)
    assert [each.frame.index for each in frames] == list(range(len(WALK)))
    for each in frames:
        true = WALK[each.frame.index]
        np.testing.assert_allclose(each.frame.world_from_camera, true.world_from_camera, atol=1e-6)
        np.testing.assert_array_equal(each.frame.rgb, true.rgb)
        assert each.frame.depth_m is not None
        np.testing.assert_allclose(each.frame.depth_m, true.depth_m, atol=0.001)
    assert f"/camera/color/image_raw: {len(WALK)} messages" in out
    assert "waiting for somebody" in err


def test_a_bag_is_played_in_its_time(bag: Path) -> None:
    from cartier_ros.bags.bag import Bag
    from cartier_ros.streams.topic_player import TopicPlayer

    player, begin = TopicPlayer(Bag(bag), any_domain(), 4.0), time.monotonic()
    sent = player.play()
    assert time.monotonic() - begin >= (len(WALK) - 1) * 0.1 / 4
    assert sent.total() == player.count
    assert player.damaged == player.left_out == []


def test_a_played_bag_is_checked_and_mapped(tmp_path: Path) -> None:
    from bags import write_bag

    from cartier import Home
    from cartier_ros.bags.bag import Bag
    from cartier_ros.streams.topic_player import TopicPlayer

    write_bag(studio(), tmp_path / "flat")
    domain = any_domain()

    def heard(*words: object) -> dict[str, Any]:
        """What the command says at its end of the bag, which is played to it over DDS."""
        told = ("--domain", domain, "--seconds", 4, "--json")
        player = TopicPlayer(Bag(tmp_path / "flat"), domain, 1.0)
        playing = threading.Thread(target=lambda: player.wait() and player.play())
        playing.start()
        result = CliRunner().invoke(app, [str(word) for word in ("live", *words, *told)])
        player.close()
        playing.join()
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout.splitlines()[-1])  # type: ignore[no-any-return]

    report = heard("--check", "ros2")
    assert report["ok"], report["faults"]
    assert report["frames"] >= len(studio()) - 2
    state = heard(tmp_path / "home", "--from", "ros2", "--detector", "embedded")
    assert state["frames_in"] >= len(studio()) - 2, state
    assert "bed" in Home.load(tmp_path / "home").names


@pytest.mark.parametrize("layout", ["humble", "yolo"])
def test_detections_by_topic_come_with_frames(tmp_path: Path, layout: str) -> None:
    topic_detections = pytest.importorskip("topic_detections", reason="needs cartier[ros]")
    from cartier_ros.bags.bag import Bag
    from cartier_ros.streams.topic_player import TopicPlayer

    short, eyes, domain = replace(WALK, poses=WALK.poses[:6]), TrueBoxes(THINGS), any_domain()
    topic_detections.write(tmp_path / "bag", short, eyes, layout)
    player = TopicPlayer(Bag(tmp_path / "bag"), domain, 1.0)
    playing = threading.Thread(target=lambda: player.wait() and player.play())
    playing.start()
    try:
        frames = some_frames(domain, len(short.poses) - 1, detections=topic_detections.TOPIC)
    finally:
        player.close()
        playing.join()
    for each in frames:
        true = eyes.detect(short[round((each.frame.time_s * 1e9 - topic_detections.START_NS) / 1e8)])
        assert each.detections is not None and each.detections.labels == true.labels
        np.testing.assert_allclose(each.detections.boxes_xyxy, true.boxes_xyxy, atol=1e-4)


def test_a_topic_without_detections_is_told() -> None:
    domain = any_domain()
    with peer(sys.executable, CAMERA, domain, "raw", 400):
        says = first_fault(domain, lambda fault: "no detections can come" not in fault.text, detections="/tf").text
    assert "it holds tf2_msgs/msg/TFMessage; topics of detections: none" in says


def test_a_player_refuses_what_it_cannot_play(tmp_path: Path) -> None:
    from bags import BagFile

    from cartier_ros.bags.bag import Bag
    from cartier_ros.streams.topic_player import TopicPlayer

    with BagFile(tmp_path / "talk") as out:
        out.put("/chatter", 1, out.messages("std_msgs/msg/String", data="hello"))
    with pytest.raises(InputError, match="holds no images to play"):
        TopicPlayer(Bag(tmp_path / "talk"), any_domain(), 1.0)
    for words, says in (
        (("play", tmp_path), "is no ROS bag"),
        (("play", tmp_path / "talk", "--speed", "0"), "--speed"),
    ):
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code == 1 and isinstance(result.exception, InputError)
        assert says in str(result.exception) and "\n" not in str(result.exception)


def test_a_source_is_closed_from_another_thread() -> None:
    source: Source = open_source("ros2", domain=any_domain())
    events = iter(source)
    next(events)
    source.close()
    begin = time.monotonic()
    assert list(events) == []
    assert time.monotonic() - begin < 1
