"""The exported map, read as Nav2's map_server and RViz read it: from the YAML alone, by a reader that shares no code.

map_server puts the lower-left corner of the image's lowest row at ``origin``; ``trinary`` maps grey p to an occupancy
(255 - p) / 255 and calls it occupied above ``occupied_thresh``, free below ``free_thresh``, else unknown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import cartier
import synthetic
from cartier.home import map_server
from cartier.navigation.planning import plan
from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, TrueObject


class MapServer:
    """What stands at a point of the map, from the two exported files."""

    def __init__(self, file: Path) -> None:
        self.head = yaml.safe_load(file.read_text())
        assert self.head["mode"] == "trinary"
        assert self.head["negate"] == 0
        data = (file.parent / self.head["image"]).read_bytes()
        header = re.match(rb"P5\s+(\d+)\s+(\d+)\s+255\s", data)
        assert header is not None
        self.width, self.height = int(header[1]), int(header[2])
        self.pixels = data[header.end() :]
        assert len(self.pixels) == self.width * self.height

    def pixel(self, x: float, y: float) -> int:
        left, bottom, turn = self.head["origin"]
        assert turn == 0
        column = math.floor((x - left) / self.head["resolution"])
        up = math.floor((y - bottom) / self.head["resolution"])
        assert 0 <= column < self.width
        assert 0 <= up < self.height
        return self.pixels[(self.height - 1 - up) * self.width + column]

    def says(self, x: float, y: float) -> int:
        occupied = (255 - self.pixel(x, y)) / 255
        if occupied > self.head["occupied_thresh"]:
            return OCCUPIED
        return FREE if occupied < self.head["free_thresh"] else UNKNOWN


@given(
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.sampled_from([0.01, 0.025, 0.05, 0.1, 1 / 3, 1.0]),
    st.tuples(st.integers(-4000, 4000), st.integers(-4000, 4000)),
    st.integers(0, 2**32),
)
@settings(deadline=None, max_examples=40)
def test_every_cell_is_where_it_was(
    tmp_path_factory: pytest.TempPathFactory,
    shape: tuple[int, int],
    resolution_m: float,
    corner: tuple[int, int],
    seed: int,
) -> None:
    cells = np.random.default_rng(seed).choice([FREE, OCCUPIED, UNKNOWN], shape).astype(np.int8)
    origin_xy = (corner[0] * resolution_m, corner[1] * resolution_m)  # whole cells, as the mapper's are
    grid = OccupancyGrid(cells, resolution_m, origin_xy, np.zeros(shape, np.float16))
    folder = tmp_path_factory.mktemp("map")
    (folder / "plan.pgm").write_bytes(map_server.pgm(grid))
    (folder / "occupancy.yaml").write_bytes(map_server.yaml(grid, "plan.pgm"))
    server = MapServer(folder / "occupancy.yaml")
    for row, col in np.ndindex(shape):
        assert server.says(*grid.centre((row, col))) == cells[row, col]


@pytest.fixture(scope="module")
def home() -> cartier.Home:
    return cartier.map_home(synthetic.walk(), synthetic.TrueBoxes(synthetic.THINGS))


# The mug stands on the table, and that is what occupies the floor under it.
@pytest.mark.parametrize(
    ("name", "solid"), [("chair", synthetic.CHAIR), ("table", synthetic.TABLE), ("mug", synthetic.TABLE)]
)
def test_a_goal_lies_on_free_floor_and_faces_its_object(
    home: cartier.Home, tmp_path: Path, name: str, solid: TrueObject
) -> None:
    home.save(tmp_path / "home")
    server = MapServer(tmp_path / "home" / "occupancy.yaml")
    place = home.index()[1].locate(name)
    assert place is not None
    assert home.grid is not None
    goal, why = plan(home.grid, place, home.start_xy, cartier.RobotModel())
    assert goal is not None, why
    assert [server.pixel(x, y) for x, y in goal.path] == [254] * len(goal.path)
    assert server.pixel(goal.x, goal.y) == 254
    hit = _first_occupied(server, (goal.x, goal.y), goal.yaw)
    assert (hit >= np.array(solid.box_min[:2]) - 0.05).all()
    assert (hit <= np.array(solid.box_max[:2]) + 0.05).all()


def _first_occupied(server: MapServer, xy: Sequence[float], yaw: float) -> np.ndarray:
    step = server.head["resolution"] / 4
    for k in range(1000):
        x, y = xy[0] + k * step * math.cos(yaw), xy[1] + k * step * math.sin(yaw)
        if server.pixel(x, y) == 0:
            return np.array([x, y])
    raise AssertionError("nothing is occupied where the goal looks")
