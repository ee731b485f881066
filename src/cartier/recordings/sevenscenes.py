"""7-Scenes: frame-000000.color.jpg|png, .depth.png (mm), .pose.txt (4x4 camera-to-world), camera-intrinsics.txt.

The first camera defines its world. Up and the floor are estimated. The files carry no times: 30 frames per second are
assumed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.images import image_size, read_depth
from cartier.recordings.common.files import names_in
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import PosedImages, Source, View
from cartier.recordings.common.poses import read_matrix, rigid
from cartier.types import Camera

COLOUR = re.compile(r"(frame-(\d{1,9}))\.color\.(?:jpg|png)", re.ASCII)
INTRINSICS = "camera-intrinsics.txt"
FRAMES_PER_SECOND = 30.0
REGISTRATION = (0.91, -8.0, -2.0)
"""Its depth is published raw, not registered to colour: how it would have to be zoomed and moved (px, at 2 m)."""


def matches(path: Path) -> bool:
    """Whether a folder holds 7-Scenes frames."""
    return path.is_dir() and any(COLOUR.fullmatch(name) for name in names_in(path))


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a sequence; ``up`` (x, y, z in the source's world) and ``floor_m`` (along up) override the estimates."""
    root = Path(path)
    colours, stems, frames, has_depth = _listing(root)
    poses = [root / f"{stem}.pose.txt" for stem in stems]
    depths = [root / f"{stem}.depth.png" if has_depth else None for stem in stems]
    camera = _camera(root, root / colours[0])
    views = [
        View(number / FRAMES_PER_SECOND, root / colour, Lens(camera), depth)
        for number, colour, depth in zip(frames, colours, depths, strict=True)
    ]
    source = Source(
        root, "sevenscenes 1", views, np.array([rigid(read_matrix(pose, 4), str(pose)) for pose in poses]),
        [INTRINSICS, *(pose.name for pose in poses), *colours, *(depth.name for depth in depths if depth is not None)],
        [f"times assumed: {FRAMES_PER_SECOND:g} frames per second, by frame number"],
        partial(read_depth, camera=camera),
        handheld=False, known_registration=REGISTRATION,
    )  # fmt: skip
    return PosedImages(source, up, floor_m)


def _listing(root: Path) -> tuple[list[str], list[str], list[int], bool]:
    """Colour files, stems and frame numbers in order, and whether there is depth; each frame must be complete."""
    names = names_in(root)
    found = sorted((int(m[2]), m[1], m[0]) for m in map(COLOUR.fullmatch, names) if m)
    if not found:
        raise InputError(f"{root} is no 7-Scenes folder: it holds no frame-000000.color.jpg or .png")
    stems = [stem for _, stem, _ in found]
    if len(set(stems)) != len(stems):
        twice = next(s for s in stems if stems.count(s) > 1)
        raise InputError(f"{root}: {twice}.color is there as .jpg and as .png; delete one of them")
    has_depth = any(name.endswith(".depth.png") for name in names)
    for kind in (".pose.txt", ".depth.png") if has_depth else (".pose.txt",):
        _complete(root, names, stems, kind)
    return [colour for _, _, colour in found], stems, [number for number, _, _ in found], has_depth


def _complete(root: Path, names: set[str], stems: Sequence[str], kind: str) -> None:
    """Refuse a folder in which not each colour image has its file of a kind, or a file of a kind its colour image."""
    there = {name.removesuffix(kind) for name in names if name.startswith("frame-") and name.endswith(kind)}
    odd = sorted(there.symmetric_difference(stems))
    if odd:
        missing = f"{odd[0]}{kind if odd[0] in stems else '.color.jpg or .png'}"
        raise InputError(f"{root} holds {len(stems)} colour images but {len(there)} {kind} files: {missing} is missing")


def _camera(root: Path, first_image: Path) -> Camera:
    path = root / INTRINSICS
    if not path.is_file():
        raise InputError(
            f"{path} is missing: write the camera's 3x3 matrix there, 3 lines 'fx 0 cx', '0 fy cy', '0 0 1' in pixels "
            "(7-Scenes itself gives 585 0 320, 0 585 240, 0 0 1)"
        )
    matrix = read_matrix(path, 3)
    off = matrix.copy()
    off[[0, 1, 2, 0, 1], [0, 1, 2, 2, 2]] = 0  # fx, fy, 1, cx and cy
    if off.any() or matrix[2, 2] != 1:
        raise InputError(f"{path} must read 'fx 0 cx', '0 fy cy', '0 0 1' (skew is not supported)")
    return camera_of(*image_size(first_image), matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), str(path))
