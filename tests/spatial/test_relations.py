from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cartier.labels import display_name
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
from cartier_dollhouse.scene import load_home


def obj(label: str, low: Sequence[float], high: Sequence[float], id: int = 0, room: int | None = None) -> MapObject:
    corners = tuple(map(float, low)), tuple(map(float, high))
    middle = tuple((np.add(low, high) / 2).tolist())
    return MapObject(id, label, ((label, 1.0),), middle, *corners, 1.0, True, 3, 3, 0.0, 0.0, 0.0, (), (), room)


def cube(label: str, x: float, y: float, side: float = 0.2, z: float = 0.0, id: int = 0) -> MapObject:
    return obj(label, (x - side / 2, y - side / 2, z), (x + side / 2, y + side / 2, z + side), id)


TABLE = obj("dining table", (0, 0, 0), (1.6, 0.9, 0.75), 1)
SOFA = obj("sofa", (3, 0, 0), (5, 0.9, 0.85), 2)
SHELVES = obj("shelving unit", (6, 0, 0), (7, 0.35, 1.8), 3)
MUG = cube("mug", 0.4, 0.4, 0.1, 0.75, 10)
BOWL = cube("bowl", 1.0, 0.4, 0.2, 0.75, 11)
APPLE = cube("apple", 1.0, 0.4, 0.08, 0.78, 12)
PILLOW = obj("pillow", (3.2, 0.3, 0.42), (3.6, 0.6, 0.6), 13)
VASE = obj("vase", (6.2, 0.1, 1.0), (6.3, 0.2, 1.25), 14)
STATUE = obj("statue", (6.6, 0.1, 1.8), (6.7, 0.2, 2.0), 15)
PAINTING = obj("painting", (3.5, -0.03, 1.3), (4.5, 0.0, 1.9), 16)
CHAIR = obj("chair", (0.5, -0.3, 0), (0.95, 0.2, 0.85), 17)
BALL = cube("ball", 1.2, 0.6, 0.2, 0.0, 18)
HOME = (TABLE, SOFA, SHELVES, MUG, BOWL, APPLE, PILLOW, VASE, STATUE, PAINTING, CHAIR, BALL)


def told(relations: Sequence[Relation]) -> list[int]:
    return [relation.subject for relation in relations if relation.probability >= 0.5]


def test_what_things_stand_on_and_in() -> None:
    found = {i: (relation.kind, relation.object) for i, relation in supports(HOME).items()}
    assert found == {
        MUG.id: ("on", TABLE.id), BOWL.id: ("on", TABLE.id), APPLE.id: ("in", BOWL.id), PILLOW.id: ("on", SOFA.id),
        VASE.id: ("in", SHELVES.id), STATUE.id: ("on", SHELVES.id),
    }  # fmt: skip
    for relation in supports(HOME).values():
        assert 0.5 <= relation.probability <= 1 and relation.metres < 0.01


@pytest.mark.parametrize("high_m", [0.0, 0.05, 0.15], ids=["exact", "5 cm", "15 cm"])
def test_a_table_whose_box_has_some_of_what_stands_on_it_still_holds_it(high_m: float) -> None:
    blurred = replace(TABLE, box_max=(1.6, 0.9, 0.75 + high_m))
    found = supports((blurred, MUG))
    assert (found[MUG.id].kind, found[MUG.id].object) == ("on", TABLE.id)
    assert found[MUG.id].probability == pytest.approx(supports((TABLE, MUG))[MUG.id].probability, abs=0.1)


def test_a_chair_of_which_only_the_back_shows_above_a_table_does_not_stand_on_it() -> None:
    back = obj("chair", (0.5, 0.5, 0.72), (0.95, 0.85, 0.95), 20)
    assert supports([TABLE, back, MUG]) == supports([TABLE, MUG]) != {}


def test_a_thing_that_floats_higher_is_held_less_surely_until_it_is_not() -> None:
    n_observable = []
    for lift in (0.0, 0.05, 0.1, 0.2, 0.4):
        floating = cube("thing", 0.4, 0.4, 0.1, 0.75 + lift, 10)
        relation = supports((TABLE, floating)).get(10)
        n_observable.append(relation.probability if relation else 0.0)
    assert n_observable == sorted(n_observable, reverse=True) and n_observable[0] > 0.9 and n_observable[-1] == 0


@pytest.mark.parametrize("seed", range(8))
def test_each_thing_has_one_holder_at_most_and_none_holds_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    labels = ["table", "bowl", "box", "book", "pan", "shelf", "thing"]
    low = rng.uniform(0, 1, (40, 3)) * (1, 1, 0.5)
    crowd = [
        obj(labels[k % len(labels)], low[k], low[k] + rng.uniform(0.02, 0.5, 3), id=100 + k) for k in range(len(low))
    ]
    found = supports(crowd)
    assert len(found) > 5
    for i in found:
        chain = [i]
        while chain[-1] in found:
            chain.append(found[chain[-1]].object or 0)
            assert len(set(chain)) == len(chain), "nothing stands on what stands on it"


def test_neither_the_order_of_things_nor_where_the_home_lies_matters() -> None:
    def moved(one: MapObject, turn: bool) -> MapObject:
        low, high = np.array(one.box_min), np.array(one.box_max)
        if turn:  # by a right angle
            low, high = np.array([-high[1], low[0], low[2]]), np.array([-low[1], high[0], high[2]])
        shift = np.array([3.0, -7.0, 0.0])
        return replace(one, box_min=tuple(low + shift), box_max=tuple(high + shift))

    expected = supports(HOME)
    for turn in (False, True):
        found = supports([moved(one, turn) for one in reversed(HOME)])
        assert found.keys() == expected.keys()
        for i, relation in found.items():
            assert (relation.kind, relation.object) == (expected[i].kind, expected[i].object)
            assert relation.probability == pytest.approx(expected[i].probability)


@pytest.mark.parametrize("name", ["studio", "kitchen_diner", "family_flat"])
def test_in_a_home_with_true_boxes_what_stands_on_what_is_found(name: str) -> None:
    scene = load_home(name)
    boxes = {one.id: one.truth() for one in scene.things}
    objs = [obj(display_name(box.label), box.box_min, box.box_max, i) for i, box in boxes.items()]
    found = supports(objs)
    held = [one for one in scene.things if one.on and one.type != "Faucet"]  # which counts as hanging on the wall
    right = [one for one in held if one.id in found and found[one.id].object == one.on]
    assert len(held) > 20 and len(right) >= 0.9 * len(held)
    wrong = [one.id for one in scene.things if one.id in found and found[one.id].object != one.on]
    assert len(wrong) <= 0.08 * len(found)


def test_under_a_table_is_what_it_does_not_hold() -> None:
    assert told(under(TABLE, HOME)) == [BALL.id], "a chair that is pushed in by a third is not"
    assert told(under(SHELVES, HOME)) == []
    assert told(under(BOWL, HOME)) == [], "the table is larger"
    lamp = cube("lamp", 0.4, 0.4, 0.3, 1.9, 30)
    assert told(under(lamp, [MUG, lamp, TABLE])) == [MUG.id]


def test_next_to_is_beside_and_in_the_same_room() -> None:
    lamp = obj("floor lamp", (5.1, 0.2, 0), (5.4, 0.5, 1.6), 20)
    assert told(next_to(SOFA, [*HOME, lamp])) == [lamp.id], "neither the pillow on it nor the painting above it"
    assert told(next_to(lamp, [*HOME, lamp])) == [SOFA.id]
    apart = replace(SOFA, room=0), replace(lamp, room=1)
    assert next_to(*apart[:1], apart) == (), "a wall stands between"
    assert told(next_to(apart[0], [replace(lamp, room=0)])) == [lamp.id]


def test_what_is_farther_is_less_surely_next_to() -> None:
    n_observable = [
        sum(relation.probability for relation in next_to(BALL, [cube("box", 1.6 + far, 0.6, id=2)]))
        for far in (0, 0.2, 0.4, 0.6, 0.8, 2)
    ]
    assert n_observable == sorted(n_observable, reverse=True) and n_observable[0] > 0.9 and n_observable[-1] < 0.01
    (relation,) = next_to(BALL, [cube("box", 1.6, 0.6, id=2)])
    assert relation.metres == pytest.approx(0.2)


def test_between_is_on_the_line_and_not_beyond() -> None:
    a, b = cube("chair", 0, 0, id=1), cube("chair", 3, 0, id=2)
    row = [
        cube("thing", x, y, id=10 + k) for k, (x, y) in enumerate(((1.5, 0.1), (1, -0.4), (1.5, 2), (-1, 0), (4, 0)))
    ]
    relations = between(a, b, [a, b, *row])
    assert told(relations) == [10, 11]
    assert (relations[0].object, relations[0].other, relations[0].metres) == (1, 2, pytest.approx(0.1))
    assert told(between(b, a, row)) == told(relations)


def test_distances_are_between_boxes_and_not_their_middles() -> None:
    long, small = obj("sofa", (1, 0, 0), (4, 1, 1), 1), cube("stool", -0.9, 0.5, 0.4, id=2)
    here = cube("lamp", 0.4, 0.5, 0.2, id=3)
    first, second = nearest(here, [long, small, here])
    assert (first.subject, first.object) == (1, 3)
    assert (first.metres, second.metres) == (pytest.approx(0.5), pytest.approx(1.0))
    assert farthest(here, [long, small])[0].subject == 2


def test_two_that_are_as_near_share_the_probability() -> None:
    left, right, far = cube("cup", -1, 0, id=1), cube("cup", 1, 0, id=2), cube("cup", 5, 0, id=3)
    ranked = nearest((0.0, 0.0), [left, right, far])
    assert [relation.subject for relation in ranked] == [1, 2, 3] and ranked[0].object is None
    assert ranked[0].probability == ranked[1].probability == pytest.approx(0.5)
    unsure = replace(left, probability=0.25)
    n_observable = {relation.subject: relation.probability for relation in nearest((0.0, 0.0), [unsure, right])}
    assert n_observable == {1: pytest.approx(0.2), 2: pytest.approx(0.8)}, (
        "what may not exist is less likely the nearest"
    )


def test_a_point_may_have_a_height() -> None:
    low, high = cube("box", 0, 0, id=1), cube("box", 0.3, 0, z=2, id=2)
    assert nearest((0.0, 0.0), [low, high])[0].metres == 0
    assert nearest((0.3, 0.0, 2.1), [low, high])[0].subject == 2


def test_nothing_is_the_nearest_of_nothing() -> None:
    assert nearest(TABLE, [TABLE]) == farthest((0, 0), []) == next_to(TABLE, []) == under(TABLE, []) == ()
    assert between(TABLE, SOFA, [SOFA]) == left_of(TABLE, [], (0, 0)) == ()
    assert supports([]) == supports([MUG]) == {}


def test_left_from_one_side_is_right_from_the_other() -> None:
    desk, lamp = cube("desk", 0, 0, id=1), cube("lamp", 0.8, 0.1, id=2)
    south, north = (0.0, -3.0), (0.0, 3.0)
    assert told(right_of(desk, [lamp], south)) == told(left_of(desk, [lamp], north)) == [2]
    assert told(left_of(desk, [lamp], south)) == told(right_of(desk, [lamp], north)) == []
    assert right_of(desk, [lamp], south)[0].metres == pytest.approx(0.8)
    both = right_of(desk, [cube("lamp", 0.05, 0, id=2)], south), left_of(desk, [cube("lamp", 0.05, 0, id=2)], south)
    assert sum(relation.probability for (relation,) in both) == pytest.approx(1)


def test_a_pose_says_where_its_left_is() -> None:
    desk, lamp = cube("desk", 2, 0, id=1), cube("lamp", 2, 1, id=2)
    assert told(left_of(desk, [lamp], (0, 0, 0.0))) == [2], "it looks along x, y is to its left"
    assert told(left_of(desk, [lamp], (0, 0, math.pi))) == told(right_of(desk, [lamp], (0, 0, math.pi))) == [], "behind"


def test_one_of_two_is_bigger() -> None:
    small, large = cube("plant", 0, 0, 0.2, id=1), cube("plant", 1, 0, 0.5, id=2)
    there, back = bigger(large, small), bigger(small, large)
    assert there.probability > 0.95 and there.probability + back.probability == pytest.approx(1)
    assert there.metres == pytest.approx(0.3) == -back.metres
    assert bigger(small, cube("plant", 5, 5, 0.2, id=3)).probability == pytest.approx(0.5)
    flat = obj("plant", (0, 0, 0), (0, 0, 0), 4)
    assert bigger(flat, small).probability < 0.05, "a box without extent is no fault"


def test_every_probability_is_one() -> None:
    everything = itertools.chain(
        supports(HOME).values(), *(next_to(one, HOME) for one in HOME), *(under(one, HOME) for one in HOME),
        *(nearest(one, HOME) for one in HOME), *(between(a, b, HOME) for a, b in itertools.combinations(HOME, 2)),
        *(left_of(one, HOME, (2, -3)) for one in HOME),
    )  # fmt: skip
    for relation in everything:
        assert 0 <= relation.probability <= 1 and math.isfinite(relation.metres)
        assert relation.subject not in (relation.object, relation.other)


def test_supports_computed_once() -> None:
    kept = supports(HOME)
    assert supports(list(HOME)) is kept
    moved = (*HOME[:3], replace(MUG, position=(9.0, 9.0, 0.1), box_min=(8.9, 8.9, 0.0), box_max=(9.1, 9.1, 0.2)))
    assert MUG.id in supports(HOME[:4]) and MUG.id not in supports(moved)


def test_under_shares_the_supports() -> None:
    many = [cube("mug", 0.3 * k, 0.0, id=k) for k in range(70)]  # more than are kept
    kept = supports(many)
    for one in many:
        under(one, many)
    assert supports(many) is kept
