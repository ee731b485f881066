from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import BackendError
from synthetic import THINGS, TrueBoxes, walk


def eyes(**options: Any) -> Any:
    return plugins.make("detectors", "ground_truth", truth=THINGS, **options)


def test_it_sees_what_the_instances_show_and_calls_itself_ground_truth() -> None:
    recording, peer = walk(), TrueBoxes(THINGS, with_masks=True)
    detector = eyes(min_pixels=20, source="dollhouse")
    assert detector.name == "ground truth (dollhouse)"
    for number in range(len(recording)):
        ours, theirs = detector.detect(recording[number]), peer.detect(recording[number])
        assert ours.labels == theirs.labels and np.array_equal(ours.boxes_xyxy, theirs.boxes_xyxy)
        assert ours.masks is not None and np.array_equal(ours.masks, theirs.masks)


def test_small_things_are_missed_more_and_the_seed_decides() -> None:
    recording = walk()
    frames = [recording[number] for number in range(len(recording))]
    full = [eyes(min_pixels=20).detect(frame).labels for frame in frames]

    def share(label: str, **options: Any) -> float:
        seen = 0
        for seed in range(10):
            detector = eyes(min_pixels=20, seed=seed, **options)
            assert "misses" in detector.name
            seen += sum(label in detector.detect(frame).labels for frame in frames)
        return seen / (10 * sum(label in labels for labels in full))

    assert share("mug", misses=0.8) < share("table", misses=0.8) - 0.2
    a, b = eyes(jitter=0.1, seed=5), eyes(jitter=0.1, seed=5)
    assert np.array_equal(a.detect(frames[3]).boxes_xyxy, b.detect(frames[3]).boxes_xyxy)
    assert not np.array_equal(a.detect(frames[3]).boxes_xyxy, eyes(jitter=0.1, seed=6).detect(frames[3]).boxes_xyxy)


def test_confusion_gives_other_names_of_the_same_home() -> None:
    recording, confused = walk(), eyes(confusion=1.0, seed=1)
    names = {label for number in range(len(recording)) for label in confused.detect(recording[number]).labels}
    assert names <= {t.label for t in THINGS} and len(names) > 1
    assert "confusion 1, seed 1" in confused.name


def test_without_a_simulator_there_is_no_ground_truth() -> None:
    with pytest.raises(BackendError, match="needs a simulator's recording"):
        plugins.make("detectors", "ground_truth")
    with pytest.raises(BackendError, match="no instances"):
        eyes().detect(dataclasses.replace(walk()[0], instances=None))
    with pytest.raises(BackendError, match="misses must be from 0 to 1"):
        eyes(misses=2)
