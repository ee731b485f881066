"""Errors that users can mend, and checks of values; each message is one line with what, where, and how to mend it."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")  # of an object, as Python prints it; useless to a user
MAX_FAR_M = 1e5
"""The largest coordinate (m). No home is larger, and beyond it float32 cannot resolve centimetres."""
MAX_TIME_S = 1e12
"""The latest time (s): what is later is no time in seconds."""
MAX_SIDE_PX, MAX_PIXELS = 1 << 15, 1 << 26
MIN_FOCAL, MAX_FOCAL = 0.01, 1000.0  # of the image's longer side: views of 179° and 3.4'


class CartierError(Exception):
    """A fault that the user can mend. The command line prints the message alone and exits with 1.

    Messages may quote foreign files: line breaks and control characters become blanks.

    Args:
        message: What is wrong and how to mend it, in one line.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message)))


class InputError(CartierError):
    """An input is invalid: a recording, a detections file, a model, a saved home, or a request."""


class BackendError(CartierError):
    """A backend is unknown, was given an invalid option, or broke its contract."""


class MissingExtra(BackendError):
    """A backend needs a package that is not installed."""


class ReasonerError(CartierError):
    """A language model could not be reached or refused to answer. An unusable reply is no error, but no choice."""


class NothingSent(ReasonerError):
    """A vision model that was not asked, because it cannot be: no photograph left."""


def brief(foreign: object, most: int = 100) -> str:
    """Text of a file, a server or a library for a message: one printable line of at most ``most`` characters."""
    try:
        text = foreign[: 4 * most] if isinstance(foreign, str) else str(foreign)
    except (ValueError, RecursionError):  # a number of thousands of digits, an endlessly nested list
        text = type(foreign).__name__
    line = " ".join(printable(ADDRESS.sub("", text[: 4 * most])).split())
    return line if len(line) <= most else line[: most - 1] + "…"


def printable(text: str) -> str:
    """Foreign text for a terminal or a file: control characters, line breaks and lone surrogates become blanks."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)


def need(ok: bool, message: str) -> None:
    """Raise an InputError unless ``ok``."""
    if not ok:
        raise InputError(message)


def finite(values: Sequence[float] | npt.NDArray[Any], size: int, what: str) -> tuple[float, ...]:
    """``values`` as a tuple of ``size`` finite numbers, or an InputError that names ``what``."""
    try:
        numbers = tuple(float(v) for v in values)
    except (TypeError, ValueError, OverflowError):  # no list of numbers, or a number of hundreds of digits
        numbers = ()
    if len(numbers) != size or not all(map(math.isfinite, numbers)):  # an error's text is made only where there is one
        raise InputError(f"{what} must be {size} finite numbers, got {brief(values)}")
    return numbers


def check_camera(width: int, height: int, lens: Sequence[float]) -> None:
    """Raise an InputError for an impossible image size (px) or lens (fx, fy, cx, cy in px)."""
    need(
        0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX,
        f"camera size must be 1 to {MAX_SIDE_PX} px, got {brief(width, 20)}x{brief(height, 20)}",
    )
    need(
        width * height <= MAX_PIXELS,
        f"camera images must have {MAX_PIXELS // 10**6} megapixels at most, got {width}x{height}",
    )
    fx, fy, cx, cy = finite(lens, 4, "camera fx, fy, cx, cy")
    need(fx > 0 and fy > 0, f"camera focal lengths must be positive, got fx={fx}, fy={fy}")
    side = max(width, height)
    need(
        all(MIN_FOCAL * side <= f <= MAX_FOCAL * side for f in (fx, fy)),
        f"camera focal lengths fx={fx:g}, fy={fy:g} are no lens's for images of {width}x{height} "
        "px: they are in pixels of these images",
    )
    need(
        abs(cx) <= MAX_FOCAL * side and abs(cy) <= MAX_FOCAL * side,
        f"the camera's principal point cx={cx:g}, cy={cy:g} is nowhere near its {width}x{height} px",
    )


def check_pose(world_from_camera: npt.NDArray[Any], where: str = "pose") -> npt.NDArray[np.float64]:
    """A (4, 4) rigid transform as float64, or an InputError that says what is wrong with it."""
    import numpy as np  # "cartier --help" needs none

    pose = np.asarray(world_from_camera, dtype=np.float64)
    need(pose.shape == (4, 4), f"{where}: a pose must be 4x4, got {pose.shape}")
    need(bool(np.isfinite(pose).all()), f"{where}: the pose holds NaN or infinity")
    need(
        bool(np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6)),
        f"{where}: the last row of a pose must be 0 0 0 1, got {pose[3].tolist()}",
    )
    far = float(np.abs(pose[:3, 3]).max())
    need(far <= MAX_FAR_M, f"{where}: the pose is {far:.3g} m from the origin, which is no home: are the units metres?")
    off = float(np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max())
    need(off < 1e-2, f"{where}: the rotation is not orthonormal (off by {off:.3g})")
    need(
        float(np.linalg.det(pose[:3, :3])) > 0,
        f"{where}: the rotation mirrors (determinant -1): is the world left-handed?",
    )
    return pose


def check_radius(radius_m: float) -> float:
    """A robot's radius (m), or an InputError unless it is above 0 and at most 5."""
    need(0 < radius_m <= 5, f"a robot's radius must be above 0 and at most 5 m, got {radius_m:g}")
    return float(radius_m)


def frame_number(index: int, length: int, name: str) -> int:
    """``index``, or an IndexError if there is no such frame; negative numbers do not count from the end."""
    number = operator.index(index)
    if not 0 <= number < length:
        raise IndexError(f"{name} has frames 0 to {length - 1}, not {number}")
    return number


def only_readings(depth_m: npt.NDArray[np.float32], where: str) -> npt.NDArray[np.float32]:
    """Depth (H, W), NaN where nothing was read: where it is not positive, or beyond ``MAX_FAR_M``, out of range."""
    import numpy as np

    read = (depth_m > 0) & (depth_m <= MAX_FAR_M)
    if (read | np.isnan(depth_m)).all():
        return depth_m
    need(
        2 * int((np.isfinite(depth_m) & (np.abs(depth_m) > MAX_FAR_M)).sum()) <= depth_m.size,
        f"{where}: its depth reaches beyond {MAX_FAR_M:g} m, which is no home: are the units metres?",
    )
    return np.where(read, depth_m, np.float32(np.nan))
