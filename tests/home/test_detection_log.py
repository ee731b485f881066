"""The log of detections: all of every processed frame with their objects, bounded, and read with care."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.home import detection_log
from cartier.home.detection_log import DetectionLog
from cartier.home.entity import DETECTIONS, Home
from cartier.io.files import npz_bytes, read_npz
from cartier.mapping.mapper import Mapper
from cartier.mapping.object_map import ObjectMap
from cartier.pipeline import map_home
from cartier.types import Detections, Frame
from synthetic import THINGS, TrueBoxes
from synthetic import small_walk as walk


class Every(TrueBoxes):
    """Says what it was asked, and also reports a thing that no depth bears out, weakly and first."""

    score_model = replace(TrueBoxes.score_model, spawn_threshold=0.01)

    def __init__(self) -> None:
        super().__init__(THINGS)
        self.told: dict[int, Detections] = {}

    def detect(self, frame: Frame) -> Detections:
        found = super().detect(frame)
        boxes = np.concatenate([[[0, 0, 3, 3]], found.boxes_xyxy]).astype(np.float32)
        scores = np.linspace(0.001, 1, len(boxes)).astype(np.float32)  # weakest first
        self.told[frame.index] = Detections(frame.index, boxes, scores, ("ghost", *found.labels))
        return self.told[frame.index]


def test_a_home_keeps_every_box_of_every_frame_that_was_looked_at(tmp_path: Path) -> None:
    detector = Every()
    map_home(walk(), detector, every=3).save(tmp_path)
    home = Home.load(tmp_path)
    log = home.detections()
    assert log is not None
    looked = log.looked()
    assert list(looked) == list(range(0, len(walk()), 3)) and log.least == 0
    objects = {number: obj for obj in home.objects for number in (obj.id, *obj.aliases)}
    for number, seen in looked.items():
        told = detector.told[number]
        assert sorted(seen.detections.labels) == sorted(told.labels)
        np.testing.assert_allclose(seen.detections.scores, np.sort(told.scores)[::-1], atol=1e-3)
        for label, box, owner in zip(seen.detections.labels, seen.detections.boxes_xyxy, seen.objects, strict=True):
            assert box.tolist() == np.rint(told.boxes_xyxy[told.labels.index(label)]).tolist()
            assert owner == -1 or objects[int(owner)].label == label, "each box is of the object that it made"
    given = [int(owner) for seen in looked.values() for owner in seen.objects]
    assert set(given) - {-1} == set(objects) and -1 in given


def test_ids_come_in_the_order_of_the_detections() -> None:
    frame, upwards = walk()[0], Every()
    told = upwards.detect(frame)
    a, b = ObjectMap(Every.score_model), ObjectMap(Every.score_model)
    backwards = np.arange(len(told))[::-1]
    ids, mirrored = a.add(frame, told), b.add(frame, told.keep(backwards))
    assert len(set(ids.tolist())) > 1 and mirrored[backwards].tolist() == ids.tolist()


def test_it_grows_with_its_home() -> None:
    first, recording = Mapper(Every()), walk()
    for number in range(4):
        first.add(recording[number])
    second = Mapper(Every(), onto=first.home())
    second.add(recording[5])
    log = second.home().detections()
    assert log is not None and list(log.looked()) == [0, 1, 2, 3, 5]


def test_its_size_is_bounded_and_the_surest_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection_log, "MAX_BOXES", 100)
    log, chance = DetectionLog(), np.random.default_rng(0)
    scores = chance.uniform(0, 1, (40, 5)).astype(np.float32)
    for frame, row in enumerate(scores):
        log.add(Detections(frame, np.zeros((5, 4)), row, tuple("abcde")), np.arange(5))
    looked = log.looked()
    kept = np.concatenate([seen.detections.scores for seen in looked.values()])
    assert len(looked) == 40 and 50 <= len(kept) <= 100 and log.least > 0.3
    early = [float(score) for frame in range(20) for score in looked[frame].detections.scores]
    assert sorted(early) == sorted(float(score) for score in scores[:20].ravel() if score >= log.least)
    for frame, seen in looked.items():
        for label, score in zip(seen.detections.labels, seen.detections.scores, strict=True):
            assert scores[frame]["abcde".index(label)] == score


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("counts", np.array([9], np.int32)),
        ("counts", np.array([[2]], np.int32)),
        ("counts", np.array([-1], np.int32)),
        ("labels", np.array([0, 7], np.int32)),
        ("labels", np.array([0, -1], np.int32)),
        ("boxes_px", np.zeros((2, 3), np.int16)),
        ("objects", np.zeros(1, np.int32)),
        ("scores", np.zeros(2)),
        ("names", np.array(3)),
        ("least", np.zeros(2)),
    ],
)
def test_a_damaged_one_is_one_line(name: str, value: np.ndarray) -> None:
    log = DetectionLog()
    log.add(Detections(0, np.zeros((2, 4)), np.ones(2), ("a", "b")), np.array([1, -1]))
    arrays = read_npz(log.state())
    DetectionLog().restore(npz_bytes(**arrays))
    with pytest.raises(InputError, match="the log of detections is damaged"):
        DetectionLog().restore(npz_bytes(**(arrays | {name: value})))


def test_a_home_without_one_cannot_be_grown_and_says_so() -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    older = replace(home, growth={name: data for name, data in home.growth.items() if name != DETECTIONS})
    assert older.detections() is None
    with pytest.raises(InputError, match=r"keeps no detections\.npz to go on from: map it again"):
        Mapper(TrueBoxes(THINGS), onto=older)
