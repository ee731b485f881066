"""ScanNet, as its SensReader exports it: color/0.jpg, depth/0.png (mm), pose/0.txt (camera-to-world), intrinsic/*.txt.

Camera axes are optical. Frames without tracking have a pose of -inf and are left out. Depth has its own lens, in the
colour camera's place, and is resampled to the colour camera's pixels. Dai et al., CVPR 2017.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.images import image_size
from cartier.recordings.common.files import names_in
from cartier.recordings.common.lens import Lens, camera_of, off_centre
from cartier.recordings.common.posed import PosedImages, Source, View
from cartier.recordings.common.poses import read_matrix, rigid
from cartier.types import Camera

COLOUR = re.compile(r"(\d{1,9})\.(?:jpg|png)", re.ASCII)
COLOUR_MATRIX, DEPTH_MATRIX = "intrinsic/intrinsic_color.txt", "intrinsic/intrinsic_depth.txt"
SIZES = {
    COLOUR_MATRIX: (1296, 968),
    DEPTH_MATRIX: (640, 480),
}  # px of the sensors: the exported intrinsics are for them
SAME_SHAPE = 0.02
FRAMES_PER_SECOND = 30.0


def matches(path: Path) -> bool:
    """Whether a folder holds color/, pose/ and intrinsic/intrinsic_color.txt."""
    return (path / COLOUR_MATRIX).is_file() and (path / "color").is_dir() and (path / "pose").is_dir()


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read an exported scan; its world is nearly level, and is levelled by its surfaces unless ``up`` is given."""
    root = Path(path)
    found = sorted((int(m[1]), m[0]) for m in map(COLOUR.fullmatch, names_in(root / "color")) if m)
    if not found:
        raise InputError(f"{root / 'color'} holds no image 0.jpg")
    notes: list[str] = []
    colour = _camera(root, COLOUR_MATRIX, root / "color" / found[0][1], notes)
    depths = names_in(root / "depth", optional=True)
    poses, views, files = [], [], [COLOUR_MATRIX]
    for number, name in found:
        pose = read_matrix(root / "pose" / f"{number}.txt", 4)
        if depths and f"{number}.png" not in depths:
            raise InputError(f"{root / 'depth' / f'{number}.png'} is missing")
        depth = root / "depth" / f"{number}.png" if depths else None
        poses.append(rigid(pose, str(root / "pose" / f"{number}.txt")))
        views.append(View(number / FRAMES_PER_SECOND, root / "color" / name, Lens(colour), depth))
        files += [f"color/{name}", f"pose/{number}.txt", *([f"depth/{number}.png"] if depth else [])]
    notes.append(f"times assumed: {FRAMES_PER_SECOND:g} frames per second, by frame number")
    depth_lens = None
    if views[0].depth is not None and (root / DEPTH_MATRIX).is_file():
        depth_lens = Lens(_camera(root, DEPTH_MATRIX, views[0].depth, notes))
        files.append(DEPTH_MATRIX)
    return PosedImages(
        Source(root, "scannet 2", views, np.array(poses), files, notes, depth_lens=depth_lens), up, floor_m
    )


def _camera(root: Path, name: str, image: Path, notes: list[str]) -> Camera:
    """The camera at its images' size. Resized images often come with the intrinsics of the sensor's own size.

    A matrix is for the size in whose middle its principal point lies.
    """
    fx, fy, cx, cy = (float(v) for v in read_matrix(root / name, 4)[[0, 1, 0, 1], [0, 1, 2, 2]])
    size, sensor = image_size(image), SIZES[name]
    same_shape = abs(size[0] / size[1] / (sensor[0] / sensor[1]) - 1) < SAME_SHAPE
    if not same_shape or off_centre(size, (cx, cy)) <= off_centre(sensor, (cx, cy)):
        return camera_of(*size, (fx, fy, cx, cy), str(root / name))
    whole = camera_of(*sensor, (fx, fy, cx, cy), str(root / name))
    notes.append(f"{name} is for images of {sensor[0]}x{sensor[1]} px; it was scaled to {size[0]}x{size[1]}")
    return whole.scaled(*size)
