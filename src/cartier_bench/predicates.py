"""What is true of the boxes of true objects and of a true floor: the bench's own measures, of nothing that it measures.

A relation holds or does not; whatever is near its limit neither surely holds nor surely does not. Metres throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from cartier.geometry import box_distance
from cartier.types import FREE, OCCUPIED, MapObject, OccupancyGrid

NEXT_M, LEVEL_M = 0.5, 0.3  # beside: so near, and so little of a height between one's top and the other's bottom
BESIDE_LINE_M = 0.3  # between: so far from the straight line, or a quarter of its length
SURE_M = 0.115  # between: so far within its limits it surely is, so far outside of them it surely is not
CLOSEST_M, MARGIN_M = 1.5, 0.3  # "the X closest to the Y": at most so far, any other X so much farther


def apart(one: MapObject, other: MapObject, axes: int = 3) -> float:
    """Between two boxes, in space or (``axes`` 2) on the floor plan."""
    low, high = (np.array([getattr(obj, corner)[:axes] for obj in (one, other)]) for corner in ("box_min", "box_max"))
    return float(np.linalg.norm(np.maximum(low.max(0) - high.min(0), 0)))


def gap(one: MapObject, other: MapObject) -> float:
    """Between two boxes on the floor plan."""
    return apart(one, other, 2)


def away(xy: Sequence[float], obj: MapObject) -> float:
    """From a point to an object's box on the floor plan."""
    return float(box_distance(np.array(xy), np.array(obj.box_min[:2]), np.array(obj.box_max[:2])))


def sizes(objs: Sequence[MapObject]) -> tuple[Any, Any, Any]:
    """Volumes (m³), longest sides and heights (m) of boxes."""
    sides = np.array([np.subtract(obj.box_max, obj.box_min) for obj in objs])
    return sides.prod(1), sides.max(1), sides[:, 2]


def closest(landmark: MapObject, objs: Sequence[MapObject]) -> int | None:
    """The id of the one of two or more that is clearly the closest to a landmark, and close to it; else None."""
    far = sorted((apart(landmark, obj), obj.id) for obj in objs)
    clear = len(far) > 1 and far[0][0] <= CLOSEST_M and far[1][0] >= far[0][0] + MARGIN_M
    return far[0][1] if clear else None


def is_beside(one: MapObject, other: MapObject) -> bool:
    """Whether true boxes are near each other in one room, neither of them mostly over or under the other."""
    low, high = (np.array([getattr(obj, corner) for obj in (one, other)]) for corner in ("box_min", "box_max"))
    shared = np.maximum(high.min(0) - low.max(0), 0)[:2].prod() / (high - low)[:, :2].prod(1).min()
    level = low[:, 2].max() - high[:, 2].min() < LEVEL_M
    return one.id != other.id and one.room == other.room and bool(apart(one, other) < NEXT_M and level and shared < 0.5)


def only_between(one: MapObject, other: MapObject, objs: Sequence[MapObject]) -> int | None:
    """The id of the object that is surely between two others on the floor plan, if no further one may be; else None."""
    start, end = (np.add(obj.box_min, obj.box_max)[:2] / 2 for obj in (one, other))
    length = math.dist(start, end)
    slack_m = dict[int, float]()
    for obj in objs:
        if obj.id not in (one.id, other.id):
            from_start = np.add(obj.box_min, obj.box_max)[:2] / 2 - start
            along = float(from_start @ (end - start)) / length
            across = math.sqrt(max(float(from_start @ from_start) - along**2, 0.0))
            slack_m[obj.id] = min(along, length - along, max(BESIDE_LINE_M, length / 4) - across)
    possible = [number for number, slack in slack_m.items() if slack > -SURE_M]
    return possible[0] if len(possible) == 1 and slack_m[possible[0]] > SURE_M else None


def fits(grid: OccupancyGrid, radius_m: float) -> npt.NDArray[np.bool_]:
    """The cells (rows, cols) where a robot's centre can be: known free, and no part of an occupied cell nearer."""
    far_cells = ndimage.distance_transform_edt(grid.cells != OCCUPIED)
    return np.asarray((grid.cells == FREE) & (far_cells >= radius_m / grid.resolution_m + math.sqrt(0.5)))
