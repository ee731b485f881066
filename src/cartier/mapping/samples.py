"""Samples of a recording: poses and times of the frames that are read, and small depth and grey images of them.

At most ``MAX_FRAMES`` frames are read, in runs of consecutive ones, so that time and memory have a bound.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.mapping.sharpness import edge_width_px
from cartier.types import Array, Camera, Frame

MAX_FRAMES, RUNS = 1000, 10
FEW, FEW_STEP = 10, 15
SMALL_WIDTH, FINE_WIDTH, EDGE_WIDTH, FINE_FRAMES = 160, 320, 640, 24
POSE_WORDS = re.compile(r"rotation|quaternion|\bpose must be 4x4|the pose holds|last row of a pose")
MIRROR_WORDS = re.compile(r"rotation mirrors")


@dataclass(frozen=True, eq=False)
class Samples:
    """M frames of a recording of ``length`` frames.

    ``index`` (M,) are their numbers, ``poses`` (M, 4, 4) world_from_camera, ``depth_m`` and ``grey`` (M, h, w) float32;
    depth is NaN without a measurement, grey is 0 to 1. ``camera`` is that of the recording, ``small`` that of the
    small images. ``valid_share`` (M,) is the share of pixels with depth, ``spread_m`` (M,) the standard deviation of
    the depth, ``edge_px`` (M,) the width of the sharpest edges in images about ``EDGE_WIDTH`` wide, NaN without edges.
    ``fine`` holds (grey, depth) of some frames, twice as large. ``faults``: which frames could not be read, and why.
    """

    length: int
    index: npt.NDArray[np.int64]
    times_s: npt.NDArray[np.float64]
    poses: npt.NDArray[np.float64]
    camera: Camera
    small: Camera
    depth_m: npt.NDArray[np.float32]
    grey: npt.NDArray[np.float32]
    valid_share: npt.NDArray[np.float64]
    spread_m: npt.NDArray[np.float64]
    edge_px: npt.NDArray[np.float64]
    fine: list[tuple[Array, Array]]
    has_depth: bool
    faults: dict[int, InputError]

    def __len__(self) -> int:
        return len(self.index)


def is_pose_fault(error: InputError) -> bool:
    """Whether a reader or a frame refused a pose, rather than an image or a file."""
    return POSE_WORDS.search(str(error)) is not None


def is_mirror_fault(error: InputError) -> bool:
    """Whether a pose was refused because its determinant is -1."""
    return MIRROR_WORDS.search(str(error)) is not None


def chosen(length: int) -> list[int]:
    """The numbers of the frames to read: all, or runs of consecutive ones spread evenly."""
    if length <= MAX_FRAMES:
        return list(range(length))
    run = MAX_FRAMES // RUNS
    starts = np.linspace(0, length - run, RUNS).astype(int).tolist()
    return [start + i for start in starts for i in range(run)]


def few(length: int) -> list[int]:
    """The numbers of FEW pairs of frames, near to each other in time and spread over the recording."""
    firsts = np.linspace(0, max(length - 2, 0), FEW).round().astype(int)
    step = int(np.clip(length // FEW // 2, 1, FEW_STEP))
    return sorted({int(i) for first in firsts for i in (first, min(first + step, length - 1))} if length else ())


def sample(
    recording: Recording, progress: Callable[[int, int], None] | None = None, numbers: list[int] | None = None
) -> Samples:
    """Read the frames, by default those that ``chosen`` names; of others, blur is not measured.

    One with an invalid pose is listed in ``faults``; any other fault is raised as it is.
    """
    wanted, camera = chosen(len(recording)) if numbers is None else numbers, recording.camera
    faults: dict[int, InputError] = {}
    stride, half, thin = (max(1, camera.width // width) for width in (SMALL_WIDTH, FINE_WIDTH, EDGE_WIDTH))
    small = thinned(camera, stride)
    fine_numbers = {wanted[i] for i in np.linspace(0, len(wanted) - 1, FINE_FRAMES).astype(int)} if wanted else set()
    frames, depths, greys, edges, fine = [], [], [], [], []
    for frame in _frames(recording, wanted, faults, progress):
        grey = frame.rgb[..., 1]  # green carries most of the brightness, and a view costs nothing
        frames.append((frame.index, frame.time_s, frame.world_from_camera, frame.depth_m is not None))
        greys.append(_unit(grey[::stride, ::stride]))
        depths.append(thinned_depth(frame, stride) if frame.depth_m is not None else np.full_like(greys[-1], np.nan))
        edges.append(edge_width_px(grey[::thin, ::thin]) if numbers is None else np.nan)
        if frame.index in fine_numbers and frame.depth_m is not None:
            fine.append((_unit(grey[::half, ::half]), thinned_depth(frame, half)))
    measured = [depth_m[np.isfinite(depth_m)] for depth_m in depths]
    shape = (-1, small.height, small.width)
    return Samples(
        length=len(recording),
        index=np.array([index for index, *_ in frames], np.int64),
        times_s=np.array([time_s for _, time_s, *_ in frames]),
        poses=np.array([pose for _, _, pose, _ in frames]).reshape(-1, 4, 4),
        camera=camera,
        small=small,
        depth_m=np.array(depths, np.float32).reshape(shape),
        grey=np.array(greys, np.float32).reshape(shape),
        valid_share=np.array([values.size / (small.width * small.height) for values in measured]),
        spread_m=np.array([float(values.std()) if values.size else 0.0 for values in measured]),
        edge_px=np.array(edges),
        fine=fine,
        has_depth=any(has_depth for *_, has_depth in frames),
        faults=faults,
    )


def _frames(
    recording: Recording, wanted: list[int], faults: dict[int, InputError], progress: Callable[[int, int], None] | None
) -> Iterator[Frame]:
    for done, i in enumerate(wanted, 1):
        try:
            yield recording[i]
        except InputError as error:
            if not is_pose_fault(error):
                raise
            faults[i] = error
        if progress is not None:
            progress(done, len(wanted))


def _unit(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    return np.asarray(grey.astype(np.float32) / 255, dtype=np.float32)


def thinned(camera: Camera, stride: int) -> Camera:
    """The camera of every ``stride``-th pixel of its images."""
    return Camera(
        -(-camera.width // stride), -(-camera.height // stride), camera.fx / stride, camera.fy / stride,
        camera.cx / stride, camera.cy / stride,
    )  # fmt: skip


def thinned_depth(frame: Frame, stride: int) -> npt.NDArray[np.float32]:
    """A frame's depth (m) at every ``stride``-th pixel, NaN wherever it is not positive and finite."""
    assert frame.depth_m is not None
    depth_m = np.array(frame.depth_m[::stride, ::stride], np.float32)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = np.nan
    return depth_m
