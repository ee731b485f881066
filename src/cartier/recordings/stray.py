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
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.errors import MAX_PIXELS, InputError, brief
from cartier.io.files import check_file
from cartier.io.images import image_size
from cartier.recordings.common.files import READERS, names_in, read_table, relative
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import Colours, PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import Y_UP, matrices, read_matrix, unit_quaternions

EXTRA = "phone"
MATRIX, ODOMETRY, VIDEO = "camera_matrix.csv", "odometry.csv", "rgb.mp4"
COLOUR = re.compile(r"(\d{1,9})\.(?:jpg|png)", re.ASCII)
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
INTRINSICS = ("fx", "fy", "cx", "cy")
CODECS = (
    "h264",
    "hevc",
    "mpeg4",
    "mjpeg",
    "vp9",
    "av1",
    "prores",
)  # phones write these; FFmpeg's others are rarely read


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
    rows = read_table(root / ODOMETRY, ("timestamp", "frame", *POSE), INTRINSICS, notes, POSE)
    own = all(name in rows for name in INTRINSICS)
    shared = [] if own else read_matrix(root / MATRIX, 3, ",")[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    depths, confidences = (names_in(root / name, optional=True) for name in ("depth", "confidence"))
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
        lens = Lens(camera_of(*pictures.size, values, str(root / (ODOMETRY if own else MATRIX))))
        depth = root / "depth" / name if depths else None
        trust = root / "confidence" / name if depths and name in confidences else None
        views.append(View(float(rows["timestamp"][i]), image, lens, depth, trust))
        files += relative(root, depth, trust, None if pictures.video else image)
        kept.append(i)
    notes += [f"{missing} poses without an image or depth left out"] if missing else []
    if not views:
        raise InputError(f"{root}: none of the {missing} poses in {ODOMETRY} has an image and depth")
    poses = np.column_stack([rows[name] for name in POSE])[kept]
    poses[:, 3:] = unit_quaternions(poses[:, 3:], str(root / ODOMETRY))
    source = Source(
        root, f"stray 1 {confidence}", views, matrices(poses), files, notes, read_colour=pictures.read,
        min_confidence=confidence, known_up=Y_UP, readers=1 if pictures.video else READERS,
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


class Video:
    """An MP4 or MOV file. Nothing but the decoder's own few frames is held in memory."""

    def __init__(self, path: Path) -> None:
        import av

        self._path = path
        check_file(path)
        try:
            # a given format: a playlist with this suffix could name other files
            self._container = av.open(str(path.resolve()), format="mp4")
            self._stream = self._container.streams.video[0]
            codec = self._stream.codec_context
            if codec.name not in CODECS or codec.width * codec.height > MAX_PIXELS:
                raise ValueError(f"{codec.width}x{codec.height} px of {codec.name}; cartier reads {', '.join(CODECS)}")
            self._pts = sorted(p.pts for p in self._container.demux(self._stream) if p.pts is not None)
        except Exception as error:  # PyAV's share no base class
            raise InputError(f"{path} is no readable MP4 video ({brief(error)})") from error
        if not self._pts:
            raise InputError(f"{path} holds no picture")
        self.size: tuple[int, int] = (codec.width, codec.height)
        self._frames: Any = None
        self._next = -1

    def __len__(self) -> int:
        return len(self._pts)

    def frame(self, number: int) -> npt.NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB of a frame by its number."""
        if not 0 <= number < len(self._pts):
            raise InputError(f"{self._path} has {len(self._pts)} pictures; frame {number} is asked for")
        try:
            if number != self._next or self._frames is None:
                self._container.seek(self._pts[number], stream=self._stream, backward=True)
                self._frames = self._container.decode(self._stream)
            self._next = number + 1
            for frame in self._frames:
                if (frame.width, frame.height) != self.size:
                    raise ValueError(f"it is {frame.width}x{frame.height} px, the video {self.size[0]}x{self.size[1]}")
                if frame.pts is not None and frame.pts >= self._pts[number]:
                    return np.asarray(frame.to_ndarray(format="rgb24"))
        except Exception as error:  # PyAV's share no base class
            raise InputError(f"{self._path}: frame {number} cannot be decoded ({brief(error)})") from error
        raise InputError(f"{self._path} is damaged or truncated: frame {number} cannot be decoded")
