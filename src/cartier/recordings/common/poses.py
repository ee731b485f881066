"""Camera poses to and from text: TUM trajectories, 4x4 matrices, and the small repairs that are safe to make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief, check_pose
from cartier.io.files import read_text
from cartier.types import Array

Matrix = npt.NDArray[np.float64]
MAX_TABLE_BYTES = 1 << 26  # a pose takes some 150 bytes: two hours at 60 Hz
MATRIX_SIZES = (12, 16)  # a line of as many numbers is a matrix, and no pose with columns of somebody's own behind it
MAX_NUMBER = 1e30  # nanoseconds fit, and squares stay finite


def rigid(world_from_camera: Array, where: str) -> Matrix:
    """The pose with the nearest true rotation; an InputError if it is further off than ``types.check_pose`` allows."""
    if (np.abs(world_from_camera) > MAX_NUMBER).any():
        raise InputError(f"{where}: the pose holds numbers of a senseless size")
    pose = check_pose(world_from_camera, where).copy()
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    pose[3] = (0, 0, 0, 1)
    return pose


def read_matrix(path: Path, rows: int) -> Matrix:
    """A square matrix written as ``rows`` lines of ``rows`` numbers."""
    lines = [line.split() for line in read_text(path, 1 << 16).splitlines() if line.strip()]
    if len(lines) != rows or any(len(line) != rows for line in lines):
        raise InputError(f"{path} must hold {rows} lines of {rows} numbers")
    return np.array([_numbers(line, f"{path} line {i}") for i, line in enumerate(lines, 1)])


def read_trajectory(path: Path) -> tuple[npt.NDArray[np.float64], Matrix]:
    """Times (N,) in seconds and world_from_camera (N, 4, 4) of a TUM file: lines of ``t x y z qx qy qz qw [more]``."""
    table = read_trajectory_rows(path)
    return table[:, 0], matrices(table[:, 1:])


def read_trajectory_rows(path: Path) -> Matrix:
    """(N, 8) of a TUM file, as written."""
    rows = []
    for number, line in enumerate(read_text(path, MAX_TABLE_BYTES).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            rows.append(_tum_row(line, f"{path} line {number}"))
    if not rows:
        raise InputError(f"{path} holds no pose")
    return np.array(rows)


def trajectory_line(time_s: float, world_from_camera: Array) -> str:
    """One TUM line with all the digits of a float64."""
    x, y, z = world_from_camera[:3, 3]
    return " ".join(repr(float(v)) for v in (time_s, x, y, z, *_quaternion(world_from_camera[:3, :3]))) + "\n"


def _tum_row(line: str, where: str) -> list[float]:
    words = line.split()
    if len(words) < 8 or len(words) in MATRIX_SIZES:
        raise InputError(f"{where}: a pose is 't x y z qx qy qz qw', 8 numbers, got {len(words)}")
    row = _numbers(words[:8], where)
    if not all(abs(value) <= MAX_NUMBER for value in row):  # false for NaN too
        raise InputError(f"{where}: the pose holds NaN, infinity or a senseless size")
    norm = float(np.linalg.norm(row[4:]))
    if abs(norm - 1) > 1e-2:
        raise InputError(f"{where}: the quaternion's length must be 1, got {norm:.3g}")
    return row


def _numbers(words: list[str], where: str) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"{where}: {brief(error)}") from error


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
    symmetric = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    quaternion = np.linalg.eigh(symmetric)[1][:, -1]
    return np.asarray(quaternion * np.copysign(1, quaternion[3]), dtype=np.float64)
