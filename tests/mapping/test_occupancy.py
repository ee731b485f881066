from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.mapping.map_server import grid_from, pgm, yaml
from cartier.mapping.occupancy import OccupancyMapper
from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from synthetic import CHAIR, TABLE, walk


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    mapper, recording = OccupancyMapper(), walk()
    for number in range(len(recording)):
        mapper.add(recording[number])
    made = mapper.grid()
    assert made is not None
    return made


def test_the_room_is_mapped_where_it_is(grid: OccupancyGrid) -> None:
    centres = grid.centre(np.argwhere(grid.cells == FREE))
    assert ((centres > -0.05) & (centres < (5.05, 4.05))).all(), "nothing beyond the walls is free"
    for thing in (CHAIR, TABLE):
        inside = ((centres > np.array(thing.box_min[:2]) + 0.05) & (centres < np.array(thing.box_max[:2]) - 0.05)).all(
            1
        )
        assert not inside.any(), f"a cell inside of the {thing.label} is free"
    solid = grid.centre(np.argwhere(grid.cells == OCCUPIED))
    to_wall = np.minimum(solid, (5, 4) - solid).min(1)
    near_thing = np.zeros(len(solid), bool)
    for thing in (CHAIR, TABLE):
        near_thing |= ((solid > np.array(thing.box_min[:2]) - 0.05) & (solid < np.array(thing.box_max[:2]) + 0.05)).all(
            1
        )
    assert (near_thing | (to_wall < 0.06)).all(), "obstacles stand where there are walls or furniture"
    room = (grid.cells != UNKNOWN).sum() * grid.resolution_m**2
    assert room > 0.8 * 20, "most of the 5 m x 4 m room is known"


def test_what_nobody_saw_is_unknown(grid: OccupancyGrid) -> None:
    assert grid.value((1.5, 3.9)) == UNKNOWN, "behind the table"
    assert grid.value((7, 7)) == UNKNOWN, "beyond the walls"
    assert grid.value((1000, -1000)) == UNKNOWN, "outside of the grid"


def test_heights_let_sight_pass_over_the_table(grid: OccupancyGrid) -> None:
    row, col = grid.cell((1.2, 3.3))
    assert grid.height_m[row, col] == pytest.approx(0.8, abs=0.02)


def test_the_image_comes_back_the_same(grid: OccupancyGrid) -> None:
    again = grid_from(pgm(grid), grid.resolution_m, grid.origin_xy, grid.height_m)
    assert np.array_equal(again.cells, grid.cells) and np.array_equal(again.height_m, grid.height_m)
    assert again.origin_xy == grid.origin_xy and again.resolution_m == grid.resolution_m


def test_map_server_reads_our_pixels_as_we_mean_them() -> None:
    """Nav2's rule: p = (255 - pixel) / 255; above occupied_thresh occupied, below free_thresh free, else unknown."""
    cells = np.array([[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, FREE]], np.int8)
    small = OccupancyGrid(cells, 0.05, (-1.0, 2.0), np.zeros(cells.shape, np.float16))
    fields = dict(line.split(": ") for line in yaml(small, "plan.pgm").decode().splitlines())
    pixels = np.frombuffer(pgm(small).split(b"\n", 3)[3], np.uint8).reshape(2, 3)
    p = (255 - pixels.astype(float)) / 255
    read = np.where(
        p > float(fields["occupied_thresh"]), OCCUPIED, np.where(p < float(fields["free_thresh"]), FREE, UNKNOWN)
    )
    assert np.array_equal(read[::-1], cells), "the last image row is the smallest y"
    assert fields["origin"] == "[-1.0, 2.0, 0.0]" and fields["resolution"] == "0.05" and fields["negate"] == "0"


@pytest.mark.parametrize("damaged", [b"", b"\x00\xffrubbish", b"P5\n3 2\n255\n12345", b"P5\n-3 -2\n255\n123456"])
def test_a_damaged_image_is_named(damaged: bytes) -> None:
    with pytest.raises(InputError, match="damaged"):
        grid_from(damaged, 0.05, (0.0, 0.0), np.zeros((2, 3), np.float16))


def test_a_pose_far_away_is_named_and_not_mapped() -> None:
    mapper, recording = OccupancyMapper(), walk()
    mapper.add(recording[0])
    away = recording[1].world_from_camera.copy()
    away[:2, 3] += 5000
    with pytest.raises(InputError, match=r"frame 1.*outlier"):
        mapper.add(dataclasses.replace(recording[1], world_from_camera=away))


def test_a_chair_that_was_moved_away_is_forgotten() -> None:
    mapper, with_chair, without = OccupancyMapper(), walk(), walk([])
    mapper.add(with_chair[3])
    for _ in range(8):
        mapper.add(without[3])
    made = mapper.grid()
    assert made is not None and made.value((3.66, 1.83)) != OCCUPIED


def test_depth_of_nothing_marks_only_where_the_camera_was() -> None:
    frame = walk()[0]
    mapper = OccupancyMapper()
    mapper.add(dataclasses.replace(frame, depth_m=np.full_like(frame.depth_m, np.nan)))
    made = mapper.grid()
    assert made is not None and (made.cells == OCCUPIED).sum() == 0
    assert made.value(frame.world_from_camera[:2, 3]) == FREE
