"""Small helpers of the readers of folder formats: numbers, rows of poses, and names that must stay in their folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.files import read_text
from cartier.recordings.common.poses import MAX_NUMBER, MAX_TABLE_BYTES, read_trajectory_rows
from cartier.types import Camera

GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera axes (x right, y up, z backwards) from ours; a matrix of ARKit, ARCore, Blender or nerfstudio times
this is ours. Its own inverse."""
Y_UP = (0.0, 1.0, 0.0)
USUAL_WAY_M = 0.6
"""How far from their middle the cameras of a home's recording stand; the scale of one that has none is guessed by it."""
USUAL_OFF_CENTRE, MAX_OFF_CENTRE = 0.05, 0.2
"""How far from the middle of an image, in shares of its side, a principal point lies: a real camera's by a few hundredths, that
of an image with a strip cut off by half the strip's share (which is noted), one beyond the second is that of other images."""
RESIZED, SAME_RATIO = 0.1, 0.08
"""A principal point that is off by one factor (to 8 %) of 10 % or more in both directions is that of images of another size."""


def numbers(words: Sequence[object], where: str) -> list[float]:
    """Finite numbers of a sane size, or an InputError."""
    try:
        values = [float(word) for word in words]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {brief(error)}") from error
    if not all(abs(value) < MAX_NUMBER for value in values):  # false for NaN too
        raise InputError(f"{where}: NaN, infinity or a senseless size where a number belongs")
    return values


def inside(name: object, where: str) -> str:
    """A file name relative to a recording's folder, or an InputError if it leads out of it; ``check_inside`` sees to links."""
    if not isinstance(name, str) or not _is_name(name):
        raise InputError(f"{where}: {brief(name, 60)!r} is no file name")
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise InputError(f"{where}: {brief(name, 80)!r} leads out of the recording's folder")
    return path.as_posix()


def _is_name(name: str) -> bool:
    try:
        parts = name.encode().split(b"/")
    except UnicodeEncodeError:  # half of a character
        return False
    return bool(name) and "\0" not in name and "\\" not in name and len(name) < 1000 and max(map(len, parts)) <= 255


def read_samples(path: Path) -> npt.NDArray[np.float64]:
    """(N, 8) ``t x y z qx qy qz qw`` of a TUM file, by time, one row per time, quaternions of length 1."""
    table = read_trajectory_rows(path)
    table = table[np.argsort(table[:, 0], kind="stable")]
    table = table[np.append(np.diff(table[:, 0]) > 0, True)]
    table[:, 4:] /= np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    return np.asarray(table)


def camera_of(width: int, height: int, values: Sequence[float], where: str) -> Camera:
    """A camera of fx, fy, cx, cy, or an InputError that names the file, also where they belong to images of another size."""
    try:
        camera = Camera(width, height, *values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    ratios = (2 * (camera.cx + 0.5) / width, 2 * (camera.cy + 0.5) / height)
    one_factor = abs(ratios[0] - ratios[1]) <= SAME_RATIO * max(ratios)
    resized = one_factor and min(abs(ratio - 1) for ratio in ratios) >= RESIZED
    if resized or off_centre((width, height), (camera.cx, camera.cy)) > MAX_OFF_CENTRE:
        raise InputError(
            f"{where}: the principal point {camera.cx:g}, {camera.cy:g} is that of images of some {max(2 * camera.cx, 0):.0f}x"
            f"{max(2 * camera.cy, 0):.0f} px, but these have {width}x{height}: scale fx, fy, cx, cy as the images were resized"
        )
    return camera


def off_centre(size: tuple[int, int], centre: tuple[float, float]) -> float:
    """How far a principal point is from the middle of images (width, height), in shares of the side that it is further off on."""
    return max(abs(c + 0.5 - side / 2) / side for c, side in zip(centre, size, strict=True))


def off_centre_notes(camera: Camera) -> list[str]:
    """The line to say where the principal point is further from the middle than a whole image's ever is."""
    off = off_centre((camera.width, camera.height), (camera.cx, camera.cy))
    if off <= USUAL_OFF_CENTRE:
        return []
    return [
        f"the principal point {camera.cx:g}, {camera.cy:g} lies {off:.0%} of the side off the middle of the images "
        f"({camera.width}x{camera.height} px): right if they were cropped, wrong if they were resized"
    ]


def check_confidence(confidence: int, highest: int) -> None:
    """Raises InputError for a least confidence of depth that the format does not have."""
    if not 0 <= confidence <= highest:
        raise InputError(f"--confidence {confidence}: this format's depth has confidences of 0 to {highest}")


def check_floor(level_from_camera: npt.NDArray[np.float64], floor_m: float | None) -> None:
    """Raises InputError where a floor that the user gave, z = 0 of levelled poses (N, 4, 4), lies above every camera."""
    highest_m = float(level_from_camera[:, 2, 3].max())
    if floor_m is not None and highest_m <= 0:
        raise InputError(
            f"--floor {floor_m:g} lies above every camera: the highest is at {floor_m + highest_m:.2f} m along up in the "
            "recording's own world"
        )


def read_cells(path: Path, notes: list[str]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names in a CSV file's first line, and each row's line number and cells, as many as there are names.

    A row of more or fewer cells, such as the last of an app that was stopped, is left out and counted in ``notes``.
    """
    every = enumerate(read_text(path, MAX_TABLE_BYTES).splitlines(), 1)
    lines = [(number, line.split(",")) for number, line in every if line.strip()]
    names = [name.strip() for name in lines[0][1]] if lines else []
    rows = [(number, cells) for number, cells in lines[1:] if len(cells) == len(names)]
    if len(lines) > 1 and len(rows) < len(lines) - 1:
        number, cells = next((number, cells) for number, cells in lines[1:] if len(cells) != len(names))
        says = f"line {number} has {len(cells)} values for {len(names)} columns"
        if not rows:
            raise InputError(f"{path}: none of its {len(lines) - 1} rows fits its first line: {says}")
        notes.append(f"{len(lines) - 1 - len(rows)} rows of {path.name} left out: {says}")
    return names, rows


def read_table(
    path: Path, wanted: Sequence[str], optional: Sequence[str], notes: list[str]
) -> dict[str, npt.NDArray[np.float64]]:
    """The wanted columns of a CSV file by the names in its first line; an InputError if one is missing.

    An ``optional`` column is given where it is there and filled in every row. No other column is looked at: the apps add new
    ones, and leave them empty. ``notes`` gets what ``read_cells`` says.
    """
    names, rows = read_cells(path, notes)
    lack = [name for name in wanted if name not in names]
    if lack:
        raise InputError(
            f"{path}: its first line must name the columns {', '.join(wanted)}; {', '.join(lack)} is missing"
        )
    if not rows:
        raise InputError(f"{path} holds no row")
    at = {name: names.index(name) for name in (*wanted, *optional) if name in names}
    at = {name: i for name, i in at.items() if name in wanted or all(cells[i].strip() for _, cells in rows)}
    values = [numbers([cells[i] for i in at.values()], f"{path} line {number}") for number, cells in rows]
    return dict(zip(at, np.array(values).T, strict=True))


def unit_quaternions(quaternions: npt.NDArray[np.float64], where: str) -> npt.NDArray[np.float64]:
    """(N, 4) of length 1, or an InputError if one is far from it."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    if not (np.abs(lengths - 1) < 0.01).all():
        raise InputError(f"{where}: pose {int(np.abs(lengths - 1).argmax())} has a quaternion that is not of length 1")
    return np.asarray(quaternions / lengths)
