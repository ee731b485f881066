"""Camera poses: TUM trajectories, 4x4 matrices, quaternions, and poses interpolated between samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, check_pose
from cartier.io.files import read_text
from cartier.recordings.common.files import MAX_NUMBER, MAX_TABLE_BYTES, numbers
from cartier.types import Array

Matrix = npt.NDArray[np.float64]
GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera axes (x right, y up, z backwards) from ours; its own inverse.

A camera-to-world matrix of ARKit, ARCore, Blender or nerfstudio, multiplied by this from the right, is ours.
"""
Y_UP, Z_UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
USUAL_WAY_M = 0.6
"""How far from their middle the cameras of a home's recording stand; guesses the scale of a recording without one."""
UNIT_TOLERANCE = 0.01  # of a quaternion's length
MATRIX_SIZES = (12, 16)  # a line of so many numbers is a matrix, and no pose with additional columns
MAX_GAP_S = 1.0
STILL_M, STILL_RAD = 0.1, 0.1  # poses this close on both sides of a gap: the camera stood still in between


def rigid(world_from_camera: Array, where: str) -> Matrix:
    """The pose with the nearest true rotation; NaN for one that holds NaN or infinity: a tracker was lost.

    Raises InputError if it is further off than ``check_pose`` allows.
    """
    if lost(world_from_camera[None])[0]:
        return np.full((4, 4), np.nan)
    if (np.abs(world_from_camera) > MAX_NUMBER).any():
        raise InputError(f"{where}: the pose holds numbers of a senseless size")
    pose = check_pose(world_from_camera, where).copy()
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    pose[3] = (0, 0, 0, 1)
    return pose


def read_matrix(path: Path, rows: int, separator: str | None = None) -> Matrix:
    """A square matrix written as ``rows`` lines of ``rows`` numbers, which may be NaN or infinite."""
    lines = [line.split(separator) for line in read_text(path, 1 << 16).splitlines() if line.strip()]
    if len(lines) != rows or any(len(line) != rows for line in lines):
        raise InputError(f"{path} must hold {rows} lines of {rows} numbers")
    return np.array([numbers(line, f"{path} line {i}", finite=False) for i, line in enumerate(lines, 1)])


def parse_trajectory(text: str, where: str) -> tuple[npt.NDArray[np.float64], Matrix]:
    """Times (N,) in seconds and world_from_camera (N, 4, 4) of a TUM file: lines of ``t x y z qx qy qz qw [more]``."""
    table = _trajectory_rows(text, where)
    return table[:, 0], matrices(table[:, 1:])


def read_trajectory_rows(path: Path) -> Matrix:
    """(N, 8) of a TUM file, as written."""
    return _trajectory_rows(read_text(path, MAX_TABLE_BYTES), str(path))


def _trajectory_rows(text: str, where: str) -> Matrix:
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            rows.append(trajectory_row(line, f"{where} line {number}"))
    if not rows:
        raise InputError(f"{where} holds no pose")
    return np.array(rows)


def trajectory_row(line: str, where: str) -> list[float]:
    """The 8 numbers of a TUM line; those of the pose are NaN or infinite where a tracker was lost."""
    words = line.split()
    if len(words) < 8 or len(words) in MATRIX_SIZES:
        raise InputError(f"{where}: a pose is 't x y z qx qy qz qw', 8 numbers, got {len(words)}")
    row = numbers(words[:1], where) + pose_numbers(words[1:8], where)
    norm = float(np.linalg.norm(row[4:]))
    if not lost(np.array([row]))[0] and abs(norm - 1) > UNIT_TOLERANCE:
        raise InputError(f"{where}: the quaternion's length must be 1, got {norm:.3g}")
    return row


def trajectory_line(time_s: float, world_from_camera: Array) -> str:
    """One TUM line with all the digits of a float64."""
    x, y, z = world_from_camera[:3, 3]
    return " ".join(repr(float(v)) for v in (time_s, x, y, z, *_quaternion(world_from_camera[:3, :3]))) + "\n"


def pose_numbers(words: Sequence[object], where: str) -> list[float]:
    """Numbers of a pose, all NaN where one is NaN or infinite: a tracker was lost. Raises InputError for others."""
    values = numbers(words, where, finite=False)
    if any(MAX_NUMBER < abs(value) < np.inf for value in values):
        raise InputError(f"{where}: a senseless size where a number of a pose belongs")
    return values if np.isfinite(values).all() else [np.nan] * len(values)


def lost(poses: Array) -> npt.NDArray[np.bool_]:
    """Which of N poses of any form hold NaN or infinity, as trackers write while they are lost."""
    return np.asarray(~np.isfinite(poses.reshape(len(poses), -1)).all(axis=1))


def unit_quaternions(quaternions: npt.NDArray[np.float64], where: str) -> npt.NDArray[np.float64]:
    """(N, 4) of length 1, or NaN and infinity as they are. Raises InputError if one is far from it."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    off = np.where(np.isfinite(lengths), np.abs(lengths - 1), 0)
    if not (off < UNIT_TOLERANCE).all():
        raise InputError(f"{where}: pose {int(off.argmax())} has a quaternion that is not of length 1")
    return np.asarray(quaternions / lengths)


def matrices(positions_quaternions: Array) -> Matrix:
    """(N, 4, 4) of rows x y z qx qy qz qw."""
    quaternions = positions_quaternions[:, 3:]
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    poses = np.zeros((len(x), 4, 4))
    poses[:, 0, :3] = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), axis=-1)
    poses[:, 1, :3] = np.stack((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), axis=-1)
    poses[:, 2, :3] = np.stack((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), axis=-1)
    poses[:, :3, 3] = positions_quaternions[:, :3]
    poses[:, 3, 3] = 1
    return poses


def _quaternion(rotation: Array) -> npt.NDArray[np.float64]:
    """Unit (x, y, z, w) of a rotation matrix, as the largest eigenvector of Bar-Itzhack's symmetric matrix."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    rows = [a - e - i, b + d, c + g, h - f], [b + d, e - a - i, f + h, c - g], [c + g, f + h, i - a - e, d - b]
    quaternion = np.linalg.eigh(np.array([*rows, [h - f, c - g, d - b, a + e + i]]))[1][:, -1]
    return np.asarray(quaternion * np.copysign(1, quaternion[3]), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Rows (N, 7) ``x y z qx qy qz qw``, and which lie outside of the samples' time and in gaps between samples."""

    rows: npt.NDArray[np.float64]
    outside: npt.NDArray[np.bool_]
    in_gaps: npt.NDArray[np.bool_]

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """Which lie beside a sample that is NaN."""
        return lost(self.rows)

    def matrices(self) -> Matrix:
        """(N, 4, 4)."""
        return matrices(self.rows)


def by_time(samples: Array) -> npt.NDArray[np.float64]:
    """Samples (N, 8) ``t x y z qx qy qz qw`` by time, one row per time; of equal times the last."""
    samples = samples[np.argsort(samples[:, 0], kind="stable")]
    return np.asarray(samples[np.append(np.diff(samples[:, 0]) > 0, True)])


def interpolated(samples: Array, times_s: Array) -> Interpolated:
    """The poses at each time: straight lines between the positions of samples (M, 8), slerp between the rotations."""
    times = np.asarray(times_s, dtype=np.float64)
    known = samples[:, 0]
    outside = (times < known[0]) | (times > known[-1])
    after = np.clip(np.searchsorted(known, times), 1, max(1, len(known) - 1))
    a, b = samples[after - 1], samples[np.minimum(after, len(known) - 1)]
    span = b[:, 0] - a[:, 0]
    with np.errstate(over="ignore"):  # times outside of two samples that all but coincide: cut to 0 or 1
        share = np.clip(np.divide(times - a[:, 0], span, out=np.zeros_like(times), where=span > 0), 0, 1)
    a, b = np.where(share[:, None] == 1, b, a), np.where(share[:, None] == 0, a, b)  # a lost neighbour does not matter
    rotation, angle = _slerp(a[:, 4:], b[:, 4:], share)
    position = a[:, 1:4] + share[:, None] * (b[:, 1:4] - a[:, 1:4])
    moved = (np.linalg.norm(b[:, 1:4] - a[:, 1:4], axis=1) > STILL_M) | (angle > STILL_RAD)
    between = (share > 0) & (share < 1)
    return Interpolated(np.hstack([position, rotation]), outside, (span > MAX_GAP_S) & moved & between)


def _slerp(a: Array, b: Array, share: Array) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Unit quaternions (N, 4) between two, on the shorter way, and the whole angle of the rotation in radians."""
    cosine = np.einsum("ij,ij->i", a, b)
    b = b * np.copysign(1, cosine)[:, None]
    half = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(half)
    flat = sine < 1e-6
    safe = np.where(flat, 1, sine)
    weight_a = np.where(flat, 1 - share, np.sin((1 - share) * half) / safe)
    weight_b = np.where(flat, share, np.sin(share * half) / safe)
    mixed = weight_a[:, None] * a + weight_b[:, None] * b
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True), 2 * half
