"""3D Scanner App (iPhone with LiDAR): its "All Data" export, frame_00000.json, .jpg, depth_00000.png, conf_00000.png.

Each JSON file holds ``cameraPoseARFrame``, 16 numbers row by row, and ``intrinsics``, 9 numbers row by row, in pixels
of the JPEG. Poses are ARKit's: OpenGL camera axes, world with y up. Frames without an image are left out. Depth is in
millimetres and smaller than colour; depth below ``confidence`` (0, 1 or 2) is dropped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError, brief
from cartier.io.files import read_json
from cartier.io.images import image_size
from cartier.recordings.common.files import names_in, numbers, relative
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import GL_FROM_OPTICAL, Y_UP, pose_numbers, rigid

FRAME = re.compile(r"frame_(\d{1,9})\.json", re.ASCII)
FRAMES_PER_SECOND = 60.0


def matches(path: Path) -> bool:
    """Whether a folder holds frame_00000.json and frame_00000.jpg."""
    if not path.is_dir():
        return False
    names = names_in(path)
    return any(name.removesuffix("json") + "jpg" in names for name in names if FRAME.fullmatch(name))


def open(
    path: str | Path, confidence: int = 1, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read a scan; ``confidence`` is the least that depth must have, 0 for all of it."""
    check_confidence(confidence, 2)
    root = Path(path)
    names = names_in(root)
    every = sorted((int(m[1]), m[1]) for m in map(FRAME.fullmatch, names) if m)
    deep = any(f"depth_{digits}.png" in names for _, digits in every)
    kept = [
        (number, digits)
        for number, digits in every
        if f"frame_{digits}.jpg" in names and (not deep or f"depth_{digits}.png" in names)
    ]
    if not kept:
        raise InputError(f"{root}: none of its {len(every)} frames has an image frame_00000.jpg and depth")
    size = image_size(root / f"frame_{kept[0][1]}.jpg")
    views, poses, files, timed = [], [], [], True
    for number, digits in kept:
        file = root / f"frame_{digits}.json"
        head = read_json(file)
        head = head if isinstance(head, dict) else {}
        pose = pose_numbers(_list(head, "cameraPoseARFrame", 16, file), f"{file}: cameraPoseARFrame")
        k = numbers(_list(head, "intrinsics", 9, file), f"{file}: intrinsics")
        timed &= "time" in head
        time_s = numbers([head.get("time", number / FRAMES_PER_SECOND)], f"{file}: time")[0]
        lens = Lens(camera_of(*size, (k[0], k[4], k[2], k[5]), str(file)))
        depth = root / f"depth_{digits}.png" if deep else None
        trust = root / f"conf_{digits}.png" if deep and f"conf_{digits}.png" in names else None
        views.append(View(time_s, root / f"frame_{digits}.jpg", lens, depth, trust))
        poses.append(rigid(np.reshape(pose, (4, 4)), f"{file}: cameraPoseARFrame") @ GL_FROM_OPTICAL)
        files += relative(root, file, views[-1].colour, depth, trust)
    left = len(every) - len(kept)
    notes = [f"{left} frames without an image or depth left out"] if left else []
    notes += [] if timed else [f"times assumed: {FRAMES_PER_SECOND:g} frames per second, by frame number"]
    settings = f"scannerapp 1 {confidence}"
    source = Source(root, settings, views, np.array(poses), files, notes, min_confidence=confidence, known_up=Y_UP)
    return PosedImages(source, up, floor_m)


def _list(head: dict[str, object], name: str, size: int, file: Path) -> list[object]:
    value = head.get(name)
    if not isinstance(value, list) or len(value) != size:
        raise InputError(f"{file}: {name} must be a list of {size} numbers, got {brief(value, 40)}")
    return value
