"""Simulated drive to a planned goal in the true home: collisions stop it, and a picture shows the view at the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import invert, transform
from cartier.types import Camera, Frame, Goal, Place
from cartier_dollhouse.explore import RADIUS_M, advance, standing_plan
from cartier_dollhouse.model import Scene
from cartier_dollhouse.recording import EYE_M, lit_renderer, look, pinhole

STEP_M = 0.05
LOWEST, HIGHEST = math.radians(60), math.radians(-30)  # how far the camera can be pitched, down and up
OWN_M = 0.3  # the front of an object of unknown size may be so far before its place

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Drive:
    """What came of a goal: the robot's ``poses`` (N, 3) of x, y (m) and yaw (rad), and the ``view`` (H, W, 3) uint8 at
    the end.

    ``collided_at`` is the (x, y) at which something stopped it, or None. ``in_view`` tells whether the place lies in
    the view with nothing before it.
    """

    arrived: bool
    collided_at: tuple[float, float] | None
    poses: Floats
    length_m: float
    view: npt.NDArray[np.uint8]
    in_view: bool


def drive(
    scene: Scene,
    start_xy: Sequence[float],
    goal: Goal,
    radius_m: float = RADIUS_M,
    camera: Camera | None = None,
    eye_m: float = EYE_M,
) -> Drive:
    """Follow ``goal.path`` from a start, turn to ``goal.yaw``, pitch the camera towards the place, and look.

    Raises InputError if the robot does not fit at the start, or if the goal is inside of furniture, a wall, or outside.
    """
    plan = standing_plan(scene, (float(start_xy[0]), float(start_xy[1])), radius_m)
    if plan.clearance((goal.x, goal.y)) == 0:
        raise InputError(
            f"the goal ({goal.x:.2f}, {goal.y:.2f}) for the {goal.place.label} lies in a wall, in furniture or outside "
            f"of {scene.name}: no robot can stand there"
        )
    xy = np.array(start_xy, dtype=np.float64)
    poses, collided_at = [(*xy.tolist(), goal.yaw)], None
    for target in [*np.asarray(goal.path, dtype=np.float64), np.array([goal.x, goal.y])]:
        begin, yaw = xy, math.atan2(target[1] - xy[1], target[0] - xy[0])
        steps = math.ceil(float(np.linalg.norm(target - begin)) / STEP_M - 1e-9)
        for k in range(1, steps + 1):
            xy, free = advance(plan, xy, begin + (target - begin) * (k / steps))
            poses.append((*xy.tolist(), yaw))
            if not free:
                collided_at = (float(xy[0]), float(xy[1]))
                break
        if collided_at:
            break
    poses.append((*xy.tolist(), goal.yaw))
    poses[0] = (*poses[0][:2], poses[1][2])
    track = np.array(poses)
    view, in_view = _look_at(scene, xy, goal, camera or pinhole(), eye_m)
    length_m = float(np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1).sum())
    return Drive(collided_at is None, collided_at, track, length_m, view, in_view)


def frame_at(
    scene: Scene,
    goal: Goal,
    xy: Sequence[float] | Floats | None = None,
    camera: Camera | None = None,
    eye_m: float = EYE_M,
) -> Frame:
    """What a robot's camera shows at a goal, or at ``xy`` (m): along the goal's yaw, pitched towards its place."""
    place, camera = goal.place, camera or pinhole()
    x, y = (goal.x, goal.y) if xy is None else (float(xy[0]), float(xy[1]))
    away_m = math.hypot(place.position[0] - x, place.position[1] - y)
    down = math.atan2(eye_m - place.position[2], max(away_m, 0.1))
    pose = look((x, y), goal.yaw, min(max(down, HIGHEST), LOWEST), eye_m)
    view = lit_renderer(scene, camera).render(pose)
    return Frame(0, 0.0, view.rgb, view.depth_m, pose, camera)


def _look_at(scene: Scene, xy: Floats, goal: Goal, camera: Camera, eye_m: float) -> tuple[npt.NDArray[np.uint8], bool]:
    """The view from a point along the goal's yaw, pitched towards its place, and whether the place shows in it."""
    frame = frame_at(scene, goal, xy, camera, eye_m)
    assert frame.depth_m is not None
    return frame.rgb, _shows(goal.place, camera, frame.world_from_camera, frame.depth_m)


def _shows(place: Place, camera: Camera, pose: Floats, depth_m: npt.NDArray[np.float32]) -> bool:
    """Whether a place's position projects into an image, and what is seen there is no nearer than the object."""
    x, y, z = transform(invert(pose), np.array(place.position)).tolist()
    if z <= 0:
        return False
    column, row = round(camera.fx * x / z + camera.cx), round(camera.fy * y / z + camera.cy)
    if not (0 <= column < camera.width and 0 <= row < camera.height):
        return False
    own_m = OWN_M
    if place.box_min is not None and place.box_max is not None:
        own_m = max(own_m, math.dist(place.box_min, place.box_max) / 2)
    return not depth_m[row, column] < z - own_m  # no reading: nothing is in the way
