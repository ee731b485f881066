"""7-Scenes: frame-000000.color.jpg|png, .depth.png (mm), .pose.txt (4x4 camera-to-world), camera-intrinsics.txt.

The first camera defines its world. Up and the floor are estimated. The files carry no times: 30 frames per second are
assumed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.images import image_size, read_depth, read_rgb
from cartier.recordings.common.edges import Registration, fits
from cartier.recordings.common.files import names_in
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import PosedImages, Source, View
from cartier.recordings.common.poses import read_matrix, rigid
from cartier.types import Camera

COLOUR = re.compile(r"(frame-(\d{1,9}))\.color\.(?:jpg|png)", re.ASCII)
INTRINSICS = "camera-intrinsics.txt"
FRAMES_PER_SECOND = 30.0
REGISTRATION = (0.91, -8.0, -2.0)
"""Its depth is published raw, not registered to colour: how it has to be zoomed and moved (px of 640, at 2 m)."""
FULL_WIDTH = 640
LOOKED, CLEARER, LEAST_FIT = 10, 1.3, 0.05  # frames whose edges tell raw depth, and how well they fit if moved


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
    moved = _raw(root, colours, depths, camera)
    notes = [f"times assumed: {FRAMES_PER_SECOND:g} frames per second, by frame number"]
    if moved is not None:
        camera = moved.camera(camera)
        notes.append(
            f"depth zoomed by {moved.zoom:g} and moved by ({REGISTRATION[1]:g}, {REGISTRATION[2]:g}) px onto the colour"
            f" images, as 7-Scenes needs: correlation of edges {moved.fit:.2f}, {moved.fit_as_given:.2f} as published"
        )
    views = [
        View(number / FRAMES_PER_SECOND, root / colour, Lens(camera), depth)
        for number, colour, depth in zip(frames, colours, depths, strict=True)
    ]
    source = Source(
        root, "sevenscenes 1" if moved is None else "sevenscenes 2 registered", views,
        np.array([rigid(read_matrix(pose, 4), str(pose)) for pose in poses]),
        [INTRINSICS, *(pose.name for pose in poses), *colours, *(depth.name for depth in depths if depth is not None)],
        notes, partial(read_depth, camera=camera), handheld=False, registration=moved,
    )  # fmt: skip
    return PosedImages(source, up, floor_m)


def _raw(root: Path, colours: Sequence[str], depths: Sequence[Path | None], camera: Camera) -> Registration | None:
    """The published registration, if the edges say that this depth needs it: others write this layout registered."""
    images, step = [], max(1, camera.width // 320)
    for number in np.unique(np.linspace(0, len(colours) - 1, LOOKED).round().astype(int)).tolist():
        depth = depths[number]
        with suppress(InputError):  # whoever asks for that frame is told
            if depth is not None:
                grey = read_rgb(root / colours[number], camera).mean(2, dtype=np.float32) / 255
                images.append((grey[::step, ::step], read_depth(depth, camera)[::step, ::step]))
    zoom, dx, dy = REGISTRATION
    known = Registration(zoom, dx / FULL_WIDTH, dy / FULL_WIDTH, 0, 0, 0)
    if not images:
        return None
    fit, as_given = fits(images, known)
    return replace(known, fit=fit, fit_as_given=as_given) if fit > max(CLEARER * as_given, LEAST_FIT) else None


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
