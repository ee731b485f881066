from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fake_runs import METHODS, TYPES, fake_rows, row
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.errors import InputError
from cartier_bench.summary import MIN_RESAMPLES, RADII_M, summarise

FEW = MIN_RESAMPLES


@st.composite
def runs(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Rows of up to three methods that were not all asked the same, with places missing here and there."""
    cases = st.tuples(st.integers(0, 3), st.integers(0, 5), st.sampled_from(["object_depth", "nlmap", "mine"]))
    rows = []
    for home, query, method in sorted(draw(st.sets(cases, min_size=1, max_size=40))):
        distance = draw(st.none() | st.floats(0, 20))
        rows.append(
            row(
                f"home {home}",
                f"query {query}",
                method,
                type=TYPES[query % 3],
                match=draw(st.booleans()),
                distance_m=distance,
                distance_floor_m=None if distance is None else distance * draw(st.floats(0, 1)),
                goal_reachable=None if distance is None else draw(st.none() | st.booleans()),
                seconds=draw(st.floats(0, 100)),
                llm_calls=draw(st.integers(0, 3)),
                tokens=draw(st.integers(0, 5000)),
            )
        )
    return rows


def each(summary: dict[str, Any]) -> list[dict[str, Any]]:
    return [numbers for kinds in summary["methods"].values() for numbers in kinds.values()]


@settings(max_examples=40, deadline=None)
@given(runs())
def test_every_number_keeps_its_bounds(rows: list[dict[str, Any]]) -> None:
    summary = summarise(rows, resamples=FEW)
    assert sum(x["n"] for x in each(summary)) == len(rows)
    assert sum(x["n_placed"] for x in each(summary)) == sum(r["distance_m"] is not None for r in rows)
    for x in each(summary):
        assert 0 <= x["match_ci"][0] <= x["match_ci"][1] <= 1
        assert 0 <= x["match"] <= 1
        shares = [x["success"][radius] for radius in RADII_M]
        assert all(a <= b for a, b in pairwise(shares))
        assert shares[0] >= 0 and shares[-1] <= x["n_placed"] / x["n"] + 1e-6
        assert (x["distance_mean_m"] is None) == (x["distance_mean_ci"] is None) == (x["n_placed"] == 0)
        if x["n_placed"]:
            assert 0 <= x["distance_mean_ci"][0] <= x["distance_mean_ci"][1]
            assert x["distance_floor_mean_m"] <= x["distance_mean_m"] + 1e-6


@settings(max_examples=25, deadline=None)
@given(runs(), st.randoms(use_true_random=False))
def test_the_order_of_rows_changes_nothing(rows: list[dict[str, Any]], random: Any) -> None:
    shuffled = list(rows)
    random.shuffle(shuffled)
    assert summarise(shuffled, 3, FEW) == summarise(rows, 3, FEW)


@settings(max_examples=25, deadline=None)
@given(runs(), st.floats(0.1, 8))
def test_distances_scale_and_shares_do_not(rows: list[dict[str, Any]], factor: float) -> None:
    scaled = [
        r | {key: None if r[key] is None else factor * r[key] for key in ("distance_m", "distance_floor_m")}
        for r in rows
    ]
    for x, y in zip(each(summarise(rows, resamples=FEW)), each(summarise(scaled, resamples=FEW)), strict=True):
        assert y["match_ci"] == x["match_ci"]
        if x["n_placed"]:
            for key in ("distance_mean_m", "distance_median_m", "distance_floor_mean_m", "distance_mean_ci"):
                np.testing.assert_allclose(y[key], factor * np.asarray(x[key]), atol=1e-5)


@settings(max_examples=25, deadline=None)
@given(runs())
def test_a_method_differs_from_its_twin_by_nothing(rows: list[dict[str, Any]]) -> None:
    mine = [r | {"method": "object_depth"} for r in rows if r["method"] == "mine"]
    twin = [r | {"method": "twin"} for r in mine]
    for x in summarise(mine + twin, resamples=FEW)["paired"].get("object_depth", {}).get("twin", {}).values():
        assert (x["match"], x["match_ci"], x["success_1m"], x["success_1m_ci"]) == (0, [0, 0], 0, [0, 0])
        assert (x["distance_m"], x["distance_ci"]) in [(0, [0, 0]), (None, None)]


def test_numbers_by_hand() -> None:
    rows = [
        row("a", "q1", "object_depth", distance_m=0.2, distance_floor_m=0.1, seconds=1.0),
        row("b", "q1", "object_depth", distance_m=1.0, distance_floor_m=0.5, goal_reachable=False, tokens=100,
            seconds=3.0),
        row("a", "q2", "object_depth", distance_m=3.0, distance_floor_m=3.0, match=False, seconds=5.0),
        row("b", "q2", "object_depth", distance_m=None, distance_floor_m=None, goal_reachable=None, object=None,
            match=False, status="not_found"),
    ]  # fmt: skip
    x = summarise(rows)["methods"]["object_depth"]["implicit"]
    assert (x["n"], x["n_placed"], x["match"]) == (4, 3, 0.5)
    assert (x["distance_mean_m"], x["distance_median_m"], x["distance_floor_mean_m"]) == (1.4, 1.0, 1.2)
    assert x["success"] == {"0.25": 0.25, "0.5": 0.25, "1": 0.5, "1.5": 0.5, "2": 0.5}, "no place is a miss"
    assert x["goal_reachable"] == pytest.approx(2 / 3, abs=1e-6)
    assert (x["llm_calls"], x["tokens"], x["seconds_median"]) == (1, 175, 2)
    # Two requests: drawn are q1 twice (all right), q2 twice (all wrong) or both; a quarter, a quarter, a half.
    assert x["match_ci"] == [0, 1]
    assert x["distance_mean_ci"] == [0.6, 3.0], "the mean of the places of q1 alone, and of q2 alone"


def test_a_perfect_method_is_perfect() -> None:
    rows = [r for r in fake_rows() if r["method"] == "object_depth"]
    rows = [r | {"match": True, "distance_m": 0.0, "distance_floor_m": 0.0, "goal_reachable": True} for r in rows]
    for x in each(summarise(rows, resamples=FEW)):
        assert (x["match"], x["match_ci"]) == (1, [1, 1])
        assert (x["distance_mean_m"], x["distance_mean_ci"]) == (0, [0, 0])
        assert set(x["success"].values()) == {1}


def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    held = []
    for seed in range(60):
        right = {f"q{n}": bool(rng.random() < 0.7) for n in range(60)}
        rows = [row("home", q, "object_depth", match=m, distance_m=float(rng.gamma(2, 0.5))) for q, m in right.items()]
        (x,) = each(summarise(rows, seed, 400))
        held += [x["match_ci"][0] <= 0.7 <= x["match_ci"][1], x["distance_mean_ci"][0] <= 1 <= x["distance_mean_ci"][1]]
    assert 0.85 <= np.mean(held) <= 0.99


def test_one_text_in_many_homes_is_one_text() -> None:
    """Copies of every answer in ten homes make no interval narrower, as they would if homes were drawn one by one."""
    one = [row("h0", f"q{n}", "object_depth", match=n % 3 > 0, distance_m=n / 10) for n in range(20)]
    ten = [r | {"home": f"h{h}"} for r in one for h in range(10)]
    (few,), (many,) = each(summarise(one)), each(summarise(ten))
    assert few["match_ci"] == many["match_ci"]
    assert few["distance_mean_ci"] == many["distance_mean_ci"]


def test_pairs_are_the_cases_that_both_were_asked() -> None:
    rows = [row("h", f"q{n}", "object_depth", distance_m=1.0) for n in range(6)]
    rows += [row("h", f"q{n}", "nlmap", distance_m=3.0, match=False) for n in range(3, 9)]
    rows += [row("h", "q9", "vlmaps")]
    paired = summarise(rows, resamples=FEW)["paired"]["object_depth"]
    x = paired["nlmap"]["implicit"]
    assert (x["n"], x["n_placed"], x["match"], x["success_1m"], x["distance_m"]) == (3, 3, 1, 1, -2)
    assert (x["match_ci"], x["distance_ci"]) == ([1, 1], [-2, -2])
    assert paired["vlmaps"] == {}, "no case in common, no difference"
    assert "paired" in (alone := summarise([rows[-1]], resamples=FEW)) and alone["paired"] == {}


def test_methods_stand_in_the_fixed_order() -> None:
    rows = [*fake_rows(1, 2), row("h", "q", "my_own"), row("h", "q", "another")]
    assert list(summarise(rows, resamples=FEW)["methods"]) == [*METHODS, "another", "my_own"]


def test_the_seed_decides_the_draws() -> None:
    rows = fake_rows()
    assert summarise(rows, 1, FEW) == summarise(rows, 1, FEW)
    assert summarise(rows, 1, FEW) != summarise(rows, 2, FEW)


BROKEN = [
    ([row("h", "q", "nlmap"), row("h", "q", "nlmap")], "nlmap answered 'q' in 'h' twice"),
    ([row("h", "q", "nlmap"), row("h", "p", "nlmap", detector="other")], "in 'h' with two detectors"),
    ([row("h", "q", "nlmap"), row("h", "p", "nlmap", reasoner="other")], "in 'h' with two reasoners"),
    ([row("h", "q", "nlmap"), row("h", "p", "nlmap", status="alarm", detector="other")], "in 'h' with two detectors"),
    ([row("h", "q", "nlmap", distance_m=-1.0)], "result 1: distance_m: input should be greater than or equal to 0"),
    ([row("h", "q", "nlmap", distance_m=float("nan"))], "result 1: distance_m: input should be a finite number"),
    ([row("h", "q", "nlmap", match="yes")], "result 1: match: input should be a valid boolean"),
    ([row("h", "q", "nlmap", type="rude")], 
        "result 1: type: input should be 'explicit', 'implicit' or 'conversational'"),
    ([row("h", "q", "<b>")], "result 1: method: "),
    ([row("h", "q", "nlmap", text="\ud800")], "result 1: text: half a character"),
    ([row("h", "q", "nlmap"), {"home": "h"}], "result 2: query_id: field required"),
    ([7], "result 1: the line: "),
]  # fmt: skip


@pytest.mark.parametrize(("rows", "fault"), BROKEN, ids=[fault for _, fault in BROKEN])
def test_broken_rows_are_named_in_one_line(rows: list[Any], fault: str) -> None:
    with pytest.raises(InputError) as caught:
        summarise(rows, resamples=FEW)
    assert fault in str(caught.value) and "\n" not in str(caught.value)


def test_an_alarm_comes_before_any_reasoner() -> None:
    alarm = row("h", "p", "nlmap", status="alarm", object=None, match=False, reasoner="alarm screen")
    assert summarise([row("h", "q", "nlmap"), alarm], resamples=FEW)["methods"]


def test_too_few_resamples_are_refused() -> None:
    with pytest.raises(InputError, match="give no interval"):
        summarise([row("h", "q", "nlmap")], resamples=1)


def test_whose_fault_a_wrong_answer_is() -> None:
    """Eyes where nothing right was listed, index where the right name lies elsewhere, words for the rest."""
    answers = [(True, 0.2), (True, 3.0), (False, 0.1), (False, None), (False, None)]
    rows = [
        row(f"home {n}", "query", "object_depth", type="explicit", match=match, distance_m=far, distance_floor_m=far)
        for n, (match, far) in enumerate(answers)
    ]
    truth = [
        row(f"home {n}", "query", "true_object", type="explicit", match=n != 4, distance_m=0.0, distance_floor_m=0.0)
        for n in range(5)
    ]
    told = summarise(rows + truth, resamples=FEW)["faults"]
    assert told["object_depth"]["explicit"] == {"none": 1, "index": 1, "words": 2, "detector": 1}
    assert list(told) == ["object_depth"]
    assert summarise(rows, resamples=FEW)["faults"] == {}, "without the yardstick nobody knows what was listed"
