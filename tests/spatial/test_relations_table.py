"""Spatial relations as a table: each predicate both ways round, with a near miss of each, on boxes of known size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pytest

from cartier.spatial.relations import (
    Relation,
    between,
    bigger,
    farthest,
    left_of,
    nearest,
    next_to,
    right_of,
    supports,
    under,
)
from cartier.types import MapObject

TRUE_FROM = 0.5  # probability


def box(label: str, low: Sequence[float], high: Sequence[float], id: int, room: int | None = None) -> MapObject:
    corners = tuple(map(float, low)), tuple(map(float, high))
    middle = tuple((a + b) / 2 for a, b in zip(*corners, strict=True))
    return MapObject(id, label, ((label, 1.0),), middle, *corners, 1.0, True, 3, 3, 0.0, 0.0, 0.0, (), (), room)


def cube(
    label: str, x: float, y: float, side: float, z: float = 0.0, id: int = 2, room: int | None = None
) -> MapObject:
    half = side / 2
    return box(label, (x - half, y - half, z), (x + half, y + half, z + side), id, room)


def probability(relations: Sequence[Relation], subject: int) -> float:
    return next((relation.probability for relation in relations if relation.subject == subject), 0.0)


TABLE = box("dining table", (0, 0, 0), (1.6, 0.9, 0.75), 1)
SHELVES = box("bookcase", (0, 0, 0), (1, 0.35, 1.8), 1)
CRATE = box("box", (0, 0, 0), (0.6, 0.4, 0.3), 1)
BED = box("bed", (0, 0, 0), (1.6, 2.0, 0.55), 1)
DRAWERS = box("wardrobe", (0, 0, 0), (1.2, 0.6, 0.75), 1)
STONE = box("stone", (0, 0, 0), (1.6, 0.9, 0.75), 1)
BOWL = cube("bowl", 1.0, 0.4, 0.2, 0.75, 3)


@dataclass(frozen=True)
class Held:
    """What a subject stands on or in: the expected kind and holder, None for nothing."""

    says: str
    subject: MapObject
    others: tuple[MapObject, ...]
    expected: tuple[str, int] | None


HELD = (
    Held("a mug on a table", cube("mug", 0.4, 0.4, 0.1, 0.75), (TABLE,), ("on", 1)),
    Held("a table on a mug", TABLE, (cube("mug", 0.4, 0.4, 0.1, 0.75),), None),
    Held("a mug beside the table, as high", cube("mug", 1.9, 0.4, 0.1, 0.75), (TABLE,), None),
    Held("a mug over the rim by less than half", cube("mug", 1.58, 0.4, 0.1, 0.75), (TABLE,), ("on", 1)),
    Held("a mug 5 cm over the table", cube("mug", 0.4, 0.4, 0.1, 0.80), (TABLE,), ("on", 1)),
    Held("a mug 35 cm over the table", cube("mug", 0.4, 0.4, 0.1, 1.10), (TABLE,), None),
    Held("a mug 5 cm over a stone", cube("mug", 0.4, 0.4, 0.1, 0.80), (STONE,), ("on", 1)),
    Held("a mug by a fifth over a stone", cube("mug", 1.66, 0.4, 0.1, 0.75), (STONE,), None),
    Held("a mug 20 cm over a stone", cube("mug", 0.4, 0.4, 0.1, 0.95), (STONE,), None),
    Held("a ball on the floor under the table", cube("ball", 0.8, 0.4, 0.2), (TABLE,), None),
    Held("a chair pushed under a table", box("chair", (0.3, 0.2, 0), (0.7, 0.7, 0.9), 2), (TABLE,), None),
    Held("the back of a chair above a table", box("chair", (0.3, 0.2, 0.72), (0.7, 0.7, 0.95), 2), (TABLE,), None),
    Held("an apple in a bowl on a table", cube("apple", 1.0, 0.4, 0.08, 0.78), (TABLE, BOWL), ("in", 3)),
    Held("an apple beside the bowl on the table", cube("apple", 0.4, 0.4, 0.08, 0.75), (TABLE, BOWL), ("on", 1)),
    Held("a vase in a bookcase", cube("vase", 0.5, 0.17, 0.2, 1.0), (SHELVES,), ("in", 1)),
    Held("a vase on a bookcase", cube("vase", 0.5, 0.17, 0.2, 1.8), (SHELVES,), ("on", 1)),
    Held("a toy in a box", cube("toy", 0.3, 0.2, 0.1, 0.1), (CRATE,), ("in", 1)),
    Held(
        "a pillow on a bed, below its highest", box("pillow", (0.2, 1.5, 0.4), (0.8, 1.9, 0.55), 2), (BED,), ("on", 1)
    ),
    Held("a painting before a sofa's back", box("painting", (0.2, 0, 0.8), (1, 0.03, 1.3), 2), (DRAWERS,), None),
    Held("a mirror whose foot meets a stone", box("mirror", (0.2, 0, 0.76), (1, 0.03, 1.3), 2), (STONE,), None),
    Held("a vase there", box("vase", (0.2, 0, 0.76), (0.4, 0.2, 1.0), 2), (STONE,), ("on", 1)),
)


@pytest.mark.parametrize("row", HELD, ids=lambda row: row.says)
def test_on_and_in(row: Held) -> None:
    found = supports([row.subject, *row.others]).get(row.subject.id)
    assert (None if found is None else (found.kind, found.object)) == row.expected
    assert supports([*reversed(row.others), row.subject]).get(row.subject.id) == found, "whatever the order"


def test_two_boxes_at_one_place_hold_each_other_not() -> None:
    one, other = (box("box", (0, 0, 0.5), (0.4, 0.4, 0.8), id) for id in (1, 2))
    assert len(supports([one, other])) == 1


@dataclass(frozen=True)
class Row:
    """``predicate`` of the arguments holds of object 2, or does not; the one beside it is its near miss."""

    says: str
    predicate: Callable[..., tuple[Relation, ...]]
    arguments: tuple[Any, ...]
    expected: bool


BALL = cube("ball", 0.8, 0.4, 0.2)
SOFA = box("sofa", (0, 0, 0), (2, 0.9, 0.85), 1, 0)
DESK = cube("desk", 0, 0, 0.6, id=1)
TABLE_4 = replace(TABLE, id=4)
A, B = cube("chair", 0, 0, 0.4, id=1), cube("chair", 4, 0, 0.4, id=3)
NEAR_A, NEAR_B = cube("chair", 0, 0, 0.2, id=1), cube("chair", 1, 0, 0.2, id=3)
SOUTH, NORTH = (0.0, -3.0), (0.0, 3.0)
BOXED = cube("toy", 0.8, 0.4, 0.1, 0.1, id=5)


def lamp(gap_m: float, **about: Any) -> MapObject:
    """To the right of the sofa, so far from it."""
    return box("lamp", (2 + gap_m, 0.3, 0), (2.3 + gap_m, 0.6, 1.6), 2, about.get("room", 0))


ROWS = (
    # under
    Row("a ball under a table", under, (TABLE, [BALL]), True),
    Row("a table under a ball", under, (replace(BALL, id=1), [replace(TABLE, id=2)]), False),
    Row("a ball above a table", under, (TABLE, [cube("ball", 0.8, 0.4, 0.2, 1.5)]), False),
    Row("a ball on a table", under, (TABLE, [cube("ball", 0.8, 0.4, 0.2, 0.75)]), False),
    Row("a ball beside a table", under, (TABLE, [cube("ball", 2.0, 0.4, 0.2)]), False),
    Row("a ball by a quarter under a table", under, (TABLE, [cube("ball", 1.65, 0.4, 0.2)]), False),
    Row(
        "a table under a lamp that hangs over it",
        under,
        (cube("lamp", 0.4, 0.4, 2, 2.0, 1), [cube("mug", 0.4, 0.4, 0.1, 0.75)]),
        True,
    ),
    Row("a ball in a bowl's outline on the floor", under, (replace(BOWL, id=1), [cube("ball", 1.0, 0.4, 0.1)]), True),
    Row("a box between a bed's legs", under, (BED, [cube("box", 0.8, 1.0, 0.3)]), True),
    Row("a chair between a bed's legs", under, (BED, [box("chair", (0.5, 0.5, 0), (0.9, 0.9, 0.5), 2)]), False),
    Row("a ball between the legs of no table", under, (STONE, [BALL]), False),
    Row(
        "a pan under a hood, on one hob",
        under,
        (
            box("hood", (0.4, 0.2, 1.5), (1.2, 0.7, 1.7), 1),
            [box("pan", (0.6, 0.3, 0.75), (0.9, 0.6, 0.85), 2), TABLE_4],
        ),
        True,
    ),
    Row(
        "the bowl under what is in it",
        under,
        (cube("apple", 1.0, 0.4, 0.08, 0.78, 1), [replace(BOWL, id=2), TABLE_4]),
        False,
    ),
    Row(
        "the lower of two that one shelf holds",
        under,
        (
            box("vase", (0.4, 0.1, 1.2), (0.6, 0.3, 1.4), 1),
            [box("cup", (0.45, 0.15, 0.5), (0.55, 0.25, 0.6), 2), replace(SHELVES, id=4)],
        ),
        False,
    ),
    # next to
    Row("a lamp 0.2 m beside a sofa", next_to, (SOFA, [lamp(0.2)]), True),
    Row("that sofa next to the lamp", next_to, (replace(lamp(0.2), id=1), [replace(SOFA, id=2)]), True),
    Row("a lamp 0.8 m beside a sofa", next_to, (SOFA, [lamp(0.8)]), False),
    Row("a lamp behind the wall", next_to, (SOFA, [lamp(0.2, room=1)]), False),
    Row("a lamp of which no room is known", next_to, (SOFA, [replace(lamp(0.2), room=None)]), True),
    Row("a clock high beside a sofa", next_to, (SOFA, [box("clock", (2.1, 0.3, 1.5), (2.3, 0.5, 1.7), 2, 0)]), False),
    Row(
        "a shelf just above a sofa's height",
        next_to,
        (SOFA, [box("shelf", (2.1, 0.3, 1.0), (2.3, 0.5, 1.2), 2, 0)]),
        True,
    ),
    Row(
        "a cup 0.25 m higher than a cup",
        next_to,
        (cube("cup", 0, 0, 0.1, id=1), [cube("cup", 0.12, 0, 0.1, 0.35)]),
        True,
    ),
    Row(
        "a cup 0.38 m higher than a cup",
        next_to,
        (cube("cup", 0, 0, 0.1, id=1), [cube("cup", 0.12, 0, 0.1, 0.48)]),
        False,
    ),
    Row("a pillow on the sofa", next_to, (SOFA, [box("pillow", (0.2, 0.3, 0.6), (0.6, 0.7, 0.85), 2, 0)]), False),
    Row("a ball under a table is not beside it", next_to, (TABLE, [BALL]), False),
    Row("two cups 0.45 m apart", next_to, (cube("cup", 0, 0, 0.1, id=1), [cube("cup", 0.55, 0, 0.1)]), True),
    Row("two cups 0.65 m apart", next_to, (cube("cup", 0, 0, 0.1, id=1), [cube("cup", 0.75, 0, 0.1)]), False),
    Row(
        "two beds 0.45 m apart",
        next_to,
        (box("bed", (0, 0, 0), (2, 3, 0.5), 1), [box("bed", (2.45, 0, 0), (4.45, 3, 0.5), 2)]),
        True,
    ),
    Row(
        "two beds 0.55 m apart",
        next_to,
        (box("bed", (0, 0, 0), (2, 3, 0.5), 1), [box("bed", (2.55, 0, 0), (4.55, 3, 0.5), 2)]),
        False,
    ),
    # between
    Row("a ball half-way", between, (A, B, [cube("ball", 2, 0, 0.2)]), True),
    Row("a ball half-way, of B and A", between, (B, A, [cube("ball", 2, 0, 0.2)]), True),
    Row("a ball beyond the end", between, (A, B, [cube("ball", 4.5, 0, 0.2)]), False),
    Row("a ball before the beginning", between, (A, B, [cube("ball", -0.5, 0, 0.2)]), False),
    Row("a ball 0.9 m off a line of 4 m", between, (A, B, [cube("ball", 2, 0.9, 0.2)]), True),
    Row("a ball 1.2 m off a line of 4 m", between, (A, B, [cube("ball", 2, 1.2, 0.2)]), False),
    Row("a ball 0.25 m off a line of 1 m", between, (NEAR_A, NEAR_B, [cube("ball", 0.5, -0.2, 0.1)]), True),
    Row("a ball 0.45 m off a line of 1 m", between, (NEAR_A, NEAR_B, [cube("ball", 0.5, -0.45, 0.1)]), False),
    # left of, right of: whoever stands south looks north, and has the east to the right
    Row("east of a desk from the south is right", right_of, (DESK, [cube("lamp", 0.5, 0.1, 0.2)], SOUTH), True),
    Row("west of a desk from the south is not right", right_of, (DESK, [cube("lamp", -0.5, 0.1, 0.2)], SOUTH), False),
    Row("west of a desk from the south is left", left_of, (DESK, [cube("lamp", -0.5, 0.1, 0.2)], SOUTH), True),
    Row("east of a desk from the south is not left", left_of, (DESK, [cube("lamp", 0.5, 0.1, 0.2)], SOUTH), False),
    Row("east of a desk from the north is left", left_of, (DESK, [cube("lamp", 0.5, 0.1, 0.2)], NORTH), True),
    Row("east of a desk from the north is not right", right_of, (DESK, [cube("lamp", 0.5, 0.1, 0.2)], NORTH), False),
    Row("behind who looks, to the left", left_of, (DESK, [cube("lamp", -0.5, -4, 0.2)], SOUTH), False),
    Row(
        "before who looks along x, to the left",
        left_of,
        (cube("desk", 2, 0, 0.4, id=1), [cube("lamp", 2, 1, 0.2)], (0, 0, 0.0)),
        True,
    ),
    Row(
        "who looks along y has the east right",
        right_of,
        (cube("desk", 2, 1, 0.4, id=1), [cube("lamp", 3, 2, 0.2)], (0, 0, math.pi / 2)),
        True,
    ),
    Row(
        "who looks along y has the east not left",
        left_of,
        (cube("desk", 2, 1, 0.4, id=1), [cube("lamp", 3, 2, 0.2)], (0, 0, math.pi / 2)),
        False,
    ),
    # in room
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.predicate.__name__}: {row.says}")
def test_predicate(row: Row) -> None:
    assert (probability(row.predicate(*row.arguments), 2) >= TRUE_FROM) == row.expected


ORIGIN = cube("here", 0, 0, 0.2, id=1)
RANKED = (  # from what, the objects, the id of the nearest and of the farthest
    ("from a thing", ORIGIN, [cube("cup", 1, 0, 0.2, id=2), cube("cup", 2, 0, 0.2, id=3)], 2, 3),
    ("to the other side", ORIGIN, [cube("cup", -1, 0, 0.2, id=2), cube("cup", -2, 0, 0.2, id=3)], 2, 3),
    ("one on each side", ORIGIN, [cube("cup", -1, 0, 0.2, id=2), cube("cup", 1.5, 0, 0.2, id=3)], 2, 3),
    ("along y", ORIGIN, [cube("cup", 0, -2, 0.2, id=2), cube("cup", 0, 1, 0.2, id=3)], 3, 2),
    ("upwards", ORIGIN, [cube("cup", 0, 0, 0.2, 1.5, id=2), cube("cup", 1, 0, 0.2, id=3)], 3, 2),
    ("from a point", (0.0, 0.0), [cube("cup", 1, 0, 0.2, id=2), cube("cup", 2, 0, 0.2, id=3)], 2, 3),
    ("a point has no height", (0.0, 0.0), [cube("cup", 0.5, 0, 0.2, 2.0, id=2), cube("cup", 1, 0, 0.2, id=3)], 2, 3),
    ("a point with a height", (0.0, 0.0, 0.0), [cube("cup", 0.5, 0, 0.2, 2, 2), cube("cup", 1, 0, 0.2, id=3)], 3, 2),
    (
        "by the boxes and not their middles",
        ORIGIN,
        [box("sofa", (0.5, -1, 0), (4, 1, 1), 2), cube("cup", 1.5, 0, 0.2, id=3)],
        2,
        3,
    ),
)


@pytest.mark.parametrize("row", RANKED, ids=lambda row: row[0])
def test_nearest_and_farthest(row: tuple[str, Any, list[MapObject], int, int]) -> None:
    _, here, objects, near, far = row
    for order in (objects, objects[::-1]):
        assert nearest(here, order)[0].subject == near
        assert farthest(here, order)[0].subject == far
        assert nearest(here, order)[0].metres < farthest(here, order)[0].metres


def test_a_doubtful_object_is_less_likely_the_nearest() -> None:
    doubtful, sure = replace(cube("cup", 1, 0, 0.2), probability=0.2), cube("cup", 0, 1, 0.2, id=3)
    assert probability(nearest((0, 0), [doubtful, sure]), 2) == pytest.approx(0.2 / 1.2)
    assert probability(farthest((0, 0), [doubtful, sure]), 3) == pytest.approx(1 / 1.2)


SIZES = (  # (m, m, m) of one and of the other; whether the first is bigger, None if neither
    ("twice each side", (0.4, 0.4, 0.4), (0.2, 0.2, 0.2), True),
    ("half each side", (0.2, 0.2, 0.2), (0.4, 0.4, 0.4), False),
    ("the same", (0.3, 0.2, 0.1), (0.3, 0.2, 0.1), None),
    ("the same, turned", (0.3, 0.2, 0.1), (0.1, 0.3, 0.2), None),
    ("as long, but of more volume", (1.0, 0.8, 0.8), (1.0, 0.2, 0.2), True),
    ("as long, but of less volume", (1.0, 0.2, 0.2), (1.0, 0.8, 0.8), False),
    ("of one volume, but longer", (1.6, 0.4, 0.1), (0.4, 0.4, 0.4), True),
    ("of one volume, but shorter", (0.4, 0.4, 0.4), (1.6, 0.4, 0.1), False),
    ("a plane and a cube", (0.3, 0.3, 0.0), (0.3, 0.3, 0.3), False),
)


@pytest.mark.parametrize("row", SIZES, ids=lambda row: row[0])
def test_bigger(row: tuple[str, tuple[float, ...], tuple[float, ...], bool | None]) -> None:
    _, size, other_size, expected = row
    one, other = box("plant", (0, 0, 0), size, 1), box("plant", (0, 0, 0), other_size, 2)
    there, back = bigger(one, other), bigger(other, one)
    assert there.probability + back.probability == pytest.approx(1)
    assert there.metres == pytest.approx(max(size) - max(other_size))
    if expected is None:
        assert there.probability == pytest.approx(0.5)
    else:
        assert (there.probability > 0.85) == expected and (there.probability < 0.15) == (not expected)
