"""Stray Scanner (iPhone with LiDAR): rgb.mp4 or rgb/000000.jpg, camera_matrix.csv, odometry.csv, depth/, confidence/.

Poses are of the camera's optical frame, in ARKit's world (y up). Depth is in millimetres and smaller than colour; depth
below ``confidence`` (0, 1 or 2; the app's own tools take 1) is dropped. The video needs PyAV; without it, unpack it to
rgb/000000.jpg, rgb/000001.jpg and so on. Images of a phone held upright are turned upright.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.files import read_text
from cartier.io.images import image_size
from cartier.recordings.common.content import READERS, names_in
from cartier.recordings.common.lens import Lens
from cartier.recordings.common.posed import Colours, PosedImages, Source, View, png_depth
from cartier.recordings.common.poses import matrices
from cartier.recordings.common.tables import Y_UP, camera_of, check_confidence, numbers, read_table, unit_quaternions
from cartier.recordings.common.video import Video

EXTRA = "phone"
MATRIX, ODOMETRY, VIDEO = "camera_matrix.csv", "odometry.csv", "rgb.mp4"
COLOUR = re.compile(r"(\d{1,9})\.(?:jpg|png)", re.ASCII)
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
INTRINSICS = ("fx", "fy", "cx", "cy")


def matches(path: Path) -> bool:
    """Whether a folder holds odometry.csv and camera_matrix.csv."""
    return (path / ODOMETRY).is_file() and (path / MATRIX).is_file()


def open(
    path: str | Path, confidence: int = 1, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read a scan; ``confidence`` is the least that depth must have, 0 for all of it."""
    check_confidence(confidence, 2)
    root = Path(path)
    pictures = _pictures(root)
    notes: list[str] = []
    rows = read_table(root / ODOMETRY, ("timestamp", "frame", *POSE), INTRINSICS, notes)
    own = all(name in rows for name in INTRINSICS)
    shared = None if own else _matrix(root / MATRIX)
    depths = names_in(root / "depth") if (root / "depth").is_dir() else set()
    confidences = names_in(root / "confidence") if (root / "confidence").is_dir() else set()
    views, kept, files = [], [], [MATRIX, ODOMETRY, *([VIDEO] if pictures.video else [])]
    missing = 0
    if not ((rows["frame"] >= 0) & (rows["frame"] < 1e9)).all():
        raise InputError(f"{root / ODOMETRY}: a frame's number must be 0 or more")
    for i, number in enumerate(rows["frame"].astype(int).tolist()):
        image, name = pictures.path(number), f"{number:06d}.png"
        if image is None or (depths and name not in depths):
            missing += 1
            continue
        values = [float(rows[name][i]) for name in INTRINSICS] if own else shared
        lens = Lens(camera_of(*pictures.size, values or [], str(root / (ODOMETRY if own else MATRIX))))
        sure = root / "confidence" / name if depths and name in confidences else None
        views.append(View(float(rows["timestamp"][i]), image, lens, root / "depth" / name if depths else None, sure))
        files += [p.relative_to(root).as_posix() for p in (views[-1].depth, sure) if p is not None]
        files += [] if pictures.video else [image.relative_to(root).as_posix()]
        kept.append(i)
    notes += [f"{missing} poses without an image or depth left out"] if missing else []
    if not views:
        raise InputError(f"{root}: none of the {missing} poses in {ODOMETRY} has an image and depth")
    poses = np.column_stack([rows[name] for name in POSE])[kept]
    poses[:, 3:] = unit_quaternions(poses[:, 3:], str(root / ODOMETRY))
    settings = f"stray 1 {confidence} up={up} floor_m={floor_m}"
    source = Source(
        root, root.resolve().name, settings, views, matrices(poses), files, notes, png_depth,
        min_confidence=confidence, known_up=Y_UP, read_colour=pictures.read, handheld=True,
        readers=1 if pictures.video else READERS,
    )  # fmt: skip
    return PosedImages(source, up, floor_m)


@dataclass(frozen=True)
class _Pictures:
    """The colour images: of a folder, or of the video."""

    size: tuple[int, int]
    path: Callable[[int], Path | None]
    read: Callable[[View], Colours] | None
    video: bool


def _pictures(root: Path) -> _Pictures:
    folder = root / "rgb"
    if folder.is_dir():
        found = {int(m[1]): folder / m[0] for m in map(COLOUR.fullmatch, sorted(names_in(folder))) if m}
        if not found:
            raise InputError(f"{folder} holds no image 000000.jpg")
        return _Pictures(image_size(found[min(found)]), found.get, None, False)
    if not (root / VIDEO).is_file():
        raise InputError(f"{root} holds neither {VIDEO} nor a folder rgb/ of images")
    video = Video(root / VIDEO)

    def named(number: int) -> Path | None:
        return Path(str(number)) if 0 <= number < len(video) else None

    return _Pictures(video.size, named, lambda view: video.frame(int(view.colour.name)), True)


def _matrix(path: Path) -> list[float]:
    lines = [line.split(",") for line in read_text(path, 1 << 16).splitlines() if line.strip()]
    if len(lines) != 3 or any(len(line) != 3 for line in lines):
        raise InputError(f"{path} must hold 3 lines of 3 numbers")
    matrix = [numbers(line, str(path)) for line in lines]
    return [matrix[0][0], matrix[1][1], matrix[0][2], matrix[1][2]]
