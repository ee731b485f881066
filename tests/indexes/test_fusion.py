"""The fusion of features into the grid against a plain float64 loop over pixels, and against what sensors do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.errors import BackendError, InputError
from cartier.types import Camera
from cartier_bench.baselines.fusion import HEIGHT_M, FeatureGrid
from synthetic import look

CAMERA = Camera(40, 30, 30.0, 32.0, 19.3, 14.8)


def by_the_pixel(features, depth_m, camera, pose, cell_m):  # type: ignore[no-untyped-def]
    """{cell: (sum of features, pixels, sum of heights)}: what the fusion must equal."""
    (height, width), (h, w) = depth_m.shape, features.shape[:2]
    cells: dict[tuple[int, int], list[object]] = {}
    for v in range(height):
        for u in range(width):
            z = float(depth_m[v, u])
            if not z > 0:
                continue
            ray = np.array([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z])
            x, y, up = pose[:3, :3] @ ray + pose[:3, 3]
            if not HEIGHT_M[0] < up < HEIGHT_M[1]:
                continue
            i = min(max((v + 0.5) * h / height - 0.5, 0), h - 1)
            j = min(max((u + 0.5) * w / width - 0.5, 0), w - 1)
            i0, j0 = min(int(i), max(h - 2, 0)), min(int(j), max(w - 2, 0))
            i1, j1 = min(i0 + 1, h - 1), min(j0 + 1, w - 1)
            f = features.astype(np.float64)
            above = f[i0, j0] * (1 - (j - j0)) + f[i0, j1] * (j - j0)
            below = f[i1, j0] * (1 - (j - j0)) + f[i1, j1] * (j - j0)
            feature = above * (1 - (i - i0)) + below * (i - i0)
            cell = (int(np.floor(x / cell_m)), int(np.floor(y / cell_m)))
            old = cells.get(cell, [0.0, 0, 0.0])
            cells[cell] = [old[0] + feature, old[1] + 1, old[2] + up]  # type: ignore[operator]
    return cells


@pytest.mark.parametrize("shape", [(13, 17), (30, 40), (1, 1), (2, 5), (45, 64)])
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10**6), frames=st.integers(1, 3))
def test_the_sums_are_those_of_a_loop_over_pixels(shape: tuple[int, int], seed: int, frames: int) -> None:
    rng = np.random.default_rng(seed)
    grid, expected = FeatureGrid(0.2), dict[Any, Any]()
    for _ in range(frames):
        features = rng.normal(size=(*shape, 6)).astype(np.float32)
        depth_m = rng.uniform(0.4, 4, (30, 40)).astype(np.float32)
        depth_m[rng.random((30, 40)) < 0.2] = np.nan
        pose = look(rng.uniform((-3, -3, 0.3), (3, 3, 1.8)), rng.uniform((-9, -9, -3), (9, 9, 3)))
        grid.add(features, depth_m, CAMERA, pose)
        for cell, (total, pixels, up) in by_the_pixel(features, depth_m, CAMERA, pose, 0.2).items():
            old = expected.get(cell, (0, 0, 0))
            expected[cell] = (old[0] + total, old[1] + pixels, old[2] + up)
    assert {tuple(xy) for xy in grid.cells["xy"].tolist()} == set(expected)
    for record, total in zip(grid.cells, grid.sums, strict=True):
        want, pixels, up = expected[tuple(record["xy"].tolist())]
        assert record["pixels"] == pixels
        np.testing.assert_allclose(record["height_sum"], up, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(total / pixels, want / pixels, atol=1e-5)


def test_the_frame_that_shows_most_of_a_cell_is_its_evidence() -> None:
    grid = FeatureGrid(1.0)
    few = np.full((30, 40), np.nan, np.float32)
    few[15, :10] = 0.3
    many = np.full((30, 40), 0.3, np.float32)
    for number, depth_m in enumerate((few, many, few)):
        grid.add(np.ones((3, 4, 2), np.float32), depth_m, CAMERA, look((5.1, 5.5, 1), (9, 5.5, 1)), number)
    assert grid.cells["frame"].tolist() == [1]


def test_sizes_may_change_from_frame_to_frame() -> None:
    grid, pose = FeatureGrid(), look((0, 0, 1), (4, 0, 1))
    grid.add(np.ones((3, 4, 2), np.float32), np.full((30, 40), 2, np.float32), CAMERA, pose)
    before = int(grid.cells["pixels"].sum())
    small = Camera(20, 15, 15.0, 16.0, 9.5, 7.0)
    grid.add(np.ones((6, 5, 2), np.float32), np.full((15, 20), 2, np.float32), small, pose)
    assert before < grid.cells["pixels"].sum() <= before + 300
    np.testing.assert_allclose(grid.sums, np.repeat(grid.cells["pixels"][:, None], 2, 1), rtol=1e-6)


def test_a_pose_outlier_is_named_and_leaves_the_grid_as_it_was() -> None:
    grid, depth_m, features = FeatureGrid(), np.full((30, 40), 2, np.float32), np.ones((3, 4, 2), np.float32)
    grid.add(features, depth_m, CAMERA, look((0, 0, 1), (4, 0, 1)), 16)
    cells, sums = grid.cells.copy(), grid.sums.copy()
    with pytest.raises(InputError, match=r"frame 17 .* outlier"):
        grid.add(features, depth_m, CAMERA, look((5000, 0, 1), (5004, 0, 1)), 17)
    with pytest.raises(InputError, match=r"frame 18 .* unit"):
        grid.add(features, depth_m * 100, CAMERA, look((0, 0, 1), (4, 0, 1)), 18)
    np.testing.assert_array_equal(grid.cells, cells)
    np.testing.assert_array_equal(grid.sums, sums)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_features_that_are_no_numbers_are_refused(bad: float) -> None:
    features = np.ones((3, 4, 2), np.float32)
    features[1, 1, 0] = bad
    grid = FeatureGrid()
    with pytest.raises(BackendError, match="frame 3"):
        grid.add(features, np.full((30, 40), 2, np.float32), CAMERA, look((0, 0, 1), (4, 0, 1)), 3)
    assert not len(grid.cells)


def test_a_frame_without_depth_readings_adds_nothing() -> None:
    grid = FeatureGrid()
    grid.add(np.ones((3, 4, 2), np.float32), np.full((30, 40), np.nan, np.float32), CAMERA, np.eye(4))
    assert not len(grid.cells)
