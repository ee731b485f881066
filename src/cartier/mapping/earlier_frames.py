"""Earlier frames, few and coarse: evidence against an object that appears, from the frames that did not show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.mapping.config import ExistenceConfig
from cartier.mapping.existence import predict_visibility, viewpoint_bins
from cartier.types import Array, Camera, Frame

MAX_FRAMES = 64  # kept; then every other one goes, and half as many are added from there on
FIRST_STRIDE = 2  # frames from one kept to the next, at first
COARSE_PX = 40  # about so many samples along a frame's width
NAMES = ("earlier_depth", "earlier_pose", "earlier_camera", "earlier_counts")


class EarlierFrames:
    """Depth and poses of at most 64 earlier frames, evenly over the recording.

    An object counts the frames that should show it from its first detection on. Without those before, it would be the
    likelier the later it is first detected, and another order of the frames would give another map.
    """

    def __init__(self) -> None:
        self._frames: list[Frame] = []
        self._stride, self._count = FIRST_STRIDE, 0

    def add(self, frame: Frame) -> None:
        """Keep a frame with depth, if it is its turn; frames of another camera replace all."""
        if frame.depth_m is None:
            return
        if self._count % self._stride == 0:
            small = coarse(frame)
            if self._frames and self._frames[0].camera != small.camera:
                self._frames = []
            if len(self._frames) == MAX_FRAMES:
                self._frames, self._stride = self._frames[::2], 2 * self._stride
            self._frames.append(small)
        self._count += 1

    def count(self, columns: Mapping[str, Array], rows: npt.NDArray[np.intp], config: ExistenceConfig) -> None:
        """Count the frames that should have shown the new objects ``rows`` (k,), in place."""
        if not len(rows):
            return
        points, low, high = (columns[name][rows] for name in ("points", "extent_min", "extent_max"))
        centres, reach_m = (columns["box_min"][rows] + columns["box_max"][rows]) / 2, np.ptp(points, axis=1).max(1)
        for frame in self._in_view(centres, reach_m):
            observable, _, _ = predict_visibility(points, low, high, frame, config)
            seen = np.flatnonzero(observable)
            if len(seen):
                bins = viewpoint_bins(centres[seen], frame.world_from_camera[:3, 3], config)
                columns["observable"][rows[seen], bins] += 1

    def _in_view(self, centres: Array, reach_m: Array) -> list[Frame]:
        """The frames that may show most of an object by its centre (k, 3)."""
        if not self._frames:
            return []
        poses = np.array([frame.world_from_camera for frame in self._frames])
        camera = self._frames[0].camera
        x, y, z = np.moveaxis(np.einsum("fkx,fxy->fky", centres - poses[:, None, :3, 3], poses[:, :3, :3]), 2, 0)
        wide, tall = camera.width / camera.fx / 2, camera.height / camera.fy / 2
        inside = (z > 0) & (np.abs(x) < wide * z + reach_m / 4) & (np.abs(y) < tall * z + reach_m / 4)
        return [self._frames[k] for k in np.flatnonzero(inside.any(1)).tolist()]

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """All of it, as named arrays; none without frames."""
        if not self._frames:
            return {}
        of = self._frames[0].camera
        depth = np.array([frame.depth_m for frame in self._frames], np.float16)
        poses = np.array([frame.world_from_camera for frame in self._frames])
        camera = np.array([of.fx, of.fy, of.cx, of.cy])
        return dict(zip(NAMES, (depth, poses, camera, np.array([self._stride, self._count])), strict=True))

    def restore(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take what ``state`` gave; maps made before hold none. Raises KeyError or ValueError."""
        if NAMES[0] not in arrays:
            return
        depth, poses, lens, counts = (arrays[name] for name in NAMES)
        stride, count = (int(number) for number in counts)
        if not (len(depth) <= MAX_FRAMES and stride >= FIRST_STRIDE and count > 0) or depth.dtype != np.float16:
            raise ValueError("its earlier frames are none")
        self._stride, self._count = stride, count
        try:
            camera = Camera(depth.shape[2], depth.shape[1], *map(float, lens))
            rgb = np.zeros((*depth.shape[1:], 3), np.uint8)
            pairs = zip(depth.astype(np.float32), poses, strict=True)
            self._frames = [Frame(0, 0.0, rgb, depth_m, pose, camera) for depth_m, pose in pairs]
        except InputError as error:
            raise ValueError(f"an earlier frame: {error}") from error


def coarse(frame: Frame) -> Frame:
    """A frame (H, W) by every so manieth pixel of its depth, of half precision, without its colours."""
    assert frame.depth_m is not None
    camera = frame.camera
    step = max(1, round(camera.width / COARSE_PX))
    first = step // 2
    depth_m = frame.depth_m[first::step, first::step].astype(np.float16).astype(np.float32)
    height, width = depth_m.shape
    cx, cy = ((middle - first) / step + 0.5 for middle in (camera.cx, camera.cy))  # to the nearest sample
    small = Camera(width, height, camera.fx / step, camera.fy / step, cx, cy)
    return replace(
        frame, rgb=np.zeros((height, width, 3), np.uint8), depth_m=depth_m, camera=small, instances=None, index=0,
        time_s=0.0,
    )  # fmt: skip
