from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier.geometry import (
    backproject,
    box_distance,
    invert,
    project,
    transform,
    view_yaw,
    weak_perspective_size,
    yaw_towards,
)
from cartier.types import Camera
from synthetic import CAMERA, look

coordinate = st.floats(-3, 3)


@given(st.tuples(coordinate, coordinate, coordinate), st.tuples(coordinate, coordinate), st.floats(-1, 1))
def test_back_projection_inverts_projection(
    eye: tuple[float, float, float], ahead: tuple[float, float], tilt: float
) -> None:
    direction = np.array([*ahead, tilt])
    if np.linalg.norm(direction[:2]) < 0.1:
        return
    pose = look(eye, eye + direction)
    depth = np.random.default_rng(0).uniform(0.5, 5, (CAMERA.height, CAMERA.width)).astype(np.float32)
    world = transform(pose, backproject(depth, CAMERA).astype(np.float64))
    uv, z = project(world, CAMERA, pose)
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    assert np.abs(uv - np.stack([columns, rows], -1)).max() < 1e-3
    assert np.abs(z - depth).max() < 1e-5
    assert np.abs(invert(pose) @ pose - np.eye(4)).max() < 1e-12


def test_stride_takes_the_same_points() -> None:
    depth = np.random.default_rng(1).uniform(0.5, 5, (CAMERA.height, CAMERA.width)).astype(np.float32)
    assert np.array_equal(backproject(depth, CAMERA, 4), backproject(depth, CAMERA)[::4, ::4])


def _image_box(points: np.ndarray) -> np.ndarray:
    uv, _ = project(points, CAMERA, np.eye(4))
    return np.concatenate([uv.min(0), uv.max(0)])[None]


@given(st.floats(0, 0.9), st.floats(0, math.tau), st.floats(2, 8))
def test_a_plate_parallel_to_the_image_has_the_same_size_wherever_it_is_seen(
    theta: float, phi: float, distance: float
) -> None:
    def size(off_axis: float) -> float:
        direction = [math.sin(off_axis) * math.cos(phi), math.sin(off_axis) * math.sin(phi), math.cos(off_axis)]
        centre = distance * np.array(direction)
        corners = centre + 0.1 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return float(weak_perspective_size(_image_box(corners), CAMERA)[0])

    assert size(theta) == pytest.approx(size(0), rel=1e-9)


@given(st.floats(0.1, 0.9), st.floats(2, 8))
def test_a_sphere_keeps_only_the_radial_shear(theta: float, distance: float) -> None:
    """Uncorrected, a small sphere's box grows as 1/cos³; corrected, as 1/cos: the correction is partial."""
    angles = np.linspace(0, math.pi, 60)[:, None], np.linspace(0, math.tau, 120)[None]
    shell = np.stack(
        [
            np.sin(angles[0]) * np.cos(angles[1]),
            np.sin(angles[0]) * np.sin(angles[1]),
            np.cos(angles[0]) + 0 * angles[1],
        ],
        -1,
    )

    def box(off_axis: float) -> np.ndarray:
        centre = distance * np.array([math.sin(off_axis), 0, math.cos(off_axis)])
        return _image_box((centre + 0.01 * shell).reshape(-1, 3))

    ratio = float(weak_perspective_size(box(theta), CAMERA)[0] / weak_perspective_size(box(0), CAMERA)[0])
    assert ratio == pytest.approx(1 / math.cos(theta), rel=0.02)


def test_box_distance_is_the_closed_form() -> None:
    points = [[0.5, 0.5, 0.5], [2, 0.5, 0.5], [2, 2, 0.5], [-1, -1, -1]]
    assert box_distance(points, (0, 0, 0), (1, 1, 1)) == pytest.approx([0, 1, math.sqrt(2), math.sqrt(3)])


@given(st.floats(-3, 3), st.floats(0.5, 3))
def test_headings(angle: float, distance: float) -> None:
    eye = np.array([1.0, 2.0, 1.5])
    target = eye + distance * np.array([math.cos(angle), math.sin(angle), -0.2])
    pose = look(eye, target)
    assert view_yaw(pose, CAMERA, CAMERA.cx, CAMERA.cy) == pytest.approx(angle)
    assert yaw_towards(eye[0], eye[1], target[0], target[1]) == pytest.approx(angle)
    to_the_right = view_yaw(pose, CAMERA, CAMERA.cx + 20, CAMERA.cy)
    assert math.sin(to_the_right - angle) < 0, "what lies right of the centre is seen clockwise"


def test_a_scaled_camera_sees_the_same_rays() -> None:
    camera = Camera(640, 480, 525.0, 520.0, 319.5, 239.5)
    half = camera.scaled(320, 240)
    # The centre of a pixel of the half image is the middle of a 2x2 block of the full one.
    assert (10 - half.cx) / half.fx == pytest.approx((20.5 - camera.cx) / camera.fx)
