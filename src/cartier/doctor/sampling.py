"""What the doctor keeps of a recording: poses and times of every frame it reads, small depth and grey images, counts.

At most ``MOST`` frames are read, in runs of consecutive ones spread over the recording, so that time and memory have a bound.
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

MOST, RUNS = 1000, 10
SMALL_WIDTH, FINE_WIDTH, EDGE_WIDTH, FINE_FRAMES = 160, 320, 640, 24
POSE_WORDS = re.compile(r"rotation|quaternion|\bpose must be 4x4|the pose holds|last row of a pose")
MIRROR_WORDS = re.compile(r"rotation mirrors")


@dataclass(frozen=True, eq=False)
class Samples:
    """M frames of a recording of ``length``. ``depth_m`` (M, h, w) float32 with NaN, ``grey`` (M, h, w) float32 in 0 to 1.

    ``camera`` is the recording's, ``small`` that of the small images. ``read`` (M,) tells depth pixels with a reading, as a
    share; ``spread_m`` (M,) the standard deviation of the depth; ``edge_px`` (M,) the width of the image's sharpest edges, in
    pixels (of every 2nd, 3rd … where the image is 1280, 1920 … wide), NaN where there are none. ``fine`` holds (grey, depth) of some frames, twice as large.
    ``faults`` maps a frame's number to why it could not be read.
    """

    length: int
    index: npt.NDArray[np.int64]
    times_s: npt.NDArray[np.float64]
    poses: npt.NDArray[np.float64]
    camera: Camera
    small: Camera
    depth_m: npt.NDArray[np.float32]
    grey: npt.NDArray[np.float32]
    read: npt.NDArray[np.float64]
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
    if length <= MOST:
        return list(range(length))
    run = MOST // RUNS
    starts = np.linspace(0, length - run, RUNS).astype(int).tolist()
    return [start + i for start in starts for i in range(run)]


def sample(recording: Recording, progress: Callable[[int, int], None] | None = None) -> Samples:
    """Read the frames; one that cannot be read because of its pose is noted, any other fault is raised as it is."""
    wanted = chosen(len(recording))
    faults: dict[int, InputError] = {}
    stride = max(1, recording.camera.width // SMALL_WIDTH)
    fine_ones = {wanted[i] for i in np.linspace(0, len(wanted) - 1, FINE_FRAMES).astype(int)} if wanted else set()
    kept, fine = [], []
    for frame in _frames(recording, wanted, faults, progress):
        kept.append(_keep(frame, stride))
        if frame.index in fine_ones and frame.depth_m is not None:
            half = max(1, recording.camera.width // FINE_WIDTH)
            fine.append(
                (_grey(frame)[::half, ::half].astype(np.float32) / 255, _readings(frame.depth_m[::half, ::half]))
            )
    camera = recording.camera
    small = Camera(
        -(-camera.width // stride), -(-camera.height // stride), camera.fx / stride, camera.fy / stride,
        camera.cx / stride, camera.cy / stride,
    )  # fmt: skip
    shape = (small.height, small.width)
    return Samples(
        len(recording),
        np.array([k.index for k in kept], np.int64),
        np.array([k.time_s for k in kept]),
        np.array([k.pose for k in kept]).reshape(-1, 4, 4),
        camera,
        small,
        np.array([k.depth_m for k in kept], np.float32).reshape(-1, *shape),
        np.array([k.grey for k in kept], np.float32).reshape(-1, *shape),
        np.array([k.read for k in kept]),
        np.array([k.spread_m for k in kept]),
        np.array([k.edge_px for k in kept]),
        fine,
        any(k.has_depth for k in kept),
        faults,
    )


def _frames(
    recording: Recording,
    wanted: list[int],
    faults: dict[int, InputError],
    progress: Callable[[int, int], None] | None,
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


@dataclass(frozen=True, eq=False)
class _Kept:
    index: int
    time_s: float
    pose: Array
    depth_m: Array
    grey: Array
    read: float
    spread_m: float
    edge_px: float
    has_depth: bool


def _keep(frame: Frame, stride: int) -> _Kept:
    grey = _grey(frame)
    thin = max(1, frame.camera.width // EDGE_WIDTH)
    small = grey[::stride, ::stride].astype(np.float32) / 255
    if frame.depth_m is None:
        depth_m = np.full(small.shape, np.nan, np.float32)
    else:
        depth_m = _readings(frame.depth_m[::stride, ::stride])
    readings = depth_m[np.isfinite(depth_m)]
    return _Kept(
        frame.index,
        frame.time_s,
        frame.world_from_camera,
        depth_m,
        small,
        readings.size / depth_m.size,
        float(readings.std()) if readings.size else 0.0,
        edge_width_px(grey[::thin, ::thin]),
        frame.depth_m is not None,
    )


def _grey(frame: Frame) -> npt.NDArray[np.uint8]:
    return frame.rgb[..., 1]  # green carries most of the brightness, and a view costs nothing


def _readings(depth_m: Array) -> npt.NDArray[np.float32]:
    """A copy with NaN wherever there is no positive, finite depth."""
    depth = np.array(depth_m, np.float32)
    depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    return depth
