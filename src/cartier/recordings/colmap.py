"""COLMAP: a sparse model (cameras and images, .bin or .txt) beside or above images/; no scale and no depth.

Poses are camera-from-world with optical axes, in a world of any rotation and scale. The model lies in sparse/0, sparse,
colmap/sparse/0 or the folder itself. Up is estimated. The scale is guessed so that rooms are as large as usual,
whatever the model's units. Distortion is removed. The numbers of the camera models and the layouts of the files are
those of COLMAP's "Output Format". Schönberger and Frahm, CVPR 2016.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartier.contracts import Recording
from cartier.errors import MAX_SIDE_PX, InputError, brief
from cartier.geometry import invert
from cartier.io.bounded_file import File
from cartier.io.files import read_text
from cartier.recordings.common.files import absolute_notes, inside, numbers, relative
from cartier.recordings.common.lens import Lens, Model, camera_of, straight
from cartier.recordings.common.posed import PosedImages, Source, View
from cartier.recordings.common.poses import USUAL_WAY_M, matrices, unit_quaternions
from cartier.types import Array

PLACES = ("", "sparse/0", "sparse", "colmap/sparse/0")
FRAMES_PER_SECOND = 30.0
MAX_TEXT_BYTES = 1 << 29  # the points of each image stand in it, too
MAX_NAME = 1000
MAX_CAMERAS = 100_000
POINT_BYTES = 24
MOST_POINTS = 20_000  # tell the scale well enough
USUAL_DISTANCE_M = 2.0  # of what is seen from the camera


@dataclass(frozen=True)
class _Kind:
    """A camera model: how many focal lengths it has, and what follows them and the principal point."""

    focals: int
    coefficients: int
    lens: Model

    @property
    def size(self) -> int:
        return self.focals + 2 + self.coefficients


KINDS = {
    "SIMPLE_PINHOLE": _Kind(1, 0, "pinhole"),
    "PINHOLE": _Kind(2, 0, "pinhole"),
    "SIMPLE_RADIAL": _Kind(1, 1, "plumb_bob"),
    "RADIAL": _Kind(1, 2, "plumb_bob"),
    "OPENCV": _Kind(2, 4, "plumb_bob"),
    "OPENCV_FISHEYE": _Kind(2, 4, "equidistant"),
    "FULL_OPENCV": _Kind(2, 8, "plumb_bob"),
    "SIMPLE_RADIAL_FISHEYE": _Kind(1, 1, "equidistant"),
    "RADIAL_FISHEYE": _Kind(1, 2, "equidistant"),
    "SIMPLE_FISHEYE": _Kind(1, 0, "equidistant"),
    "FISHEYE": _Kind(2, 0, "equidistant"),
}
NUMBERS = {0: "SIMPLE_PINHOLE", 1: "PINHOLE", 2: "SIMPLE_RADIAL", 3: "RADIAL", 4: "OPENCV", 5: "OPENCV_FISHEYE"} | {
    6: "FULL_OPENCV", 8: "SIMPLE_RADIAL_FISHEYE", 9: "RADIAL_FISHEYE", 14: "SIMPLE_FISHEYE", 15: "FISHEYE",
}  # fmt: skip
"""Camera models by their number in cameras.bin."""


@dataclass(frozen=True)
class _Image:
    """One image of a model: ``pose`` is x y z qx qy qz qw of camera_from_world."""

    key: int
    name: str
    camera: int
    pose: tuple[float, ...]


def matches(path: Path) -> bool:
    """Whether a folder holds a sparse model, and not nerfstudio's transforms.json, which says more."""
    return _model(path) is not None and not (path / "transforms.json").is_file()


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a model and its images; ``up`` (x, y, z in its world) and ``floor_m`` (along up) override the estimates."""
    root = Path(path)
    found = _model(root)
    if found is None:
        raise InputError(f"{root} holds no cameras and images of a sparse model, .bin or .txt")
    folder, suffix = found
    lenses = dict(_cameras(folder / f"cameras{suffix}"))
    where = str(folder / f"images{suffix}")
    pictures = sorted(_images(Path(where)), key=lambda image: image.name)
    base, names = _base(root, pictures, where)
    if base is None:
        named = f"{len(names)} images" + (f", such as {brief(names[0], 60)}" if names else "")
        there = f"none of them is in {root / 'images'}"
        raise InputError(f"{where} names {named}, but {there}: give the folder that holds images/ and sparse/")
    kept = [i for i, name in enumerate(names) if (base / name).is_file()]
    unknown = next((pictures[i].camera for i in kept if pictures[i].camera not in lenses), None)
    if unknown is not None:
        raise InputError(f"{where}: camera {unknown} is not in cameras{suffix}")
    missing = len(names) - len(kept)
    notes = [f"{missing} images of the model left out: they are missing"] if missing else []
    notes += absolute_notes((image.name for image in pictures), Path(where).name)
    others = [f"sparse/{n}" for n in range(1, 10) if folder.name == "0" and _pair(folder.parent / str(n))]
    notes += [f"the model has other parts that do not hang together with it: {', '.join(others)}"] if others else []
    notes.append(f"times assumed: {FRAMES_PER_SECOND:g} frames per second, in the order of the file names")
    rows = np.array([pictures[i].pose for i in kept])
    rows[:, 3:] = unit_quaternions(rows[:, 3:], where)
    views = [View(n / FRAMES_PER_SECOND, base / names[i], lenses[pictures[i].camera]) for n, i in enumerate(kept)]
    poses = np.array([invert(pose) for pose in matrices(rows)])
    positions = {pictures[i].key: poses[n, :3, 3] for n, i in enumerate(kept)}
    points = folder / f"points3D{suffix}"
    metres_per_unit, by = _scale(positions, points)
    poses[:, :3, 3] *= metres_per_unit
    notes.append(f"COLMAP knows no scale: metres are a guess, {by}; and it gives no depth, so no floor plan")
    head = [folder / f"{kind}{suffix}" for kind in ("cameras", "images")]
    files = relative(root, *head, *(view.colour for view in views), points if points.is_file() else None)
    source = Source(root, "colmap 2", views, poses, files, notes, scale_guessed=True)
    return PosedImages(source, up, floor_m)


def _base(root: Path, pictures: Sequence[_Image], where: str) -> tuple[Path | None, list[str]]:
    """The folder that holds images of a model, and their names below it; None if none does."""
    names = list[str]()
    for base in (root / "images", root):
        names = [inside(image.name, where, base) for image in pictures]
        if any((base / name).is_file() for name in names):
            return base, names
    return None, names


def _model(root: Path) -> tuple[Path, str] | None:
    """The folder of the model, and the suffix of its files."""
    return next(((root / place, suffix) for place in PLACES if (suffix := _pair(root / place))), None)


def _pair(folder: Path) -> str | None:
    both = (s for s in (".bin", ".txt") if all((folder / f"{kind}{s}").is_file() for kind in ("cameras", "images")))
    return next(both, None)


def _scale(cameras: Mapping[int, Array], points: Path) -> tuple[float, str]:
    """Metres per unit of a model, as usual in homes, and the reason; ``cameras`` are the images' positions by key."""
    away = [
        float(np.linalg.norm(point - cameras[key]))
        for key, point in (_points(points) if points.is_file() else ())
        if key in cameras
    ]
    if away and 1e-12 < (middle := float(np.median(away))) < 1e12:
        by = f"by which the points of the model lie {USUAL_DISTANCE_M:g} m from the cameras"
        return USUAL_DISTANCE_M / middle, by
    positions = np.array(list(cameras.values()))
    way = float(np.median(np.linalg.norm(positions - np.median(positions, axis=0), axis=1)))
    if not 1e-12 < way < 1e12:
        return 1.0, "as the model has them: it has no points, and its cameras stand in one place"
    return USUAL_WAY_M / way, f"by which the cameras stand {USUAL_WAY_M:g} m from their middle: the model has no points"


def _points(path: Path) -> Iterator[tuple[int, Array]]:
    """The first image that shows a point, and where (3,) it is, of the first points of a model."""
    if path.suffix == ".bin":
        file, at = File(path), 8
        (count,) = struct.unpack("<Q", file.at(0, 8))
        for _ in range(min(count, MOST_POINTS)):
            *xyz, _, tracks = struct.unpack("<8x3d3xdQ", file.at(at, 51))
            if tracks:
                (image,) = struct.unpack("<I", file.at(at + 51, 4))
                yield image, np.array(numbers(xyz, f"{path}: the point at byte {at}"))
            at += 51 + 8 * tracks
        return
    lines = (line for line in read_text(path, MAX_TEXT_BYTES).splitlines() if line.strip() and not line.startswith("#"))
    for line in itertools.islice(lines, MOST_POINTS):
        words = line.split(maxsplit=9)
        if len(words) >= 9:
            _, x, y, z, _, _, _, _, image = numbers(words[:9], str(path))
            yield int(image), np.array((x, y, z))


def _cameras(path: Path) -> Iterator[tuple[int, Lens]]:
    if path.suffix == ".bin":
        yield from _binary_cameras(File(path))
        return
    for number, line in enumerate(read_text(path, MAX_TEXT_BYTES).splitlines(), 1):
        words, where = line.split(), f"{path} line {number}"
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 4:
            raise InputError(f"{where}: a camera is 'ID MODEL WIDTH HEIGHT PARAMETERS', got {brief(line, 60)!r}")
        key, width, height = numbers((words[0], *words[2:4]), where)
        yield int(key), _lens(words[1], int(width), int(height), numbers(words[4:], where), where)


def _images(path: Path) -> Iterator[_Image]:
    if path.suffix == ".bin":
        yield from _binary_images(File(path))
        return
    after_image = False
    for number, line in enumerate(read_text(path, MAX_TEXT_BYTES).splitlines(), 1):
        may_be_points, after_image = after_image, False
        words = line.split(maxsplit=9)
        if not words or words[0].startswith("#") or (may_be_points and _are_points(line)):
            continue
        if len(words) < 10:
            raise InputError(
                f"{path} line {number}: an image is 'ID QW QX QY QZ TX TY TZ CAMERA NAME', got {len(words)} words"
            )
        key, qw, qx, qy, qz, x, y, z, camera = numbers(words[:9], f"{path} line {number}")
        yield _Image(int(key), words[9].strip(), int(camera), (x, y, z, qx, qy, qz, qw))
        after_image = True  # its points may follow, or an empty line, or neither


def _are_points(line: str) -> bool:
    """Whether a line holds the points of an image, x y ID of each, rather than the next image, which ends in a name."""
    words = line.split()
    try:
        return len(words) % 3 == 0 and bool([float(word) for word in (*words[:12], words[-1])])
    except ValueError:
        return False


def _binary_cameras(file: File) -> Iterator[tuple[int, Lens]]:
    at = 8
    (count,) = struct.unpack("<Q", file.at(0, 8))
    if count > MAX_CAMERAS:
        raise InputError(f"{file.path} is damaged: it claims {count} cameras")
    for _ in range(count):
        key, model, width, height = struct.unpack("<IiQQ", file.at(at, 24))
        where = f"{file.path}: camera {key}"
        kind = KINDS.get(NUMBERS.get(model, ""))
        if kind is None:
            raise InputError(f"{where} is of model {model}, which cartier does not read: {_undistort()}")
        values = struct.unpack(f"<{kind.size}d", file.at(at + 24, 8 * kind.size))
        yield key, _lens(NUMBERS[model], width, height, numbers(values, where), where)
        at += 24 + 8 * kind.size


def _binary_images(file: File) -> Iterator[_Image]:
    at = 8
    (count,) = struct.unpack("<Q", file.at(0, 8))
    for _ in range(count):  # each takes bytes of the file, which ends
        key, qw, qx, qy, qz, x, y, z, camera = struct.unpack("<I7dI", file.at(at, 64))
        head = file.at(at + 64, min(MAX_NAME + 1, file.size - at - 64))
        name, end, _ = head.partition(b"\0")
        if not end:
            raise InputError(f"{file.path} is damaged: the name of an image at byte {at + 64} does not end")
        at += 64 + len(name) + 1
        (points,) = struct.unpack("<Q", file.at(at, 8))
        at += 8 + POINT_BYTES * points
        decoded = name.decode("utf-8", "replace")
        pose = numbers((x, y, z, qx, qy, qz, qw), f"{file.path}: image {brief(decoded, 60)}")
        yield _Image(key, decoded, camera, tuple(pose))
    file.at(at, 0)  # the last image's points are there, too


def _lens(model: str, width: int, height: int, values: Sequence[float], where: str) -> Lens:
    kind = KINDS.get(model)
    if kind is None:
        raise InputError(f"{where}: camera model {brief(model, 40)!r} is not read: {_undistort()}")
    if len(values) != kind.size:
        raise InputError(f"{where}: {model} has {kind.size} parameters, got {len(values)}")
    if not 0 < width <= MAX_SIDE_PX or not 0 < height <= MAX_SIDE_PX:
        raise InputError(f"{where}: images must have 1 to {MAX_SIDE_PX} px a side, got {brief((width, height), 60)}")
    fx, fy = values[0], values[kind.focals - 1]
    cx, cy = values[kind.focals] - 0.5, values[kind.focals + 1] - 0.5  # its pixel (0, 0) is the corner of the first one
    camera = camera_of(width, height, (fx, fy, cx, cy), where)
    coefficients = tuple(values[kind.focals + 2 :])
    filled = coefficients + (0.0,) * (4 - len(coefficients))
    if kind.lens == "equidistant":  # without coefficients it bends all the same
        return Lens(camera, "equidistant", filled)
    return straight(camera, "plumb_bob", filled)


def _undistort() -> str:
    return f"cartier reads {', '.join(KINDS)}; 'colmap image_undistorter' writes images and a model of PINHOLE"
