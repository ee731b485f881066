"""Existence: which frames are observable, what detections and misses weigh, and which objects are pruned."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from cartier.errors import BackendError
from cartier.mapping.config import DEFAULT_CONFIG
from cartier.mapping.existence import BEARING_BINS, VIEWPOINT_BINS, detection_weights, posterior, viewpoint_bins
from cartier.mapping.object_map import ObjectMap
from cartier.types import DetectorScoreModel, Frame, MapObject, TrueObject
from staged import CAMERA, SURE, WEAK, flat, found, fresh, looks, square, true_box
from synthetic import box

table = pytest.mark.parametrize
CONFIG = DEFAULT_CONFIG.existence
CRATE = box(1, "crate", (2.3, 1.8, 0.8), (2.7, 2.2, 1.2))
EYE, AT = (1.0, 2.0, 1.0), (2.5, 2.0, 1.0)


def seen_once(obj: TrueObject = CRATE, eye: Sequence[float] = EYE, at: Sequence[float] = AT) -> ObjectMap:
    made, frame = fresh(), looks(eye, at, [obj])
    assert made.add(frame, found(frame, (obj.label, SURE, true_box(frame, 1)))).tolist() == [0]
    return made


def missed(made: ObjectMap, frame: Frame) -> MapObject:
    """Nothing is detected in this frame."""
    made.add(frame, found(frame))
    return made.objects()[0]


# ---- which frames are observable

OTHER = (1.3, 1.6, 1.0)


def before(low: Sequence[float], high: Sequence[float], gone: bool = False) -> Frame:
    return looks(EYE, AT, [*([] if gone else [CRATE]), box(2, "board", low, high)], 1)


def blind(share: float) -> Frame:
    """The depth sensor reads nothing in so much of the image, from the left."""
    frame = looks(EYE, AT, [CRATE], 1)
    assert frame.depth_m is not None
    frame.depth_m[:, : round(share * CAMERA.width)] = np.nan
    return frame


OBSERVABLE: dict[str, tuple[Callable[[], Frame], bool]] = {
    "in full view": (lambda: looks(OTHER, AT, [CRATE], 1), True),
    "an occluder in front": (lambda: before((1.6, 1.0, 0.3), (1.65, 3.0, 1.7)), False),
    "an occluder before a third of it": (lambda: before((1.6, 1.0, 0.3), (1.65, 1.95, 1.7)), True),
    "an occluder before most of it": (lambda: before((1.6, 1.0, 0.3), (1.65, 2.05, 1.7)), False),
    "a board beside it": (lambda: before((1.6, 1.0, 0.3), (1.65, 1.6, 1.7)), True),
    "the depth shows the wall where it stood": (lambda: looks(EYE, AT, [], 1), True),
    "half of it is hidden, and it is gone": (lambda: before((1.6, 1.0, 0.3), (1.65, 2.0, 1.7), gone=True), False),
    "the camera looks elsewhere": (lambda: looks(EYE, (1.0, 0.1, 1.0), [CRATE], 1), False),
    "the camera looks away": (lambda: looks(EYE, (0.1, 2.0, 1.0), [CRATE], 1), False),
    "half out of view": (lambda: looks(EYE, (2.2, 2.95, 1.0), [CRATE], 1), False),
    "no depth": (lambda: blind(1.0), False),
    "no depth beside it": (lambda: blind(0.3), True),
    "far away but large enough": (lambda: looks((0.1, 0.1, 1.0), AT, [CRATE], 1), True),
}


@table(("second", "observable"), OBSERVABLE.values(), ids=OBSERVABLE.keys())
def test_frame_is_observable(second: Callable[[], Frame], observable: bool) -> None:
    made = seen_once()
    (first,) = made.objects()
    obj = missed(made, second())
    assert (obj.n_detected, obj.n_observable) == (1, 1 + observable)
    assert obj.last_looked_s == float(observable) and obj.last_seen_s == 0.0
    assert (obj.probability < first.probability) is observable
    assert obj.probability <= first.probability


@table(("panel_m", "observable"), [(2.75, False), (3.1, True)], ids=["close behind it", "well behind it"])
def test_what_was_taken_away_is_doubted(panel_m: float, observable: bool) -> None:
    """Depth that ends within slack of the far side of its extent, which a corner view shows, says nothing."""
    made = seen_once(eye=(1.2, 0.8, 1.9))
    (first,) = made.objects()
    low, high = (panel_m, 0.5, 0.0), (panel_m + 0.05, 3.5, 2.0)
    obj = missed(made, looks(EYE, AT, [box(2, "panel", low, high)], 1))
    assert obj.n_observable == 1 + observable
    assert (obj.probability < first.probability) is observable


def test_frames_before_an_object_was_brought_do_not_count_against_it() -> None:
    made = fresh()
    for number in range(8):
        missed_frame = looks(EYE, AT, [], number)
        made.add(missed_frame, found(missed_frame))
    frame = looks(EYE, AT, [CRATE], 8)
    made.add(frame, found(frame, ("crate", SURE, true_box(frame, 1))))
    assert made.objects()[0].n_observable == 1
    assert made.columns()["observable"][0].sum() == 1


@table(("eye", "observable"), [((2.4, 2.0, 1.0), True), ((0.4, 2.0, 1.0), False)], ids=["near", "too small"])
def test_small_appearance_is_not_observable(eye: Sequence[float], observable: bool) -> None:
    die = box(1, "die", (2.97, 1.97, 0.97), (3.03, 2.03, 1.03))
    made = seen_once(die, (2.3, 2.0, 1.0), (3.0, 2.0, 1.0))
    assert missed(made, looks(eye, (3.0, 2.0, 1.0), [die], 1)).n_observable == 1 + observable


def test_what_lies_behind_the_camera_is_not_observable() -> None:
    """A long rail, most of it behind the camera, whose mirror image would lie in view."""
    made, frame = fresh(), flat(y_m=0.0)
    assert frame.depth_m is not None
    depth = np.full_like(frame.depth_m, 4.0)
    depth[40:80, 60:100] = np.linspace(1.2, 2.8, 40, dtype=np.float32)[:, None]
    frame = flat(depth_m=depth)
    made.add(frame, found(frame, ("rail", SURE, (30.5, 30.5, 128.5, 90.5))))
    assert np.ptp(made.columns()["points"][0, :, 1]) > 1.3
    assert missed(made, flat(1, y_m=2.6, depth_m=0.7)).n_observable == 1


def test_detection_makes_a_frame_observable() -> None:
    """Half of it in view: not observable, had it not been detected."""
    made = seen_once()
    frame = looks(EYE, (2.2, 2.95, 1.0), [CRATE], 1)
    assert made.add(frame, found(frame, ("crate", SURE, true_box(frame, 1)))).tolist() == [0]
    (obj,) = made.objects()
    assert (obj.n_detected, obj.n_observable) == (2, 2)


# ---- ten misses

POST = box(1, "post", (2.42, 1.92, 0.6), (2.58, 2.08, 1.4))
ROUND = [(2.5 + 1.7 * math.cos(a), 2.0 + 1.7 * math.sin(a), 1.0) for a in np.deg2rad(np.arange(10, 360, 45))]


def ten_misses(eyes: Sequence[Sequence[float]]) -> tuple[MapObject, MapObject]:
    """A post detected from three viewpoints, before and after ten frames without a detection."""
    made = fresh()
    for number, eye in enumerate(ROUND[:3]):
        frame = looks(eye, AT, [POST], number)
        assert made.add(frame, found(frame, ("post", SURE, true_box(frame, 1)))).tolist() == [0]
    (first,) = made.objects()
    for number in range(10):
        missed(made, looks(eyes[number % len(eyes)], AT, [POST], 3 + number))
    return first, made.objects()[0]


@table(
    ("eyes", "stays"),
    [(ROUND[3:], False), (ROUND[4:5], True), (ROUND[:1], True)],
    ids=["from five viewpoints", "from one viewpoint", "from where it was seen"],
)
def test_ten_misses(eyes: Sequence[Sequence[float]], stays: bool) -> None:
    first, last = ten_misses(eyes)
    assert (
        first.confirmed
        and first.probability >= CONFIG.confirmed_probability
        and (first.n_detected, first.n_observable) == (3, 3)
    )
    assert (last.n_detected, last.n_observable) == (3, 13) and last.probability < first.probability
    assert last.confirmed is stays and (last.probability >= CONFIG.confirmed_probability) is stays


# ---- viewpoint bins: twelve bearings, three ranges

VIEWPOINTS: dict[str, tuple[tuple[float, float, float], int, int]] = {
    "near, at 15 degrees": ((1.0 * math.cos(0.26), 1.0 * math.sin(0.26), 0.0), 0, 0),
    "near, at 45 degrees": ((0.7, 0.7, 0.0), 1, 0),
    "near, at 195 degrees": ((-0.97, -0.26, 0.0), 6, 0),
    "near, at 345 degrees": ((0.97, -0.26, 0.0), 11, 0),
    "middle, at 45 degrees": ((1.3, 1.3, 0.0), 1, 1),
    "far, at 45 degrees": ((2.0, 2.0, 0.0), 1, 2),
    "near, from high above": ((0.7, 0.7, 3.0), 1, 0),
}


@table(("camera", "bearing", "distance"), VIEWPOINTS.values(), ids=VIEWPOINTS.keys())
def test_viewpoint_bin_of_a_camera(camera: tuple[float, float, float], bearing: int, distance: int) -> None:
    here = np.array([[4.0, -2.0, 1.0]])
    (number,) = viewpoint_bins(here, here[0] + camera, CONFIG)
    assert number == bearing + BEARING_BINS * distance


@table("eyes", [[(1.5, 2.0), (0.6, 2.0)], [(0.8, 2.0), (1.3, 3.2)]], ids=["two ranges", "two bearings"])
def test_viewpoints_are_counted_apart(eyes: list[tuple[float, float]]) -> None:
    counts = []
    for where in (eyes, eyes[:1] * 2):
        made = fresh()
        for number, (x, y) in enumerate(where):
            frame = looks((x, y, 1.0), AT, [POST], number)
            made.add(frame, found(frame, ("post", SURE, true_box(frame, 1))))
        tried, hits, _ = made.evidence()
        assert np.array_equal(tried, hits) and tried.sum() == 2
        counts.append((int((tried > 0).sum()), made.objects()[0].probability))
    assert [number for number, _ in counts] == [2, 1] and counts[0][1] > counts[1][1]


# ---- the posterior in closed form

PLAIN = DetectorScoreModel(beta_true=(2.0, 1.0), beta_false=(1.0, 3.0), prior_log_odds=-1.0, best_view_log_odds=0.0)


def log_odds(pairs: Sequence[tuple[float, float]], score_model: DetectorScoreModel, widest_rad: float = 0.1) -> float:
    tried, hits = np.zeros((2, 1, VIEWPOINT_BINS))
    for k, (t, h) in enumerate(pairs):
        tried[0, 5 * k], hits[0, 5 * k] = t, h
    (likely,) = posterior(tried, hits, np.array([widest_rad]), score_model)
    return math.log(likely / (1 - likely))


def log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


def evidence(hit: float, miss: float) -> float:
    """What so much of a detection and of a miss is worth to PLAIN: Beta-binomial odds over the prior's."""
    real = log_beta(2.0 + hit, 1.0 + miss) - log_beta(2.0, 1.0)
    return real - (log_beta(1.0 + hit, 3.0 + miss) - log_beta(1.0, 3.0))


POSTERIOR: dict[str, tuple[list[tuple[float, float]], float]] = {
    "nothing": ([], 0.0),
    "one detection": ([(1, 1)], evidence(1 / 2, 0)),
    "one miss": ([(1, 0)], evidence(0, 1 / 2)),
    "half a detection": ([(1, 0.5)], evidence(1 / 4, 1 / 4)),
    "four detections from one viewpoint": ([(4, 4)], evidence(4 / 5, 0)),
    "four detections from four viewpoints": ([(1, 1)] * 4, evidence(2, 0)),
    "a thousand detections from one viewpoint": ([(1000, 1000)], evidence(1000 / 1001, 0)),
    "detections and misses": ([(3, 2), (1, 0), (2, 2)], evidence(2 / 4 + 2 / 3, 1 / 4 + 1 / 2)),
}


@table(("pairs", "expected"), POSTERIOR.values(), ids=POSTERIOR.keys())
def test_posterior_is_beta_binomial(pairs: list[tuple[float, float]], expected: float) -> None:
    assert log_odds(pairs, PLAIN) == pytest.approx(-1.0 + expected, abs=1e-6)


BEST = DetectorScoreModel(beta_true=(2.0, 1.0), beta_false=(1.0, 3.0), prior_log_odds=-1.0, best_view_log_odds=1.5)
SIZED = DetectorScoreModel(
    beta_true=(2.0, 1.0), beta_false=(1.0, 3.0), prior_log_odds=-1.0, best_view_log_odds=0.0, log_odds_per_log_width=0.8
)
TERMS: dict[str, tuple[DetectorScoreModel, list[tuple[float, float]], float, float]] = {
    "best viewpoint: a steady one": (BEST, [(9, 9), (1, 0)], 0.1, 1.5 * (0.9 - 0.5)),
    "best viewpoint: the best of three": (BEST, [(1, 1), (3, 3), (1, 0)], 0.1, 1.5 * (0.75 - 0.5)),
    "best viewpoint: never detected": (BEST, [(4, 0)], 0.1, 1.5 * -0.5),
    "size: as usual": (SIZED, [(1, 1)], 0.1, 0.0),
    "size: seen large": (SIZED, [(1, 1)], 0.4, -0.8 * math.log(4)),
    "size: seen small": (SIZED, [(1, 1)], 0.05, 0.8 * math.log(2)),
}


@table(("score_model", "pairs", "widest_rad", "more"), TERMS.values(), ids=TERMS.keys())
def test_posterior_terms(
    score_model: DetectorScoreModel, pairs: list[tuple[float, float]], widest_rad: float, more: float
) -> None:
    assert log_odds(pairs, score_model, widest_rad) - log_odds(pairs, PLAIN) == pytest.approx(more, abs=1e-6)


# ---- what detections weigh

WEIGHTS = {0.0: 0.02, 0.3: 0.02, 0.4: 0.25, 0.5: 0.5, 0.7: 1.0, 0.99: 1.0}


@table(("score", "weight"), WEIGHTS.items(), ids=[f"score {score}" for score in WEIGHTS])
def test_detection_weighs_by_its_score(score: float, weight: float) -> None:
    score_model = DetectorScoreModel(zero_weight_score=0.3, full_weight_score=0.7, spawn_threshold=0.0)
    assert detection_weights(np.array([score]), score_model) == pytest.approx(weight)
    made, frame = ObjectMap(score_model), flat()
    made.add(frame, found(frame, ("cup", score, square())))
    tried, hits, _ = made.evidence()
    assert tried.sum() == 1 and hits.sum() == pytest.approx(weight)


def test_weak_detections_confirm_nothing() -> None:
    likely = {}
    for score in (SURE, WEAK):
        made = fresh()
        for number, eye in enumerate(ROUND[:3]):
            frame = looks(eye, AT, [POST], number)
            made.add(frame, found(frame, ("post", score, true_box(frame, 1))))
        (obj,) = made.objects()
        assert (obj.n_detected, obj.n_observable) == (3, 3)
        likely[score] = obj
    assert likely[SURE].confirmed and not likely[WEAK].confirmed
    assert likely[SURE].probability > likely[WEAK].probability + 0.2


def test_widest_view_is_kept() -> None:
    made = fresh()
    for number, width in enumerate((24, 48, 30)):
        frame = flat(number)
        made.add(frame, found(frame, ("cup", SURE, square(width=width, height=width))))
    assert made.evidence()[2] == pytest.approx([48 / 120], rel=1e-3)


# ---- which objects are pruned

PRUNED = {"two of thirty": (2, 30, True), "two of twenty-nine": (2, 29, False), "three of thirty": (3, 30, False)}


@table(("n_detected", "n_observable", "gone"), PRUNED.values(), ids=PRUNED.keys())
def test_seldom_seen_object_is_pruned(n_detected: int, n_observable: int, gone: bool) -> None:
    made = fresh()
    for number in range(n_observable):
        frame = flat(number)
        rows = [("cup", SURE, square())] if number < n_detected else []
        made.add(frame, found(frame, *rows))
    made.merge_and_prune()
    assert [(obj.n_detected, obj.n_observable) for obj in made.objects()] == (
        [] if gone else [(n_detected, n_observable)]
    )


# ---- score models

NONSENSE: dict[str, dict[str, object]] = {
    "low above high": {"zero_weight_score": 0.6, "full_weight_score": 0.5},
    "spawning above one": {"spawn_threshold": 1.1},
    "threshold under zero": {"threshold": -0.1},
    "an infinite prior": {"prior_log_odds": math.inf},
    "a Beta of zero": {"beta_true": [0.0, 1.0]},
    "a Beta of three": {"beta_false": [1.0, 1.0, 1.0]},
}


@table("values", NONSENSE.values(), ids=NONSENSE.keys())
def test_nonsense_is_no_score_model(values: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        DetectorScoreModel.from_dict(values)


def test_score_model_is_read() -> None:
    values = {"zero_weight_score": 0.1, "full_weight_score": 0.6, "beta_true": [1, 2], "measured": "here"}
    assert DetectorScoreModel.from_dict(values) == DetectorScoreModel(
        zero_weight_score=0.1, full_weight_score=0.6, beta_true=(1.0, 2.0), measured="here"
    )
    with pytest.raises(TypeError):
        DetectorScoreModel.from_dict({"lowest": 0.1})


def test_another_threshold_moves_all_scores() -> None:
    whole = DetectorScoreModel(0.4, spawn_threshold=0.2, zero_weight_score=0.1, full_weight_score=0.3, measured="here")
    moved = whole.with_threshold(0.8)
    assert (moved.threshold, moved.spawn_threshold, moved.zero_weight_score, moved.full_weight_score) == pytest.approx(
        (0.8, 0.4, 0.2, 0.6)
    )
    assert moved.measured == "" and moved.beta_true == whole.beta_true
    assert whole.with_threshold(None) is whole and whole.with_threshold(0.4) is whole
    with pytest.raises(BackendError, match="threshold must be from 0 to 1"):
        whole.with_threshold(1.5)
