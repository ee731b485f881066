from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
import pytest
from numpy.typing import ArrayLike

from cartier.errors import InputError
from cartier.home.map_server import grid_from, pgm, yaml
from cartier.mapping.config import OccupancyConfig
from cartier.mapping.occupancy import MAX_SIDE_M, OccupancyMapper
from cartier.navigation.planning import line_of_sight, reach
from cartier.types import FREE, OCCUPIED, UNKNOWN, Camera, Frame, OccupancyGrid, Place, TrueObject
from synthetic import CHAIR, TABLE, RoomRecording, box, look, walk


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
    for obj in (CHAIR, TABLE):
        inside = ((centres > np.array(obj.box_min[:2]) + 0.05) & (centres < np.array(obj.box_max[:2]) - 0.05)).all(1)
        assert not inside.any(), f"a cell inside of the {obj.label} is free"
    solid = grid.centre(np.argwhere(grid.cells == OCCUPIED))
    to_wall = np.minimum(solid, (5, 4) - solid).min(1)
    near_thing = np.zeros(len(solid), bool)
    for obj in (CHAIR, TABLE):
        near_thing |= ((solid > np.array(obj.box_min[:2]) - 0.05) & (solid < np.array(obj.box_max[:2]) + 0.05)).all(1)
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


SOFA = box(4, "black leather sofa", (3.4, 0.9, 0), (4.4, 3.1, 0.8))
HOLE = np.array([[3.2, 0.8], [4.6, 3.2]])  # corners in x, y of a stairwell


def mapped(frames: Iterable[Frame], mapper: OccupancyMapper | None = None) -> OccupancyGrid:
    mapper = mapper or OccupancyMapper()
    for frame in frames:
        mapper.add(frame)
    made = mapper.grid()
    assert made is not None
    return made


def within(grid: OccupancyGrid, low: ArrayLike, high: ArrayLike) -> npt.NDArray[np.bool_]:
    """Cells whose centres lie in a rectangle."""
    centres = grid.centre(np.argwhere(np.ones(grid.cells.shape, bool)))
    return ((centres > np.asarray(low)) & (centres < np.asarray(high))).all(1).reshape(grid.cells.shape)


def from_the_left() -> list[np.ndarray]:
    """Poses of a camera at 1.5 m that stays in the left of the room and looks all over it."""
    places = [(0.6, 0.8), (0.6, 3.2), (1.6, 0.6), (1.6, 3.4), (2.6, 2.0), (2.2, 1.2), (2.2, 2.8)]
    targets = [(4.6, 0.5, 0.3), (4.6, 3.5, 0.3), (3.9, 2.0, 0.4), (2.6, 0.8, 0.0), (2.6, 3.2, 0.0), (1.0, 2.0, 0.0)]
    return [look((*place, 1.5), target) for place in places for target in targets]


def unread(recording: RoomRecording, obj: TrueObject) -> Iterator[Frame]:
    """Frames in which a thing gives no reading: black leather swallows the light, glass lets it through."""
    for number in range(len(recording)):
        frame = recording[number]
        assert frame.depth_m is not None and frame.instances is not None
        depth_m = np.where(frame.instances == obj.id, np.float32(np.nan), frame.depth_m)
        yield dataclasses.replace(frame, depth_m=depth_m)


def with_hole(recording: RoomRecording) -> Iterator[Frame]:
    """Frames of a room with a stairwell: where a ray meets the floor in it, it ends 2.5 m lower down."""
    for number in range(len(recording)):
        frame = recording[number]
        camera, pose = frame.camera, frame.world_from_camera
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = (
            np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1) @ pose[:3, :3].T
        )
        with np.errstate(divide="ignore"):
            to_floor = np.where(rays[..., 2] < 0, -pose[2, 3] / rays[..., 2], np.inf)
        met = pose[:2, 3] + np.where(np.isfinite(to_floor), to_floor, 0)[..., None] * rays[..., :2]
        assert frame.depth_m is not None
        falls = np.isfinite(to_floor) & ((met > HOLE[0]) & (met < HOLE[1])).all(-1) & (frame.depth_m > to_floor - 1e-3)
        deeper = np.where(falls, -(pose[2, 3] + 2.5) / np.minimum(rays[..., 2], -1e-6), frame.depth_m)
        yield dataclasses.replace(frame, depth_m=deeper.astype(np.float32))


def test_what_gives_no_reading_is_not_free() -> None:
    """Rays above a black sofa see the wall behind it; they do not make it floor."""
    grid = mapped(unread(RoomRecording(from_the_left(), [SOFA]), SOFA))
    inside = within(grid, SOFA.box_min[:2], SOFA.box_max[:2])
    assert not (grid.cells[inside] == FREE).any()
    area = reach(grid, (1.0, 2.0), 0.2)
    assert area is not None and not np.isfinite(area.length_m[inside]).any()
    beside = within(grid, (0.5, 0.5), (3.0, 3.5))
    assert (grid.cells[beside] == FREE).mean() > 0.95, "floor that was seen stays free"


def test_a_stairwell_is_not_free() -> None:
    grid = mapped(with_hole(RoomRecording(from_the_left(), [])))
    well = within(grid, HOLE[0] + 0.1, HOLE[1] - 0.1)
    assert not (grid.cells[well] == FREE).any()
    area = reach(grid, (1.0, 2.0), 0.2)
    assert area is not None and not np.isfinite(area.length_m[well]).any()
    assert (grid.cells[within(grid, (0.5, 0.5), (3.0, 3.5))] == FREE).mean() > 0.95


def test_a_recording_whose_floor_is_elsewhere_has_no_holes() -> None:
    """A phone that calls its first position the origin: the floor lies 1.5 m below, all over."""
    recording = walk([])
    low = [recording[i].world_from_camera - np.array([[0] * 4, [0] * 4, [0, 0, 0, 1.5], [0] * 4]) for i in range(5)]
    frames = [dataclasses.replace(recording[i], world_from_camera=pose) for i, pose in enumerate(low)]
    grid = mapped(frames)
    assert all(grid.value(pose[:2, 3]) == FREE for pose in low)


def test_without_holes_the_same_floor_is_free() -> None:
    """The law that keeps the two above honest: it is the missing readings that close the floor, not the walk."""
    grid = mapped(RoomRecording(from_the_left(), []))
    assert (grid.cells[within(grid, HOLE[0], HOLE[1])] == FREE).mean() > 0.95


PERSON = box(5, "person", (2.2, 1.8, 0), (2.6, 2.2, 1.75))
EYE = np.array([0.3, 2.02])
ACROSS = Place("picture", (4.9, 2.02, 1.2), 1.0, 0)


def watched(objects: Sequence[TrueObject], frames: int) -> RoomRecording:
    return RoomRecording([look((*EYE, 1.5), (4.0, 2.02, 0.9))] * frames, objects)


def test_who_walked_through_does_not_stay_in_the_way() -> None:
    mapper = OccupancyMapper()
    with_person = mapped(watched([PERSON], 3), mapper)
    assert not line_of_sight(with_person, EYE, ACROSS)
    without = mapped(watched([], 13), mapper)
    assert line_of_sight(without, EYE, ACROSS)


def test_who_leaned_over_a_table_leaves_the_table() -> None:
    table, mapper = box(3, "table", (1.8, 1.5, 0), (3.0, 2.5, 0.8)), OccupancyMapper()
    mapped(watched([table, PERSON], 3), mapper)
    grid = mapped(watched([table], 20), mapper)
    assert line_of_sight(grid, EYE, ACROSS)
    top = within(grid, (1.9, 1.6), (2.9, 2.4)) & (grid.height_m > 0)
    assert np.median(grid.height_m[top]) == pytest.approx(0.8, abs=0.05)
    assert grid.height_m[top].max() <= 1.0


def test_heights_do_not_fall_by_themselves() -> None:
    grid = mapped(watched([TABLE, PERSON], 40))
    assert grid.height_m[within(grid, (2.15, 1.8), (2.3, 2.2))].max() == pytest.approx(1.75, abs=0.05)


def test_one_flying_pixel_hides_nothing() -> None:
    frame = watched([], 1)[0]
    assert frame.depth_m is not None
    grid = mapped([frame])
    assert line_of_sight(grid, EYE, ACROSS)
    depth_m = frame.depth_m.copy()
    depth_m[40, 79] = 2.0  # hangs in the air at about 1.5 m, right in the line
    flying = mapped([dataclasses.replace(frame, depth_m=depth_m)])
    assert line_of_sight(flying, EYE, ACROSS)
    assert np.array_equal(flying.cells == OCCUPIED, grid.cells == OCCUPIED)


def corridor(length_m: float, step_m: float = 1.0) -> Iterator[Frame]:
    """A camera that is carried along x and looks down at the floor, so that it sees hardly farther than its feet."""
    camera = Camera(32, 24, 24.0, 24.0, 15.5, 11.5)
    rgb, depth_m = np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 1.5, np.float32)
    for number, x in enumerate(np.arange(0, length_m + 1e-6, step_m)):
        pose = np.eye(4)
        pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = x, 0, 1.5
        yield Frame(number, float(number), rgb, depth_m, pose, camera)


def test_the_largest_map_is_as_large_as_it_says() -> None:
    """The view reaches 1 m to each side of the camera."""
    grid = mapped(corridor(MAX_SIDE_M - 2.5))
    rows, cols = np.array(grid.cells.shape) * grid.resolution_m
    assert cols <= MAX_SIDE_M + 50 and rows <= 60, "nor does it grow far where nothing is"
    with pytest.raises(InputError, match="larger than 200 m"):
        mapped(corridor(MAX_SIDE_M - 1.0))


@pytest.mark.parametrize("value", [1e30, 3e38, np.inf, -np.inf, -1.0, 0.0, np.nan])
def test_depth_that_is_none_is_no_depth(value: float) -> None:
    """Not a warning, nor a giant map."""
    frame = walk()[0]
    assert frame.depth_m is not None
    depth_m = frame.depth_m.copy()
    depth_m[::3] = value
    grid = mapped([dataclasses.replace(frame, depth_m=depth_m)])
    assert max(grid.cells.shape) * grid.resolution_m < 12


@pytest.mark.parametrize("far", [1e6, 1e30, 1e300])
def test_a_pose_in_another_unit_is_refused_before_it_takes_memory(far: float) -> None:
    frame = walk()[0]
    pose = frame.world_from_camera.copy()
    pose[0, 3] = far
    with pytest.raises(InputError, match=r"frame 0: the pose is .* no home"):
        OccupancyMapper().add(dataclasses.replace(frame, world_from_camera=pose))


def test_a_map_goes_on_from_its_counts() -> None:
    first, second = OccupancyMapper(), OccupancyMapper()
    mapped(watched([PERSON], 3), first)
    counts = first.counts()
    assert counts is not None
    second.restore(counts)
    assert np.array_equal(mapped(watched([], 13), second).height_m, mapped(watched([], 13), first).height_m)


@pytest.mark.parametrize(("range_m", "reaches"), [(2.0, False), (5.0, True)])
def test_farther_than_its_range_nothing_is_mapped(range_m: float, reaches: bool) -> None:
    mapper = OccupancyMapper(OccupancyConfig(range_m=range_m))
    mapper.add(RoomRecording([look((1.0, 2.0, 1.5), (5.0, 2.0, 1.2))], [])[0])
    made = mapper.grid()
    assert made is not None
    known = made.centre(np.argwhere(made.cells != UNKNOWN))
    assert (known[:, 0].max() > 3.5) == reaches
