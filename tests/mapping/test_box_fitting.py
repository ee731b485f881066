"""Boxes of surfaces on which views agree: closed forms, on made-up frames of a block before a wall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from cartier.mapping.box_fitting import (
    about_z,
    agreed_surface,
    agreement,
    cell_keys,
    decoded,
    flying,
    on_top,
    sides_seen,
    surface_box,
)
from cartier.mapping.config import DEFAULT_CONFIG, ExtentConfig, MappingConfig
from cartier.mapping.furniture import FLAT_TOPPED, STANDING, shapes
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.observation import PATCH_KIND, PATCHES_KEPT, keep_patches
from cartier.types import Camera, Detections, DetectorScoreModel, Frame

CAMERA = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)
BLOCK = np.array([[-0.3, -0.2, 0.0], [0.3, 0.2, 0.5]])
"""Of 60 x 40 x 50 cm, on the floor."""
WALL_M = -0.3
"""A wall at this y, behind the block for most cameras."""


def rotation(yaw: float) -> np.ndarray:
    return np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])


def look(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([right, np.cross(ahead, right), ahead], axis=1), eye
    return pose


def seen(
    number: int, angle_deg: float, yaw: float = 0.0, radius_m: float = 1.8
) -> tuple[Frame, np.ndarray, np.ndarray]:
    """A frame from around the block, which is turned by ``yaw``; the block's box (4,) in the image and its mask."""
    angle, turn = math.radians(angle_deg) + yaw, rotation(yaw)
    pose = look(np.array([1.8 * math.cos(angle), 1.8 * math.sin(angle), 1.3]), np.array([0, 0, 0.25]))
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    way, eye = rays @ pose[:3, :3].T @ turn, pose[:3, 3] @ turn  # in the frame of the block
    with np.errstate(divide="ignore"):
        ends = np.sort((BLOCK[:, None, None] - eye) / way, axis=0)
        enter, leave = ends[0].max(-1), ends[1].min(-1)
        floor, wall = -eye[2] / way[..., 2], (WALL_M - eye[1]) / way[..., 1]
    block = (enter < leave) & (enter > 0)
    behind = np.minimum(np.where(floor > 0, floor, 9), np.where(wall > 0, wall, 9))
    depth_m = np.where(block, enter, behind).astype(np.float32)
    rows, cols = np.nonzero(block)
    box = np.array([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1], np.float32)
    frame = Frame(number, float(number), np.zeros((*block.shape, 3), np.uint8), depth_m, pose, CAMERA)
    return frame, box, block


ANGLES = (20.0, 65.0, 110.0, 160.0, 45.0)


def mapped(yaw: float = 0.0, masked: bool = False, config: MappingConfig = DEFAULT_CONFIG) -> ObjectMap:
    made = ObjectMap(DetectorScoreModel(), config)
    for number, angle in enumerate(ANGLES):
        frame, box, block = seen(number, angle, yaw)
        masks = block[None] if masked else None
        made.add(frame, Detections(number, box[None], np.ones(1, np.float32), ("box",), masks))
    return made


@pytest.mark.parametrize("masked", [False, True])
def test_box_fits_what_views_agree_on(masked: bool) -> None:
    (obj,) = mapped(masked=masked).objects()
    np.testing.assert_allclose([obj.box_min, obj.box_max], BLOCK, atol=0.04)
    assert obj.oriented is None


def test_what_other_views_have_outside_of_their_box_is_left_out() -> None:
    """The reason why several views are asked: in one, floor beside the block cannot be told from the block."""
    careless = replace(DEFAULT_CONFIG, extent=ExtentConfig(min_agreement=0.0))
    (fit,), (loose,) = mapped().objects(), mapped(config=careless).objects()
    area = [np.prod(np.subtract(obj.box_max, obj.box_min)[:2]) for obj in (fit, loose)]
    assert area[1] > 1.2 * area[0]


@pytest.mark.parametrize("yaw_deg", [0, 25, -40])
def test_box_along_walls_fits_a_turned_block(yaw_deg: float) -> None:
    yaw = math.radians(yaw_deg)
    (obj,) = mapped(yaw).objects(yaw)
    assert obj.oriented is not None and obj.oriented.yaw == pytest.approx(yaw, abs=1e-5)
    np.testing.assert_allclose(obj.oriented.size, BLOCK[1] - BLOCK[0], atol=0.06)
    np.testing.assert_allclose(obj.oriented.middle, [0, 0, 0.25], atol=0.04)
    assert set(obj.oriented.seen) >= {"+y", "+z"} and "-y" not in obj.oriented.seen


def worktop(ends_m: tuple[float, float], per_metre: int) -> np.ndarray:
    """Points of the top and the front of a worktop 0.9 m high, along x."""
    along, across = np.meshgrid(np.arange(*ends_m, 1 / per_metre), np.arange(0, 0.6, 1 / per_metre))
    top = np.stack([along.ravel(), across.ravel(), np.full(along.size, 0.9)], axis=1)
    return np.concatenate([top, top * (1, 0, 0) + (0, 0, 0.1) + across.reshape(-1, 1) * (0, 0, 1.2)])


def test_far_end_of_a_worktop_counts_though_few_points_show_it() -> None:
    points = np.concatenate([worktop((0, 1.4), 60), worktop((1.4, 2), 12)])
    assert np.mean(points[:, 0] > 1.4) < 0.03
    box = surface_box(points, masked=False)
    assert box is not None
    np.testing.assert_allclose(box[:, 0], [0, 2], atol=0.12)


def test_top_of_furniture_is_one_plane() -> None:
    points = worktop((0, 2), 20)
    agreed = points[:, 0] < 1.2
    np.testing.assert_array_equal(on_top(points, agreed), np.abs(points[:, 2] - 0.9) < 0.03)
    assert not on_top(points, points[:, 0] < 0.5).any(), "no furniture's top is so small"
    assert not on_top(points * (1, 1, 0.1), agreed).any(), "a carpet is no top"


def test_more_frames_from_one_standpoint_replace_each_other() -> None:
    patches = np.zeros((1, PATCHES_KEPT), PATCH_KIND)
    one = np.zeros(1, np.intp)
    for number in range(20):
        frame, box, _ = seen(number, 20 + number * 0.2)
        keep_patches(patches, one, frame, one, box[None], np.array([100.0 + number]), None)
    assert (patches["worth"] > 0).sum() == 1 and patches["worth"].max() == 119
    frame, box, _ = seen(20, 160)
    assert len(keep_patches(patches, one, frame, one, box[None], np.array([1.0]), None)) == 1
    assert (patches["worth"] > 0).sum() == 2, "another standpoint adds a view, however small"


def test_turned_camera_is_another_standpoint() -> None:
    """Where it stands, it may see what the edge of the picture had cut off."""
    patches, one = np.zeros((1, PATCHES_KEPT), PATCH_KIND), np.zeros(1, np.intp)
    for turn in (0.0, 30.0):
        frame, box, _ = seen(0, 20)
        frame.world_from_camera[:3, :3] = rotation(math.radians(turn)) @ frame.world_from_camera[:3, :3]
        keep_patches(patches, one, frame, one, box[None], np.ones(1), None)
    assert (patches["worth"] > 0).sum() == 2


def test_view_says_nothing_of_what_it_does_not_show() -> None:
    patches, one = np.zeros((1, PATCHES_KEPT), PATCH_KIND), np.zeros(1, np.intp)
    frame, box, _ = seen(0, 90)
    keep_patches(patches, one, frame, one, box[None], np.ones(1), None)
    patches = patches[0, :1]
    points = np.array([[0, 0.2, 0.25], [0, -0.2, 0.25], [0.45, 0.2, 0.0]])  # its face, its back, the floor beside it
    assert agreement(points, patches, *decoded(patches)).tolist() == [1, 0, 0]


def test_pixels_between_an_edge_and_what_is_behind_are_no_surface() -> None:
    depth_m = np.full((1, 5, 5), np.nan)
    depth_m[0, 1:4, 1:4] = 2.0
    depth_m[0, 2, 4] = 2.4  # hangs behind the edge
    expected = np.zeros((5, 5), bool)
    expected[2, 4] = True
    assert np.array_equal(flying(depth_m, np.array([0.5]))[0] & np.isfinite(depth_m[0]), expected)


def test_flying_pixels_make_no_box_larger() -> None:
    made, rng = ObjectMap(DetectorScoreModel()), np.random.default_rng(0)
    for number, angle in enumerate(ANGLES):
        frame, box, block = seen(number, angle)
        assert frame.depth_m is not None
        edge = block & ~ndimage.binary_erosion(block, iterations=2)
        frame.depth_m[edge] += rng.choice([0.0, 0.0, 0.3, 0.6, 0.9], edge.sum()).astype(np.float32)
        made.add(frame, Detections(number, box[None], np.ones(1, np.float32), ("box",), block[None]))
    (obj,) = made.objects()
    np.testing.assert_allclose([obj.box_min, obj.box_max], BLOCK, atol=0.12)


def test_sides_are_seen_by_cameras_beyond_them() -> None:
    patches = np.zeros(2, PATCH_KIND)
    patches["worth"] = 1
    patches["pose"][:, :, 3] = [[2, 0, 0.2], [0, -2, 1.0]]
    box = np.array([[-1.0, -1, 0], [1, 1, 0.5]])
    assert sides_seen(patches, box, 0.0).tolist() == [True, False, False, True, True]
    assert sides_seen(patches, box, math.pi / 2).tolist() == [False, True, False, True, True]


def test_low_surface_reaches_the_floor_and_a_hung_one_does_not() -> None:
    rng = np.random.default_rng(0)
    seat = rng.uniform([0, 0, 0.4], [0.5, 0.5, 0.9], (400, 3))
    hung = rng.uniform([0, 0, 1.4], [0.5, 0.02, 1.9], (400, 3))
    high = surface_box(seat, False)
    assert high is not None and high[0, 2] > 0.35
    low = surface_box(seat - [0, 0, 0.2], False)
    assert low is not None and low[0, 2] == 0
    high = surface_box(hung, False)
    assert high is not None and high[0, 2] > 1.35


def test_nothing_shown_is_no_surface() -> None:
    assert len(agreed_surface(np.zeros(PATCHES_KEPT, PATCH_KIND), 0.9)[0]) == 0
    assert surface_box(np.zeros((3, 3)), True) is None


def table(clutter: bool) -> np.ndarray:
    """The upper part of a table of 140 x 80 x 75 cm; with a lamp on it and a chair before it."""
    rng = np.random.default_rng(0)
    top = rng.uniform([0, 0, 0.74], [1.4, 0.8, 0.76], (600, 3))
    apron = rng.uniform([0, 0, 0.6], [1.4, 0.02, 0.76], (100, 3))
    lamp, chair = (
        rng.uniform([0.2, 0.2, 0.76], [0.4, 0.4, 1.1], (40, 3)),
        rng.uniform([0.4, -0.5, 0.42], [0.8, 0, 0.46], (60, 3)),
    )
    return np.concatenate([top, apron, lamp, chair] if clutter else [top, apron])


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_table_ends_at_its_top_and_at_the_floor(yaw: float) -> None:
    points = table(clutter=True) @ about_z(yaw).T
    (shape,) = shapes(["DiningTable"])
    box = surface_box(points, False, yaw, int(shape))
    assert box is not None
    np.testing.assert_allclose(box, [[0, 0, 0], [1.4, 0.8, 0.76]], atol=0.04)
    bare = surface_box(points, False, yaw)
    assert bare is not None and bare[1, 2] > 1 and bare[0, 1] < -0.4 and bare[0, 2] > 0.4, (
        "nothing is known of its name"
    )


def test_worktop_ends_at_its_top_only() -> None:
    (shape,) = shapes(["counter top"])
    box = surface_box(table(clutter=True), False, 0.0, int(shape))
    assert box is not None and box[1, 2] < 0.78 and box[0, 1] < -0.4 and box[0, 2] > 0.4


def test_low_shelf_is_no_top() -> None:
    rng = np.random.default_rng(0)
    shelf, sides = (
        rng.uniform([0, 0, 0.3], [1, 0.4, 0.31], (300, 3)),
        rng.uniform([0, 0, 0.3], [1, 0.02, 1.2], (300, 3)),
    )
    box = surface_box(np.concatenate([shelf, sides]), False, 0.0, FLAT_TOPPED | STANDING)
    assert box is not None and box[1, 2] > 1.1


def test_masks_need_no_names() -> None:
    points = table(clutter=True)
    np.testing.assert_array_equal(surface_box(points, True, 0.0, FLAT_TOPPED | STANDING), surface_box(points, True))


def test_shapes_are_by_name() -> None:
    assert shapes(["Desk", "arm_chair", "counter top", "mug"]).tolist() == [
        STANDING | FLAT_TOPPED, STANDING, FLAT_TOPPED, 0
    ]  # fmt: skip


def test_another_label_fits_the_box_anew() -> None:
    known = ObjectMap(DetectorScoreModel())
    for number in range(4):
        frame, box, _ = seen(number, 60 + 30 * number)
        known.add(frame, Detections(number, box[None], np.array([0.9]), ("box",)))
    columns = known.columns()
    known.objects()
    assert columns["fit_shape"].tolist() == [0]
    for number in range(4, 28):  # weaker, so that no view is replaced
        frame, box, _ = seen(number, 60 + 30 * (number % 4))
        known.add(frame, Detections(number, box[None], np.array([0.5]), ("bench",)))
    assert not known.columns()["fit_is_stale"].any()
    known.objects()
    assert known.columns()["fit_shape"].tolist() == [STANDING | FLAT_TOPPED]


@pytest.mark.parametrize("far_m", [1.0, 1e9])
def test_cells_are_numbered_in_their_order(far_m: float) -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (300, 3)) * [1.0, far_m, far_m]
    cells = np.floor(points / 0.2).astype(int)
    _, first, of, counts = np.unique(cells, axis=0, return_index=True, return_inverse=True, return_counts=True)
    found = np.unique(cell_keys(points, 0.2), return_index=True, return_inverse=True, return_counts=True)[1:]
    for mine, truth in zip(found, (first, of.ravel(), counts), strict=True):
        np.testing.assert_array_equal(mine, truth)
