"""What the pictures and poses of a recording are like, as notes to whoever reads its map: blur, exposure, size, turn, drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.geometry import backproject, project, transform
from cartier.mapping.gravity import LYING, quarter_turns
from cartier.mapping.sharpness import edge_width_px
from cartier.types import Camera, Floats, Frame

SAMPLES = 64  # frames that are looked at closely, spread evenly over the recording
SHARP_WIDTH = 640  # px at which edges are judged
BLURRED_PX, BLURRED_SHARE = 6.2, 0.5
JUMP_FACTOR, JUMP_SHARE = 1.8, 0.15  # in mean brightness from a frame to the next, and in how many of them
SMALL_PX = 240
SMALL_DEPTH = 40  # px wide
FEWEST_SHARED = 0.15  # of one frame's points, that another must have in view to be asked
FEWEST_PAIRS = 6
THROUGH_M = 0.15  # nearer than what is seen behind it by more than this: seen through
THROUGH_SHARE = 0.2
"""Of what a frame sees, by the worst quarter of the pairs: 0.07 at most in two real kitchens and three homes of the dollhouse with
a sensor's faults, 0.35 in one whose poses drift by a metre and 29 degrees."""


@dataclass(frozen=True, eq=False)
class _Sample:
    """One frame's small depth (h, w) as points (N, 3) in the world, and what it needs to be asked about others'."""

    edge_px: float
    points: Floats
    depth_m: npt.NDArray[np.float32] | None
    camera: Camera
    world_from_camera: npt.NDArray[np.float64]


class Conditions:
    """Looks at frames as they pass by; nothing but some small samples is kept."""

    def __init__(self) -> None:
        self._samples: list[_Sample] = []
        self._every = 1
        self._frames = self._jumps = 0
        self._brightness = 0.0
        self._up = np.zeros(2)  # the world's up in the images: right, down
        self._size = (0, 0)

    def add(self, frame: Frame) -> None:
        """Take in the next frame."""
        brightness = float(frame.rgb[::16, ::16].mean()) + 1.0
        ratio = brightness / self._brightness if self._frames else 1.0
        self._jumps += max(ratio, 1 / ratio) > JUMP_FACTOR
        self._brightness = brightness
        self._up += frame.world_from_camera[2, :2]
        self._size = (frame.camera.width, frame.camera.height)
        if self._frames % self._every == 0:
            self._samples.append(_sample(frame))
            if len(self._samples) > SAMPLES:
                self._samples, self._every = self._samples[::2], 2 * self._every
        self._frames += 1

    def notes(self) -> list[str]:
        """One line for each condition that makes the map worse than it could be."""
        found = []
        widths = np.array([s.edge_px for s in self._samples if np.isfinite(s.edge_px)])
        if len(widths) and (widths > BLURRED_PX).mean() > BLURRED_SHARE:
            found.append(
                f"the pictures are blurred (edges {np.median(widths):.1f} px wide, where a sharp one has 1 to 5): things are "
                "missed; move slower, with more light"
            )
        if self._frames > 1 and self._jumps / (self._frames - 1) > JUMP_SHARE:
            found.append(
                f"the exposure jumps between {self._jumps} of {self._frames} frames and those before them: lock it, or things "
                "are missed"
            )
        if 0 < max(self._size) < SMALL_PX:
            found.append(f"the pictures are small ({self._size[0]}x{self._size[1]} px): small things are missed")
        turns = quarter_turns(self._up)
        if turns and self._frames:
            found.append(
                f"by their poses the pictures {LYING[turns]}: few things are recognised so; turn pictures, depth and poses"
            )
        found += self._drift()
        return found

    def _drift(self) -> list[str]:
        """Whether frames far apart in time see through what each other saw, while neighbours agree."""
        near: list[float] = []
        far: list[float] = []
        for i, one in enumerate(self._samples):
            for j, other in enumerate(self._samples):
                if i == j or other.depth_m is None or not len(one.points):
                    continue
                share = _seen_through(one, other)
                if share is not None:
                    (near if abs(i - j) <= 2 else far if abs(i - j) > len(self._samples) / 4 else []).append(share)
        if min(len(near), len(far)) < FEWEST_PAIRS:
            return []
        agreed, denied = float(np.quantile(near, 0.75)), float(np.quantile(far, 0.75))
        if denied < THROUGH_SHARE or denied < 2 * agreed:
            return []
        return [
            f"the poses drift: of what a frame sees, those long before or after it see through {denied:.0%}, its neighbours "
            f"{agreed:.0%}: one thing stands in the map twice; run the SLAM with loop closure, or map a part"
        ]


def _sample(frame: Frame) -> _Sample:
    grey = frame.rgb[..., 1]
    thin = max(1, grey.shape[1] // SHARP_WIDTH)
    camera, depth_m = frame.camera, None
    points: Floats = np.empty((0, 3))
    if frame.depth_m is not None:
        stride = max(1, camera.width // SMALL_DEPTH)
        depth_m = np.ascontiguousarray(frame.depth_m[::stride, ::stride])
        camera = Camera(
            depth_m.shape[1],
            depth_m.shape[0],
            camera.fx / stride,
            camera.fy / stride,
            camera.cx / stride,
            camera.cy / stride,
        )
        local = backproject(depth_m, camera).reshape(-1, 3)
        points = transform(frame.world_from_camera, local[np.isfinite(local[:, 2])].astype(np.float64))
    return _Sample(edge_width_px(grey[::thin, ::thin]), points, depth_m, camera, frame.world_from_camera)


def _seen_through(one: _Sample, other: _Sample) -> float | None:
    """The share of one frame's points that another sees through; None if it has too few of them in view."""
    assert other.depth_m is not None
    uv, z = project(one.points, other.camera, other.world_from_camera)
    with np.errstate(invalid="ignore"):
        cells = np.rint(np.where((z > 0.1)[:, None], uv, -1.0))
    inside = ((cells >= 0) & (cells < (other.camera.width, other.camera.height))).all(axis=1)
    if inside.sum() < FEWEST_SHARED * len(one.points):
        return None
    column, row = cells[inside].astype(int).T
    seen = other.depth_m[row, column]
    known = np.isfinite(seen)
    if known.sum() < FEWEST_SHARED * len(one.points):
        return None
    return float((z[inside][known] < 0.95 * seen[known] - THROUGH_M).mean())
