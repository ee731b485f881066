"""Viewpoint planning: a reachable pose from which an object would appear large enough to be asked about."""

from __future__ import annotations

import math

import numpy as np

from cartier.geometry import box_distance, yaw_towards
from cartier.navigation.planning import NEAREST_M, line_of_sight, reach
from cartier.types import Goal, MapObject, OccupancyGrid, Place, RobotModel
from cartier.vision.views import SAME_SIDE_RAD

WANTED_PX = 160.0
"""The shorter side that an object shall have in the next picture."""
MAX_POSES = 200
"""That are tried for a free line of sight, nearest to the robot first."""


def pose_to_see(
    obj: MapObject,
    seen_px: float,
    grid: OccupancyGrid | None,
    from_xy: tuple[float, float],
    robot: RobotModel,
    new_side: bool = False,
) -> Goal | None:
    """The nearest reachable pose that faces an object from where its shorter side has ``WANTED_PX``; None without one.

    The object had ``seen_px`` in its largest view, and sizes fall with distance: the robot's camera is taken to be like
    that of the recording. ``new_side``: a side that no view shows comes first.
    """
    if grid is None or not obj.views or seen_px <= 0 or (area := reach(grid, from_xy, robot.radius_m)) is None:
        return None
    view = max(obj.all_views, key=lambda view: view.size_px2)
    middle = np.array(obj.position)
    near_m = float(np.linalg.norm(np.array(view.camera) - middle)) * seen_px / WANTED_PX
    above_m = robot.camera_height_m - middle[2]
    floor_m = math.sqrt(max(near_m**2 - above_m**2, 0.0))
    cells = np.argwhere(np.isfinite(area.length_m))
    xy = grid.centre(cells)
    away_m = np.linalg.norm(xy - middle[:2], axis=1)
    outside = box_distance(xy, np.array(obj.box_min)[:2], np.array(obj.box_max)[:2]) > 0
    fits = np.flatnonzero((away_m <= floor_m) & (away_m >= NEAREST_M) & outside)
    yaws = np.arctan2(middle[1] - xy[fits, 1], middle[0] - xy[fits, 0])
    known = np.zeros(len(fits), bool)
    for each in obj.all_views if new_side else ():
        known |= np.abs(np.remainder(yaws - each.yaw + math.pi, math.tau) - math.pi) < SAME_SIDE_RAD
    place = Place(obj.label, obj.position, 1.0, view.frame, None, obj.box_min, obj.box_max, object_id=obj.id)
    order = fits[np.lexsort((area.length_m[tuple(cells[fits].T)], known))]
    for k in order[:MAX_POSES]:
        if line_of_sight(grid, xy[k], place, robot.camera_height_m):
            path = area.path(tuple(cells[k]))
            x, y = (float(v) for v in path[-1])
            yaw = yaw_towards(x, y, *middle[:2])
            return Goal(x, y, float(yaw), path, float(area.length_m[tuple(cells[k])]), place, True)
    return None
