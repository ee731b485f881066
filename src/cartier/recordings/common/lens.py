"""Cameras and lenses: checked intrinsics, images without distortion, and depth of one camera as another one sees it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.geometry import backproject, transform
from cartier.types import Array, Camera

Model = Literal["pinhole", "plumb_bob", "equidistant"]
Source = npt.NDArray[np.int32]
MAX_COEFFICIENT = 1e6
MAX_COVER = 16  # how often the depth pixels may cover the target: about once, where both cameras see the same
USUAL_OFF_CENTRE, MAX_OFF_CENTRE = 0.05, 0.2
"""How far from the middle of an image, in shares of its side, a principal point may lie without a note, and at all.

A real camera's lies off by a few hundredths, that of an image with a strip cut off by half the strip's share.
"""
RESIZED, SAME_RATIO = 0.1, 0.08
"""A principal point off by one factor (to 8 %) of 10 % or more in both directions is that of images of another size."""


def camera_of(width: int, height: int, values: Sequence[float], where: str) -> Camera:
    """A camera of fx, fy, cx, cy. Raises InputError, also if they are for images of another size."""
    try:
        camera = Camera(width, height, *values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    ratios = (2 * (camera.cx + 0.5) / width, 2 * (camera.cy + 0.5) / height)
    one_factor = abs(ratios[0] - ratios[1]) <= SAME_RATIO * max(ratios)
    resized = one_factor and min(abs(ratio - 1) for ratio in ratios) >= RESIZED
    if resized or off_centre((width, height), (camera.cx, camera.cy)) > MAX_OFF_CENTRE:
        raise InputError(
            f"{where}: the principal point {camera.cx:g}, {camera.cy:g} is that of images of some "
            f"{max(2 * camera.cx, 0):.0f}x{max(2 * camera.cy, 0):.0f} px, but these have {width}x{height}: scale fx, "
            "fy, cx, cy as the images were resized"
        )
    return camera


def off_centre(size: tuple[int, int], centre: tuple[float, float]) -> float:
    """How far a principal point is from the middle of images (w, h), the larger of its shares of the two sides."""
    return max(abs(c + 0.5 - side / 2) / side for c, side in zip(centre, size, strict=True))


def off_centre_notes(camera: Camera) -> list[str]:
    """The line to say where the principal point is further from the middle than a whole image's ever is."""
    off = off_centre((camera.width, camera.height), (camera.cx, camera.cy))
    if off <= USUAL_OFF_CENTRE:
        return []
    return [
        f"the principal point {camera.cx:g}, {camera.cy:g} lies {off:.0%} of the side off the middle of the images "
        f"({camera.width}x{camera.height} px): right if they were cropped, wrong if they were resized"
    ]


@dataclass(frozen=True)
class Lens:
    """A camera and its distortion.

    ``plumb_bob`` is OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]] (the last three make it rational), ``equidistant`` OpenCV's
    fisheye k1 k2 k3 k4. Raises InputError on another number of coefficients.
    """

    camera: Camera
    model: Model = "pinhole"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        sizes = {"pinhole": (0,), "plumb_bob": (4, 5, 8), "equidistant": (4,)}[self.model]
        if len(self.coefficients) not in sizes or not all(
            abs(c) < MAX_COEFFICIENT for c in self.coefficients
        ):  # or NaN
            raise InputError(f"{self.model} distortion needs {sizes} sane numbers, got {brief(self.coefficients)}")

    def scaled(self, width: int, height: int) -> Lens:
        return Lens(self.camera.scaled(width, height), self.model, self.coefficients)


def straight(camera: Camera, model: Model, coefficients: Array | tuple[float, ...]) -> Lens:
    """A lens, as a pinhole where the coefficients are all zero."""
    numbers = tuple(float(c) for c in coefficients)
    return Lens(camera, model, numbers) if any(numbers) else Lens(camera)


def resampled(image: Array, lens: Lens, target: Camera, empty: float) -> Array:
    """``image`` (H, W, …) of a lens as the target camera sees it; nearest pixel, ``empty`` outside of the image.

    The nearest pixel and no mean of several: a mean of depths over an edge is a point in the air.
    """
    if lens.model == "pinhole" and lens.camera == target:
        return image
    source = _source(lens, target)
    flat = image.reshape(lens.camera.height * lens.camera.width, *image.shape[2:])
    out = np.take(flat, source, axis=0, mode="clip")
    out[source < 0] = empty
    return np.asarray(out)


def straightened(box_xyxy: Array, lens: Lens) -> Array:
    """The box (4,) that bounds, in ``resampled`` images of the lens's own camera, what a box in its images shows.

    It is empty (all zeros) where that is outside of them.
    """
    if lens.model == "pinhole":
        return box_xyxy
    row, col = np.divmod(_source(lens, lens.camera), lens.camera.width)
    x1, y1, x2, y2 = box_xyxy
    inside = (row >= 0) & (col >= x1 - 0.5) & (col <= x2 - 0.5) & (row >= y1 - 0.5) & (row <= y2 - 0.5)
    rows, cols = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if not len(rows):
        return np.zeros(4)
    return np.array([cols[0], rows[0], cols[-1] + 1, rows[-1] + 1], np.float64)


@lru_cache(maxsize=4)
def _source(lens: Lens, target: Camera) -> Source:
    """(H, W) int32: which pixel of the lens's image each pixel of the target looks at, counted row by row, or -1."""
    x = (np.arange(target.width) - target.cx) / target.fx
    y = ((np.arange(target.height) - target.cy) / target.fy)[:, None]
    camera = lens.camera
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # beyond where the model holds: not inside
        bent_x, bent_y = _bent(lens, x, y)
        columns = np.rint(bent_x * camera.fx + camera.cx)
        rows = np.rint(bent_y * camera.fy + camera.cy)
        inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        return np.where(inside, rows * camera.width + columns, -1).astype(np.int32)


def _bent(lens: Lens, x: Array, y: Array) -> tuple[Array, Array]:
    """Where the lens puts the ray (x, y, 1)."""
    if lens.model == "pinhole":
        return x, y
    r2 = x * x + y * y
    if lens.model == "equidistant":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        t2 = theta * theta
        k1, k2, k3, k4 = lens.coefficients
        bent = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        scale = np.divide(bent, r, out=np.ones_like(r), where=r > 1e-9)
        return x * scale, y * scale
    k1, k2, p1, p2, k3, k4, k5, k6 = (*lens.coefficients, *[0.0] * (8 - len(lens.coefficients)))
    scale = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    xy = x * y
    return x * scale + 2 * p1 * xy + p2 * (r2 + 2 * x * x), y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * xy


def registered(depth_m: Array, camera: Camera, target: Camera, target_from_camera: Array) -> npt.NDArray[np.float32]:
    """(H, W) float32 z-depth of the target camera, NaN where nothing falls; of two points on a pixel the nearer.

    A depth pixel covers as many pixels of the target as its focal lengths ask for, so that a small depth image leaves
    no sieve of holes.
    """
    points = transform(target_from_camera, backproject(depth_m, camera).reshape(-1, 3))
    z = points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = points[:, 0] / z * target.fx + target.cx
        v = points[:, 1] / z * target.fy + target.cy
        seen = (z > 0) & (u > -1) & (u < target.width) & (v > -1) & (v < target.height)
    u, v, z = u[seen], v[seen], z[seen]
    across, down = math.ceil(target.fx / camera.fx), math.ceil(target.fy / camera.fy)
    if across * down * len(z) > MAX_COVER * target.width * target.height:
        raise InputError(
            f"a depth image with fx={camera.fx:g}, fy={camera.fy:g} cannot be put on a colour image with "
            f"fx={target.fx:g}, "
            f"fy={target.fy:g}: are the depth camera's intrinsics right?"
        )
    first_u, first_v = np.rint(u - (across - 1) / 2).astype(np.int64), np.rint(v - (down - 1) / 2).astype(np.int64)
    out = np.full(target.height * target.width, np.inf, np.float32)
    for dy in range(down):
        for dx in range(across):
            column, row = first_u + dx, first_v + dy
            inside = (column >= 0) & (column < target.width) & (row >= 0) & (row < target.height)
            np.minimum.at(out, row[inside] * target.width + column[inside], z[inside].astype(np.float32))
    out[np.isinf(out)] = np.nan
    return out.reshape(target.height, target.width)
