"""Small helpers of the readers of folder formats: numbers, rows of poses, and names that must stay in their folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.files import read_text
from cartier.recordings._poses import MAX_NUMBER, MAX_TABLE_BYTES, read_trajectory_rows
from cartier.types import Camera

GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera axes (x right, y up, z backwards) from ours; a matrix of ARKit, ARCore, Blender or nerfstudio times
this is ours. Its own inverse."""
Y_UP = (0.0, 1.0, 0.0)


def numbers(words: Sequence[object], where: str) -> list[float]:
    """Finite numbers of a sane size, or an InputError."""
    try:
        values = [float(word) for word in words]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {brief(error)}") from error
    if not all(abs(value) < MAX_NUMBER for value in values):  # false for NaN too
        raise InputError(f"{where}: NaN, infinity or a senseless size where a number belongs")
    return values


def inside(root: Path, name: object, where: str) -> str:
    """A file name relative to ``root``, or an InputError if it leads out of it."""
    if not isinstance(name, str) or not name or "\0" in name or "\\" in name:
        raise InputError(f"{where}: {brief(name, 60)!r} is no file name")
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not (root / name).resolve().is_relative_to(root.resolve()):
        raise InputError(f"{where}: {brief(name, 80)!r} leads out of the recording's folder")
    return path.as_posix()


def read_samples(path: Path) -> npt.NDArray[np.float64]:
    """(N, 8) ``t x y z qx qy qz qw`` of a TUM file, by time, one row per time, quaternions of length 1."""
    table = read_trajectory_rows(path)
    table = table[np.argsort(table[:, 0], kind="stable")]
    table = table[np.append(np.diff(table[:, 0]) > 0, True)]
    table[:, 4:] /= np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    return np.asarray(table)


def camera_of(width: int, height: int, values: Sequence[float], where: str) -> Camera:
    """A camera of fx, fy, cx, cy, or an InputError that names the file."""
    try:
        return Camera(width, height, *values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def read_table(path: Path, wanted: Sequence[str]) -> dict[str, npt.NDArray[np.float64]]:
    """The columns of a CSV file by the names in its first line; an InputError if a wanted one is missing."""
    lines = [line for line in read_text(path, MAX_TABLE_BYTES).splitlines() if line.strip()]
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    lack = [name for name in wanted if name not in names]
    if lack:
        raise InputError(
            f"{path}: its first line must name the columns {', '.join(wanted)}; {', '.join(lack)} is missing"
        )
    rows = []
    for number, line in enumerate(lines[1:], 2):
        values = numbers(line.split(","), f"{path} line {number}")
        if len(values) != len(names):
            raise InputError(f"{path} line {number}: {len(values)} values for {len(names)} columns")
        rows.append(values)
    if not rows:
        raise InputError(f"{path} holds no row")
    return dict(zip(names, np.array(rows).T, strict=True))


def unit_quaternions(quaternions: npt.NDArray[np.float64], where: str) -> npt.NDArray[np.float64]:
    """(N, 4) of length 1, or an InputError if one is far from it."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    if not (np.abs(lengths - 1) < 0.01).all():
        raise InputError(f"{where}: pose {int(np.abs(lengths - 1).argmax())} has a quaternion that is not of length 1")
    return np.asarray(quaternions / lengths)
