"""ARCore: images/TIME.jpg, poses.csv, intrinsics.json, and optional depth/TIME.png, confidence/TIME.png.

ARCore has no export of its own; an app writes this per ``Frame``, with TIME = ``Frame.getTimestamp()`` in nanoseconds:

- ``images/TIME.jpg`` (or .png): the camera image, as ``acquireCameraImage`` gives it, not turned.
- ``poses.csv``: a line ``timestamp_ns,tx,ty,tz,qx,qy,qz,qw`` of names, then ``Camera.getPose()`` (OpenGL camera axes,
  world with y up) of each frame whose camera was TRACKING. Images without a pose are left out and counted.
- ``intrinsics.json``: ``{"width", "height", "fx", "fy", "cx", "cy"}`` of ``Camera.getImageIntrinsics()``.
- ``depth/TIME.png``: ``acquireDepthImage16Bits`` or ``acquireRawDepthImage16Bits`` as 16-bit PNG, millimetres, 0 =
  none;
  it may be smaller than the image, but must show the same field of view.
- ``confidence/TIME.png``: ``acquireRawDepthConfidenceImage`` as 8-bit PNG; below ``confidence`` depth is dropped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.files import read_json
from cartier.recordings.common.files import names_in, read_cells, read_fields, read_table, relative
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import GL_FROM_OPTICAL, Y_UP, matrices, unit_quaternions

POSES, CAMERA = "poses.csv", "intrinsics.json"
COLUMNS = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
FIELDS = ("width", "height", "fx", "fy", "cx", "cy")
COLOUR = re.compile(r"(\d{1,19})\.(?:jpg|png)", re.ASCII)


def matches(path: Path) -> bool:
    """Whether a folder holds poses.csv, intrinsics.json and images/."""
    return (path / POSES).is_file() and (path / CAMERA).is_file() and (path / "images").is_dir()


def open(
    path: str | Path, confidence: int = 77, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read such a folder; ``confidence``, 0 to 255, is the least that depth must have (77 is 0.3: Google's samples)."""
    check_confidence(confidence, 255)
    root = Path(path)
    notes: list[str] = []
    rows = read_table(root / POSES, ("timestamp_ns", *COLUMNS), (), notes, COLUMNS)
    row_of = {time: i for i, time in enumerate(_times(root / POSES))}
    width, height, *intrinsics = read_fields(read_json(root / CAMERA), FIELDS, str(root / CAMERA))
    lens = Lens(camera_of(int(width), int(height), intrinsics, str(root / CAMERA)))
    images = {int(m[1]): m[0] for m in map(COLOUR.fullmatch, names_in(root / "images")) if m}
    depths, confidences = (names_in(root / name, optional=True) for name in ("depth", "confidence"))
    posed = [time for time in sorted(images) if time in row_of]
    kept = [time for time in posed if not depths or f"{time}.png" in depths]
    notes += [f"{len(images) - len(posed)} images without a pose left out"] if len(images) > len(posed) else []
    notes += [f"{len(posed) - len(kept)} images without depth left out"] if len(posed) > len(kept) else []
    if not kept:
        raise InputError(f"{root}: of {len(images)} images none can be used: {'; '.join(notes) or 'images/ is empty'}")
    views, files = [], [POSES, CAMERA]
    for time in kept:
        depth = root / "depth" / f"{time}.png" if depths else None
        trust = root / "confidence" / f"{time}.png" if depths and f"{time}.png" in confidences else None
        views.append(View(time / 1e9, root / "images" / images[time], lens, depth, trust))
        files += relative(root, views[-1].colour, depth, trust)
    poses = np.column_stack([rows[name] for name in COLUMNS])[[row_of[time] for time in kept]]
    poses[:, 3:] = unit_quaternions(poses[:, 3:], str(root / POSES))
    poses = matrices(poses) @ GL_FROM_OPTICAL
    source = Source(
        root, f"arcore 1 {confidence}", views, poses, files, notes, min_confidence=confidence, known_up=Y_UP
    )
    return PosedImages(source, up, floor_m)


def _times(path: Path) -> list[int]:
    """The time stamps as whole numbers: a float64 would round nanoseconds."""
    names, rows = read_cells(path, [])
    column = names.index("timestamp_ns")
    words = [cells[column].strip() for _, cells in rows]
    odd = next((word for word in words if not word.isascii() or not word.isdigit()), None)
    if odd is not None:
        raise InputError(f"{path}: timestamp_ns must be a whole number, got {odd[:40]!r}")
    return [int(word) for word in words]
