"""Merging: which two objects turn out to be one, and what is left of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from cartier.mapping.bearings import BearingGeometry
from cartier.mapping.columns import COLUMNS, empty_columns
from cartier.mapping.config import DEFAULT_CONFIG
from cartier.mapping.merging import merge_by_box, merge_pair
from cartier.mapping.object_map import ObjectMap
from cartier.types import DetectorScoreModel, Frame, MapObject
from staged import SURE, WEAK, Box, about, all_of, flat, found, fresh, square

table = pytest.mark.parametrize


def both(
    one: tuple[str, Box], two: tuple[str, Box], scores: Sequence[float], made: ObjectMap | None = None
) -> ObjectMap:
    """A map of frames that show two objects side by side, with the scores of one frame after another."""
    made = made or fresh()
    for number, score in enumerate(scores):
        frame = flat(number)
        assert len(set(made.add(frame, all_of(frame, (one[0], score, one[1]), (two[0], score, two[1]))).tolist())) == 2
    return made


# ---- twins: two overlapping objects, begun by detections too weak to show that they are two

TWINS: dict[str, tuple[tuple[str, Box], tuple[str, Box], int]] = {
    "half of each shared": (("chair", square()), ("chair", square(12)), 1),
    "two fifths of their union shared": (("chair", square()), ("chair", square(18)), 1),
    "a seventh shared": (("chair", square()), ("chair", square(30)), 2),
    "side by side": (("chair", square()), ("chair", square(42)), 2),
    "a small one within a large one": (("sofa", square(0, width=90)), ("sofa", square(0, width=20, height=20)), 1),
    "a tiny one within a small one": (
        ("mug", square(0, width=20, height=20)), ("mug", square(0, width=8, height=8)), 1,
    ),
    "a small one of another name within a large one": (
        ("sofa", square(0, width=90)), ("cushion", square(0, width=20, height=20)), 2,
    ),
    "another name for the same": (("sofa", square()), ("couch", square(6)), 1),
    "another name, half of each shared": (("sofa", square()), ("couch", square(15)), 2),
    "another name for most of it": (("sofa", square()), ("couch", square(0, width=26)), 1),
}  # fmt: skip


@table(("one", "two", "count"), TWINS.values(), ids=TWINS.keys())
def test_overlapping_objects_merge(one: tuple[str, Box], two: tuple[str, Box], count: int) -> None:
    for first, second in ((one, two), (two, one)):
        made = both(first, second, [WEAK])
        assert len(made) == 2
        made.merge_and_prune()
        assert len(made) == count
        made.merge_and_prune()
        assert len(made) == count


TOGETHER = {
    "always side by side": ([SURE] * 4, 2),
    "side by side in one of two": ([SURE, WEAK], 2),
    "side by side in one of eight": ([SURE] + [WEAK] * 7, 1),
    "never for sure": ([WEAK] * 4, 1),
}


@table(("scores", "count"), TOGETHER.values(), ids=TOGETHER.keys())
def test_co_visible_twins_stay_two(scores: list[float], count: int) -> None:
    made = both(("chair", square()), ("chair", square(18)), scores)
    made.merge_and_prune()
    assert len(made) == count
    if count == 2:
        assert about(made)["covisible"] == [[0, 1, scores.count(SURE)]]
    else:
        assert about(made)["covisible"] == []


def test_objects_apart_are_not_counted_together() -> None:
    assert about(both(("chair", square(-50)), ("chair", square(50)), [SURE] * 3))["covisible"] == []


def test_merging_happens_every_ten_frames() -> None:
    twins = ("chair", square()), ("chair", square(18))
    assert len(both(*twins, [WEAK] * 9)) == 2
    assert len(both(*twins, [WEAK] * 10)) == 1


def test_ids_hold_in_the_frame_that_merges() -> None:
    """Rows move when twins become one; what stands behind them in the map keeps its id."""
    made = fresh()
    for number in range(10):
        frame = flat(number)
        rows = [("chair", WEAK, square(-40)), ("chair", WEAK, square(-22)), ("lamp", WEAK, square(50))]
        got = made.add(frame, all_of(frame, *rows)).tolist()
        assert got == [0, 1, 2]
    assert {(obj.label, obj.id, obj.aliases) for obj in made.objects()} == {("chair", 0, (1,)), ("lamp", 2, ())}


# ---- halves: what shows of one chair on either side of a table

WHOLE = (40.0, 60.0)
UPPER, LOWER = square(50, -20, 40, 20), square(50, 20, 40, 20)


def with_wholes(halves: Sequence[Box], scale: float, whole_views: int, half_views: int) -> int:
    """How many objects are left of three whole chairs in three places and of halves, no two of them in one frame."""
    made, number = fresh(), 0
    wholes = [(x_m, square(-45, 0, *WHOLE)) for x_m in (0.0, 5.0, 10.0)]
    for x_m, box in wholes * whole_views + [(0.0, box) for box in halves] * half_views:
        frame, number = flat(number, x_m=x_m), number + 1
        x1, y1, x2, y2 = ((v - m) * scale + m for v, m in zip(box, (79.5, 59.5) * 2, strict=True))
        made.add(frame, found(frame, ("chair", SURE, (x1, y1, x2, y2))))
    made.merge_and_prune()
    return len(made)


@table(
    ("halves", "scale", "whole_views", "half_views", "count"),
    [
        ([UPPER, LOWER], 1.0, 1, 1, 4),
        ([square(50, -30, 40, 20), square(50, 30, 40, 20)], 1.0, 1, 1, 5),
        ([UPPER, LOWER], 0.4, 1, 1, 5),
        ([UPPER, LOWER], 1.0, 1, 4, 5),
        ([UPPER, LOWER], 1.0, 4, 4, 4),
    ],
    ids=["as large as the others", "larger than the others", "too small", "the usual chair is small", "often seen"],
)
def test_halves_make_a_whole(halves: list[Box], scale: float, whole_views: int, half_views: int, count: int) -> None:
    assert with_wholes(halves, scale, whole_views, half_views) == count


# ---- what is left of both


def merged(first: str = "sofa", second: str = "sofa", early: int = 1, late: int = 3) -> tuple[MapObject, ...]:
    """A left part seen early and a right part seen late, and what they become; one weak frame shows both."""
    made = fresh()
    for number in range(early):
        frame = flat(number, grey=250)
        made.add(frame, found(frame, (first, 0.6, square(0))))
    frame = flat(early)
    made.add(frame, all_of(frame, (first, WEAK, square(0)), (second, WEAK, square(18))))
    for number in range(early + 1, early + 1 + late):
        frame = flat(number, grey=5)
        assert made.add(frame, found(frame, (second, 0.8, square(18)))).tolist() == [1]
    before = made.objects()
    made.merge_and_prune()
    assert len(before) == 2 and len(made) == 1
    return *before, *made.objects()


def test_one_seen_more_keeps_its_id() -> None:
    _, _, whole = merged()
    assert (whole.id, whole.aliases) == (1, (0,))
    _, _, whole = merged(early=5, late=1)
    assert (whole.id, whole.aliases) == (0, (1,))


def test_merged_object_has_the_evidence_of_both() -> None:
    left, right, whole = merged()
    assert whole.n_detected == min(left.n_detected + right.n_detected, max(left.n_observable, right.n_observable)) == 5
    assert whole.n_observable == max(left.n_observable, right.n_observable) == 5
    assert whole.first_seen_s == left.first_seen_s == 0.0 < right.first_seen_s
    assert whole.last_seen_s == right.last_seen_s and whole.last_looked_s == right.last_looked_s
    assert dict(whole.labels)["sofa"] == pytest.approx(dict(left.labels)["sofa"] + dict(right.labels)["sofa"], abs=1e-3)
    worth = sorted((v.score * v.size_px2**0.5 for v in (*left.views, *right.views)), reverse=True)[:3]
    assert [v.score * v.size_px2**0.5 for v in whole.views] == pytest.approx(worth)
    _, right, whole = merged(early=3, late=1)
    assert {view.frame for view in whole.views} > {view.frame for view in right.views if view.score > 0.5}
    assert {name for name, _ in left.colours} | {name for name, _ in right.colours} == {n for n, _ in whole.colours}
    assert {name for name, _ in left.colours} != {name for name, _ in right.colours}


def test_merged_object_has_the_larger_view_of_each_side() -> None:
    columns = empty_columns(COLUMNS, 2)
    columns["side_views"]["frame"] = [[1, 2, -1, 3], [4, 5, 6, -1]]
    columns["side_views"]["worth"] = [[9, 1, 0, 5], [1, 9, 5, 0]]
    columns["late_view"]["frame"], columns["late_s"][:] = [[7], [8]], [70, 80]
    merge_pair(columns, 0, 1, BearingGeometry(DEFAULT_CONFIG))  # which joins nothing of its own
    assert columns["side_views"]["frame"][0].tolist() == [1, 5, 6, 3]
    assert (columns["late_view"]["frame"][0, 0], columns["late_s"][0]) == (8, 80)


def test_box_grows_by_half_over_the_merged_one() -> None:
    left, right, whole = merged()
    assert left.box_min[0] < right.box_min[0] and left.box_max[0] < right.box_max[0]
    assert whole.box_min[0] == pytest.approx((left.box_min[0] + right.box_min[0]) / 2, abs=2e-4)
    assert whole.box_max[0] == pytest.approx(right.box_max[0], abs=2e-4)


def test_labels_of_both_vote() -> None:
    made = both(("sofa", square()), ("couch", square(6)), [WEAK] * 2)
    made.merge_and_prune()
    (obj,) = made.objects()
    assert dict(obj.labels) == pytest.approx({"sofa": 2 * WEAK**2, "couch": 2 * WEAK**2}, abs=1e-3)


@table(
    ("scores", "hits"),
    [([0.4] * 9, 2 * 9 * 0.08 / 0.18), ([SURE] * 2 + [0.4] * 7, 9.0)],
    ids=["each had half of the detections", "more detections than frames"],
)
def test_detections_of_both_are_capped_by_observable_frames(scores: list[float], hits: float) -> None:
    made = both(("chair", square(-25)), ("chair", square(-7)), scores)
    tried, apart, _ = made.evidence()
    assert np.count_nonzero(tried.sum(0)) == 1, "one viewpoint"
    assert tried.sum(1).tolist() == [9, 9] and apart.sum() >= hits - 1e-3
    made.merge_and_prune()
    tried, together, _ = made.evidence()
    assert len(made) == 1 and tried.sum() == 9 and together.sum() == pytest.approx(hits, rel=1e-3)


def test_viewpoints_of_both_are_known() -> None:
    """The one was seen from far on before the other was begun near by."""
    made = fresh()
    far = flat(0, y_m=-1.0, depth_m=3.0)
    made.add(far, found(far, ("chair", SURE, square(0, width=27, height=27))))
    frame = flat(1)
    made.add(frame, all_of(frame, ("chair", WEAK, square()), ("chair", WEAK, square(18))))
    for number in range(2, 6):
        made.add(flat(number), found(flat(number), ("chair", SURE, square(18))))
    before = made.evidence()[0].copy()
    assert [int((row > 0).sum()) for row in before] == [2, 2], "the earlier frame should have shown it, too"
    made.merge_and_prune()
    (after,) = made.evidence()[0]
    assert made.objects()[0].id == 1
    assert np.array_equal(after, before.max(0))


def test_widest_view_of_both_is_kept() -> None:
    made = both(("chair", square(0, width=60, height=60)), ("chair", square(0, width=42, height=42)), [WEAK])
    for number in range(1, 4):
        made.add(flat(number), found(flat(number), ("chair", SURE, square(0, width=42, height=42))))
    before = made.evidence()[2].copy()
    made.merge_and_prune()
    assert made.objects()[0].id == 1 and before[0] > before[1]
    assert made.evidence()[2] == pytest.approx(before[:1])


# ---- ids


def test_alias_of_an_alias_leads_to_the_last() -> None:
    made = both(("chair", square()), ("chair", square(18)), [WEAK])
    for number in range(1, 3):
        made.add(flat(number), found(flat(number), ("chair", SURE, square(18))))
    made.merge_and_prune()
    assert [(obj.id, obj.aliases) for obj in made.objects()] == [(1, (0,))]
    frame = flat(3)
    got = made.add(frame, all_of(frame, ("chair", WEAK, square(9)), ("chair", WEAK, square(27)))).tolist()
    assert got == [1, 2]
    for number in range(4, 10):
        made.add(flat(number), found(flat(number), ("chair", SURE, square(27))))
    made.merge_and_prune()
    assert [(obj.id, obj.aliases) for obj in made.objects()] == [(2, (0, 1))]


def test_id_is_never_given_again() -> None:
    made = both(("chair", square()), ("chair", square(18)), [WEAK])
    made.merge_and_prune()
    (left,) = made.objects()
    assert made.add(flat(1), found(flat(1), ("lamp", SURE, square(-60)))).tolist() == [2]
    assert made.add(flat(2), found(flat(2), ("vase", SURE, square(60)))).tolist() == [3]
    assert [obj.id for obj in made.objects()] == [left.id, 2, 3]


def test_forgotten_object_takes_its_aliases_along() -> None:
    made = both(("chair", square()), ("chair", square(18)), [WEAK])
    made.merge_and_prune()
    assert about(made)["aliases"] == [[1, 0]]
    for number in range(1, 32):
        made.add(flat(number), found(flat(number)))
    made.merge_and_prune()
    assert len(made) == 0 and about(made)["aliases"] == []


# ---- without depth


def test_merged_bearings_keep_the_box_of_the_more_confident_one() -> None:
    """A box from bearings says where an object may be: two of them together are no better answer."""
    made = ObjectMap(DetectorScoreModel(), geometry=BearingGeometry)
    rows = [("chair", WEAK, square()), ("chair", WEAK, square(12))]

    def view(number: int) -> Frame:
        frame = flat(number)
        return Frame(number, frame.time_s, frame.rgb, None, frame.world_from_camera, frame.camera)

    made.add(view(0), all_of(view(0), *rows))
    assert made.add(view(1), found(view(1), ("chair", SURE, square()))).tolist() == [0]
    before = {obj.id: obj for obj in made.objects()}
    made.merge_and_prune()
    (whole,) = made.objects()
    assert len(before) == 2 and whole.aliases
    kept = before[whole.id]
    assert (whole.box_min, whole.box_max, whole.position) == (kept.box_min, kept.box_max, kept.position)


# ---- fitted boxes

FITTED: dict[str, tuple[str, float, int, bool]] = {
    "two fifths of the smaller shared": ("chair", 0.6, 0, True),
    "a fifth of the smaller shared": ("chair", 0.8, 0, False),
    "another name": ("table", 0.2, 0, False),
    "frames show both": ("chair", 0.2, 3, False),
}


@table("case", FITTED)
def test_objects_whose_fitted_boxes_overlap_are_one(case: str) -> None:
    label, moved_m, together, one = FITTED[case]
    made = both(("chair", square()), (label, square(60)), [SURE] * 4)
    boxes = np.array([[[0, 0, 0], [1, 1, 1]], [[moved_m, 0, 0], [1 + moved_m, 1, 1]]], float)
    covisible = {(0, 1): together} if together else {}
    merged, gone = merge_by_box(made.columns(), boxes, covisible, made.geometry, made.config.merging)
    assert (merged, gone.tolist()) == (({1: 0}, [1]) if one else ({}, []))


def test_consolidated_map_merges_by_fitted_boxes() -> None:
    made, frame = fresh(), flat()
    made.add(frame, all_of(frame, ("sofa", SURE, square(0, width=60)), ("sofa", SURE, square(36, width=60))))
    assert len(made.objects()) == 2, "their extents overlap too little"
    made.consolidate()
    assert len(made.objects()) == 2, "one frame shows both"
    made, frames = fresh(), (flat(0), flat(1))
    for frame, box in zip(frames, (square(0, width=60), square(36, width=60)), strict=True):
        made.add(frame, found(frame, ("sofa", SURE, box)))
    assert len(made) == 2
    made.consolidate()
    (sofa,) = made.objects()
    assert sofa.aliases == (1,)
