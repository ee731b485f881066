"""Topics of DDS in one process: what is kept, what is asked for; transforms, and drives that are judged by them."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from bags import Messages
from peers import LOOPBACK, any_domain, goal_at

from cartier.types import DriveProgress
from cartier_ros.robots.transforms import Latest
from synthetic import CAMERA

for needed in ("cyclonedds", "rosbags"):
    pytest.importorskip(needed, reason="needs cartier[ros]")

GOAL = goal_at(2.0, 0.0, 1.0)


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)


def heard(reader: Any, count: int) -> list[bytes]:
    found, end = list[bytes](), time.monotonic() + 5
    while len(found) < count and time.monotonic() < end:
        found += reader.take()
        time.sleep(0.02)
    time.sleep(0.1)
    return [*found, *reader.take()]


def test_who_comes_later_gets_every_latched_message() -> None:
    from cartier_ros.dds.topics import Offer, Publishers, Reader, Writer, participant

    domain, m = any_domain(), Messages()
    ours, theirs = participant(domain), participant(domain)
    writer = Writer(ours, "/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
    plain = Writer(ours, "/tf", "tf2_msgs/msg/TFMessage")
    sent = [m.bytes_of(m.transforms((k, "map", f"frame_{k}", np.eye(4)))) for k in range(5)]
    for data in sent:
        writer.write(data)
        plain.write(data)
    publishers, offers = Publishers(theirs), dict[str, Offer]()
    while len(offers) < 2:
        offers = publishers.offers()
    assert offers["/tf_static"] == Offer("/tf_static", "tf2_msgs/msg/TFMessage", True, True)
    assert offers["/tf"].latched is False
    assert heard(Reader(theirs, offers["/tf_static"], 1), 5) == sent
    assert heard(Reader(theirs, offers["/tf"], 10), 0) == []
    assert writer.received(1.0)


def test_large_buffers_are_asked_for_and_the_environment_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier_ros.dds import topics

    seen = list[str]()
    monkeypatch.setattr(topics, "DomainParticipant", lambda domain: seen.append(os.environ["CYCLONEDDS_URI"]))
    topics.participant(3)
    assert os.environ["CYCLONEDDS_URI"] == LOOPBACK
    monkeypatch.delenv("CYCLONEDDS_URI")
    topics.participant(3)
    assert "CYCLONEDDS_URI" not in os.environ
    assert all('SocketReceiveBufferSize max="10000000B"' in uri for uri in seen)
    assert seen[0].endswith(LOOPBACK) and not seen[1].endswith(LOOPBACK)  # what the person says comes last, and holds


def test_what_linux_lets_a_socket_hold_is_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    from cartier_ros.dds import topics

    for text, limit in (("212992\n", 212992), ("20000000\n", None), ("much", None)):
        (tmp_path / "rmem_max").write_text(text)
        monkeypatch.setattr(topics, "RMEM_MAX", str(tmp_path / "rmem_max"))
        assert topics.socket_limit() == limit


def test_other_images_are_no_longer_heard_once_the_topics_are_chosen() -> None:
    from cartier.sources import open_source
    from cartier.types.streams import Stamped
    from cartier_ros.dds.topics import Writer, participant

    domain, m = any_domain(), Messages()
    ours = participant(domain)
    names = ("/camera/color/image_raw", "/camera/depth/image_raw", "/other/color/image_raw")
    colour, depth, other = (Writer(ours, name, "sensor_msgs/msg/Image") for name in names)
    info = Writer(ours, "/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", latched=True)
    tf = Writer(ours, "/tf", "tf2_msgs/msg/TFMessage")
    info.write(m.bytes_of(m.info(0, "optical", CAMERA)))
    counts, ended = list[int](), threading.Event()

    def send() -> None:
        for k in range(200):
            ns = 10**18 + k * 10**8
            tf.write(m.bytes_of(m.transforms((ns, "map", "optical", np.eye(4)))))
            colour.write(m.bytes_of(m.image(ns, "optical", np.zeros((120, 160, 3), np.uint8), "rgb8")))
            depth.write(m.bytes_of(m.image(ns, "optical", np.full((120, 160), 900, np.uint16), "16UC1")))
            counts.append(other.listeners())
            if ended.wait(0.05):
                return

    source = open_source("ros2", domain=domain)
    threading.Thread(target=send, daemon=True).start()
    patience = threading.Timer(20, source.close)
    patience.start()
    frames = 0
    for event in source:
        frames += isinstance(event, Stamped)
        if frames >= 30:
            source.close()
    ended.set()
    patience.cancel()
    assert 1 in counts
    assert counts[-1] == 0


def test_frames_are_chained_and_bounded() -> None:
    m, latest = Messages(), Latest()
    turn = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert latest.add(m.bytes_of(m.transforms((0, "map", "odom", turn), (0, "odom", "base", turn))))
    found = latest.lookup("map", "base")
    assert found is not None
    np.testing.assert_allclose(found, turn @ turn, atol=1e-12)
    assert latest.lookup("map", "wheel") is None
    assert latest.lookup("base", "map") is None
    assert not latest.add(b"\0\1\0\0\5\0\0\0")
    latest.add(m.bytes_of(m.transforms((0, "a", "b", turn), (0, "b", "a", turn))))
    assert latest.lookup("map", "a") is None  # a circle
    for k in range(0, 1200, 200):
        latest.add(m.bytes_of(m.transforms(*((0, "map", f"f{j}", turn) for j in range(k, k + 200)))))
    assert latest.lookup("map", "f100") is not None
    assert latest.lookup("map", "f1199") is None


class Scripted:
    """A robot that is at given poses, one each time it is asked, and then stays."""

    def __init__(self, poses: Sequence[tuple[float, float, float] | None], silent: float = 0.0) -> None:
        self.poses, self.silent, self.asked = poses, silent, 0

    def now(self) -> tuple[float, float, float] | None:
        self.asked += 1
        return self.poses[min(self.asked, len(self.poses)) - 1]

    def silent_s(self) -> float:
        return self.silent


def driven(
    monkeypatch: pytest.MonkeyPatch, poses: Sequence[tuple[float, float, float] | None], silent: float = 0.0
) -> DriveProgress:
    """How a drive ends, where what takes seconds takes tenths."""
    from cartier_ros.robots import dds

    for name, value in {"STILL_S": 0.2, "STUCK_S": 0.6, "SILENT_S": 1.0, "POLL_S": 0.01, "TELL_S": 0.1}.items():
        monkeypatch.setattr(dds, name, value)
    return list(dds.follow(GOAL, "sent", Scripted(poses, silent), threading.Event()))[-1]


def test_who_stands_at_the_goal_has_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    way = [(x / 10, 0.0, 0.0) for x in range(20)]
    last = driven(monkeypatch, [*way, (2.1, 0.1, 1.2)])
    assert last.status == "arrived"
    assert last.left_m == pytest.approx(math.hypot(0.1, 0.1))


@pytest.mark.parametrize("end", [(1.7, 0.0, 1.0), (2.0, 0.0, 1.3), (2.0, 0.0, 1.0 - math.pi)])
def test_who_stands_elsewhere_or_looks_elsewhere_has_not(
    end: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    last = driven(monkeypatch, [(0.0, 0.0, 0.0), end])
    assert last.status == "failed"
    assert "has not moved" in last.text


def test_who_drives_past_the_goal_has_not_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    past = [(1.8 + k * 0.03, 0.0, 1.0) for k in range(40)]
    assert driven(monkeypatch, past).status == "failed"


def test_who_turns_on_the_spot_is_not_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    turns = [(1.0, 0.0, k * 0.1) for k in range(60)]
    assert driven(monkeypatch, [*turns, (2.0, 0.0, 1.0)]).status == "arrived"


def test_silence_and_the_unknown_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    silent = driven(monkeypatch, [(0.0, 0.0, 0.0)], silent=2.0)
    assert silent.status == "failed"
    assert "stopped coming 2.00 m short" in silent.text
    assert driven(monkeypatch, [None]).status == "unknown"


def test_a_goal_is_over_once_it_was_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier_ros.dds.topics import Writer, participant
    from cartier_ros.dds.types import encoded, message
    from cartier_ros.robots.dds import STATUS_ARRAY, GoalStatus

    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    domain, name = any_domain(), "/navigate_to_pose/_action/status"
    server = Writer(participant(domain), name, STATUS_ARRAY, 1, latched=True)
    stamp = message("builtin_interfaces/msg/Time", sec=1, nanosec=0)

    def tell(*statuses: int) -> None:
        goals = [
            message(
                "action_msgs/msg/GoalInfo", goal_id=message("unique_identifier_msgs/msg/UUID", uuid=uuid), stamp=stamp
            )
            for uuid in np.arange(len(statuses) * 16, dtype=np.uint8).reshape(-1, 16)
        ]
        told = [
            message("action_msgs/msg/GoalStatus", goal_info=g, status=s) for g, s in zip(goals, statuses, strict=True)
        ]
        server.write(encoded(message(STATUS_ARRAY, status_list=told)))
        assert server.received(5)
        time.sleep(0.05)

    heard = GoalStatus(participant(domain), name)
    assert not heard.over()
    tell(4)
    end = time.monotonic() + 10
    while not server.listeners() and time.monotonic() < end:
        heard.begin()
        time.sleep(0.02)
    time.sleep(0.1)
    heard.begin()
    assert not heard.over(), "the goal before is none of this drive"
    tell(4, 2)
    assert not heard.over()
    tell(4, 5)
    assert heard.over() and not heard.arrived
    heard.begin()
    tell(4, 5, 4)
    assert heard.over() and heard.arrived
