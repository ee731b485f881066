"""Noise model of an RGB-D camera or a phone: coarse depth, holes, flying pixels, image noise, drifting poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from cartier.errors import InputError, check_pose
from cartier_dollhouse.render import View

Floats = npt.NDArray[np.float32]
Index = tuple[npt.NDArray[np.intp], ...]
_FRAMES, _DRIFT = 0, 1  # streams of random numbers that never touch


@dataclass(frozen=True)
class Sensor:
    """A fault model with the size of each fault; 0 or False switches one off. The same seed and frame give the same
    bytes.

    ``depth_width`` is how many pixels wide depth is measured, where that is less than the picture's width; 0 is as wide
    as the picture. ``depth_noise`` is the deviation of depth as a share of it, in smooth patches.
    ``depth_quantum`` is the depth step in metres at 1 m; it grows with depth squared, as disparities do (a first
    Kinect: 0.003). ``range_m`` is where depth ends. ``flying`` is the share of pixels at depth edges that hang between
    front and back. ``image_noise`` is the deviation of the colours (of 255) and ``exposure`` that of the frame's
    brightness. ``drift_m`` and ``drift_rad`` are how far poses wander, as a deviation after a hundred frames.
    """

    seed: int = 0
    depth_width: int = 0
    depth_noise: float = 0.0
    depth_quantum: float = 0.003
    range_m: tuple[float, float] = (0.35, 6.0)
    holes: bool = True
    flying: float = 0.3
    image_noise: float = 2.5
    exposure: float = 0.03
    drift_m: float = 0.05
    drift_rad: float = 0.02

    def __post_init__(self) -> None:
        sizes = [self.depth_width, self.depth_noise, self.depth_quantum, self.flying, self.image_noise, self.exposure]
        sizes += [self.drift_m, self.drift_rad]
        if not (0 <= self.range_m[0] < self.range_m[1] and all(0 <= size < 1e3 for size in sizes) and self.flying <= 1):
            raise InputError(
                f"sensor: sizes must be finite and not negative, flying at most 1, a range (near, far); got {self}"
            )
        if self.seed < 0:
            raise InputError(f"sensor: the seed must not be negative, got {self.seed}")

    def corrupt(self, view: View, frame_index: int) -> View:
        """The view with this sensor's faults; its instances stay true."""
        rng = np.random.default_rng((self.seed, _FRAMES, frame_index))
        width = min(self.depth_width or view.depth_m.shape[1], view.depth_m.shape[1])
        coarse, cell = _cells(view.depth_m.shape, width)
        true, hard = view.depth_m[coarse], view.hard[coarse]
        depth, edge = true.copy(), _edges(true)
        if self.flying:
            depth = self._fly(depth, edge, rng)
        if self.depth_noise:
            depth *= 1 + np.float32(self.depth_noise) * _patches(depth.shape, rng)
        if self.depth_quantum:
            depth = self._quantise(depth, rng)
        if self.holes:
            depth[_grazing(true) & ~edge & (rng.random(depth.shape) < 0.8)] = np.nan
            depth[hard & (_patches(depth.shape, rng) > -0.8)] = np.nan
        with np.errstate(invalid="ignore"):
            depth[(depth < self.range_m[0]) | (depth > self.range_m[1])] = np.nan
        return replace(view, rgb=self._film(view.rgb, rng), depth_m=depth[cell])

    def drift(
        self, poses: Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating]
    ) -> list[npt.NDArray[np.float64]]:
        """Poses (4, 4) as an odometry would report them: the first is true, then error builds up as a smooth random
        walk."""
        rng = np.random.default_rng((self.seed, _DRIFT))
        # a walk of n equal steps that forget over about five frames deviates by step * 5 * sqrt(n)
        steps = np.zeros((len(poses), 4))
        for number in range(1, len(poses)):
            steps[number] = 0.8 * steps[number - 1] + rng.standard_normal(4) * (1, 1, 0.3, 1)
        walk = np.cumsum(steps, 0) / 50
        return [
            _moved(check_pose(pose, f"pose {number}"), offset[:3] * self.drift_m, float(offset[3]) * self.drift_rad)
            for number, (pose, offset) in enumerate(zip(poses, walk, strict=True))
        ]

    def _fly(self, depth: Floats, edge: npt.NDArray[np.bool_], rng: np.random.Generator) -> Floats:
        """Some pixels at an edge take a depth between their own and a neighbour's."""
        row, col = np.nonzero(edge & (rng.random(depth.shape) < self.flying))
        step = rng.integers(-1, 2, (2, len(row)))
        height, width = depth.shape
        other = depth[np.clip(row + step[0], 0, height - 1), np.clip(col + step[1], 0, width - 1)]
        share = rng.random(len(row)).astype(np.float32)
        depth[row, col] += share * (other - depth[row, col])
        return depth

    def _quantise(self, depth: Floats, rng: np.random.Generator) -> Floats:
        """Depth is read in equal steps of 1/z, with half a step of noise before."""
        disparity = 1 / (depth * np.float32(self.depth_quantum))
        disparity += 0.35 * rng.standard_normal(depth.shape, dtype=np.float32)
        return np.asarray(1 / (np.maximum(np.round(disparity), 1) * np.float32(self.depth_quantum)), dtype=np.float32)

    def _film(self, rgb: npt.NDArray[np.uint8], rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        if not (self.image_noise or self.exposure):
            return rgb
        bright = np.float32(np.exp(self.exposure * rng.standard_normal()))
        noise = np.float32(self.image_noise) * rng.standard_normal(rgb.shape, dtype=np.float32)
        return np.asarray(np.clip(rgb * bright + noise + 0.5, 0, 255), dtype=np.uint8)


SENSORS = {
    "depth-camera": Sensor(),
    "phone": Sensor(
        depth_width=256, depth_noise=0.01, depth_quantum=0.0, range_m=(0.2, 5.0), image_noise=1.5, drift_m=0.03,
        drift_rad=0.01,
    ),
}  # fmt: skip
"""By the name that ``cartier record --sensor`` takes; a phone's is that of a LiDAR phone: 256 pixels wide, to 5 m."""


def sensor_of(kind: str, seed: int) -> Sensor | None:
    """The sensor of a name in SENSORS, None for "exact". Raises InputError for another name."""
    if kind == "exact":
        return None
    if kind not in SENSORS:
        raise InputError(f"there is no sensor {kind!r}: exact, {', '.join(SENSORS)}")
    return replace(SENSORS[kind], seed=seed)


def _cells(shape: tuple[int, ...], width: int) -> tuple[Index, Index]:
    """Which pixels a depth image of a smaller width measures, and which of its own each pixel of the picture shows."""
    height = max(1, round(shape[0] * width / shape[1]))
    sizes = tuple(zip(shape, (height, width), strict=True))
    measured = [((np.arange(few) + 0.5) * many / few).astype(np.intp) for many, few in sizes]
    shown = [(np.arange(many) * few // many).astype(np.intp) for many, few in sizes]
    return np.ix_(*measured), np.ix_(*shown)


def _edges(depth: Floats) -> npt.NDArray[np.bool_]:
    """Both sides of a jump in depth. 1/z is linear on a plane, however slanting, so that only jumps bend it."""
    edge = np.zeros(depth.shape, np.bool_)
    inverse = 1 / depth
    for axis in (0, 1):
        line, marked = np.moveaxis(inverse, axis, 0), np.moveaxis(edge, axis, 0)
        bend = np.abs(line[:-2] - 2 * line[1:-1] + line[2:])
        marked[1:-1] |= bend > 0.05 * line[1:-1]
    return edge


def _grazing(depth: Floats) -> npt.NDArray[np.bool_]:
    """Surfaces seen so slantingly that depth changes by more than 1.5 % from pixel to pixel at VGA width."""
    steps = [np.abs(np.gradient(depth, axis=axis)) for axis in (0, 1)]
    return np.asarray(np.maximum(*steps) > 0.015 * depth * 640 / depth.shape[1], dtype=np.bool_)


def _patches(shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Smooth noise of deviation 1: whatever still reads in a hole comes in patches."""
    smooth = gaussian_filter(rng.standard_normal(shape, dtype=np.float32), 6)
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def _moved(pose: npt.NDArray[np.float64], offset: npt.NDArray[np.float64], turn: float) -> npt.NDArray[np.float64]:
    """A pose shifted in the world and turned about the vertical through the camera."""
    c, s = np.cos(turn), np.sin(turn)
    result = pose.copy()
    result[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose[:3, :3]
    result[:3, 3] += offset
    return result
