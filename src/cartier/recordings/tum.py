"""TUM RGB-D: rgb.txt, depth.txt, groundtruth.txt and the images that they name; depth in 1/5000 m.

Poses are those of the camera's optical frame. An image takes the depth nearest in time, at most 20 ms away as in the
benchmark's own ``associate.py``, and its pose is interpolated; without a pose on both sides it is left out. The files
hold no intrinsics: those published for freiburg1 to freiburg3 are chosen by the sequence's name, which is that of the
folder or stands in the second line of the files. Otherwise give ``camera``, or write ``calibration.txt``
(``fx fy cx cy [k1 k2 p1 p2 k3]``). Sturm et al., IROS 2012.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.files import read_text
from cartier.io.images import image_size
from cartier.recordings.common.clock import check_clock
from cartier.recordings.common.files import MAX_TABLE_BYTES, inside, numbers, relative
from cartier.recordings.common.lens import Lens, camera_of, straight
from cartier.recordings.common.posed import PosedImages, Source, View, png_depth
from cartier.recordings.common.poses import by_time, interpolated, read_trajectory_rows, rigid, unit_quaternions

COLOUR, DEPTH, POSES, CALIBRATION = "rgb.txt", "depth.txt", "groundtruth.txt", "calibration.txt"
PER_METRE = 5000.0
NEAREST_S = 0.02
PUBLISHED = {  # fx fy cx cy k1 k2 p1 p2 k3 of the colour cameras; the benchmark undistorted freiburg3's images
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}


def matches(path: Path) -> bool:
    """Whether a folder holds rgb.txt and groundtruth.txt."""
    return (path / COLOUR).is_file() and (path / POSES).is_file()


def open(
    path: str | Path,
    camera: Sequence[float] | str | None = None,
    up: Sequence[float] | None = None,
    floor_m: float | None = None,
) -> Recording:
    """Read a sequence; ``camera`` is fx, fy, cx, cy (px) and, if the lens distorts, k1, k2, p1, p2, k3."""
    root = Path(path)
    times_s, images = _listing(root / COLOUR)
    lens, lens_note = _lens(root, root / images[0], camera)
    depth = _listing(root / DEPTH) if (root / DEPTH).is_file() else None
    table = read_trajectory_rows(root / POSES)
    check_clock(table[:, 0], str(root / POSES))
    table = by_time(table)
    table[:, 4:] = unit_quaternions(table[:, 4:], str(root / POSES))
    samples = interpolated(table, times_s)
    missing = samples.outside | samples.in_gaps | samples.lost
    notes = [lens_note]
    if missing.any():
        notes.append(f"{int(missing.sum())} images left out: {POSES} has no pose at their time")
    views, rows = [], []
    lonely = 0
    for i in np.flatnonzero(~missing):
        partner = None if depth is None else _nearest(depth[0], float(times_s[i]))
        if depth is not None and partner is None:
            lonely += 1
            continue
        measured = None if depth is None or partner is None else root / depth[1][partner]
        views.append(View(float(times_s[i]), root / images[i], lens, measured))
        rows.append(i)
    if lonely:
        notes.append(f"{lonely} images left out: no depth within {NEAREST_S * 1000:.0f} ms of them")
    if not rows:
        raise InputError(f"{root}: no image has a pose and depth: {'; '.join(notes)}")
    files = [name for name in (COLOUR, DEPTH, POSES, CALIBRATION) if (root / name).is_file()]
    files += relative(root, *(path for view in views for path in (view.colour, view.depth)))
    poses = np.array([rigid(pose, f"{root / POSES}") for pose in samples.matrices()[rows]])
    read = partial(png_depth, per_metre=PER_METRE)
    return PosedImages(Source(root, f"tum 2 {camera}", views, poses, files, notes, read), up, floor_m)


def _listing(path: Path) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Times in seconds and image files of lines ``time file``, by time."""
    rows = []
    for number, line in enumerate(read_text(path, MAX_TABLE_BYTES).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            words = line.split(maxsplit=1)
            if len(words) != 2:
                raise InputError(f"{path} line {number}: expected 'time file', got {line[:60]!r}")
            time_s = numbers(words[:1], f"{path} line {number}")[0]
            rows.append((time_s, inside(words[1].strip(), f"{path} line {number}", path.parent)))
    if not rows:
        raise InputError(f"{path} names no image")
    check_clock(np.array([time_s for time_s, _ in rows]), str(path))
    rows.sort()
    return np.array([row[0] for row in rows]), [row[1] for row in rows]


def _nearest(times_s: npt.NDArray[np.float64], time_s: float) -> int | None:
    best = int(np.abs(times_s - time_s).argmin())
    return best if abs(times_s[best] - time_s) <= NEAREST_S else None


def _lens(root: Path, first: Path, given: Sequence[float] | str | None) -> tuple[Lens, str]:
    if given is not None:
        words = given.split(",") if isinstance(given, str) else [str(v) for v in given]
        values, note = numbers(words, "camera"), "intrinsics given by the user"
    elif (root / CALIBRATION).is_file():
        values = numbers(read_text(root / CALIBRATION, 1 << 16).split(), str(root / CALIBRATION))
        note = f"intrinsics from {CALIBRATION}"
    else:
        sequence, by = _sequence(root)
        if sequence is None:
            raise InputError(
                f"{root} holds no intrinsics: write fx fy cx cy to {root / CALIBRATION}, or give --camera FX,FY,CX,CY "
                f"(they are known where the folder's name or the second line of {COLOUR} has {', '.join(PUBLISHED)})"
            )
        values, note = list(PUBLISHED[sequence]), f"intrinsics of {sequence} as published, by {by}"
    if len(values) not in (4, 8, 9):
        wanted = "fx fy cx cy and, if it distorts, k1 k2 p1 p2 [k3]"
        raise InputError(f"{root}: the camera needs {wanted}, got {len(values)}")
    return straight(camera_of(*image_size(first), values[:4], str(root)), "plumb_bob", tuple(values[4:])), note


def _sequence(root: Path) -> tuple[str | None, str]:
    """The published camera whose sequence this is, and what said so: the folder, or the comments of its files."""
    says = {"the folder's name": root.resolve().name}
    says |= {
        f"the head of {name}": "\n".join(read_text(root / name, MAX_TABLE_BYTES).split("\n", 4)[:4])
        for name in (COLOUR, POSES, DEPTH)
        if (root / name).is_file()
    }
    return next(((name, by) for by, text in says.items() for name in PUBLISHED if name in text), (None, ""))
