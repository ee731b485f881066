"""An image side for text-only encoders: each detection's surface gets the feature of its label."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from cartier.types import Array, Detections, Frame

BACKGROUND = (
    "wall and floor"  # what nothing covers; were it zero, a trace of the thing beside it would pass for the thing
)
STRIDE = 4  # pixels per feature: a mug at 3 m is still 15 features wide in a 640 px image


def label_features(
    frame: Frame, detections: Detections, text: Callable[[Sequence[str]], Array]
) -> npt.NDArray[np.float32]:
    """(h, w, D) features of a frame with depth: the vector of the label in each mask, or in a box where there is no mask.

    In a box only the thing's own surface gets it: depths within half its own width or height of the near third of the
    box's middle, as in object_depth. Smaller things lie over larger ones, and the rest is "wall and floor".
    """
    assert frame.depth_m is not None
    height, width = frame.depth_m.shape
    h, w = max(1, height // STRIDE), max(1, width // STRIDE)
    rows = ((np.arange(h) + 0.5) * height / h).astype(np.intp)
    cols = ((np.arange(w) + 0.5) * width / w).astype(np.intp)
    depth_m = frame.depth_m[np.ix_(rows, cols)]
    names = sorted(set(detections.labels))
    which = np.zeros((h, w), np.intp)  # 0 = background
    x1, y1, x2, y2 = detections.boxes_xyxy.T
    for i in np.argsort(-(x2 - x1) * (y2 - y1), kind="stable"):
        if detections.masks is not None:
            inside = detections.masks[i][np.ix_(rows, cols)]
        else:
            inside = _surface(frame, depth_m, rows, cols, detections.boxes_xyxy[i])
        which[inside] = 1 + names.index(detections.labels[i])
    features: npt.NDArray[np.float32] = text([BACKGROUND, *names])[which]
    return features


def _surface(
    frame: Frame, depth_m: Array, rows: npt.NDArray[np.intp], cols: npt.NDArray[np.intp], box: npt.NDArray[np.float32]
) -> npt.NDArray[np.bool_]:
    (x1, y1, x2, y2), camera = box, frame.camera
    inside = np.outer((rows >= y1) & (rows < y2), (cols >= x1) & (cols < x2)) & (depth_m > 0)
    middle = inside & np.outer(
        np.abs(rows - (y1 + y2) / 2) <= (y2 - y1) / 4, np.abs(cols - (x1 + x2) / 2) <= (x2 - x1) / 4
    )
    depths = depth_m[middle] if middle.any() else depth_m[inside]
    if not len(depths):
        return inside
    seed = float(np.partition(depths, len(depths) // 3)[len(depths) // 3])
    extent_m = max(float(x2 - x1) / camera.fx, float(y2 - y1) / camera.fy) * seed
    own: npt.NDArray[np.bool_] = inside & (np.abs(depth_m - seed) <= extent_m / 2)
    return own
