"""Observation of detections in space: the surface that depth shows behind each box, its colours, and its best views."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_FAR_M
from cartier.mapping.colours import COLOURS, LEVELS, colour_table
from cartier.types import Array, Frame

GRID = 15  # samples along either side of a box
SURFACE_POINTS = 48  # of the samples, kept for an object's surface
MIN_SURFACE_SAMPLES = 6  # with fewer the detection is not valid
FLYING_PIXEL_RATIO = 50  # one of so many points at either end is a flying pixel
BACKGROUND_RATIO = 20  # without a mask one of so many points is of what stands beside or behind
MIN_THICKNESS_M = 0.04  # a surface is at least this deep

LUMA = np.array((0.299, 0.587, 0.114), np.float32)
BALANCE_SAMPLES = 30  # along the shorter side of a frame
NEAR_NEUTRAL = 0.7  # least ratio of the darkest to the brightest channel of what may be white
CLIPPED = 252  # from here on a channel says nothing about the light
BRIGHTEST = 0.1  # share of the near-neutral samples that is taken to be white
MIN_NEUTRAL = 30  # samples; with fewer there is no balance
BALANCE_STRENGTH, MAX_BALANCE = 0.5, 1.1  # half of the cast is taken off: walls and wood are warm by themselves
VALUES, STRIDES = np.arange(256)[:, None], np.array((LEVELS**2, LEVELS, 1))  # of a byte, and of the table of colours

PATCHES_KEPT = 7  # per object
INSIDE_SAMPLES = 16  # samples along either side of a box
MARGINS = np.array((0.05, 0.15, 0.35))  # of further samples beyond each side, in sides of the box
OFFSETS = np.concatenate([-MARGINS[::-1], np.linspace(0, 1, INSIDE_SAMPLES), 1 + MARGINS])
PATCH_SIDE = len(OFFSETS)
WITHIN = (OFFSETS >= 0) & (OFFSETS <= 1)
PATCH_KIND = np.dtype(
    [("depth", "u1", (PATCH_SIDE, PATCH_SIDE)), ("inside", "u1", (PATCH_SIDE**2 + 7) // 8), ("pose", "f4", (3, 4)),
     ("camera", "f4", 4), ("box", "f4", 4), ("seed_m", "f4"), ("size_m", "f4"), ("worth", "f4"), ("masked", "?")]
)  # fmt: skip
UNKNOWN, NEARER, SEED, FARTHER = 0, 1, 128, 255  # codes of a depth; between them, hundredths of the object's size
MIN_STEP_M = 0.004
MAX_SKEW = 0.02  # of a pose's axes; readers take poses that are off by 0.01
SAME_STANDPOINT_M, SAME_STANDPOINT_COS = 0.3, np.cos(np.radians(15))  # nearer views of one object show the same side


class LiftedDetections(NamedTuple):
    """N detections in space, in the world frame (m).

    ``box_min`` and ``box_max`` (N, 3) bound the surface without outliers, ``extent_min`` and ``extent_max`` (N, 3)
    all that may belong to it. ``centroid`` (N, 3) and ``points`` (N, 48, 3) are of the surface. ``pixels`` (N, 225)
    are the sampled pixels as flat indices into the image, ``surface_mask`` (N, 225) marks those on the surface.
    ``valid`` (N,) says whether there was enough depth. ``colours`` (N, 11) are the shares of the named colours.
    """

    box_min: Array
    box_max: Array
    extent_min: Array
    extent_max: Array
    centroid: Array
    points: Array
    pixels: npt.NDArray[np.intp]
    surface_mask: npt.NDArray[np.bool_]
    valid: npt.NDArray[np.bool_]
    colours: Array


def lift(
    frame: Frame, depth_m: Array, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None = None
) -> LiftedDetections:
    """Lift boxes (N, 4), in pixels, into space by the depth (H, W) of a frame.

    A box also shows what stands behind the object. The surface of the object is where its mask is; without a mask,
    where the depth lies within half the object's width or height of the near third of the middle of the box.
    """
    n, camera = len(boxes_xyxy), frame.camera
    height, width = depth_m.shape
    part = (np.arange(GRID, dtype=np.float32) + np.float32(0.5)) / GRID
    x1, y1, x2, y2 = np.asarray(boxes_xyxy, np.float32).T[:, :, None]
    cols = np.clip(x1 + part * (x2 - x1), 0, width - 1).astype(np.intp)
    rows = np.clip(y1 + part * (y2 - y1), 0, height - 1).astype(np.intp)
    pixels = (rows[:, :, None] * width + cols[:, None, :]).reshape(n, GRID * GRID)
    z = depth_m.ravel()[pixels]
    surface = z > 0  # NaN compares as False
    if masks is not None:
        surface &= masks.reshape(n, height * width)[np.arange(n)[:, None], pixels]
    else:
        core_1d = np.abs(part - 0.5) <= 0.25
        core = surface & (core_1d[:, None] & core_1d).ravel()
        core |= surface & ~core.any(1)[:, None]
        seed = np.sort(np.where(core, z, np.inf), axis=1)[np.arange(n), core.sum(1) // 3][:, None]
        reach = np.maximum((x2 - x1) / camera.fx, (y2 - y1) / camera.fy) * seed / 2
        with np.errstate(invalid="ignore"):  # inf - inf where a box has no depth
            surface &= np.abs(z - seed) <= np.maximum(reach, MIN_THICKNESS_M)
    count = surface.sum(1)
    z = np.where(surface, z, 0)
    across = ((cols - camera.cx) / camera.fx).astype(np.float32)[:, None, :].repeat(GRID, 1).reshape(z.shape)
    down = ((rows - camera.cy) / camera.fy).astype(np.float32)[:, :, None].repeat(GRID, 2).reshape(z.shape)
    pose = frame.world_from_camera.astype(np.float32)
    order = np.argsort(~surface, axis=1, kind="stable")
    each, corners, centroid, world = np.arange(n), np.zeros((4, n, 3)), np.empty((n, 3)), []
    few = np.stack(
        [count // (FLYING_PIXEL_RATIO if masks is not None else BACKGROUND_RATIO), count // FLYING_PIXEL_RATIO]
    )
    last = np.maximum(count - 1, 0) - few
    for axis in range(3):  # one axis at a time: far quicker than products along a short one
        values = (across * pose[axis, 0] + down * pose[axis, 1] + pose[axis, 2]) * z + pose[axis, 3]
        ordered = np.sort(np.where(surface, values, np.inf), axis=1)
        corners[:2, :, axis], corners[2:, :, axis] = ordered[each, few], ordered[each, last]
        centroid[:, axis] = np.where(surface, values, 0).sum(1) / np.maximum(count, 1)
        world.append(values)
    corners[:, count == 0] = 0
    spread = (np.linspace(0, 1, SURFACE_POINTS) * np.maximum(count - 1, 0)[:, None]).astype(np.intp)
    chosen = np.take_along_axis(order, spread, 1)
    points = np.stack([np.take_along_axis(values, chosen, 1) for values in world], 2)
    box_min, extent_min, box_max, extent_max = corners
    return LiftedDetections(
        box_min, box_max, extent_min, extent_max, centroid, points, pixels, surface, count >= MIN_SURFACE_SAMPLES,
        colour_shares(frame.rgb, pixels, surface),
    )  # fmt: skip


def colour_shares(rgb: npt.NDArray[np.uint8], pixels: npt.NDArray[np.intp], mask: npt.NDArray[np.bool_]) -> Array:
    """Shares (N, 11) of the named colours among masked (N, K) ``pixels`` (N, K), flat indices into an image.

    They are named after a white balance of the image.
    """
    levels = np.minimum(VALUES * (white_balance(rgb) * (LEVELS / 256)), LEVELS - 1).astype(np.intp) * STRIDES
    values = rgb.reshape(-1, 3).take(pixels[mask], 0)
    red, green, blue = (levels[:, channel].take(values[:, channel]) for channel in range(3))
    names = colour_table().take(red + green + blue) + np.nonzero(mask)[0] * len(COLOURS)
    counts = np.bincount(names, minlength=len(pixels) * len(COLOURS)).reshape(len(pixels), len(COLOURS))
    return np.asarray(counts / np.maximum(counts.sum(1, keepdims=True), 1))


def white_balance(rgb: npt.NDArray[np.uint8]) -> Array:
    """Gains (3,) of red, green and blue that take off half of a frame's colour cast, by its brightest pale parts.

    A gain is at most a tenth: a camera balances too, and a wall or a table that fills the frame is warm by itself.
    """
    step = max(1, min(rgb.shape[:2]) // BALANCE_SAMPLES)
    samples = rgb[step // 2 :: step, step // 2 :: step].reshape(-1, 3).T.astype(np.float32)  # by channel: far quicker
    brightest, darkest = samples.max(0), samples.min(0)
    samples = samples.compress((darkest > NEAR_NEUTRAL * brightest) & (brightest < CLIPPED), 1)
    count = max(1, round(BRIGHTEST * samples.shape[1]))
    if samples.shape[1] < MIN_NEUTRAL:
        return np.ones(3)
    white = samples.take(np.argpartition(LUMA @ samples, -count)[-count:], 1).mean(1)
    return np.asarray(np.clip((LUMA @ white / white) ** BALANCE_STRENGTH, 1 / MAX_BALANCE, MAX_BALANCE))


def keep_patches(
    patches: npt.NDArray[Any],
    rows: npt.NDArray[np.intp],
    frame: Frame,
    detections: npt.NDArray[np.intp],
    boxes_xyxy: Array,
    worth: Array,
    masks: npt.NDArray[np.bool_] | None,
) -> npt.NDArray[np.intp]:
    """Keep the views of a frame that are among the best of their objects, in place; returns the rows that changed.

    ``patches`` (n, PATCHES_KEPT) are all objects'. ``detections`` (k,) of N boxes (N, 4) and masks (N, H, W) are of the
    different objects ``rows`` (k,); ``worth`` (N,) is the greater the surer and larger a view is. Of two views from
    one standpoint the better one stays, so that more frames a second add nothing.
    """
    kept_worth, worth = patches["worth"][rows], worth[detections]
    may = np.flatnonzero(worth > kept_worth.min(1, initial=np.inf))  # of most objects, better views are kept
    if not len(may):
        return rows[:0]
    rows, detections, worth, kept_worth = rows[may], detections[may], worth[may], kept_worth[may]
    pose, kept_pose = frame.world_from_camera[:3].astype(np.float32), patches["pose"][rows]
    here = np.square(kept_pose[..., 3] - pose[:, 3]).sum(-1) < SAME_STANDPOINT_M**2
    here &= (kept_pose[..., 2] @ pose[:, 2] > SAME_STANDPOINT_COS) & (kept_worth > 0)
    slot = np.where(here.any(1), np.where(here, kept_worth, -1).argmax(1), kept_worth.argmin(1))
    better = np.flatnonzero(worth > kept_worth[np.arange(len(rows)), slot])
    if not len(better):
        return rows[:0]
    new, valid = sample_patches(frame, detections[better], boxes_xyxy, worth[better], masks)
    chosen = better[valid]
    patches[rows[chosen], slot[chosen]] = new[valid]
    return rows[chosen]


def sample_patches(
    frame: Frame,
    detections: npt.NDArray[np.intp],
    boxes_xyxy: Array,
    worth: Array,
    masks: npt.NDArray[np.bool_] | None,
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """The patches (n,) of the ``detections`` (n,) among boxes (N, 4) and masks, and which show enough surface."""
    assert frame.depth_m is not None
    boxes_xyxy = boxes_xyxy[detections]
    n, camera, (height, width) = len(boxes_xyxy), frame.camera, frame.depth_m.shape
    patches = np.zeros(n, PATCH_KIND)
    patches["pose"], patches["box"], patches["worth"] = frame.world_from_camera[:3], boxes_xyxy, worth
    patches["camera"], patches["masked"] = (camera.fx, camera.fy, camera.cx, camera.cy), masks is not None
    cols, rows = sample_pixels(patches["box"])
    known = ((rows >= 0) & (rows < height))[:, :, None] & ((cols >= 0) & (cols < width))[:, None]
    rows, cols = np.clip(rows, 0, height - 1)[:, :, None], np.clip(cols, 0, width - 1)[:, None]
    z = frame.depth_m[rows, cols]
    known &= z > 0  # NaN compares as False
    inside = np.broadcast_to(WITHIN[:, None] & WITHIN, z.shape)
    if masks is not None:
        inside = inside & masks[detections[:, None, None], rows, cols]
    surface = inside & known
    core_1d = np.abs(OFFSETS - 0.5) <= 0.25
    core = surface & (core_1d[:, None] & core_1d) if masks is None else surface
    core = np.where(core.any((1, 2), keepdims=True), core, surface).reshape(n, -1)
    ordered = np.sort(np.where(core, z.reshape(n, -1), np.inf), axis=1)
    seed = ordered[np.arange(n), core.sum(1) // 3]
    x1, y1, x2, y2 = boxes_xyxy.T
    valid = (surface.sum((1, 2)) >= MIN_SURFACE_SAMPLES) & np.isfinite(seed) & (x1 < x2) & (y1 < y2)
    seed = np.where(valid, seed, 1)
    patches["seed_m"], patches["size_m"] = seed, np.maximum((x2 - x1) / camera.fx, (y2 - y1) / camera.fy) * seed
    steps = (np.where(known, z, 0) - seed[:, None, None]) / step_m(patches)[:, None, None]
    codes = np.clip(np.rint(steps), NEARER - SEED, FARTHER - SEED) + SEED
    patches["depth"], patches["inside"] = np.where(known, codes, UNKNOWN), np.packbits(inside.reshape(n, -1), axis=1)
    return patches, valid


def check_patches(patches: npt.NDArray[Any]) -> None:
    """Raises ValueError for kept patches that no camera took: a turn that is none, or surface beyond any home."""
    used = patches[patches["worth"] > 0]
    pose, lens, box = (used[name].astype(np.float64) for name in ("pose", "camera", "box"))
    turn = pose[:, :, :3]
    if (np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)) > MAX_SKEW).any():
        raise ValueError("a patch has no camera's pose")
    low, high, focal = box[:, :2], box[:, 2:], lens[:, :2]
    if (low >= high).any() or (focal <= 0).any() or (used["seed_m"] <= 0).any():
        raise ValueError("a patch has no area, no lens or no depth")
    margin = MARGINS[-1] * (high - low)
    aside = np.maximum(np.abs(low - margin - lens[:, 2:]), np.abs(high + margin - lens[:, 2:])) / focal
    deep = used["seed_m"].astype(np.float64) + (FARTHER - SEED) * step_m(used)
    if (deep * (1 + aside.max(1, initial=0)) > MAX_FAR_M).any():
        raise ValueError(f"a patch reaches beyond {MAX_FAR_M:g} m")


def sample_pixels(boxes_xyxy: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The columns and rows (n, PATCH_SIDE) of the samples of boxes (n, 4); the outermost within are at its edge."""
    spans = []
    for low, high in ((boxes_xyxy[:, :1], boxes_xyxy[:, 2:3]), (boxes_xyxy[:, 1:2], boxes_xyxy[:, 3:])):
        size = (high - low).astype(np.float64)
        spans.append(np.rint(np.where(WITHIN, low + OFFSETS * (size - 1), low + OFFSETS * size - 0.5)).astype(np.intp))
    return spans[0], spans[1]


def step_m(patches: npt.NDArray[Any]) -> Array:
    """Metres (n,) between two neighbouring codes of the depth of patches."""
    return np.asarray(np.maximum(patches["size_m"] / 100, MIN_STEP_M))
