"""The bench's own predicates against those that it measures, on the true boxes of the built-in homes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from cartier.navigation import layers
from cartier.navigation.planning import traversable
from cartier.spatial import relations
from cartier.types import RobotModel
from cartier_bench import predicates, route_drives, route_homes
from cartier_bench.true_home import scene_of, true_objects
from cartier_dollhouse.place import Plan

HOMES = ("family_flat", "kitchen_diner", "studio")
DISAGREE = {"beside": 0.03, "between": 0.04}
"""The largest shares that are told otherwise: near a limit the product gives a probability, and the bench a verdict."""


def test_beside_is_what_the_product_calls_next_to() -> None:
    told = []
    for name in HOMES[1:]:
        objs = true_objects(scene_of(name))
        likely = {(a.id, r.subject): r.probability for a in objs for r in relations.next_to(a, objs)}
        for a, b in combinations(objs, 2):
            ours, theirs = predicates.is_beside(a, b), likely.get((a.id, b.id), 0.0) > 0.5
            told += [ours == theirs] if ours or theirs else []
    assert len(told) > 100 and 1 - np.mean(told) <= DISAGREE["beside"]


def test_between_is_what_the_product_surely_says() -> None:
    told = []
    for name in HOMES:
        objs = [obj for obj in true_objects(scene_of(name)) if obj.box_min[2] < 0.1]
        for a, b in combinations(objs, 2):
            said = relations.between(a, b, objs)
            sure = said[0].subject if len(said) == 1 and said[0].probability > 0.95 else None
            ours = predicates.only_between(a, b, objs)
            told += [ours == sure] if ours or sure else []
    assert len(told) > 50 and 1 - np.mean(told) <= DISAGREE["between"]


def test_the_closest_is_the_products_nearest() -> None:
    found = 0
    for name in HOMES:
        objs = true_objects(scene_of(name))
        for landmark in objs:
            some = [obj for obj in objs if obj != landmark and obj.label == "chair"]
            first = predicates.closest(landmark, some)
            assert first in (None, relations.nearest(landmark, some)[0].subject if some else None)
            found += first is not None
    assert found > 20


@pytest.mark.parametrize("name", HOMES)
def test_a_robot_fits_where_the_product_drives(name: str) -> None:
    grid = Plan(scene_of(name), RobotModel.radius_m).grid()
    for radius_m in (0.1, RobotModel.radius_m, 0.3):
        assert (predicates.fits(grid, radius_m) == traversable(grid, radius_m)).all()


def test_rules_are_judged_by_what_the_planner_promises() -> None:
    for module, names in ((route_homes, "KEEP_AWAY_M AVOID_OBJECT_M FLAT_M"), (route_drives, "VIA_M SLOW_NEAR_M")):
        assert all(getattr(module, one) == getattr(layers, one) for one in names.split())
