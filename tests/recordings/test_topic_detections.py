"""Detections that a bag holds: what they say, and that their map is that of the same detector in process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cartier.errors import InputError
from cartier.types import Camera, Detections, DetectorScoreModel, Frame

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")

import topic_detections
from bags import FRAME, START_NS, BagFile, Messages, opened, write_images, write_transforms
from topic_detections import TOPIC, Writer

from cartier.cli import app
from cartier.home import Home
from cartier.live.session import Live
from cartier.pipeline import map_home
from cartier.recordings.common.lens import Lens, resampled, straightened
from cartier.sources import open_source
from cartier.types.streams import Fault
from cartier_ros.bags.detections import BOXES_2D, read_detections
from cartier_ros.bags.topics import Choice, Stream
from synthetic import CAMERA, THINGS, TrueBoxes, walk

WALK = replace(walk(), poses=walk().poses[::2])


class Eyes:
    """The detector on the robot: true boxes, by frame number, with unmeasured scores."""

    name, score_model = "a robot's detector", DetectorScoreModel()

    def detect(self, frame: Frame) -> Detections:
        found = TrueBoxes(THINGS).detect(WALK[frame.index])
        return replace(found, frame=frame.index, scores=np.full(len(found), 0.8, np.float32))


def choice(lens: Lens | None = None, frame: str = FRAME) -> Choice:
    stream = Stream("/image", np.empty((0, 4), np.int64), frame, "rgb8", False, CAMERA.width, CAMERA.height)
    return Choice(stream, lens or Lens(CAMERA), None, None, ())


def told(found: Detections, layout: str = "humble", **more: Any) -> Detections:
    """What is read of a message with these detections."""
    messages = Messages()
    message = Writer(messages, layout).array(START_NS, found, **more)
    kind = message.__msgtype__
    return read_detections(messages.bytes_of(message), kind, "cdr", choice(), 0, "here")


def one(box: tuple[float, ...], label: str = "cup", score: float = 0.5) -> Detections:
    return Detections(0, np.array([box], np.float32), np.array([score], np.float32), (label,))


@pytest.mark.parametrize("layout", ["humble", "galactic", "foxy", "yolo"])
def test_a_bag_gives_what_the_detector_found(tmp_path: Path, layout: str) -> None:
    topic_detections.write(tmp_path / "bag", WALK, Eyes(), layout)
    recording: Any = opened(tmp_path / "bag", detections=TOPIC.lstrip("/"))
    assert len(recording) == len(WALK) and recording.detector.name == f"detections of {TOPIC.lstrip('/')}"
    for i in range(len(WALK)):
        mine, theirs = recording.detector.detect(recording[i]), Eyes().detect(WALK[i])
        assert mine.labels == theirs.labels and mine.frame == i
        np.testing.assert_allclose(mine.boxes_xyxy, theirs.boxes_xyxy, atol=1e-4)
        np.testing.assert_allclose(mine.scores, theirs.scores)


def same_map(one: Home, other: Home) -> None:
    assert one.objects and len(one.objects) == len(other.objects)
    for a, b in zip(one.objects, other.objects, strict=True):
        assert (a.label, a.confirmed, a.n_detected) == (b.label, b.confirmed, b.n_detected)
        np.testing.assert_allclose([*a.box_min, *a.box_max], [*b.box_min, *b.box_max], atol=1e-6)


def test_its_map_is_that_of_the_detector_in_process(tmp_path: Path) -> None:
    topic_detections.write(tmp_path / "bag", WALK, Eyes())
    recording: Any = opened(tmp_path / "bag", detections=TOPIC)
    here = map_home(opened(tmp_path / "bag"), Eyes())
    same_map(map_home(recording, recording.detector), here)
    source: Any = open_source(f"bag:{tmp_path / 'bag'}@max", detections=TOPIC)
    live = Live(source, source.detector)
    live.start()
    same_map(live.wait(), here)


def test_a_session_cut_off_keeps_its_detections(tmp_path: Path) -> None:
    topic_detections.write(tmp_path / "bag", WALK, Eyes())
    for _ in range(2):
        source: Any = open_source(f"bag:{tmp_path / 'bag'}@max", detections=TOPIC)
        live = Live(source, source.detector, spool=tmp_path / "walk.spool")
        live.start()
        home = live.wait()  # the first is never saved, as after a kill
        live._map.close()
    assert live.state().resumed and home.objects


def test_images_without_detections_are_left_out(tmp_path: Path) -> None:
    topic_detections.write(tmp_path / "bag", WALK, Eyes(), every=2)
    recording: Any = opened(tmp_path / "bag", detections=TOPIC)
    half = len(range(0, len(WALK), 2))
    assert len(recording) == half and any(f"{len(WALK) - half} images left out" in note for note in recording.notes)
    events = list(open_source(f"bag:{tmp_path / 'bag'}@max", detections=TOPIC))
    lost = [event for event in events if isinstance(event, Fault) and event.reason == "no_detections"]
    assert sum(event.frames for event in lost) == len(WALK) - half
    assert sum(not isinstance(event, Fault) for event in events) == half


def test_each_hypothesis_counts() -> None:
    messages = Messages()
    writer = Writer(messages, "humble")
    message = writer.array(START_NS, one((10, 20, 30, 60)))
    second = writer.array(START_NS, one((10, 20, 30, 60), "mug", 0.25)).detections[0].results
    message.detections[0].results += second
    found = read_detections(messages.bytes_of(message), BOXES_2D, "cdr", choice(), 0, "here")
    assert found.labels == ("cup", "mug") and found.scores.tolist() == [0.5, 0.25]
    np.testing.assert_allclose(found.boxes_xyxy, [[10, 20, 30, 60]] * 2)


def test_a_turned_box_is_bounded() -> None:
    messages = Messages()
    message = Writer(messages, "humble").array(START_NS, one((40, 50, 60, 54)))
    message.detections[0].bbox.center.theta = np.pi / 2
    found = read_detections(messages.bytes_of(message), BOXES_2D, "cdr", choice(), 0, "here")
    np.testing.assert_allclose(found.boxes_xyxy, [[48, 42, 52, 62]], atol=1e-4)


def test_boxes_reach_to_the_edge_of_the_image() -> None:
    np.testing.assert_allclose(told(one((-5, 10, 20, 125))).boxes_xyxy, [[0, 10, 20, 120]])


def test_boxes_in_space_are_projected() -> None:
    middle = np.eye(4)
    middle[:3, 3] = (0.1, -0.2, 2.0)
    found = told(one((0, 0, 1, 1)), "3d", boxes_3d=[(middle, (0.4, 0.2, 0.0))])
    u, v = 120 * np.array([-0.1, 0.3]) / 2 + 79.5, 120 * np.array([-0.3, -0.1]) / 2 + 59.5
    np.testing.assert_allclose(found.boxes_xyxy, [[u[0], v[0], u[1], v[1]]], atol=1e-4)
    middle[2, 3] = -2
    assert not len(told(one((0, 0, 1, 1)), "3d", boxes_3d=[(middle, (0.4, 0.2, 0.1))])), "behind the camera"


@pytest.mark.parametrize(
    ("found", "layout", "says"),
    [
        (one((10, 10, 20, 20), "16"), "humble", "the class '16' is a number"),
        (one((10, 10, 620, 20)), "humble", "in images of another size"),
        (one((10, 10, 20, 20), score=7.0), "yolo", "a score that is not from 0 to 1"),
    ],
)
def test_what_cannot_be_meant_is_refused(found: Detections, layout: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        told(found, layout)


def test_boxes_in_another_frame_are_refused() -> None:
    with pytest.raises(InputError, match="boxes in frame 'map'"):
        told(one((0, 0, 1, 1)), "3d", boxes_3d=[(np.eye(4), (1.0, 1.0, 1.0))], frame="map")


@pytest.mark.parametrize("cut", [8, 60, 120])
def test_a_damaged_message_is_refused_in_one_line(cut: int) -> None:
    messages = Messages()
    data = messages.bytes_of(Writer(messages, "humble").array(START_NS, one((10, 10, 20, 20))))
    with pytest.raises(InputError, match="here is damaged"):
        read_detections(data[:cut], BOXES_2D, "cdr", choice(), 0, "here")
    with pytest.raises(InputError, match="numbers for classes"):
        read_detections(data, BOXES_2D, "ros1", choice(), 0, "here")


def test_distortion_is_taken_out_of_boxes() -> None:
    lens = Lens(Camera(160, 120, 100.0, 100.0, 79.5, 59.5), "plumb_bob", (-0.25, 0.05, 0.0, 0.0))
    shown = np.zeros((120, 160), np.uint8)
    shown[20:50, 15:60] = 1  # what the box (15, 20, 60, 50) of the published image shows
    straight = resampled(shown, lens, lens.camera, 0)
    rows, cols = np.flatnonzero(straight.any(1)), np.flatnonzero(straight.any(0))
    box = straightened(np.array([15.0, 20, 60, 50]), lens)
    np.testing.assert_array_equal(box, [cols[0], rows[0], cols[-1] + 1, rows[-1] + 1])
    assert box[0] < 15 and box[1] < 20, "towards the corner"


def test_map_takes_detections_by_topic(tmp_path: Path) -> None:
    topic_detections.write(tmp_path / "bag", WALK, Eyes())
    bag, home = str(tmp_path / "bag"), str(tmp_path / "home")
    done = CliRunner().invoke(app, ["map", bag, "-o", home, "--detections", TOPIC])
    assert done.exit_code == 0 and f"detections of {TOPIC}" in done.output
    assert {"chair", "table"} <= set(Home.load(home).names)
    both = CliRunner().invoke(app, ["map", bag, "-o", home, "--detections", TOPIC, "--detector", "photos"])
    assert both.exit_code == 1 and "takes the place of a detector" in str(both.exception)
    none = CliRunner().invoke(app, ["map", bag, "-o", home, "--detections", "/tf"])
    assert none.exit_code == 1 and f"topics of detections: {TOPIC}" in str(none.exception)


def test_detections_of_another_clock_are_none(tmp_path: Path) -> None:
    with BagFile(tmp_path / "bag") as bag:
        write_images(bag, WALK)
        write_transforms(bag, [WALK[i].world_from_camera for i in range(len(WALK))])
        writer = Writer(bag.messages, "humble")
        for i in range(len(WALK)):
            ns = START_NS + i * 10**8
            bag.put(TOPIC, ns, writer.array(ns + 5 * 10**6, Eyes().detect(WALK[i])))
    with pytest.raises(InputError, match=f"no message of {TOPIC} has their stamp"):
        opened(tmp_path / "bag", detections=TOPIC)
