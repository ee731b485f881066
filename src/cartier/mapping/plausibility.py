"""Physical plausibility of mapped objects: what is far too large, too small or bare floor loses its probability.

A detector's score knows nothing of metres. A telephone of 40 cm is a box, a bed without height is the floor. Each name
that is in ``KINDS`` has a range of sizes, wide enough for what shops sell; each factor beyond it is evidence against
the object. Names that are not in there are left alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cartier.types import FREE, OCCUPIED, Array, Camera, MapObject, OccupancyGrid

LOG_SIZE_SD = 0.15  # how far sides of boxes are off, as a factor e; in the built-in homes 0.13 (docs/results.md)
MAX_PENALTY = 6.0  # log-odds: no measurement is beyond doubt
EDGE_PX = 6.0  # a box so near to the edge of the image may be cut
MIN_FREE, MAX_OCCUPIED = 0.6, 0.2  # shares of the floor below, from and up to which nothing stands there
MIN_CELLS = 8


class Kind(NamedTuple):
    """Longest side of a thing (m), and how high its top lies above the floor at least if it stands on the floor."""

    least_m: float
    most_m: float
    least_top_m: float = 0.0


KINDS = {
    "bed": Kind(0.9, 2.6, 0.2), "couch": Kind(0.8, 3.6, 0.3), "sofa": Kind(0.8, 3.6, 0.3),
    "chair": Kind(0.3, 1.4, 0.25), "dining table": Kind(0.5, 3.6, 0.35), "toilet": Kind(0.3, 1.1, 0.25),
    "refrigerator": Kind(0.45, 2.2, 0.45), "oven": Kind(0.3, 1.3, 0.3), "microwave": Kind(0.25, 0.75),
    "toaster": Kind(0.12, 0.5), "sink": Kind(0.15, 1.3, 0.35), "tv": Kind(0.32, 2.2), "laptop": Kind(0.18, 0.6),
    "keyboard": Kind(0.15, 0.65), "mouse": Kind(0.05, 0.18), "remote": Kind(0.06, 0.3), "cell phone": Kind(0.06, 0.22),
    "book": Kind(0.07, 0.6), "cup": Kind(0.04, 0.25), "wine glass": Kind(0.06, 0.3), "bowl": Kind(0.05, 0.5),
    "bottle": Kind(0.06, 0.5), "vase": Kind(0.05, 0.9), "clock": Kind(0.05, 0.8), "fork": Kind(0.08, 0.35),
    "knife": Kind(0.08, 0.5), "spoon": Kind(0.07, 0.45), "scissors": Kind(0.06, 0.4), "toothbrush": Kind(0.08, 0.3),
    "hair drier": Kind(0.1, 0.4), "teddy bear": Kind(0.08, 1.3), "potted plant": Kind(0.08, 2.5),
    "apple": Kind(0.04, 0.15), "orange": Kind(0.04, 0.15), "banana": Kind(0.07, 0.35), "carrot": Kind(0.04, 0.35),
    "broccoli": Kind(0.04, 0.35), "sandwich": Kind(0.04, 0.35), "hot dog": Kind(0.06, 0.35), "donut": Kind(0.04, 0.2),
    "cake": Kind(0.05, 0.6), "pizza": Kind(0.1, 0.6), "sports ball": Kind(0.03, 0.5), "handbag": Kind(0.1, 0.7),
    "backpack": Kind(0.2, 0.9), "suitcase": Kind(0.25, 1.1), "umbrella": Kind(0.15, 1.5),
    "tennis racket": Kind(0.3, 0.9),
}  # fmt: skip
"""From what is sold and from household norms, by hand; none of it was fitted to a recording."""
FURNITURE = frozenset(name for name, kind in KINDS.items() if kind.least_top_m)


def weighed(
    objects: Sequence[MapObject], grid: OccupancyGrid | None, camera: Camera, confirmed_probability: float
) -> tuple[MapObject, ...]:
    """The objects with their probabilities after a look at sizes and at the floor plan."""
    return tuple(_weighed(obj, grid, camera, confirmed_probability) for obj in objects)


def _weighed(obj: MapObject, grid: OccupancyGrid | None, camera: Camera, confirmed_probability: float) -> MapObject:
    kind = KINDS.get(obj.label)
    if kind is None or not obj.located:
        return obj
    penalty = size_penalty(obj, kind, camera)
    if obj.label in FURNITURE and (
        obj.box_max[2] < kind.least_top_m or (grid is not None and on_free_floor(obj, grid))
    ):
        penalty = MAX_PENALTY
    if not penalty:
        return obj
    odds = obj.probability / max(1 - obj.probability, 1e-9) * math.exp(-penalty)
    likely = odds / (1 + odds)
    return replace(obj, probability=likely, confirmed=obj.confirmed and likely >= confirmed_probability)


def size_penalty(obj: MapObject, kind: Kind, camera: Camera) -> float:
    """Log-odds that an object loses for its longest side: too long, or too short though a view shows it whole."""
    longest = float(np.subtract(obj.box_max, obj.box_min).max())
    if obj.oriented is not None:
        longest = min(longest, float(max(obj.oriented.size)))
    beyond = math.log(max(longest, 0.01) / kind.most_m)
    if beyond <= 0 and any(_whole(view.box_xyxy, camera) for view in obj.views):
        beyond = math.log(kind.least_m / max(longest, 0.01))
    return min((max(beyond, 0.0) / LOG_SIZE_SD) ** 2 / 2, MAX_PENALTY)


def on_free_floor(obj: MapObject, grid: OccupancyGrid) -> bool:
    """Whether the floor plan shows bare floor where a piece of furniture should stand."""
    (row, col), (last_row, last_col) = grid.cell(obj.box_min[:2]), grid.cell(obj.box_max[:2])
    below: Array = grid.cells[max(row, 0) : max(last_row + 1, 0), max(col, 0) : max(last_col + 1, 0)]
    if below.size < MIN_CELLS:
        return False
    return bool((below == FREE).mean() >= MIN_FREE and (below == OCCUPIED).mean() <= MAX_OCCUPIED)


def _whole(box_xyxy: Sequence[float], camera: Camera) -> bool:
    x1, y1, x2, y2 = box_xyxy
    return min(x1, y1, camera.width - x2, camera.height - y2) > EDGE_PX
