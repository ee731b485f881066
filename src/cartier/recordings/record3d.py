"""Record3D (iPhone): a .r3d file or its unpacked content, or the "EXR + JPG" export (metadata.json, rgb/, depth/).

Poses are ARKit's: OpenGL camera axes, world with y up. Depth is smaller than colour, in float32 metres: LZFSE-packed in
a .r3d (needs pyliblzfse), EXR in the export (needs OpenEXR). Depth below ``confidence`` (0, 1 or 2) is dropped if the
file holds it. Intrinsics are the frame's own where they are given. Images of a phone held sideways are turned upright.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError, MissingExtra, brief
from cartier.io import images
from cartier.io.files import read_bytes
from cartier.recordings.common.depth import read_exr, valid
from cartier.recordings.common.files import numbers
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import Colours, Depths, PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import GL_FROM_OPTICAL, Y_UP, matrices, pose_numbers, unit_quaternions

EXTRA = "phone"
MAX_BYTES = 64 << 20
LZFSE_BLOCKS = (b"bvx2", b"bvx1", b"bvxn", b"bvx-")


def matches(path: Path) -> bool:
    """Whether a path is a .r3d file or a folder of Record3D's."""
    if path.is_file():
        return path.suffix == ".r3d"
    packed, exported = (path / "metadata", path / "rgbd"), (path / "metadata.json", path / "rgb")
    return any(head.is_file() and images.is_dir() for head, images in (packed, exported))


def open(
    path: str | Path, confidence: int = 1, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read a capture; ``confidence`` is the least that depth must have, 0 for all of it."""
    check_confidence(confidence, 2)
    box = _Box(Path(path))
    head = _head(box)
    poses = _rows(head, "poses", 7, box.where)
    kept = [i for i in range(len(poses)) if box.has(box.colour(i))]
    notes = [f"{len(poses) - len(kept)} poses without an image left out"] if len(kept) < len(poses) else []
    if not kept:
        raise InputError(f"{box.where}: none of its {len(poses)} poses has an image {box.colour(0)}")
    lenses = _lenses(head, box, kept)
    with_depth = [box.has(box.depth(i)) for i in kept]
    if any(with_depth) and not all(with_depth):
        raise InputError(f"{box.where}: {box.depth(kept[with_depth.index(False)])} is missing")
    times_s = _times(head, len(poses), box.where)
    depths = [Path(box.depth(i)) if any(with_depth) else None for i in kept]
    views = [
        View(times_s[i], Path(box.colour(i)), lens, depth) for i, lens, depth in zip(kept, lenses, depths, strict=True)
    ]
    quaternions = unit_quaternions(poses[:, :4], box.where)
    world_from_gl = matrices(np.hstack([poses[:, 4:], quaternions]))[kept]
    size = (0, 0)
    if box.packed and any(with_depth):
        size = (_whole(head, "dw", box.where), _whole(head, "dh", box.where))
        _lzfse()  # a missing package is reported when the recording is opened
    source = Source(
        box.root, f"record3d 1 {confidence}", views, world_from_gl @ GL_FROM_OPTICAL, box.files(views), notes,
        lambda name: box.read_depth(name, size, confidence), box.read_colour, box.name, known_up=Y_UP,
    )  # fmt: skip
    return PosedImages(source, up, floor_m)


class _Box:
    """The files of a capture, wherever they lie: in a zip, or in a folder packed or exported."""

    def __init__(self, path: Path) -> None:
        self.where, path = str(path), path.resolve()
        self.name, self._path, self._zip = path.stem, path, None
        if path.is_dir():
            self.root = path
            self.packed = (path / "rgbd").is_dir()
            self._names: set[str] | None = None
            return
        self.root, self.packed = path.parent, True
        try:
            self._zip = zipfile.ZipFile(path)
        except Exception as error:  # zipfile's share no base class
            raise InputError(f"{path} is no readable .r3d file ({brief(error)})") from error
        self._names = set(self._zip.namelist())

    @property
    def head(self) -> str:
        return "metadata" if self.packed else "metadata.json"

    def colour(self, i: int) -> str:
        return f"{'rgbd' if self.packed else 'rgb'}/{i}.jpg"

    def depth(self, i: int) -> str:
        return f"rgbd/{i}.depth" if self.packed else f"depth/{i}.exr"

    def has(self, name: str) -> bool:
        return (self._path / name).is_file() if self._names is None else name in self._names

    def files(self, views: Sequence[View]) -> list[str]:
        if self._zip is not None:
            return [self._path.name]
        names = [path.as_posix() for view in views for path in (view.colour, view.depth) if path is not None]
        sure = [name.removesuffix(".depth") + ".conf" for name in names if name.endswith(".depth")]
        return [self.head, *names, *(name for name in sure if self.has(name))]

    def get(self, name: str) -> bytes:
        if self._zip is None:
            return read_bytes(self._path / name, MAX_BYTES)
        try:
            if self._zip.getinfo(name).file_size > MAX_BYTES:
                raise ValueError(f"larger than {MAX_BYTES} bytes")
            with self._zip.open(name) as file:
                return file.read(MAX_BYTES)
        except Exception as error:  # zipfile's and zlib's share no base class
            raise InputError(f"{self.where}: {name} is missing or damaged ({brief(error)})") from error

    def size(self, name: str) -> tuple[int, int]:
        """(width, height) of an image."""
        return images.decoded_size(self.get(name), f"{self.where}: {name}")

    def read_colour(self, view: View) -> Colours:
        name = view.colour.as_posix()
        return images.decode_rgb(self.get(name), view.lens.camera, f"{self.where}: {name}")

    def read_depth(self, path: Path, size: tuple[int, int], confidence: int) -> Depths:
        name = path.as_posix()
        if not self.packed:
            return valid(read_exr(self._path / name))
        width, height = size
        depth_m = valid(self._unpacked(name, width * height * 4).view("<f4").reshape(height, width))
        sure = name.removesuffix(".depth") + ".conf"
        if confidence and self.has(sure):
            depth_m[self._unpacked(sure, width * height).reshape(height, width) < confidence] = np.nan
        return depth_m

    def _unpacked(self, name: str, size: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
        """The ``size`` bytes of an LZFSE file; its first block must not claim more."""
        packed = self.get(name)
        claimed = int.from_bytes(packed[4:8], "little")
        try:
            if packed[:4] not in LZFSE_BLOCKS or claimed > size or len(packed) > size + 64:
                raise ValueError(f"it should unpack to {size} bytes")
            plain = _lzfse()(packed)
            if len(plain) != size:
                raise ValueError(f"it should unpack to {size} bytes, but it has {len(plain)}")
        except (ValueError, RuntimeError) as error:
            raise InputError(f"{self.where}: {name} is damaged ({brief(error)})") from error
        return np.frombuffer(plain, np.uint8)


def _lzfse() -> Callable[[bytes], bytes]:
    try:
        import liblzfse
    except ImportError as error:
        raise MissingExtra(
            "depth in a .r3d is packed with LZFSE: pip install pyliblzfse (it is compiled on your machine), or share "
            "the capture from the app as 'EXR + JPG sequence'"
        ) from error

    def unpack(packed: bytes) -> bytes:
        try:
            return bytes(liblzfse.decompress(packed))
        except liblzfse.error as error:
            raise ValueError("no LZFSE") from error

    return unpack


def _head(box: _Box) -> dict[str, Any]:
    try:
        head = json.loads(box.get(box.head))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{box.where}: {box.head} is not valid JSON ({brief(error)})") from error
    if not isinstance(head, dict):
        raise InputError(f"{box.where}: {box.head} must hold a JSON object")
    return head


def _rows(head: dict[str, Any], field: str, length: int, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    rows = head.get(field)
    if not isinstance(rows, list) or not rows or not all(isinstance(r, list) and len(r) == length for r in rows):
        raise InputError(f"{where}: the metadata's {field!r} must be a list of lists of {length} numbers")
    read = pose_numbers if field == "poses" else numbers
    return np.array([read(row, f"{where}: {field} {i}") for i, row in enumerate(rows)])


def _whole(head: dict[str, Any], field: str, where: str) -> int:
    value = head.get(field)
    if type(value) is not int or not 0 < value <= 1 << 13:
        raise InputError(f"{where}: the metadata's {field!r} must be a size in pixels, got {brief(value, 40)!r}")
    return value


def _lenses(head: dict[str, Any], box: _Box, frames: Sequence[int]) -> list[Lens]:
    """Each frame's lens at the size of its images; the metadata's may be for another size."""
    if head.get("perFrameIntrinsicCoeffs"):
        rows = _rows(head, "perFrameIntrinsicCoeffs", 4, box.where)
        if max(frames) >= len(rows):
            where, last = box.where, max(frames)
            raise InputError(f"{where}: there are intrinsics for {len(rows)} frames, but images up to {last}")
        values = [rows[i].tolist() for i in frames]
    else:
        flat = _rows({"K": [head.get("K")]}, "K", 9, box.where)[0]  # column by column
        values = [[flat[0], flat[4], flat[6], flat[7]]] * len(frames)
    size = box.size(box.colour(frames[0]))
    stated = (_whole(head, "w", box.where), _whole(head, "h", box.where)) if "w" in head else size
    return [Lens(camera_of(*stated, four, box.where).scaled(*size)) for four in values]


def _times(head: dict[str, Any], count: int, where: str) -> list[float]:
    stamps = head.get("frameTimestamps")
    if isinstance(stamps, list) and len(stamps) == count:
        return numbers(stamps, f"{where}: frameTimestamps")
    fps = numbers([head.get("fps", 60)], f"{where}: fps")[0]
    if fps <= 0:
        raise InputError(f"{where}: fps must be positive, got {fps}")
    return [i / fps for i in range(count)]
