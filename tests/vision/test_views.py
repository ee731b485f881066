"""View selection: by apparent size and side, at most three, in the order in which they were taken."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cartier.vision.views import MAX_PICTURES, MIN_APPARENT_PX, apparent_px, ranked, select
from vision.staged_photos import mug

SIZE = (640, 480)
SIZES = dict.fromkeys(range(1, 20), SIZE)


def square(side: float) -> tuple[float, float, float, float]:
    return (100.0, 100.0, 100.0 + side, 100.0 + side)


@pytest.mark.parametrize(
    ("box", "pixels"),
    [((10, 10, 110, 60), 50), ((-30, 10, 40, 200), 40), ((600, 10, 900, 300), 40), ((700, 10, 800, 90), 0)],
)
def test_apparent_size_counts_the_visible_part(box: tuple[float, ...], pixels: float) -> None:
    view = mug(1, [(1, box, 0)]).views[0]  # type: ignore[list-item]
    assert apparent_px(view, SIZE) == pixels


def test_another_side_comes_before_a_larger_view() -> None:
    views = mug(1, [(1, square(200), 0), (2, square(190), 10), (3, square(80), 120)]).views
    assert [view.frame for view in ranked(views, SIZES)] == [1, 3, 2]


def test_small_views_are_left_out() -> None:
    thing = mug(1, [(1, square(MIN_APPARENT_PX - 1), 0), (2, square(MIN_APPARENT_PX), 90)])
    assert [view.frame for _, view in select([thing], SIZES)] == [2]


def test_views_stand_in_the_order_taken() -> None:
    thing = mug(1, [(9, square(200), 0), (4, square(150), 90), (7, square(100), 180)])
    assert [view.frame for _, view in select([thing], SIZES)] == [4, 7, 9]


def test_each_candidate_has_a_view_before_one_has_two() -> None:
    things = [mug(k, [(k, square(200), 0), (k + 10, square(190), 90)]) for k in (1, 2, 3, 4)]
    assert [(thing.id, view.frame) for thing, view in select(things, SIZES)] == [(1, 1), (2, 2), (3, 3)]
    assert len(select(things[:2], SIZES)) == MAX_PICTURES


def test_frames_without_a_photograph_are_left_out() -> None:
    thing = mug(1, [(1, square(200), 0), (2, square(100), 90)])
    assert [view.frame for _, view in select([thing], {2: SIZE})] == [2]
    assert [view.frame for _, view in select([thing], SIZES, out={1})] == [2]


def test_views_of_further_sides_are_asked_about() -> None:
    thing = mug(1, [(1, square(100), 0), (2, square(90), 180)])
    apart = replace(thing, views=thing.views[:1], side_views=thing.views[1:])
    assert [view.frame for _, view in select([apart], SIZES)] == [1, 2]
