"""Box fitting: the box of an object is that of the surface on which its best views agree.

Of each of its best views an object keeps a patch: the depth in and around the detected box, on a small grid. What a
box shows of the background, another view shows outside of its own box; such surface is left out. Source: votes of
views on space, as in Kutulakos and Seitz, A Theory of Shape by Space Carving, 2000, on points instead of voxels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.mapping.furniture import FLAT_TOPPED, STANDING
from cartier.mapping.observation import (
    FARTHER,
    MIN_SURFACE_SAMPLES,
    MIN_THICKNESS_M,
    NEARER,
    OFFSETS,
    PATCH_SIDE,
    SEED,
    UNKNOWN,
    sample_pixels,
    step_m,
)  # fmt: skip
from cartier.types import Array

MIDDLES = (OFFSETS[1:] + OFFSETS[:-1]) / 2
SURFACE_REACH = 0.45  # in sizes of the object: without a mask, depth so far from its middle may be its surface
SURFACE_TOLERANCE_M, SURFACE_TOLERANCE_SHARE = 0.04, 0.01  # two depths of one surface differ by that, and per metre
FLYING_SHARE, MIN_FLYING_M = 0.15, 0.02  # in sizes of the object, by which neighbours on its surface differ at most
BOX_SLACK = 0.02  # in sides of a box, by which detectors miss an edge
FALLBACK_AGREEMENT = 0.5  # where too few points are left
TOP_AGREEMENT, TOP_SHARE = 0.65, 0.1  # of the views, on the top of furniture; of the points, that a top has at least
TOP_FROM_M, TOP_SIDE_M = 0.2, 0.7  # least height and longer side of a top
TOP_LAYER_M, TOP_TOLERANCE_M = 0.02, 0.025
MIN_TOP_SHARE = 0.5  # of an object's height, from which a layer may be its top: the others are shelves
CELLS_PER_SIDE, MIN_CELL_M, MAX_CELL_M = 18, 0.008, 0.03  # points are thinned to one per cell
MIN_COMPONENT_SHARE = 0.25  # of the largest connected part; smaller parts are no part of the object
OUTLIER_SHARE = 0.02  # of the surface at either end, without masks
AREA_CELLS = 16  # along the longest side of an object; each holds the same share of its surface, however many points
FLOOR_M = 0.03  # lower points are floor, if the object is higher than ``LOW_M``
LOW_M = 0.15
NEIGHBOURS = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), axis=-1).reshape(-1, 3)  # of a cell, itself among them
MOST_KEYS = 2.0**62  # cells in a box around points; there are more only where views are a hundred kilometres apart
SIDES_SEEN = ("+x", "-x", "+y", "-y", "+z")
STANDING_SHARE = 1 / 3  # an object whose bottom is seen below this share of its top stands on the floor


def agreed_surface(patches: npt.NDArray[Any], min_agreement: float) -> tuple[Array, bool]:
    """Points (k, 3), in the world, of the surface that the patches (v,) of one object agree on; whether masks gave it.

    Few or none where the patches show too little.
    """
    patches = patches[patches["worth"] > 0]
    masked = bool(len(patches)) and bool(patches["masked"].all())
    if not len(patches):
        return np.zeros((0, 3)), masked
    depth_m, inside = decoded(patches)
    surface = inside & np.isfinite(depth_m)
    far = np.abs(depth_m - patches["seed_m"][:, None, None])
    reach = np.maximum(patches["size_m"] * SURFACE_REACH, MIN_THICKNESS_M)[:, None, None]
    surface &= patches["masked"][:, None, None] | (far <= reach)
    surface &= ~flying(np.where(surface, depth_m, np.nan), patches["size_m"])
    points = _in_world(patches, depth_m, surface)
    if len(points) < MIN_SURFACE_SAMPLES:
        return points, masked
    side_m = np.sort(np.quantile(points, 0.9, axis=0) - np.quantile(points, 0.1, axis=0))[1] / 0.8
    cell_m = float(np.clip(side_m / CELLS_PER_SIDE, MIN_CELL_M, MAX_CELL_M))
    points = points[np.unique(cell_keys(points, cell_m), return_index=True)[1]]
    share = agreement(points, patches, depth_m, inside)
    agreed = share >= min_agreement
    if agreed.sum() < MIN_SURFACE_SAMPLES:
        agreed = share >= min(min_agreement, FALLBACK_AGREEMENT)
    if not masked:
        agreed |= (share >= TOP_AGREEMENT) & on_top(points, agreed)
    points = points[agreed]
    return points if masked or not len(points) else _main_component(points, 2.5 * cell_m), masked


def on_top(points: Array, agreed: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Which points (k, 3) lie in the plane of a large horizontal surface that ``agreed`` (k,) points show, if any does.

    A box that ends short on a worktop or a bed is a frequent error, and background at the very height of it is rare.
    """
    height = points[:, 2]
    top_m = top_height(height[agreed])
    if top_m is None:
        return np.zeros(len(points), bool)
    plane = np.abs(height - top_m) < TOP_TOLERANCE_M
    top = points[plane & agreed, :2]
    return plane & bool(len(top) and np.ptp(top, axis=0).max() > TOP_SIDE_M)


def top_height(height_m: Array) -> float | None:
    """The height of the layer that holds the most points at ``height_m`` (k,); None if no layer stands out."""
    over = height_m[height_m > TOP_FROM_M]
    if not len(over):
        return None
    layers = np.bincount(np.rint(over / TOP_LAYER_M).astype(int))
    both = layers + np.append(layers[1:], 0)
    return (float(both.argmax()) + 0.5) * TOP_LAYER_M if both.max() >= TOP_SHARE * len(height_m) else None


def flying(depth_m: Array, size_m: Array) -> npt.NDArray[np.bool_]:
    """Which samples (v, s, s) have no neighbour at their depth: pixels that hang between an edge and what is behind it.

    ``depth_m`` (v, s, s) is NaN outside of the surface of an object of ``size_m`` (v,).
    """
    step_m = np.maximum(size_m * FLYING_SHARE, MIN_FLYING_M)[:, None, None]
    padded = np.pad(depth_m, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    beside = padded[:, :-2, 1:-1], padded[:, 2:, 1:-1], padded[:, 1:-1, :-2], padded[:, 1:-1, 2:]
    alike = np.stack([np.abs(neighbour - depth_m) <= step_m for neighbour in beside])  # NaN compares as False
    return np.asarray(~alike.any(0))


def agreement(
    points: Array, patches: npt.NDArray[Any], depth_m: Array, inside: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """The share (k,) of the views showing each of ``points`` (k, 3) that have it inside of the detected box or mask."""
    from scipy.ndimage import binary_dilation

    pose, camera, box = (patches[name].astype(np.float64) for name in ("pose", "camera", "box"))
    x, y, z = np.moveaxis((points - pose[:, None, :, 3]) @ pose[:, :, :3], 2, 0)  # (v, k)
    ahead = z > 0.1
    z = np.where(ahead, z, 1)
    a = (x / z * camera[:, :1] + camera[:, 2:3] + 0.5 - box[:, :1]) / (box[:, 2:3] - box[:, :1])
    b = (y / z * camera[:, 1:2] + camera[:, 3:] + 0.5 - box[:, 1:2]) / (box[:, 3:] - box[:, 1:2])
    known = ahead & (np.minimum(a, b) > OFFSETS[0] - BOX_SLACK) & (np.maximum(a, b) < OFFSETS[-1] + BOX_SLACK)
    at = np.arange(len(patches))[:, None], np.searchsorted(MIDDLES, b), np.searchsorted(MIDDLES, a)
    tolerance = SURFACE_TOLERANCE_M + SURFACE_TOLERANCE_SHARE * z
    shown = known & (np.abs(depth_m[at] - z) <= tolerance)  # NaN and infinity compare as False
    in_box = (np.minimum(a, b) >= -BOX_SLACK) & (np.maximum(a, b) <= 1 + BOX_SLACK)
    in_mask = binary_dilation(inside, np.array([[[0, 1, 0], [1, 1, 1], [0, 1, 0]]]))[at]  # a sample's neighbour counts
    within = shown & np.where(patches["masked"][:, None], in_mask, in_box)
    return np.asarray(within.sum(0) / np.maximum(shown.sum(0), 1))


def surface_box(points: Array, masked: bool, yaw: float = 0.0, shape: int = 0) -> Array | None:
    """The box (2, 3), least and greatest corner, of a surface (k, 3); None if there is too little of it.

    The corners are along axes that are turned by ``yaw`` about the vertical. What is seen standing low over the floor,
    which is at height 0, reaches down to it, and so does furniture whose ``shape`` (``furniture.shapes``) says so,
    however little of it is seen. Furniture with a flat top ends there. Masks need none of this.
    """
    if not masked and points[:, 2].max(initial=0) > LOW_M and (points[:, 2] > FLOOR_M).sum() >= MIN_SURFACE_SAMPLES:
        points = points[points[:, 2] > FLOOR_M]
    if len(points) < MIN_SURFACE_SAMPLES:
        return None
    points = points @ about_z(yaw)
    box = np.stack([points.min(0), points.max(0)]) if masked else _box_of_most(points)
    if not masked and shape & FLAT_TOPPED:
        box = _ended_at_top(box, points, bool(shape & STANDING))
    stands = not masked and bool(shape & STANDING)
    if box[0, 2] > 0 and (stands or box[0, 2] < max(LOW_M, STANDING_SHARE * box[1, 2])):
        box[0, 2] = 0
    return np.asarray(box)


def _ended_at_top(box: Array, points: Array, sideways: bool) -> Array:
    """A box (2, 3) without what stands on the top that ``points`` (k, 3) show; ``sideways``: nor beside it.

    A table reaches no further than its top, but chairs before it do. A worktop may go round a corner.
    """
    top_m = top_height(points[:, 2])
    if top_m is None or top_m <= MIN_TOP_SHARE * box[1, 2]:
        return box
    top = points[np.abs(points[:, 2] - top_m) < TOP_TOLERANCE_M]
    box = box.copy()
    box[1, 2] = min(box[1, 2], max(top_m, float(top[:, 2].max(initial=0))))
    if sideways and len(top) >= MIN_SURFACE_SAMPLES:
        low, high = _box_of_most(top)
        box[0, :2], box[1, :2] = np.maximum(box[0, :2], low[:2]), np.minimum(box[1, :2], high[:2])
    return box


def _box_of_most(points: Array) -> Array:
    """The box (2, 3) of ``points`` (k, 3) without outliers: the far end of a worktop counts as the near one does, which
    views show with many more points."""
    cell_m = max(float(np.ptp(points, axis=0).max()) / AREA_CELLS, MIN_CELL_M)
    _, of, counts = np.unique(cell_keys(points, cell_m), return_inverse=True, return_counts=True)
    weight = 1 / counts[of]
    order = np.argsort(points, axis=0)
    below = np.cumsum(weight[order], axis=0) - weight[order] / 2
    shares, ordered = below / weight.sum(), np.take_along_axis(points, order, 0)
    ends = (OUTLIER_SHARE, 1 - OUTLIER_SHARE)
    return np.stack([np.interp(ends, share, along) for share, along in zip(shares.T, ordered.T, strict=True)], axis=1)


def sides_seen(patches: npt.NDArray[Any], box: Array, yaw: float) -> npt.NDArray[np.bool_]:
    """Which sides (5,) of a box (2, 3) the patches (v,) show: those of greatest and least x and y, and the top.

    ``yaw`` is that of ``surface_box``. A camera beyond the plane of a side sees it.
    """
    cameras = patches["pose"][patches["worth"] > 0][:, :, 3].astype(np.float64) @ about_z(yaw)
    beyond = np.stack([cameras > box[1], cameras < box[0]], axis=2).any(0)
    return np.asarray(beyond.ravel()[: len(SIDES_SEEN)])


def about_z(yaw: float) -> Array:
    """The matrix (3, 3) whose columns are the axes turned by ``yaw`` about the vertical: points @ it is turned back."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def decoded(patches: npt.NDArray[Any]) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Depths (v, s, s) in metres, NaN where unknown, infinite where out of range; which samples are inside."""
    codes = patches["depth"]
    depth_m = patches["seed_m"][:, None, None] + (codes.astype(np.float64) - SEED) * step_m(patches)[:, None, None]
    depth_m[codes == UNKNOWN] = np.nan
    depth_m[codes == NEARER], depth_m[codes == FARTHER] = -np.inf, np.inf
    inside = np.unpackbits(patches["inside"], axis=1, count=PATCH_SIDE * PATCH_SIDE).reshape(codes.shape).astype(bool)
    return depth_m, inside


def _in_world(patches: npt.NDArray[Any], depth_m: Array, chosen: npt.NDArray[np.bool_]) -> Array:
    """The chosen samples (v, PATCH_SIDE, PATCH_SIDE) as points (k, 3)."""
    view, row, col = np.nonzero(chosen)
    cols, rows = sample_pixels(patches["box"])
    fx, fy, cx, cy = patches["camera"][view].T.astype(np.float64)
    z, pose = depth_m[chosen], patches["pose"][view].astype(np.float64)
    rays = np.stack([(cols[view, col] - cx) / fx * z, (rows[view, row] - cy) / fy * z, z], axis=1)
    return np.asarray((pose[:, :, :3] @ rays[:, :, None])[:, :, 0] + pose[:, :, 3])


def cell_keys(points: Array, cell_m: float) -> npt.NDArray[np.int64]:
    """A number for the cell of each of ``points`` (k, 3), which keeps the order of cells and is sorted faster."""
    cells = np.floor(points / cell_m).astype(int)
    cells -= cells.min(0)
    span = cells.max(0) + 1
    if np.prod(span, dtype=np.float64) >= MOST_KEYS:
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    return np.asarray(np.ravel_multi_index(tuple(cells.T), tuple(span)))


def _main_component(points: Array, cell_m: float) -> Array:
    """The points (k, 3) of the largest connected part, and of parts that are not much smaller."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    cells = np.floor((points - points.min(0)) / cell_m).astype(int)
    span = cells.max(0) + 3
    if np.prod(span, dtype=np.float64) >= MOST_KEYS:
        return points  # no part is the object's
    keys, of = np.unique(np.ravel_multi_index(tuple(cells.T + 1), tuple(span)), return_inverse=True)
    steps = np.ravel_multi_index(tuple(NEIGHBOURS.T + 1), tuple(span)) - np.ravel_multi_index((1, 1, 1), tuple(span))
    wanted = keys[:, None] + steps
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    cell, side = np.nonzero(keys[at] == wanted)
    links = coo_array((np.ones(len(cell)), (cell, at[cell, side])), shape=(len(keys), len(keys)))
    part = connected_components(links, directed=False)[1][of]
    sizes = np.bincount(part)
    return np.asarray(points[sizes[part] >= MIN_COMPONENT_SHARE * sizes.max()])
