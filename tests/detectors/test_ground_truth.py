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

    def share(label: str, **options: Any) -> float:
        detector = eyes(min_pixels=20, **options)
        full = eyes(min_pixels=20)
        seen, there = 0, 0
        for seed in range(10):
            again = eyes(min_pixels=20, seed=seed, **options)
            for number in range(len(recording)):
                there += label in full.detect(recording[number]).labels
                seen += label in again.detect(recording[number]).labels
        assert "misses" in detector.name
        return seen / there

    assert share("mug", misses=0.8) < share("table", misses=0.8) - 0.2
    a, b = eyes(jitter=0.1, seed=5), eyes(jitter=0.1, seed=5)
    assert np.array_equal(a.detect(recording[3]).boxes_xyxy, b.detect(recording[3]).boxes_xyxy)
    assert not np.array_equal(
        a.detect(recording[3]).boxes_xyxy, eyes(jitter=0.1, seed=6).detect(recording[3]).boxes_xyxy
    )


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
