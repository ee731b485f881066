"""7-Scenes: frame-000000.color.jpg|png, .depth.png (mm), .pose.txt (4x4 camera-to-world), camera-intrinsics.txt.

Its world hangs on the first camera. Up and the floor are estimated (see ``cartier.mapping.gravity``), and the poses come out
levelled: z up, z = 0 on the floor. The files carry no times: 30 frames per second are assumed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError, frame_number
from cartier.io.images import image_size, read_depth, read_rgb
from cartier.mapping import gravity
from cartier.recordings.common.content import READERS, check_inside, content_hash, names_in
from cartier.recordings.common.poses import read_matrix, rigid
from cartier.recordings.common.tables import camera_of, check_floor, off_centre_notes
from cartier.types import Camera, Frame, TrueObject

COLOUR = re.compile(r"(frame-(\d{1,9}))\.color\.(?:jpg|png)", re.ASCII)
INTRINSICS = "camera-intrinsics.txt"
FRAMES_PER_SECOND = 30.0


def matches(path: Path) -> bool:
    """Whether a folder holds 7-Scenes frames."""
    return path.is_dir() and any(COLOUR.fullmatch(name) for name in names_in(path))


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a sequence folder; ``up`` (x, y, z in the source's world) and ``floor_m`` (along up) override the estimates."""
    return SevenScenes(Path(path), up, floor_m)


class SevenScenes:
    """A 7-Scenes sequence, levelled. Poses are read when it is opened, images when a frame is asked for."""

    truth: Sequence[TrueObject] | None = None
    readers = READERS
    known_registration = (0.91, -8.0, -2.0)
    """Its depth is published raw, not moved onto the colour: there it would be zoomed and moved so far (px, at 2 m)."""

    def __init__(self, root: Path, up: Sequence[float] | None, floor_m: float | None) -> None:
        self.name = root.resolve().name
        self._root = root
        self._colour, self._stems, self._numbers, self._has_depth = _listing(root)
        depths = [f"{stem}.depth.png" for stem in self._stems] if self._has_depth else []
        self._files = [INTRINSICS, *(f"{stem}.pose.txt" for stem in self._stems), *self._colour, *depths]
        check_inside(root, self._files)
        self._settings = f"sevenscenes 1 up={up} floor_m={floor_m}"
        self._fingerprint: str | None = None
        self.camera = _camera(root, root / self._colour[0])
        poses = np.array([rigid(read_matrix(p, 4), str(p)) for p in (root / f"{s}.pose.txt" for s in self._stems)])
        levelling = gravity.level(poses, self.camera, self._depth if self._has_depth else None, up, floor_m)
        self.level_from_world = levelling.level_from_world  # so that the doctor sees the poses as they were given
        self._poses = levelling.level_from_world @ poses
        check_floor(self._poses, floor_m)
        self._poses.setflags(write=False)
        self.notes: Sequence[str] = [
            *off_centre_notes(self.camera),
            *levelling.notes,
            f"times assumed: {FRAMES_PER_SECOND:g} frames per second, by frame number",
        ]

    def __len__(self) -> int:
        return len(self._stems)

    def __getitem__(self, index: int) -> Frame:
        i = frame_number(index, len(self), self.name)
        return Frame(
            index=i,
            time_s=self._numbers[i] / FRAMES_PER_SECOND,
            rgb=read_rgb(self._root / self._colour[i], self.camera),
            depth_m=self._depth(i) if self._has_depth else None,
            world_from_camera=self._poses[i],
            camera=self.camera,
        )

    def fingerprint(self) -> str:
        if self._fingerprint is None:
            self._fingerprint = content_hash(self._settings, self._root, self._files)
        return self._fingerprint

    def _depth(self, i: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return read_depth(self._root / f"{self._stems[i]}.depth.png", self.camera)


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
