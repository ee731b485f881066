"""Data association: which detection becomes which object, row by row, on a flat surface."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cartier.mapping.object_map import ObjectMap
from cartier.mapping.poses.registration import about_z
from cartier.types import Detections, Frame
from staged import CAMERA, SURE, Box, Row, all_of, flat, found, fresh, square

table = pytest.mark.parametrize


# ---- one known object, one detection: is it that object?

MATCHES: dict[str, tuple[Row, Row, bool]] = {
    "the same box": (("chair", SURE, square()), ("chair", SURE, square()), True),
    "the same box under another name": (("chair", SURE, square()), ("stool", SURE, square()), True),
    "a quarter aside, another name": (("chair", SURE, square()), ("stool", SURE, square(10)), True),
    "two fifths aside, another name": (("chair", SURE, square()), ("stool", SURE, square(16)), False),
    "two fifths aside, the same name": (("chair", SURE, square()), ("chair", SURE, square(16)), True),
    "beside it, the same name": (("chair", SURE, square()), ("chair", SURE, square(42)), False),
    "far away, the same name": (("chair", SURE, square(-50)), ("chair", SURE, square(50)), False),
    "a whole of which one end is known": (
        ("sofa", SURE, square(-40, width=20)), ("sofa", SURE, square(0, width=100)), True,
    ),
    "a whole of which one end is known, another name": (
        ("sofa", SURE, square(-40, width=20)), ("bed", SURE, square(0, width=100)), False,
    ),
    "a sliver at the end of a known sofa": (
        ("sofa", SURE, square(0, width=100)), ("sofa", SURE, square(54, width=10)), True,
    ),
    "a sliver at the end of a known sofa, another name": (
        ("sofa", SURE, square(0, width=100)), ("lamp", SURE, square(54, width=10)), False,
    ),
    "a small thing in the middle of a large one": (
        ("sofa", SURE, square(0, width=100)), ("cat", SURE, square(0, width=20)), False,
    ),
    "a weak report of what is known": (("chair", SURE, square()), ("chair", 0.1, square()), True),
}  # fmt: skip


@table(("known", "seen", "same"), MATCHES.values(), ids=MATCHES.keys())
def test_detection_matches_known_object(known: Row, seen: Row, same: bool) -> None:
    made = fresh()
    (first,) = made.add(flat(0), found(flat(0), known))
    (second,) = made.add(flat(1), found(flat(1), seen))
    assert first == 0
    assert second == (0 if same else 1)
    assert [obj.n_detected for obj in made.objects()] == ([2] if same else [1, 1])


def test_two_near_detections_make_two() -> None:
    """Both are worth the one known chair; the better one gets it."""
    made = fresh()
    made.add(flat(0), found(flat(0), ("chair", SURE, square())))
    got = made.add(flat(1), found(flat(1), ("chair", SURE, square(22)), ("chair", 0.6, square())))
    assert got.tolist() == [1, 0]


def test_exact_boxes_keep_their_objects() -> None:
    made = fresh()
    for number in range(3):
        rows = [("chair", SURE, square(-10)), ("chair", 0.8, square(11))]
        assert made.add(flat(number), found(flat(number), *rows)).tolist() == [0, 1]


def test_assignment_is_best_as_a_whole() -> None:
    """The surer detection fits the first chair better than the second, but the other detection fits only the first."""
    made = fresh()
    assert made.add(flat(0), found(flat(0), ("chair", SURE, square(0)), ("chair", 0.8, square(42)))).tolist() == [0, 1]
    got = made.add(flat(1), found(flat(1), ("chair", SURE, square(20)), ("chair", 0.8, square(-14))))
    assert got.tolist() == [1, 0]


def test_agreement_is_by_share_of_votes() -> None:
    """A name that one of many frames gave says little; the usual name says all."""
    for name, same in (("bed", False), ("sofa", True)):
        made = fresh()
        for number, label in enumerate(["sofa", "sofa", "sofa", "bed"]):
            frame = flat(number)
            assert made.add(frame, found(frame, (label, 0.9 if label == "sofa" else 0.4, square()))).tolist() == [0]
        assert made.add(flat(9), found(flat(9), (name, SURE, square(17)))).tolist() == [0 if same else 1]


def test_suppressed_name_helps_to_match() -> None:
    made = fresh()
    made.add(flat(0), found(flat(0), ("sofa", SURE, square())))
    got = made.add(flat(1), found(flat(1), ("couch", SURE, square(17)), ("sofa", 0.5, square(17))))
    assert got.tolist() == [0, 0]


# ---- duplicates within one frame


def near_and_far() -> Frame:
    """A near patch at 1.2 m in the middle of a wall at 3 m."""
    depth = np.full((CAMERA.height, CAMERA.width), 3.0)
    depth[48:72, 68:92] = 1.2
    return flat(depth_m=depth)


def slanted() -> Frame:
    """A surface that leans away downwards, and below it one that stands where that one's box in space reaches."""
    v = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
    depth = np.where(v <= 0.3, 1.8 + 0.5 * (v + 0.1) / 0.4, 1.9)
    return flat(depth_m=np.repeat(depth[:, None], CAMERA.width, 1))


SLANTED_UP: Box = (55.5, 47.5, 103.5, 95.5)
SLANTED_DOWN: Box = (57.5, 96.5, 101.5, 101.5)
DUPLICATES: dict[str, tuple[Callable[[], Frame], Row, Row, int]] = {
    "one box twice": (flat, ("sofa", SURE, square()), ("sofa", 0.5, square()), 1),
    "one box under two names": (flat, ("sofa", SURE, square()), ("couch", 0.5, square(2)), 1),
    "half aside under two names": (flat, ("sofa", SURE, square()), ("couch", 0.5, square(16)), 2),
    "a sofa and half of it": (flat, ("sofa", SURE, square(0, width=80)), ("sofa", 0.5, square(-20)), 1),
    "a sofa and a cushion on it": (flat, ("sofa", SURE, square(0, width=80)), ("cushion", 0.5, square(-20)), 2),
    "two chairs side by side": (flat, ("chair", SURE, square(-12)), ("chair", 0.5, square(12)), 2),
    "a near chair before a far one": (
        near_and_far, ("chair", SURE, square(0, width=24, height=24)),
        ("chair", 0.5, square(0, width=110, height=100)), 2,
    ),
    "boxes that meet in space and not in the image": (
        slanted, ("chair", SURE, SLANTED_UP), ("chair", 0.5, SLANTED_DOWN), 2,
    ),
}  # fmt: skip


@table(("scene", "one", "two", "count"), DUPLICATES.values(), ids=DUPLICATES.keys())
def test_boxes_of_one_thing_in_one_frame(scene: Callable[[], Frame], one: Row, two: Row, count: int) -> None:
    frame = scene()
    for rows in ((one, two), (two, one)):
        made = fresh()
        got = made.add(frame, found(frame, *rows))
        assert len(made) == len(set(got.tolist())) == count and -1 not in got
        assert sum(obj.n_detected for obj in made.objects()) == count


def test_masks_are_exact() -> None:
    frame = flat()
    assert fresh().add(frame, all_of(frame, ("sofa", SURE, square()), ("sofa", 0.5, square()))).tolist() == [0, 1]


def test_suppressed_boxes_vote_by_squared_score() -> None:
    made, frame = fresh(), flat()
    made.add(frame, found(frame, ("cup", 0.9, square()), ("mug", 0.5, square(1))))
    (obj,) = made.objects()
    assert obj.labels == (("cup", 0.81), ("mug", 0.25))
    made.add(flat(1), found(flat(1), ("mug", 0.5, square())))
    assert made.objects()[0].labels == (("cup", 0.81), ("mug", 0.5))
    made.add(flat(2), found(flat(2), ("mug", 0.8, square())))
    assert made.objects()[0].label == "mug" and made.objects()[0].labels[0] == ("mug", 1.14)


def test_seventh_label_takes_the_weakest_place() -> None:
    made, names = fresh(), [("a", 0.9), ("b", 0.8), ("c", 0.7), ("d", 0.6), ("e", 0.4), ("f", 0.5), ("g", 0.75)]
    for number, (name, score) in enumerate(names):
        made.add(flat(number), found(flat(number), (name, score, square())))
    (obj,) = made.objects()
    assert [name for name, _ in obj.labels][:2] == ["a", "b"] and "e" not in dict(obj.labels)


# ---- what starts an object

STARTS: dict[str, tuple[float, np.ndarray | float, int]] = {
    "a sure report": (0.9, 2.0, 0),
    "at the threshold for births": (0.33, 2.0, 0),
    "under the threshold for births": (0.31, 2.0, -1),
    "no depth": (0.9, np.nan, -1),
    "a few pixels of depth": (
        0.9, np.where(np.arange(160) == 66, np.where(np.arange(120) < 50, 2.0, np.nan)[:, None], np.nan), -1,
    ),
}  # fmt: skip


@table(("score", "depth", "given"), STARTS.values(), ids=STARTS.keys())
def test_report_starts_an_object(score: float, depth: np.ndarray | float, given: int) -> None:
    frame, made = flat(depth_m=depth), fresh()
    assert made.add(frame, found(frame, ("cup", score, square()))).tolist() == [given]
    assert len(made) == given + 1


def test_sixty_surest_of_many_count() -> None:
    frame, made = flat(), fresh()
    corners = [(float(x), float(y)) for y in range(5, 105, 14) for x in range(5, 145, 14)]
    boxes: list[Box] = [(x, y, x + 9, y + 9) for x, y in corners[:75]]
    rows = [("thing", 0.4 + 0.005 * k, box) for k, box in enumerate(boxes)]
    got = made.add(frame, found(frame, *rows))
    assert got[:15].tolist() == [-1] * 15 and sorted(got[15:].tolist()) == list(range(60))
    again = made.add(flat(1), found(flat(1), *rows[::-1]))
    assert again[::-1].tolist() == got.tolist()


def test_ids_follow_the_order_of_detections() -> None:
    made = fresh()
    rows: list[Row] = [("a", 0.5, square(-50)), ("b", 0.9, square()), ("c", 0.7, square(50))]
    first = made.add(flat(0), found(flat(0), *rows)).tolist()
    names = {obj.id: obj.label for obj in made.objects()}
    assert [names[number] for number in first] == ["a", "b", "c"]
    assert made.add(flat(1), found(flat(1), *rows[::-1])).tolist() == first[::-1]


# ---- how an object's box follows its views


def boxed(*boxes: Box) -> tuple[np.ndarray, np.ndarray]:
    made = fresh()
    for number, box in enumerate(boxes):
        made.add(flat(number), found(flat(number), ("sofa", SURE, box)))
    (obj,) = made.objects()
    return np.array(obj.box_min), np.array(obj.box_max)


@table(("second", "share"), [(60, 0.5), (24, 0.05)], ids=["grows by half", "shrinks by a twentieth"])
def test_box_follows_a_view(second: float, share: float) -> None:
    one, two = square(), square(width=second, height=second)
    for before, after, wanted in zip(boxed(one), boxed(one, two), boxed(two), strict=True):
        assert np.abs(wanted - before)[[0, 2]].min() > 0.05
        assert after == pytest.approx(before + share * (wanted - before), abs=2e-4)


def test_part_of_an_object_does_not_shrink_it() -> None:
    made = fresh()
    made.add(flat(0), found(flat(0), ("sofa", SURE, square())))
    before = made.objects()[0]
    moved = flat(1, x_m=-1.3)  # its middle is now 78 px to the right: only its left half is in view
    assert made.add(moved, found(moved, ("sofa", SURE, (137.5, 39.5, 160.0, 79.5)))).tolist() == [0]
    after = made.objects()[0]
    assert after.box_max[0] == before.box_max[0] and after.n_detected == 2


def test_best_views_are_kept() -> None:
    """By score and size together: a small sure one and a large unsure one are worth less than what is good in both."""
    shown = [(0.95, 20), (0.5, 60), (0.9, 44), (0.6, 40), (0.85, 42), (0.8, 50), (0.4, 62)]
    for order in (range(7), range(6, -1, -1)):
        made = fresh()
        for number in order:
            score, width = shown[number]
            frame = flat(number)
            made.add(frame, found(frame, ("sofa", score, square(width=width, height=width))))
        (obj,) = made.objects()
        assert [view.frame for view in obj.views] == [5, 2, 4]
        assert made.best_frames() == {2, 4, 5}


def seen_in(made: ObjectMap, number: int, heading_deg: float, width: float, score: float = SURE) -> None:
    """A view of the only object, in a frame whose camera is turned."""
    pose = flat(0).world_from_camera.copy()
    pose[:3, :3] = about_z(math.radians(heading_deg)) @ pose[:3, :3]
    frame = replace(flat(number), world_from_camera=pose)
    made._keep_view(0, frame, np.array(square(width=width, height=width)), score, 0, width**2, np.zeros(3))


def test_the_largest_view_of_each_side_is_kept() -> None:
    """By its size, though three surer ones of another side are better views; at most one of each quarter."""
    made = fresh()
    made.add(flat(0), found(flat(0), ("sofa", SURE, square(width=60, height=60))))
    for number in (1, 2):
        seen_in(made, number, 0, 60)
    seen_in(made, 3, 180, 30, 0.3)
    seen_in(made, 4, 175, 40, 0.3)
    seen_in(made, 5, 90, 20, 0.3)
    (obj,) = made.objects()
    assert {view.frame for view in obj.views} == {0, 1, 2}
    assert [view.frame for view in obj.side_views] == [4, 5]
    assert made.best_frames() == {0, 1, 2, 4, 5} == {view.frame for view in obj.all_views}


def test_the_latest_visit_keeps_a_view() -> None:
    """Of a later recording or ten minutes later, though every earlier view is larger; within a visit the largest."""
    made = fresh()
    made.add(flat(0), found(flat(0), ("sofa", SURE, square(width=60, height=60))))
    for number in (1, 2):
        seen_in(made, number, 0, 60)
    seen_in(made, 3, 0, 20)
    assert [view.frame for view in made.objects()[0].side_views] == []
    made.visit_from = 4
    seen_in(made, 4, 0, 20)
    seen_in(made, 5, 0, 30)
    seen_in(made, 6, 0, 25)
    assert [view.frame for view in made.objects()[0].side_views] == [5]
    seen_in(made, 100_000, 0, 10)
    assert [view.frame for view in made.objects()[0].side_views] == [100_000]


# ---- from boxes to space


def depth_with(*patches: tuple[slice, slice, float], wall_m: float = 3.0) -> np.ndarray:
    depth = np.full((CAMERA.height, CAMERA.width), wall_m)
    for rows, cols, value in patches:
        depth[rows, cols] = value
    return depth


MIDDLE = slice(48, 72), slice(68, 92)
STRIPES = [(slice(40, 80), slice(first, first + 4), 3.0) for first in range(60, 100, 7)]
FLYING = [(slice(40, 42), slice(59, 75), 2.2)]


@table(
    ("depth", "low_m", "high_m"),
    [
        (depth_with((*MIDDLE, 2.0)), 2.0, 2.0),
        (depth_with((slice(40, 80), slice(60, 100), 2.0), *STRIPES), 2.0, 2.0),
        (depth_with((slice(40, 80), slice(60, 100), 2.0), *FLYING), 2.0, 2.0),
        (depth_with(wall_m=2.5), 2.5, 2.5),
    ],
    ids=["before a wall", "a chair with gaps", "flying pixels", "a wall"],
)
def test_surface_is_the_object_alone(depth: np.ndarray, low_m: float, high_m: float) -> None:
    frame, made = flat(depth_m=depth), fresh()
    made.add(frame, found(frame, ("chair", SURE, square())))
    (obj,) = made.objects()
    assert obj.box_min[1] == pytest.approx(low_m, abs=0.02) and obj.box_max[1] == pytest.approx(high_m, abs=0.02)


def test_mask_says_what_is_the_object() -> None:
    """A chair behind a table: the near third of the box is not it."""
    frame = flat(depth_m=depth_with((*MIDDLE, 2.0)))
    assert frame.depth_m is not None
    seen = Detections(0, np.array([square()]), np.array([SURE]), ("chair",), (frame.depth_m > 2.5)[None])
    made = fresh()
    made.add(frame, seen)
    (obj,) = made.objects()
    assert obj.box_min[1] == pytest.approx(3.0) and obj.box_max[1] == pytest.approx(3.0)
