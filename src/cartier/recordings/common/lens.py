"""From the pixels that a lens gave to those of a pinhole camera: another size, other intrinsics, no distortion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.types import Array, Camera

Model = Literal["pinhole", "plumb_bob", "equidistant"]
Source = npt.NDArray[np.int32]
MAX_COEFFICIENT = 1e6


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
