"""Quality checks of a recording's images and poses: blur, exposure, size, orientation and drift, as notes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.mapping.gravity import LYING, oriented, quarter_turns
from cartier.mapping.poses.drift import find_drift
from cartier.mapping.samples import thinned
from cartier.mapping.sharpness import edge_width_px
from cartier.types import Frame

SAMPLES = 64  # frames that are examined, spread evenly over the recording
SHARP_WIDTH = 640  # px at which edges are judged
BLURRED_PX, BLURRED_SHARE = 6.2, 0.5
JUMP_FACTOR, JUMP_SHARE = 1.8, 0.15  # in mean brightness from a frame to the next, and in how many of them
SMALL_PX = 240
SMALL_DEPTH = 40  # px wide
PARTS = 3  # of a recording, compared for drift


@dataclass(frozen=True, eq=False)
class _Sample:
    """How wide one frame's edges are, and its small depth as points and unit normals (N, 6) in the world."""

    edge_px: float
    surfaces: npt.NDArray[np.float32]


class Conditions:
    """Examines frames as they pass; keeps only some small samples."""

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

    def notes(self, drift: bool = True) -> list[str]:
        """One line for each condition that makes the map worse than it could be, by choice also drifting poses."""
        found = []
        widths = np.array([s.edge_px for s in self._samples if np.isfinite(s.edge_px)])
        if len(widths) and (widths > BLURRED_PX).mean() > BLURRED_SHARE:
            found.append(
                f"the pictures are blurred (edges {np.median(widths):.1f} px wide, where a sharp one has 1 to 5): "
                "objects are missed; move slower, with more light"
            )
        if self._frames > 1 and self._jumps / (self._frames - 1) > JUMP_SHARE:
            found.append(
                f"the exposure jumps between {self._jumps} of {self._frames} frames and those before them: lock it, or "
                "objects are missed"
            )
        if 0 < max(self._size) < SMALL_PX:
            found.append(f"the pictures are small ({self._size[0]}x{self._size[1]} px): small objects are missed")
        turns = quarter_turns(self._up)
        if turns and self._frames:
            found.append(
                f"by their poses the pictures {LYING[turns]}: few objects are recognised so; "
                "'cartier doctor RECORDING --fix -o OUT' turns them"
            )
        return found + (self._drift() if drift else [])

    def _drift(self) -> list[str]:
        """Whether a late part of the recording is misaligned with an early one."""
        seen = [s.surfaces for s in self._samples if len(s.surfaces)]
        if len(seen) < 2 * PARTS:
            return []
        edges = [len(seen) * part // PARTS for part in range(PARTS + 1)]
        found = find_drift([np.concatenate(seen[a:b]).astype(np.float64) for a, b in itertools.pairwise(edges)])
        if found is None:
            return []
        return [
            "the poses drift: a later part of the recording fits an earlier one only if it is moved by "
            f"{found.shift_m:.2f} m and turned by {found.turn_deg:.0f}° (then {found.after:.0%} of its surfaces lie "
            f"on the other's, {found.before:.0%} as given): objects appear twice in the map; run the SLAM with loop "
            "closure, or map a part"
        ]


def _sample(frame: Frame) -> _Sample:
    grey = frame.rgb[..., 1]
    thin = max(1, grey.shape[1] // SHARP_WIDTH)
    surfaces = np.empty((0, 6), np.float32)
    if frame.depth_m is not None:
        stride = max(1, frame.camera.width // SMALL_DEPTH)
        camera, depth_m = thinned(frame.camera, stride), frame.depth_m[::stride, ::stride]
        surfaces = np.hstack(oriented(frame.world_from_camera, camera, depth_m)).astype(np.float32)
    return _Sample(edge_width_px(grey[::thin, ::thin]), surfaces)
