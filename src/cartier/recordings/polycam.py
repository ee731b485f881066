"""Polycam (iPhone with LiDAR): its "raw data" export, keyframes/ with images, cameras, depth and confidence.

The corrected images and cameras, which the app makes when it closes loops, are preferred. Poses are ARKit's: OpenGL
camera axes, world with y up. Depth is in millimetres and smaller than colour; depth below ``confidence`` (0, 127 or
255) is dropped. Images of a phone held upright are turned upright. The layout is that of Polycam's own polyform.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.files import read_json
from cartier.io.images import image_size
from cartier.recordings.common.files import names_in, read_fields, relative
from cartier.recordings.common.lens import Lens, camera_of, off_centre
from cartier.recordings.common.posed import PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import GL_FROM_OPTICAL, Y_UP, Matrix, pose_numbers, rigid
from cartier.types import Camera

FOLDER = "keyframes"
SETS = (("corrected_images", "corrected_cameras"), ("images", "cameras"))
SIZE, INTRINSICS = ("width", "height"), ("fx", "fy", "cx", "cy")
POSE = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))


def matches(path: Path) -> bool:
    """Whether a folder holds keyframes/images and keyframes/cameras."""
    return all((path / FOLDER / name).is_dir() for name in SETS[1])


def open(
    path: str | Path, confidence: int = 127, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read a capture; ``confidence`` is the least that depth must have, 0 for all of it."""
    check_confidence(confidence, 255)
    root = Path(path)
    base = root / FOLDER
    depths, sure = (_names(base / name, ".png") for name in ("depth", "confidence"))
    every = {stem for _, cameras in SETS for stem in _names(base / cameras, ".json")}
    for images, cameras in SETS:
        there = _names(base / cameras, ".json")
        kept = sorted(
            (stem for stem in there & _names(base / images, ".jpg") if not depths or stem in depths),
            key=lambda stem: (len(stem), stem),
        )
        if kept:
            break
    else:
        raise InputError(f"{base}: none of its {len(every)} {cameras} has an image in {images} and depth")
    odd = next((stem for stem in kept if not (stem.isascii() and stem.isdigit() and len(stem) < 20)), None)
    if odd is not None:
        raise InputError(f"{base / cameras / odd}.json: a keyframe is named by its time in microseconds")
    uncorrected, incomplete = len(every - there), len(there) - len(kept)
    notes = [f"{incomplete} keyframes without an image or depth left out"] if incomplete else []
    if images == SETS[1][0]:
        notes.append("there are no corrected cameras: the poses are ARKit's own, which drift in large scans")
    elif uncorrected:
        notes.append(
            f"{uncorrected} of {len(every)} keyframes left out: they have no corrected camera, and the others' world "
            f"is not theirs (without {FOLDER}/{cameras} all are read with ARKit's own poses)"
        )
    views, poses, files = [], [], []
    for stem in kept:
        camera, pose = _camera(base / cameras / f"{stem}.json", base / images / f"{stem}.jpg")
        depth = base / "depth" / f"{stem}.png" if depths else None
        trust = base / "confidence" / f"{stem}.png" if depths and stem in sure else None
        views.append(View(int(stem) / 1e6, base / images / f"{stem}.jpg", Lens(camera), depth, trust))
        poses.append(pose @ GL_FROM_OPTICAL)
        files += relative(root, base / cameras / f"{stem}.json", views[-1].colour, depth, trust)
    settings = f"polycam 1 {confidence}"
    source = Source(root, settings, views, np.array(poses), files, notes, min_confidence=confidence, known_up=Y_UP)
    return PosedImages(source, up, floor_m)


def _names(folder: Path, suffix: str) -> set[str]:
    """The names with a suffix in a folder, without it; none if there is no such folder."""
    return {name.removesuffix(suffix) for name in names_in(folder, optional=True) if name.endswith(suffix)}


def _camera(path: Path, image: Path) -> tuple[Camera, Matrix]:
    """The camera at the size of its image, and world_from_camera (4, 4) with OpenGL axes."""
    head = read_json(path)
    values = read_fields(head, INTRINSICS, str(path))
    matrix = np.eye(4)
    matrix[:3] = np.reshape(pose_numbers(read_fields(head, POSE, str(path), False), str(path)), (3, 4))
    return _sized(path, image, head, values), rigid(matrix, str(path))


def _sized(path: Path, image: Path, head: dict[str, object], values: list[float]) -> Camera:
    """The camera at the size of its image.

    Newer exports state no size, so that the intrinsics are those of the image or of the same keyframe as it was taken:
    that one in whose middle the principal point lies.
    """
    shown = image_size(image)
    if all(name in head for name in SIZE):
        width, height = (int(side) for side in read_fields(head, SIZE, str(path)))
        return camera_of(width, height, values, str(path)).scaled(*shown)
    taken = path.parents[1] / SETS[1][1] / path.name
    sizes = [shown]
    other = read_json(taken) if taken != path and taken.is_file() else None
    if isinstance(other, dict) and all(name in other for name in SIZE):
        width, height = (int(side) for side in read_fields(other, SIZE, str(taken)))
        sizes.append((width, height))
    right = min(sizes, key=lambda size: off_centre(size, (values[2], values[3])) if min(size) > 0 else np.inf)
    return camera_of(*right, values, str(path)).scaled(*shown)
