"""The point cloud: on the surfaces, in their colours, bounded, and with no ceiling."""

from __future__ import annotations

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.home.entity import CLOUD, Home
from cartier.home.point_cloud import PointCloud, read_cloud
from cartier.io.files import npz_bytes, read_npz
from cartier.mapping import cloud
from cartier.mapping.cloud import CloudMapper
from cartier.mapping.mapper import Mapper
from cartier.pipeline import map_home
from cartier.types import Camera, Frame
from synthetic import CHAIR, ROOM, TABLE, THINGS, RoomRecording, TrueBoxes, look, walk

COLOURS = np.random.default_rng(0).integers(40, 255, (max(t.id for t in THINGS) + 1, 3))  # as the recording paints them


def mapped(recording: RoomRecording) -> CloudMapper:
    grown = CloudMapper()
    for number in range(len(recording)):
        grown.add(recording[number])
    return grown


def cloud_of(grown: CloudMapper) -> PointCloud:
    data = grown.state()
    assert data is not None
    return read_cloud(data)


def test_points_lie_on_surfaces_in_their_colours() -> None:
    seen = cloud_of(mapped(walk()))
    shell = np.minimum(np.abs(seen.xyz_m - ROOM[0]), np.abs(seen.xyz_m - ROOM[1])).min(1)
    solid = np.min([box_distance(seen.xyz_m, np.array(t.box_min), np.array(t.box_max)) for t in THINGS], axis=0)
    assert len(seen.rgb) > 1000 and np.minimum(shell, solid).max() < cloud.SIDE_M, (
        "a mean of its voxel, no flying pixel"
    )
    for obj in (CHAIR, TABLE):
        on = (box_distance(seen.xyz_m, np.array(obj.box_min), np.array(obj.box_max)) < 0.01) & (shell > 0.1)
        assert on.sum() > 20 and np.abs(seen.rgb[on] - COLOURS[obj.id]).max(1).mean() < 6


def test_the_ceiling_does_not_hide_the_room() -> None:
    up = RoomRecording(
        [look((2.5, 2.0, 1.2), (2.5 + dx, 2.0 + dy, 1.9)) for dx, dy in ((1, 0), (0, 1), (-1, 0))], THINGS
    )
    frame = up[0]
    assert frame.depth_m is not None and (frame.world_from_camera[2, 3] + 0.5 * frame.depth_m.max()) > 2.2
    assert cloud_of(mapped(up)).xyz_m[:, 2].max() <= cloud.HIGH_M + cloud.STEP_M


def test_a_large_home_gets_larger_voxels_and_no_more_points(monkeypatch: pytest.MonkeyPatch) -> None:
    fine = cloud_of(mapped(walk()))
    monkeypatch.setattr(cloud, "MAX_POINTS", 500)
    monkeypatch.setattr(cloud, "PENDING", 2000)
    grown = mapped(walk())
    coarse = cloud_of(grown)
    assert 250 < len(coarse.rgb) <= 500 and coarse.side_m > fine.side_m and len(grown._points) <= 500


def test_the_largest_cloud_is_less_than_a_megabyte() -> None:
    noise = np.random.default_rng(0)
    grown = CloudMapper()
    xyz, rgb = noise.uniform(-100, 100, (60_000, 3)), noise.uniform(0, 255, (60_000, 3))
    grown._points = np.column_stack([xyz, rgb, noise.integers(1, 255, 60_000)]).astype(np.float32)
    data = grown.state()
    assert data is not None and len(data) < 1_000_000


def test_a_restored_cloud_goes_on_where_it_was() -> None:
    recording = walk()
    first, whole = CloudMapper(), mapped(recording)
    for number in range(10):
        first.add(recording[number])
    state = first.state()
    assert state is not None
    second = CloudMapper()
    second.restore(state)
    before = cloud_of(second)
    np.testing.assert_allclose(before.xyz_m, read_cloud(state).xyz_m, atol=cloud.STEP_M)
    for number in range(10, len(recording)):
        second.add(recording[number])
    assert len(cloud_of(second).rgb) == pytest.approx(len(cloud_of(whole).rgb), rel=0.02)


def test_a_home_keeps_its_cloud_and_grows_it(tmp_path: object) -> None:
    recording = walk()
    home = map_home(recording, TrueBoxes(THINGS))
    again = map_home(recording, TrueBoxes(THINGS))
    assert home.cloud() is not None and again.growth[CLOUD] == home.growth[CLOUD]
    home.save(f"{tmp_path}/home")
    read = Home.load(f"{tmp_path}/home")
    np.testing.assert_array_equal(read.cloud().xyz_m, again.cloud().xyz_m)  # type: ignore[union-attr]
    grown = Mapper(TrueBoxes(THINGS), onto=read)
    for number in range(len(recording)):
        assert (grown.add(recording[number]) == -1).all()  # seen before: nothing changes
    np.testing.assert_allclose(grown.home().cloud().xyz_m, read.cloud().xyz_m, atol=1e-4)  # type: ignore[union-attr]


def test_without_depth_there_is_no_cloud() -> None:
    assert map_home(walk(with_depth=False), TrueBoxes(THINGS)).cloud() is None
    assert CloudMapper().empty


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (3, 200), (200, 3), (641, 2)])
def test_images_of_any_shape_are_taken(size: tuple[int, int]) -> None:
    width, height = size
    camera = Camera(width, height, 100.0, 100.0, width / 2, height / 2)
    grown = CloudMapper()
    for number in range(5):
        rgb, depth = np.full((height, width, 3), 9, np.uint8), np.full((height, width), 1.0, np.float32)
        grown.add(Frame(number, float(number), rgb, depth, look((0, 0, 1.0), (1, 0, 1.0)), camera))
    assert grown.empty == (min(size) < 2)


@pytest.mark.parametrize(
    "change",
    [
        {"xyz": None}, {"rgb": np.zeros((3, 3), np.uint8)}, {"weight": np.zeros(1, np.uint8)},
        {"low_m": np.array([np.nan, 0, 0])}, {"low_m": np.array([1e300, 0, 0])}, {"low_m": np.array(["x", "y", "z"])},
        {"side_m": np.array(np.inf)}, {"side_m": np.array([1, 2])}, {"xyz": np.zeros((0, 3), np.uint16)},
    ],
)  # fmt: skip
def test_a_damaged_cloud_is_refused_in_one_line(change: dict[str, np.ndarray | None]) -> None:
    state = mapped(walk()).state()
    assert state is not None
    arrays = {k: v for k, v in (read_npz(state) | change).items() if v is not None}
    for read in (read_cloud, CloudMapper().restore):
        with pytest.raises(InputError, match="point cloud is damaged"):
            read(npz_bytes(**arrays))
        with pytest.raises(InputError, match="damaged"):
            read(state[:-40])
