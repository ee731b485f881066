"""What cartier publishes on ROS 2 topics, read by types that were written down by hand: objects, markers, answers."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from peers import LOOPBACK, any_domain

from cartier import Home, plugins
from cartier.pipeline import map_home
from cartier.types import MapObject, OrientedBox
from studio import saved_studio
from synthetic import THINGS, TrueBoxes, walk

for needed in ("cyclonedds", "rosbags"):
    pytest.importorskip(needed, reason="needs cartier[ros]")
ros = pytest.importorskip("ros_objects")


def thing(number: int, label: str, **changes: Any) -> MapObject:
    low, high = (1.0, 2.0, 0.0), (1.5, 3.0, 0.8)
    fields: dict[str, Any] = {"probability": 0.9, "confirmed": True, "n_detected": 5, "n_observable": 6} | changes
    return MapObject(number, label, ((label, 1.0),), (1.25, 2.5, 0.4), low, high, first_seen_s=0, last_seen_s=1,
                     last_looked_s=1, views=(), **fields)  # fmt: skip


OBJECTS = (
    thing(3, "chair"),
    thing(4, "ghost", confirmed=False, probability=0.4),
    thing(9, "café table", oriented=OrientedBox((1.0, 2.0, 0.5), (2.0, 1.0, 0.0), 0.3)),
)


def test_objects_are_detections_on_the_wire() -> None:
    from cartier_ros.dds.objects import detections
    from cartier_ros.dds.types import encoded

    told = ros.Detections.deserialize(encoded(detections(OBJECTS, "odom")))
    assert [one.id for one in told.detections] == ["3", "9"]
    assert {told.header.frame_id, *(one.header.frame_id for one in told.detections)} == {"odom"}
    chair, table = told.detections
    (result,) = chair.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("chair", 0.9)
    assert chair.bbox.center == result.pose.pose
    p, q, s = chair.bbox.center.position, chair.bbox.center.orientation, chair.bbox.size
    assert [p.x, p.y, p.z, q.x, q.y, q.z, q.w, s.x, s.y, s.z] == [1.25, 2.5, 0.4, 0, 0, 0, 1, 0.5, 1.0, 0.8]
    p, q, s = table.bbox.center.position, table.bbox.center.orientation, table.bbox.size
    assert [p.x, p.y, p.z, s.x, s.y, s.z] == [1.0, 2.0, 0.5, 2.0, 1.0, 0.01]
    assert (q.z, q.w) == (math.sin(0.15), math.cos(0.15))
    assert table.results[0].hypothesis.class_id == "café table"


def test_markers_take_the_old_ones_away_and_show_box_and_label() -> None:
    from cartier_ros.dds.objects import markers
    from cartier_ros.dds.types import encoded

    told = ros.Markers.deserialize(encoded(markers(OBJECTS, "map"))).markers
    assert [(m.id, m.type, m.action, m.text) for m in told] == [
        (0, 1, 3, ""),
        (6, 1, 0, ""),
        (7, 9, 0, "chair"),
        (18, 1, 0, ""),
        (19, 9, 0, "café table"),
    ]
    _, box, label, other, _ = told
    assert (box.header.frame_id, box.ns) == ("map", "cartier")
    assert [box.scale.x, box.scale.y, box.scale.z] == [0.5, 1.0, 0.8]
    assert 0 < box.color.a < 1 < 3 * max(box.color.r, box.color.g, box.color.b)
    assert (box.color.r, box.color.g, box.color.b) != (other.color.r, other.color.g, other.color.b)
    assert label.pose.position.z > 0.8


def test_types_are_those_of_ros() -> None:
    from cartier_ros.dds.types import store

    # the hash that other implementations of ROS 2 tell of vision_msgs 4
    told = "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
    assert store().hash_rihs01("vision_msgs/msg/Detection3DArray") == told


class Outside:
    """A program on the same domain: hears objects, markers and answers, and asks."""

    def __init__(self, domain: int) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        participant = DomainParticipant(domain)
        reliable = Policy.Reliability.Reliable(duration(seconds=1))
        latched = Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
        topic = lambda name, kind: Topic(participant, f"rt/cartier/{name}", kind)  # noqa: E731
        self.objects = DataReader(participant, topic("objects", ros.Detections), qos=latched)
        self.markers = DataReader(participant, topic("markers", ros.Markers), qos=latched)
        self.answers = DataReader(
            participant, topic("answer", ros.String), qos=Qos(reliable, Policy.History.KeepLast(9))
        )
        self.asks = DataWriter(participant, topic("ask", ros.String), qos=Qos(reliable))

    def ask(self, words: str) -> dict[str, Any]:
        self.asks.write(ros.String(words))
        return json.loads(until(lambda: heard(self.answers)).data)  # type: ignore[no-any-return]


def heard(reader: Any) -> Any:
    """The newest message of a reader, or None."""
    return next((each for each in reversed(reader.take(50)) if each.sample_info.valid_data), None)


def until(told: Callable[[], Any], limit_s: float = 40.0) -> Any:
    end = time.monotonic() + limit_s
    while (found := told()) is None:
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.05)
    return found


def test_a_live_home_is_published_and_answers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    domain = any_domain()
    folder = saved_studio(tmp_path / "studio")
    command = [sys.executable, "-m", "cartier", "live", str(tmp_path / "home"), "--from", f"bag:{folder}@0.2"]
    command += ["--publish", "--domain", str(domain), "--reasoner", "embedded", "--detector", "embedded"]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            outside = Outside(domain)
            first = until(lambda: heard(outside.objects))
            assert first.header.frame_id == "map"
            assert len(until(lambda: heard(outside.markers)).markers) >= 1 + 2 * len(first.detections) > 1
            answer = outside.ask("is there a swimming pool?")
            assert answer["words"] == "is there a swimming pool?"
            assert answer["text"].startswith("Not seen yet") and answer["as_of"]["not_seen_yet"]
            assert "error" in outside.ask("   ")
            process.terminate()
            err = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    assert f"domain {domain}: /cartier/objects" in err
    last = heard(outside.objects) or first
    home = Home.load(tmp_path / "home")
    assert sorted(one.id for one in last.detections) == sorted(str(obj.id) for obj in home.objects if obj.confirmed)


def test_questions_are_answered_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier.serving.operations import Operations
    from cartier_ros.served_topics import HomeTopics

    class One:
        names, asker = ("room",), ""

        def name(self, home: str = "") -> str:
            return "room"

        def get(self, home: str = "") -> Home:
            return room

        def moment(self) -> None:
            return None

        def start_xy(self, home: Home) -> tuple[float, float]:
            return home.start_xy

    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    room = map_home(walk(), TrueBoxes(THINGS))
    domain = any_domain()
    operations = Operations(One(), plugins.make("reasoners", "embedded"))
    topics = HomeTopics(operations, domain, lambda: "map")
    outside = Outside(domain)
    until(lambda: outside.asks.get_matched_subscriptions() or None)
    until(lambda: outside.answers.get_matched_publications() or None)
    first = outside.ask("bring me to the table")
    assert first["object"] == "table"
    assert outside.ask("how many of them are there?")["status"] == "answered"
    assert until(lambda: heard(outside.objects)).detections
    topics.close()
