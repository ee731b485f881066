"""Image sharpness: the width of the strong edges."""

from __future__ import annotations

import numpy as np

from cartier.types import Array

REACH_PX = 8
LEAST_STEP = 40  # grey levels that an edge must rise to be judged
ROW_STEP = 12


def edge_width_px(grey: Array) -> float:
    """Median width (px) of the strong edges of a uint8 image (H, W): the step's height over its steepest slope.

    The larger of that along the rows and along the columns, because a moving camera blurs in one direction. A step
    blurred by a Gaussian of s px is 2.5 s wide. NaN where there are fewer than 20 strong edges.
    """
    both = [_widths(grey[::ROW_STEP]), _widths(grey[:, ::ROW_STEP].T)]
    medians = [float(np.median(widths)) for widths in both if len(widths) >= 20]
    return max(medians, default=float("nan"))


def _widths(lines: Array) -> Array:
    """Widths of the strong edges along the last axis, at most a few per line."""
    values = lines.astype(np.float32)
    slope = np.abs(np.diff(values, axis=1))
    if slope.shape[1] <= 2 * REACH_PX:
        return np.empty(0, np.float32)
    windows = np.lib.stride_tricks.sliding_window_view(slope, 2 * REACH_PX + 1, axis=1)
    centre = slope[:, REACH_PX:-REACH_PX]
    peak = np.argwhere(centre > 2)
    if len(peak) == 0:
        return np.empty(0, np.float32)
    near = windows[peak[:, 0], peak[:, 1]]
    top = near.max(axis=1) <= near[:, REACH_PX]
    peak = peak[top]
    row, col = peak[:, 0], peak[:, 1]
    around = np.lib.stride_tricks.sliding_window_view(values, 2 * REACH_PX + 2, axis=1)[row, col]
    step = around.max(axis=1) - around.min(axis=1)
    strong = step >= LEAST_STEP
    return np.asarray(step[strong] / centre[row, col][strong], dtype=np.float32)
