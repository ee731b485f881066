"""Hypotheses about conventions: which poses, depth units and intrinsics a recording may have been written with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cartier.types import Array, Camera

Matrix = npt.NDArray[np.float64]


def _signs(x: int, y: int, z: int) -> Matrix:
    return np.diag([float(x), float(y), float(z), 1.0])


OPTICAL_FROM_BODY = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
QUARTER = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
AXES = {
    "OpenGL axes (y up, z backwards)": _signs(1, -1, -1),
    "a robot's body axes (x forward, y left)": OPTICAL_FROM_BODY,
    "cameras held upside down": _signs(-1, -1, 1),
    "cameras that look backwards": _signs(-1, 1, -1),
    "axes of pictures that were turned to the left afterwards": QUARTER,
    "axes of pictures that were turned to the right afterwards": QUARTER.T,
}
MIRRORED_CAMERAS = {"x": _signs(-1, 1, 1), "y": _signs(1, -1, 1), "z": _signs(1, 1, -1)}
MIRROR_Y = _signs(1, -1, 1)
SWAP_YZ = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
UNITS = {
    1000.0: "a depth in metres was read as millimetres",
    1e-3: "a depth in millimetres was read as metres",
    5.0: "a depth in millimetres was read as 1/5000 m",
    0.2: "a depth in 1/5000 m was read as millimetres",
    4.0: "a depth in millimetres was read as 1/4000 m",
    0.25: "a depth in 1/4000 m was read as millimetres",
    10.0: "a depth in centimetres was read as millimetres",
    0.1: "a depth in millimetres was read as centimetres",
    100.0: "a depth in metres was read as centimetres",
    0.01: "a depth in centimetres was read as metres",
    0.3048: "a depth in feet was read as metres",
    2.0: "the depth is half of what it should be",
    0.5: "the depth is twice what it should be",
}
FACTORS_OF_DEPTH = (*UNITS, 1.4, 0.7, 1.15, 0.87)
POSE_UNITS = {1e-3: "millimetres", 1e-2: "centimetres", 1e3: "kilometres"}
SIZES = ((1, 1), (2, 1.5), (3, 2.25), (1.5, 1.125), (1, 0.75), (1, 4 / 3))  # width and height: also 16:9 read as 4:3
FACTORS = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 1, 4 / 3, 3 / 2, 2, 3, 4)
SHIFTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 26, 30, 36, 42, 50, 60)


@dataclass(frozen=True, eq=False)
class Reading:
    """One interpretation of the numbers: what converts poses, depth and intrinsics to cartier's conventions.

    ``level`` (4, 4) is what the reader itself multiplied the poses with to level them. Poses become
    ``before @ flip(maybe inverted (level^-1 @ pose)) @ after``; frame i gets the pose of frame i + ``shift``.
    """

    level: Matrix
    inverted: bool = False
    positions: tuple[float, float, float] = (1.0, 1.0, 1.0)
    before: Matrix | None = None
    after: Matrix | None = None
    shift: int = 0
    depth_scale: float = 1.0
    camera_factor: tuple[float, float] = (1.0, 1.0)

    def changes(self) -> bool:
        """Whether it differs from the numbers as given."""
        numbers = (self.inverted, self.positions, self.shift, self.depth_scale, self.camera_factor)
        same = numbers == (False, (1.0, 1.0, 1.0), 0, 1.0, (1.0, 1.0))
        return not same or self.before is not None or self.after is not None

    def poses(self, given: Array) -> Matrix:
        """world_from_camera (N, 4, 4) in this reading, without the shift."""
        poses: Matrix = np.array(given, dtype=np.float64)
        if self.inverted:
            poses = np.asarray(np.linalg.inv(np.linalg.inv(self.level) @ poses), dtype=np.float64)
        if self.positions != (1.0, 1.0, 1.0):
            poses[:, :3, 3] *= self.positions
        if self.after is not None:
            poses = poses @ self.after
        if self.before is not None:
            poses = self.before @ poses
        return poses

    def shifted(self, given: Array, index: Array) -> Matrix:
        """The poses of sampled frames with numbers ``index`` (M,), with the shift; NaN where no pose is known."""
        poses = self.poses(given)
        if self.shift == 0:
            return poses
        at = np.searchsorted(index, index + self.shift).clip(0, len(index) - 1)
        return np.where((index[at] == index + self.shift)[:, None, None], poses[at], np.nan)

    def camera(self, given: Camera) -> Camera:
        across, down = self.camera_factor
        if self.camera_factor == (1.0, 1.0):
            return given
        return Camera(
            given.width, given.height, given.fx / across, given.fy / down,
            (given.cx + 0.5) / across - 0.5, (given.cy + 0.5) / down - 0.5,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A reading that differs in one respect: the fault that this would be, in words, and its repair."""

    fault: str
    words: str
    repair: str
    reading: Reading


def hypotheses(now: Reading, camera: Camera) -> Iterator[Hypothesis]:
    """Every reading that differs from the present one in one respect."""
    yield Hypothesis(
        "inverted_poses", "world-to-camera read as camera-to-world",
        "invert each pose matrix: cartier expects camera-to-world", replace(now, inverted=not now.inverted),
    )  # fmt: skip
    yield from _axes(now)
    yield from _mirrors(now)
    yield from (depth_by(now, factor) for factor in FACTORS_OF_DEPTH)
    yield from _cameras(now, camera)
    for shift in (*SHIFTS, *(-s for s in SHIFTS)):
        yield shift_by(now, shift)


def shift_by(now: Reading, shift: int) -> Hypothesis:
    late = f"{abs(shift)} frame{'s' if abs(shift) > 1 else ''} {'late' if shift > 0 else 'early'}"
    return Hypothesis(
        "time_offset", f"the poses come {late}",
        f"give frame i the pose of frame i {'+' if shift > 0 else '-'} {abs(shift)}",
        replace(now, shift=now.shift + shift),
    )  # fmt: skip


def depth_by(now: Reading, factor: float) -> Hypothesis:
    """Depth times a factor: depth in another unit than metres."""
    words = UNITS.get(factor, f"the depth is too {'small' if factor > 1 else 'large'}")
    return Hypothesis(
        "depth_scale", words, f"multiply the depth by {factor:.3g}", replace(now, depth_scale=now.depth_scale * factor)
    )


def positions_by(now: Reading, factor: float) -> Hypothesis:
    """Positions times a factor: poses in another unit than metres."""
    unit = next((unit for known, unit in POSE_UNITS.items() if abs(factor / known - 1) < 0.03), None)
    if unit is None:
        words = f"the positions are too {'large' if factor < 1 else 'small'} for the depth"
    else:
        words = f"poses in {unit} were read as metres"
    x, y, z = (sign * factor for sign in now.positions)
    return Hypothesis("pose_scale", words, f"multiply each position by {factor:.3g}", replace(now, positions=(x, y, z)))


def _axes(now: Reading) -> Iterator[Hypothesis]:
    for name, after in AXES.items():
        yield Hypothesis(
            "opengl_axes", f"{name} taken for optical ones",
            "turn each camera's axes to x right, y down, z forward", replace(now, after=_times(now.after, after)),
        )  # fmt: skip


def _mirrors(now: Reading) -> Iterator[Hypothesis]:
    repair = "mirror one axis of the world, rotations and positions alike, and the matching axis of the camera"
    for axis, after in MIRRORED_CAMERAS.items():
        reading = replace(now, after=_times(now.after, after), before=_times(MIRROR_Y, now.before))
        yield Hypothesis("left_handed", f"the world is mirrored (camera axis {axis} flipped)", repair, reading)
    for i, axis in enumerate("xyz"):
        flip = [1.0, 1.0, 1.0]
        flip[i] = -1.0
        x, y, z = (a * b for a, b in zip(now.positions, flip, strict=True))
        yield Hypothesis(
            "left_handed", f"the positions, but not the rotations, are mirrored along {axis}",
            f"change the sign of {axis} in each position", replace(now, positions=(x, y, z)),
        )  # fmt: skip


def _cameras(now: Reading, camera: Camera) -> Iterator[Hypothesis]:
    """Intrinsics of another image size, if the principal point then lies near the middle."""
    given = now.camera(camera)
    for size in SIZES:
        for factor in FACTORS:
            across, down = size[0] * factor, size[1] * factor
            middle = (given.cx / across / camera.width, given.cy / down / camera.height)
            if (across, down) == (1, 1) or not all(0.35 < m < 0.65 for m in middle):
                continue
            size_words = f"{round(camera.width * across)}x{round(camera.height * down)}"
            factors = (now.camera_factor[0] * across, now.camera_factor[1] * down)
            yield Hypothesis(
                "intrinsics_resolution",
                f"intrinsics of {size_words} images used with {camera.width}x{camera.height} ones",
                f"scale fx, cx by {1 / across:.3g} and fy, cy by {1 / down:.3g}", replace(now, camera_factor=factors),
            )  # fmt: skip


def _times(first: Matrix | None, second: Matrix | None) -> Matrix | None:
    if first is None or second is None:
        return second if first is None else first
    return np.asarray(first @ second, dtype=np.float64)
