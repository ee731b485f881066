"""A toy detector in one file, for red objects: `cartier map … --detector examples/red_things.py`."""

import numpy as np
from scipy.ndimage import find_objects, label

from cartier.contracts import Detector
from cartier.types import Detections, Frame


def make(threshold: float = 0.5, smallest_px: int = 400) -> "RedThings":
    return RedThings(threshold, smallest_px)


class RedThings(Detector):
    def __init__(self, threshold: float, smallest_px: int) -> None:
        self.threshold, self.smallest_px = threshold, smallest_px
        self.name = f"red things (red share ≥ {threshold})"

    def detect(self, frame: Frame) -> Detections:
        colours = frame.rgb.astype(np.float32)
        redness = colours[..., 0] / np.maximum(colours.sum(-1), 1)
        regions, _ = label(redness >= self.threshold)
        boxes, scores = [], []
        for number, (rows, cols) in enumerate(find_objects(regions), start=1):
            inside = regions[rows, cols] == number
            if inside.sum() >= self.smallest_px:
                boxes.append((cols.start, rows.start, cols.stop, rows.stop))
                scores.append(float(redness[rows, cols][inside].mean()))
        return Detections(frame.index, np.array(boxes).reshape(-1, 4), np.array(scores), ("red thing",) * len(boxes))
