"""Keyframe selection: the frames that show a new view, and of those the sharp ones."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from cartier.contracts import Detector, Recording
from cartier.errors import InputError
from cartier.mapping.config import DEFAULT_CONFIG, KeyframesConfig, MappingConfig
from cartier.mapping.detection_cache import detecting
from cartier.mapping.occupancy import OccupancyMapper
from cartier.mapping.prefetch import batch_size
from cartier.types import Array, Frame

NEAR_M = 1.0  # nearer surfaces move more in the image, and less way makes another view
STEP_M, STEP_RAD = 0.06, np.deg2rad(4)  # from which frames are sparse, and each of them is a keyframe
TRIED = 6  # pairs of frames for a forecast
USUAL_WAY = 0.85  # between two keyframes, since the sharpest from half of the way on is taken
HALF = 0.5  # of the way: from there on a frame may stand in for a blurred one


class Pose(NamedTuple):
    """Where a view was taken from, (4, 4), and how far the middle of what it shows is away."""

    world_from_camera: Array
    depth_m: float


class Keyframes:
    """Picks frames as they come. At most one is kept waiting, the sharpest of those that would do.

    A frame is another view once the camera moved by 15 cm (less where all is near) or turned by 10 degrees since the
    last keyframe, so that five sixths of the view still overlap. Frames that lie far apart are all taken. ``every`` is
    a number of frames instead: each ``every``-th is taken, whatever it shows. Raises InputError unless that is 1 or
    more.
    """

    def __init__(self, every: int | None = None, config: KeyframesConfig = DEFAULT_CONFIG.keyframes) -> None:
        if every is not None and every < 1:
            raise InputError(f"every {every}th frame cannot be taken: 1 takes all, 2 every other one")
        self._every, self._count = every, 0
        self._far = config.distance_m, np.deg2rad(config.angle_deg)
        self._last: Pose | None = None
        self._before: Pose | None = None
        self._waiting: tuple[float, Frame, Pose] | None = None

    def push(self, frame: Frame) -> list[Frame]:
        """Add the next frame of the recording; returns the keyframes decided by it, at most two, in order."""
        if self._every is not None:
            self._count += 1
            return [frame] if (self._count - 1) % self._every == 0 else []
        here, before = _pose(frame), self._before
        self._before = here
        if self._last is None or before is None or change(before, here, STEP_M, STEP_RAD) >= 1:
            chosen = [*self.flush(), frame]
            self._last = here
            return chosen
        self._consider(frame, here)
        if change(self._last, here, *self._far) < 1:
            return []
        chosen = self.flush()
        if chosen[0] is not frame:
            self._consider(frame, here)
        return chosen

    @property
    def waiting(self) -> Frame | None:
        """The frame that is kept waiting, if any."""
        return None if self._waiting is None else self._waiting[1]

    def _consider(self, frame: Frame, here: Pose) -> None:
        """Let a frame wait that is far enough from the last keyframe, if it is the sharpest so far."""
        if self._last is not None and change(self._last, here, *self._far) >= HALF:
            sharp = sharpness(frame.rgb)
            if self._waiting is None or sharp > self._waiting[0]:
                self._waiting = sharp, frame, here

    def flush(self) -> list[Frame]:
        """The frame that is still waiting, if any."""
        if self._waiting is None:
            return []
        _, frame, self._last = self._waiting
        self._waiting = None
        return [frame]


def change(one: Pose, two: Pose, far_m: float, far_rad: float) -> float:
    """How far two views differ: 1 is far enough to be another one."""
    a, b = one.world_from_camera, two.world_from_camera
    moved = float(np.linalg.norm(a[:3, 3] - b[:3, 3]))
    turned = float(np.arccos(np.clip((np.sum(a[:3, :3] * b[:3, :3]) - 1) / 2, -1, 1)))
    return max(moved / (far_m * min(one.depth_m, two.depth_m, NEAR_M) / NEAR_M), turned / far_rad)


def sharpness(rgb: Array) -> float:
    """Sharpness of an image (H, W, 3): how much neighbouring pixels differ; comparable within a recording only."""
    green = rgb[::2, ::2, 1].astype(np.float32)
    return (
        float(np.square(np.diff(green, axis=0)).mean() + np.square(np.diff(green, axis=1)).mean())
        if min(green.shape) > 1
        else 0.0
    )


def forecast(
    recording: Recording, detector: Detector, every: int | None = None, config: MappingConfig = DEFAULT_CONFIG
) -> tuple[int, float]:
    """Estimates, from a few frames, how many keyframes a recording has and how many seconds mapping it takes."""
    length, ways, floor = len(recording), [], OccupancyMapper(config.occupancy)
    far = config.keyframes.distance_m, np.deg2rad(config.keyframes.angle_deg)
    begin, sampled = time.perf_counter(), 0
    for first in np.unique(np.linspace(0, max(length - 2, 0), TRIED).astype(int)).tolist():
        pair = [recording[number] for number in range(first, min(first + 2, length))]
        sampled += len(pair)
        for frame in pair:
            if frame.depth_m is not None:
                floor.add(frame)
        one, two = _pose(pair[0]), _pose(pair[-1])
        ways.append(1.0 if change(one, two, STEP_M, STEP_RAD) >= 1 else min(change(one, two, *far) / USUAL_WAY, 1.0))
    a_frame = (time.perf_counter() - begin) / sampled
    batch = [pair[-1]] * batch_size(detector, recording.camera)
    detecting(detector)(batch)  # the first time is the longest
    begin = time.perf_counter()
    detecting(detector)(batch)
    a_look = (time.perf_counter() - begin) / len(batch)
    looks = -(-length // every) if every else max(round(length * float(np.mean(ways))), 1)
    return looks, length * a_frame + looks * a_look


def _pose(frame: Frame) -> Pose:
    depth = np.empty(0) if frame.depth_m is None else frame.depth_m[::8, ::8]
    known = depth[np.isfinite(depth)]
    return Pose(frame.world_from_camera, max(float(np.median(known)), 0.3) if known.size else NEAR_M)
