"""Objects without depth: bearings and apparent sizes tell how far they are, and until they do, the box says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cartier.mapping.bearings import BearingGeometry
from cartier.mapping.object_map import ObjectMap
from cartier.types import DetectorScoreModel, Frame, MapObject
from staged import CAMERA, SURE, Box, all_of, flat, found

table = pytest.mark.parametrize
AWAY_M, HALF_M = 3.0, 0.25


def view(number: int, x_m: float = 0.0, y_m: float = 0.0) -> Frame:
    return replace(flat(number, x_m=x_m, y_m=y_m), depth_m=None)


def projected(x_m: float, y_m: float, away_m: float = AWAY_M, at_m: float = 0.0, half_m: float = HALF_M) -> Box:
    """Where a camera at x_m, y_m sees an upright square ``away_m`` ahead of the origin, at_m to the right."""
    scale = CAMERA.fx / (away_m - y_m)
    x1, x2 = CAMERA.cx + (at_m - half_m - x_m) * scale, CAMERA.cx + (at_m + half_m - x_m) * scale
    edge = (0.0, CAMERA.width - 1.0)
    return (*np.clip([x1], *edge).tolist(), CAMERA.cy - half_m * scale, *np.clip([x2], *edge).tolist(),
            CAMERA.cy + half_m * scale)  # fmt: skip


def walked(places: Sequence[tuple[float, float]], **where: float) -> tuple[ObjectMap, list[MapObject]]:
    """A map of views of one square from some places, and the object after each of them."""
    made, after = ObjectMap(DetectorScoreModel(), geometry=BearingGeometry), []
    for number, (x_m, y_m) in enumerate(places):
        frame = view(number, x_m, y_m)
        assert made.add(frame, found(frame, ("box", SURE, projected(x_m, y_m, **where)))).tolist() == [0], number
        after.append(made.objects()[0])
    return made, after


ASIDE = [(x, 0.0) for x in np.linspace(-1.2, 1.2, 9)]
TOWARDS = [(0.0, y) for y in np.linspace(-0.5, 1.8, 9)]


@table(
    ("places", "away_m"),
    [(ASIDE, 2.4), (ASIDE, 3.0), (ASIDE, 4.0), (TOWARDS, 2.4)],
    ids=["bearings: 2.4 m", "bearings: 3 m", "bearings: 4 m", "sizes alone: 2.4 m"],
)
def test_several_views_give_the_distance(places: Sequence[tuple[float, float]], away_m: float) -> None:
    _, after = walked(places, away_m=away_m)
    assert not after[0].located and after[-1].located
    assert after[-1].position[1] == pytest.approx(away_m, rel=0.15)
    assert abs(after[-1].position[0]) < 0.1
    assert all(view.surface == after[-1].position for view in after[-1].views)


def test_open_distance_is_a_long_box_and_no_place() -> None:
    _, after = walked(ASIDE)
    once, last = after[0], after[-1]
    assert once.box_max[1] - once.box_min[1] > 3 * (last.box_max[1] - last.box_min[1]) and once.box_max[1] > AWAY_M
    assert all(view.surface is None for view in once.views) and len(once.views) == 1


@table(
    ("half_m", "least", "most"),
    [(0.05, 5.5, 12.0), (0.25, 2.2, 3.6), (0.6, 0.7, 1.5)],
    ids=["small", "middling", "large"],
)
def test_one_view_guesses_by_usual_size(half_m: float, least: float, most: float) -> None:
    """Things are about half a metre wide: what looks small is far away."""
    _, (once,) = walked([(0.0, 0.0)], half_m=half_m)
    assert least < (once.box_min[1] * once.box_max[1]) ** 0.5 < most


MATCHES: dict[str, tuple[str, Box, bool]] = {
    "where it should be": ("box", projected(0.6, 0.0), True),
    "another name, where it should be": ("crate", projected(0.6, 0.0), False),
    "a little aside": ("box", projected(0.68, 0.0), True),
    "a little aside, another name": ("crate", projected(0.68, 0.0), False),
    "elsewhere": ("box", projected(1.2, 0.0), False),
    "three times as large": ("box", projected(0.6, 0.0, half_m=3 * HALF_M), False),
}


@table(("name", "box", "same"), MATCHES.values(), ids=MATCHES.keys())
def test_view_matches_located_object(name: str, box: Box, same: bool) -> None:
    made, _ = walked(ASIDE)
    frame = view(20, 0.6)
    assert made.add(frame, found(frame, (name, SURE, box))).tolist() == [0 if same else 1]


def test_box_cut_by_the_edge_is_of_its_object() -> None:
    """Of what is half out of view neither the middle nor the size is known."""
    made, _ = walked(ASIDE)
    x_m = 1.92
    box = projected(x_m, 0.0)
    assert box[0] == 0.0 and box[2] < 14
    frame = view(20, x_m)
    assert made.add(frame, found(frame, ("box", SURE, box))).tolist() == [0]


def test_wrong_view_is_outvoted() -> None:
    """A second view that lies: the distances that it speaks against come back."""
    made = ObjectMap(DetectorScoreModel(), geometry=BearingGeometry)
    views = [(0.0, projected(0.0, 0.0)), (0.6, projected(0.6, 0.0, away_m=1.6, half_m=HALF_M * 1.6 / 3))]
    views += [(x, projected(x, 0.0)) for x in (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.2)]
    for number, (x_m, box) in enumerate(views):
        frame = view(number, x_m)
        assert made.add(frame, found(frame, ("box", SURE, box))).tolist() == [0]
    (obj,) = made.objects()
    assert obj.located and obj.position[1] == pytest.approx(AWAY_M, abs=0.12)


def test_frames_are_observable_once_the_distance_is_known() -> None:
    made, _ = walked(ASIDE[:1])
    made.add(view(1, -1.2), found(view(1, -1.2)))
    assert made.objects()[0].n_observable == 1
    made, after = walked(ASIDE)
    made.add(view(20, 0.0), found(view(20, 0.0)))
    (obj,) = made.objects()
    assert obj.n_observable == after[-1].n_observable + 1 and obj.n_detected == after[-1].n_detected
    assert obj.probability < after[-1].probability
    made.add(view(21, 4.0), found(view(21, 4.0)))
    assert made.objects()[0].n_observable == obj.n_observable, "out of view"


def test_two_of_a_name_stay_two() -> None:
    made = ObjectMap(DetectorScoreModel(), geometry=BearingGeometry)
    for number, (x_m, y_m) in enumerate(ASIDE):
        frame = view(number, x_m, y_m)
        rows = [("box", SURE, projected(x_m, y_m, at_m=at)) for at in (-0.4, 0.4)]
        assert made.add(frame, all_of(frame, *rows)).tolist() == [0, 1]
    places = [obj.position for obj in made.objects()]
    assert places[0][0] == pytest.approx(-0.4, abs=0.1) and places[1][0] == pytest.approx(0.4, abs=0.1)
