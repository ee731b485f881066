"""Depth of one camera as another one sees it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.types import Array, Camera

MAX_COVER = 16  # how often the depth pixels may cover the target: about once, where both cameras see the same


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
            f"a depth image with fx={camera.fx:g}, fy={camera.fy:g} cannot be put on a colour image with fx={target.fx:g}, "
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
