"""From boxes in an image to the space that they show: the object's own surface behind each box, by depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.types import Array, Frame

GRID = 15  # samples along either side of a box
POINTS = 48  # of them that are kept of an object's surface
LEAST = 6  # samples on the surface under which a box shows nothing
FLYING = 50  # of so many points one at either end is a flying pixel
BESIDE = 20  # and without a mask one of so many is of what stands beside or behind
THIN_M = 0.04  # a surface is at least this deep


class Lifted(NamedTuple):
    """N boxes in space: corners ``low`` and ``high`` (N, 3) of the surface in the world, ``reach_low`` and ``reach_high`` of all
    that may belong to it, its ``middle`` (N, 3), ``points`` (N, 48, 3) of it, ``pixels`` (N, 225) as flat indices into the image
    with ``own`` (N, 225) for those on the surface, and ``shown`` (N,): whether there was enough depth."""

    low: Array
    high: Array
    reach_low: Array
    reach_high: Array
    middle: Array
    points: Array
    pixels: npt.NDArray[np.intp]
    own: npt.NDArray[np.bool_]
    shown: npt.NDArray[np.bool_]


def lift(frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None = None) -> Lifted:
    """The space that boxes (N, 4) fill; the frame must have depth.

    A box also holds what stands behind the object. Its own surface is where the depth lies within half the object's own width
    or height of the near third of the box's middle, or where its mask is.
    """
    assert frame.depth_m is not None
    n, camera = len(boxes_xyxy), frame.camera
    height, width = frame.depth_m.shape
    part = (np.arange(GRID, dtype=np.float32) + np.float32(0.5)) / GRID
    x1, y1, x2, y2 = np.asarray(boxes_xyxy, np.float32).T[:, :, None]
    cols = np.clip(x1 + part * (x2 - x1), 0, width - 1).astype(np.intp)
    rows = np.clip(y1 + part * (y2 - y1), 0, height - 1).astype(np.intp)
    pixels = (rows[:, :, None] * width + cols[:, None, :]).reshape(n, GRID * GRID)
    z = frame.depth_m.ravel()[pixels]
    own = z > 0  # NaN compares as False
    if masks is not None:
        own &= masks.reshape(n, height * width)[np.arange(n)[:, None], pixels]
    else:
        core_1d = np.abs(part - 0.5) <= 0.25
        core = own & (core_1d[:, None] & core_1d).ravel()
        core |= own & ~core.any(1)[:, None]
        seed = np.sort(np.where(core, z, np.inf), axis=1)[np.arange(n), core.sum(1) // 3][:, None]
        reach = np.maximum((x2 - x1) / camera.fx, (y2 - y1) / camera.fy) * seed / 2
        with np.errstate(invalid="ignore"):  # inf - inf where a box has no depth
            own &= np.abs(z - seed) <= np.maximum(reach, THIN_M)
    count = own.sum(1)
    z = np.where(own, z, 0)
    across = ((cols - camera.cx) / camera.fx).astype(np.float32)[:, None, :].repeat(GRID, 1).reshape(z.shape)
    down = ((rows - camera.cy) / camera.fy).astype(np.float32)[:, :, None].repeat(GRID, 2).reshape(z.shape)
    pose = frame.world_from_camera.astype(np.float32)
    order = np.argsort(~own, axis=1, kind="stable")
    each, corners, middle, world = np.arange(n), np.zeros((4, n, 3)), np.empty((n, 3)), []
    few = np.stack([count // (FLYING if masks is not None else BESIDE), count // FLYING])
    last = np.maximum(count - 1, 0) - few
    for axis in range(3):  # one axis at a time: far quicker than products along a short one
        values = (across * pose[axis, 0] + down * pose[axis, 1] + pose[axis, 2]) * z + pose[axis, 3]
        ordered = np.sort(np.where(own, values, np.inf), axis=1)
        corners[:2, :, axis], corners[2:, :, axis] = ordered[each, few], ordered[each, last]
        middle[:, axis] = np.where(own, values, 0).sum(1) / np.maximum(count, 1)
        world.append(values)
    corners[:, count == 0] = 0
    spread = (np.linspace(0, 1, POINTS) * np.maximum(count - 1, 0)[:, None]).astype(np.intp)
    chosen = np.take_along_axis(order, spread, 1)
    points = np.stack([np.take_along_axis(values, chosen, 1) for values in world], 2)
    low, reach_low, high, reach_high = corners
    return Lifted(low, high, reach_low, reach_high, middle, points, pixels, own, count >= LEAST)


def overlaps(
    low: Array, high: Array, other_low: Array, other_high: Array, pad: float = 0.0
) -> tuple[Array, Array, Array]:
    """Of axis-aligned boxes (N, D) and (M, D), each grown by ``pad``: their intersection (N, M) over the union, over the smaller
    one, and the share of each of the N that lies in each of the M or within a tenth of that one's size."""
    one, other, shared, within = 1.0, 1.0, 1.0, 1.0
    slack = 0.1 * (other_high - other_low).max(1, initial=0)
    for a, b, c, d in zip(low.T, high.T, other_low.T, other_high.T, strict=True):
        side, own = np.minimum(b[:, None], d) - np.maximum(a[:, None], c) + 2 * pad, (b - a + 2 * pad)[:, None]
        one, other, shared = one * own, other * (d - c + 2 * pad), shared * np.maximum(side, 0)
        within = within * np.clip(side + slack, 0, own) / np.maximum(own, 1e-9)
    return (
        shared / np.maximum(one + other - shared, 1e-9),
        shared / np.maximum(np.minimum(one, other), 1e-9),
        np.asarray(within),
    )
