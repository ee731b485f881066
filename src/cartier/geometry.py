"""Geometry: transforms, projection and back-projection, distances to boxes. Conventions: the head of ``types/``."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier.types import Array, Camera, Floats


def transform(b_from_a: Array, points_a: Array) -> Floats:
    """Points (..., 3) of a in b, in the points' own precision."""
    points = np.asarray(points_a)
    matrix = np.asarray(b_from_a, dtype=points.dtype if points.dtype.kind == "f" else np.float64)
    moved: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def invert(b_from_a: Array) -> npt.NDArray[np.float64]:
    """a_from_b of a rigid transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = b_from_a[:3, :3].T
    inverse[:3, 3] = -b_from_a[:3, :3].T @ b_from_a[:3, 3]
    return inverse


def ray_slopes(camera: Camera) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """x/z per image column (W,) and y/z per image row (H,)."""
    columns = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    rows = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy)) / np.float32(camera.fy)
    return columns, rows


def backproject(depth_m: Array, camera: Camera, stride: int = 1) -> npt.NDArray[np.float32]:
    """Camera-frame points (h, w, 3) float32 of every ``stride``-th pixel; NaN where the depth is."""
    columns, rows = ray_slopes(camera)
    z = np.asarray(depth_m, dtype=np.float32)[::stride, ::stride]
    points = np.empty((*z.shape, 3), np.float32)
    np.multiply(z, columns[::stride], out=points[..., 0])
    np.multiply(z, rows[::stride, None], out=points[..., 1])
    points[..., 2] = z
    return points


def project(points_world: Array, camera: Camera, world_from_camera: Array) -> tuple[Floats, Floats]:
    """Pixels uv (..., 2) and z-depth (...) of world points; the caller drops those with z <= 0."""
    points = transform(invert(world_from_camera), np.asarray(points_world, dtype=np.float64))
    z = points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = points[..., :2] / z[..., None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return uv, z


def shorter_side(box_xyxy: Sequence[float] | Array, size: tuple[int, int]) -> float:
    """The shorter side (px) of an image box, as far as it lies inside of an image of a size (width, height)."""
    x1, y1, x2, y2 = box_xyxy
    return float(max(0.0, min(min(x2, size[0]) - max(x1, 0), min(y2, size[1]) - max(y1, 0))))


def weak_perspective_size(boxes_xyxy: Array, camera: Camera) -> npt.NDArray[np.float64]:
    """Areas (N,) of image boxes (N, 4) in px², corrected for where in the image they lie.

    An object of width S, parallel to the image plane, at distance R from the camera and theta off the optical axis,
    has depth Z = R cos(theta). Weak perspective scales the whole object by its mean depth, so its image is f S / Z =
    (f S / R) / cos(theta) wide: 1 / cos(theta) larger than the same object at the same distance on the axis. Each side
    is therefore multiplied by cos(theta) of the box centre, the area by cos²(theta), and what is left depends on the
    distance alone. The correction is *partial*, as the paper (arXiv 2307.11865) says: exact for a plate parallel to
    the image, while a sphere keeps another 1 / cos(theta) along the radius, because weak perspective has no shear.
    """
    boxes = np.asarray(boxes_xyxy, dtype=np.float64).reshape(-1, 4)
    x = ((boxes[:, 0] + boxes[:, 2]) / 2 - camera.cx) / camera.fx
    y = ((boxes[:, 1] + boxes[:, 3]) / 2 - camera.cy) / camera.fy
    area = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    return np.asarray(area / (1 + x * x + y * y), dtype=np.float64)


def box_distance(points: Array, box_min: Array, box_max: Array) -> npt.NDArray[np.float64]:
    """Euclidean distances (...) of points (..., 3) to an axis-aligned box, 0 inside; or of (..., 2) on a floor plan."""
    points = np.asarray(points, dtype=np.float64)
    outside = np.maximum(np.maximum(np.asarray(box_min) - points, points - np.asarray(box_max)), 0)
    return np.asarray(np.linalg.norm(outside, axis=-1), dtype=np.float64)


def yaw_towards(x: float, y: float, target_x: float, target_y: float) -> float:
    """The heading (rad, counter-clockwise from +x) that faces a target."""
    return math.atan2(target_y - y, target_x - x)


def view_yaw(world_from_camera: Array, camera: Camera, u: float, v: float) -> float:
    """The heading in which pixel (u, v) is seen."""
    ray = world_from_camera[:3, :3] @ np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
    return math.atan2(float(ray[1]), float(ray[0]))
