"""Physical plausibility: what no shop sells and what stands on bare floor loses its probability."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartier.mapping.plausibility import weighed
from cartier.types import FREE, OCCUPIED, UNKNOWN, Camera, MapObject, OccupancyGrid, OrientedBox, View

CAMERA = Camera(640, 480, 500, 500, 320, 240)
WHOLE, CUT = (200.0, 150.0, 300.0, 250.0), (0.0, 150.0, 300.0, 250.0)


def thing(label: str, size: tuple[float, float, float], box: tuple[float, ...] = WHOLE, z: float = 0.0) -> MapObject:
    low, high = (1.0, 1.0, z), (1.0 + size[0], 1.0 + size[1], z + size[2])
    view = View(0, box, 0.9, label, 1e4, (0.0, 0.0, 1.5), 0.0, (1.0, 1.0, z))
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    return MapObject(0, label, ((label, 1.0),), middle, low, high, 0.95, True, 9, 9, 0.0, 1.0, 1.0, (view,))


def grid(state: int) -> OccupancyGrid:
    cells = np.full((100, 100), state, np.int8)
    return OccupancyGrid(cells, 0.05, (0.0, 0.0), np.zeros(cells.shape, np.float16))


def likely(obj: MapObject, plan: OccupancyGrid | None = None) -> float:
    (after,) = weighed([obj], plan, CAMERA, 0.7)
    assert after.confirmed == (after.probability >= 0.7)
    return after.probability


@pytest.mark.parametrize(
    ("label", "size"),
    [("cell phone", (0.4, 0.3, 0.1)), ("mouse", (0.4, 0.2, 0.1)), ("tv", (0.1, 0.1, 0.1)), ("bed", (5.0, 4.0, 0.5))],
)
def test_a_size_that_no_such_thing_has_refutes_it(label: str, size: tuple[float, float, float]) -> None:
    assert likely(thing(label, size, z=0.7)) < 0.3


@pytest.mark.parametrize(
    ("label", "size"),
    [
        ("cell phone", (0.15, 0.07, 0.02)),
        ("tv", (1.0, 0.2, 0.6)),
        ("bed", (2.2, 1.6, 0.6)),
        ("heater", (9.0, 9.0, 9.0)),
    ],
)
def test_usual_sizes_and_names_without_a_size_are_left_alone(label: str, size: tuple[float, float, float]) -> None:
    obj = thing(label, size)
    assert weighed([obj], grid(OCCUPIED), CAMERA, 0.7) == (obj,)


def test_what_is_cut_by_the_edge_of_every_picture_may_be_larger_than_it_seems() -> None:
    assert likely(thing("tv", (0.1, 0.1, 0.1), CUT, 1.0)) == 0.95


def test_a_bed_of_bare_floor_is_refuted_by_the_plan_and_by_its_height() -> None:
    bed = thing("bed", (2.0, 1.6, 0.5))
    assert likely(bed, grid(FREE)) < 0.1
    assert likely(bed, grid(OCCUPIED)) == likely(bed, grid(UNKNOWN)) == likely(bed) == 0.95
    assert likely(thing("bed", (2.0, 1.6, 0.05)), grid(OCCUPIED)) < 0.1
    assert likely(thing("cup", (0.5, 0.5, 0.05)), grid(FREE)) < 0.95, "its size alone"
    assert likely(thing("book", (0.3, 0.2, 0.03)), grid(FREE)) == 0.95, "a book may lie on the floor"


def test_no_size_is_beyond_doubt() -> None:
    assert likely(thing("cell phone", (50.0, 40.0, 10.0))) == pytest.approx(19 / (19 + math.exp(6)))


@pytest.mark.parametrize(("share", "elsewhere"), [(0.5, UNKNOWN), (0.7, OCCUPIED)])
def test_a_floor_that_is_bare_in_part_refutes_nothing(share: float, elsewhere: int) -> None:
    plan = grid(elsewhere)
    plan.cells[:, : 20 + round(40 * share)] = FREE  # the bed begins at column 20 and ends at 60
    assert likely(thing("bed", (2.0, 1.6, 0.5)), plan) == 0.95


def test_a_sliver_of_furniture_is_too_small_to_look_for_on_the_floor() -> None:
    assert likely(thing("chair", (0.31, 0.02, 0.5)), grid(FREE)) == 0.95


def test_what_stands_askew_is_as_long_as_its_box_along_the_walls() -> None:
    bed = thing("bed", (3.0, 3.0, 0.5))
    assert likely(bed) < 0.95
    askew = OrientedBox(bed.position, (2.2, 1.6, 0.5), math.pi / 4, ())
    assert likely(replace(bed, oriented=askew)) == 0.95
