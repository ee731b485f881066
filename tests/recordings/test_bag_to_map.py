"""A home recorded, written as a bag by rosbags, and mapped from the bag: the same things in the same places."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from cartier import plugins
from cartier.pipeline import map_home
from cartier.types import FREE, Detections, Frame

if importlib.util.find_spec("rosbags") is None:
    pytest.skip("the bag reader needs cartier[ros]", allow_module_level=True)

from bags import write_bag


class Remembered:
    """Ground-truth boxes of the recording, by frame number: a bag carries no instances."""

    name, min_views = "ground truth (dollhouse), remembered", 1

    def __init__(self, seen: list[Detections]) -> None:
        self.seen = seen

    def detect(self, frame: Frame) -> Detections:
        return self.seen[frame.index]


def test_a_dollhouse_home_maps_from_its_bag_as_it_does_directly(tmp_path: Path) -> None:
    world = plugins.make("worlds", "dollhouse", width=160, height=120)
    recording = world.explore("7", max_frames=20)
    truth = plugins.make("detectors", "ground_truth", truth=recording.truth, source="dollhouse")
    found = [truth.detect(recording[i]) for i in range(len(recording))]
    eyes = Remembered([Detections(d.frame, d.boxes_xyxy, d.scores, d.labels) for d in found])
    write_bag(recording, tmp_path / "home.mcap")
    direct, from_bag = (
        map_home(source, eyes) for source in (recording, plugins.open_recording(tmp_path / "home.mcap"))
    )
    assert len(direct.names) >= 10 and from_bag.names == direct.names  # enough to compare
    for index in ("object_depth", "object_viewpoint"):
        for name in direct.names:
            mine, theirs = from_bag.index(index)[1].locate(name), direct.index(index)[1].locate(name)
            assert (mine is None) == (theirs is None)
            if mine is not None and theirs is not None:
                np.testing.assert_allclose(mine.position, theirs.position, atol=0.01)
    assert from_bag.grid is not None and direct.grid is not None
    free = [int((home.grid.cells == FREE).sum()) for home in (from_bag, direct)]
    assert free[0] == pytest.approx(free[1], rel=0.02)  # a bag's depth is in millimetres
