"""Box fusion: what several networks see of one thing is one box."""

from __future__ import annotations

import numpy as np
import pytest

from cartier.detectors.fusion import MOST, fuse
from cartier.types import Detections


def seen(*rows: tuple[str, float, tuple[float, ...]]) -> Detections:
    boxes = np.array([box for _, _, box in rows], np.float64).reshape(-1, 4)
    return Detections(7, boxes, np.array([score for _, score, _ in rows]), tuple(label for label, _, _ in rows))


def test_boxes_of_two_networks_are_one_of_their_mean_score_and_weighted_corners() -> None:
    found = fuse([seen(("cup", 0.9, (0, 0, 100, 100))), seen(("cup", 0.3, (20, 0, 100, 100)))])
    assert found.frame == 7 and found.labels == ("cup",)
    assert found.scores == pytest.approx([0.6])
    assert found.boxes_xyxy == pytest.approx(np.array([[5, 0, 100, 100]]))


def test_what_one_network_alone_sees_sinks_and_other_labels_and_places_stay_apart() -> None:
    one = seen(("cup", 0.8, (0, 0, 50, 50)), ("book", 0.6, (0, 0, 50, 50)))
    two = seen(("cup", 0.9, (200, 0, 250, 50)), ("bowl", 0.4, (0, 0, 50, 50)))
    found = fuse([one, two])
    assert found.labels == ("cup", "cup", "book", "bowl")
    assert found.scores == pytest.approx([0.45, 0.4, 0.3, 0.2])


def test_two_boxes_of_one_network_are_two_things_unless_they_all_but_cover_each_other() -> None:
    near = seen(("book", 0.8, (0, 0, 100, 100)), ("book", 0.6, (24, 0, 124, 100)))  # they overlap by 0.61
    assert len(fuse([near, seen()])) == 2
    same = seen(("book", 0.8, (0, 0, 100, 100)), ("book", 0.6, (10, 0, 110, 100)))
    assert fuse([same, seen()]).scores == pytest.approx([0.4])


def test_boxes_of_two_networks_that_share_too_little_are_two_things() -> None:
    one, two = seen(("cup", 0.8, (0, 0, 100, 100))), seen(("cup", 0.6, (40, 0, 140, 100)))  # they overlap by 0.43
    assert fuse([one, two]).scores == pytest.approx([0.4, 0.3])


def test_the_surest_box_has_the_choice_of_its_partner() -> None:
    one = seen(("cup", 0.9, (0, 0, 100, 100)), ("cup", 0.3, (40, 0, 140, 100)))
    two = seen(("cup", 0.5, (20, 0, 120, 100)))  # it overlaps each of the others by 0.67
    assert fuse([one, two]).scores == pytest.approx([0.7, 0.15])


def test_of_very_many_boxes_the_surest_are_kept() -> None:
    many = seen(*(("cup", (k + 1) / 200, (20.0 * k, 0, 20.0 * k + 10, 10)) for k in range(MOST + 10)))
    found = fuse([many])
    assert len(found) == MOST and found.scores.min() == pytest.approx(11 / 200)


def test_nothing_seen_is_an_empty_list() -> None:
    assert len(fuse([seen(), seen()])) == 0 and fuse([seen()]).boxes_xyxy.shape == (0, 4)
