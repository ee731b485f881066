"""ObjectDepth: the depth points in the largest (perspective-corrected) box of each name."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.geometry import ray_slopes, transform
from cartier.indexes._largest_view import LargestView
from cartier.types import Detections, Frame, Place

MIN_POINTS = 12  # fewer depth readings in a box are as good as none
FEW = 800  # points enough for a mean to a few millimetres


def make(min_views: int = 1, surface: bool = True) -> ObjectDepth:
    """``min_views`` frames must agree; ``surface=False`` takes the mean over all depth in the box, as the paper does."""
    return ObjectDepth(min_views, surface)


class ObjectDepth(LargestView):
    """Position = mean of the world points behind the winning box's pixels (its mask's, where there is one).

    A box also holds what stands behind the object. Unless ``surface`` is off, only the object's own surface counts: points
    whose depth lies within half the object's own width or height of the near third of the box's middle.
    """

    def __init__(self, min_views: int, surface: bool) -> None:
        super().__init__(min_views)
        self.surface = surface

    def place(self, frame: Frame, detections: Detections, which: int) -> Place | None:
        if frame.depth_m is None:
            return None
        box = detections.boxes_xyxy[which]
        mask = None if detections.masks is None else detections.masks[which]
        points = _box_points(frame, box, mask)
        if points is not None and self.surface and mask is None:
            points = _own_surface(points, frame, box)
        if points is None or len(points) < MIN_POINTS:
            return None
        world = transform(frame.world_from_camera, points.astype(np.float64))
        ordered, few = np.sort(world, axis=0), len(world) // 50
        low, high = ordered[few], ordered[-1 - few]  # the 2 % at either end are flying pixels
        position, score = tuple(world.mean(0).tolist()), float(detections.scores[which])
        return Place(
            detections.labels[which],
            position,
            score,
            frame.index,
            tuple(box.tolist()),
            tuple(low.tolist()),
            tuple(high.tolist()),
        )


def _box_points(
    frame: Frame, box: npt.NDArray[np.float32], mask: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.float32] | None:
    """Camera-frame points (N, 3) of the pixels in a box that have depth, thinned to a few thousand; None if there are none."""
    assert frame.depth_m is not None
    height, width = frame.depth_m.shape
    x1, y1 = max(0, int(np.floor(box[0]))), max(0, int(np.floor(box[1])))
    x2, y2 = min(width, int(np.ceil(box[2]))), min(height, int(np.ceil(box[3])))
    if x2 <= x1 or y2 <= y1:
        return None
    step = int(((x2 - x1) * (y2 - y1) / FEW) ** 0.5) | 1  # odd, so that holes in every other row do not swallow all
    rows, cols = slice(y1, y2, step), slice(x1, x2, step)
    z = frame.depth_m[rows, cols]
    valid = np.isfinite(z) & (z > 0)
    if mask is not None:
        valid &= mask[rows, cols]
    if not valid.any():
        return None
    slope_x, slope_y = ray_slopes(frame.camera)
    z = np.where(valid, z, 0)
    return np.stack([z * slope_x[cols], z * slope_y[rows, None], z], axis=-1)[valid]


def _own_surface(
    points: npt.NDArray[np.float32], frame: Frame, box: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """The points that belong to the object itself and not to what is seen past it."""
    camera, z = frame.camera, points[:, 2]
    u, v = points[:, 0] / z * camera.fx + camera.cx, points[:, 1] / z * camera.fy + camera.cy
    middle = (np.abs(u - (box[0] + box[2]) / 2) <= (box[2] - box[0]) / 4) & (
        np.abs(v - (box[1] + box[3]) / 2) <= (box[3] - box[1]) / 4
    )
    inner = z[middle] if middle.any() else z
    seed = float(np.partition(inner, len(inner) // 3)[len(inner) // 3])
    extent_m = max(float(box[2] - box[0]) / camera.fx, float(box[3] - box[1]) / camera.fy) * seed
    near: npt.NDArray[np.float32] = points[np.abs(z - seed) <= extent_m / 2]
    return near
