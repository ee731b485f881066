"""RTSM sessions (iPhone with LiDAR): index.jsonl and messages.bin, which an RTSM server records.

A line of the index says where a message lies (``offset``, ``length``). A message holds JSON, a JPEG, depth (uint16, by
``depth_scale``) and ARKit's confidence (0, 1 or 2; depth below ``confidence`` is dropped), each after its length as a
little-endian uint32. Poses (``T_wc``, column by column) are ARKit's: OpenGL camera axes, world with y up. Images of a
phone held upright are turned upright; frames whose tracking was not normal are left out.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError, brief
from cartier.io import images
from cartier.io.files import check_file, parse_json, read_text
from cartier.recordings.common.depth import valid
from cartier.recordings.common.files import MAX_TABLE_BYTES, numbers
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import Colours, Depths, PosedImages, Source, View, check_confidence
from cartier.recordings.common.poses import GL_FROM_OPTICAL, Y_UP, rigid

INDEX, MESSAGES = "index.jsonl", "messages.bin"
MAX_BYTES, MAX_HEAD_BYTES = 64 << 20, 1 << 16  # of a message and of its JSON
INTRINSICS = ("fx", "fy", "cx", "cy")
FORMATS = {"rgb_format": "jpeg", "depth_format": "uint16_mm", "pose_format": "matrix4x4_col_major"}
MAX_SIDE_PX = 1 << 13


def matches(path: Path) -> bool:
    """Whether a folder holds index.jsonl and messages.bin."""
    return (path / INDEX).is_file() and (path / MESSAGES).is_file()


def open(
    path: str | Path, confidence: int = 1, up: Sequence[float] | None = None, floor_m: float | None = None
) -> Recording:
    """Read a session; ``confidence`` is the least that depth must have, 0 for all of it."""
    check_confidence(confidence, 2)
    root = Path(path)
    every = [Message.read(root, line, place) for line, place in _places(root / INDEX)]
    messages = [message for message in every if message.head.get("tracking_state", "normal") == "normal"]
    lost = len(every) - len(messages)
    if not messages:
        raise InputError(f"{root}: no frame whose tracking was normal, of {len(every)}")
    notes = [f"{lost} frames left out: their tracking was not normal"] if lost else []
    views = [
        View(message.number("timestamp_ns") / 1e9, Path(str(i)), message.lens(), Path(str(i)))
        for i, message in enumerate(messages)
    ]
    source = Source(
        root, f"rtsm 1 {confidence}", views, np.array([m.pose() for m in messages]), [INDEX, MESSAGES], notes,
        lambda name: messages[int(name.name)].depth_m(confidence), lambda view: messages[int(view.colour.name)].rgb(),
        known_up=Y_UP,
    )  # fmt: skip
    return PosedImages(source, up, floor_m)


@dataclass(frozen=True)
class Message:
    """A message of the session: its JSON, and where it lies."""

    file: Path
    where: str
    offset: int
    length: int
    head: dict[str, Any]

    @classmethod
    def read(cls, root: Path, line: int, place: tuple[int, int]) -> Message:
        """The message of a line of the index, its JSON alone. Raises InputError if it is damaged."""
        file, where = root / MESSAGES, f"{root / MESSAGES}: the message of line {line}"
        offset, length = place
        with _opened(file) as data:
            data.seek(offset)
            size = int.from_bytes(data.read(4), "little")
            text = data.read(size) if size <= min(length, MAX_HEAD_BYTES) else b""
        if not text or len(text) < size:
            raise InputError(f"{where} is damaged or cut off")
        head = parse_json(text, where)
        if not isinstance(head, dict):
            raise InputError(f"{where} must begin with a JSON object")
        for field, known in (
            ("rgb_format", "jpeg"),
            ("depth_format", "uint16_mm"),
            ("pose_format", "matrix4x4_col_major"),
        ):
            if head.get(field, known) != known:
                raise InputError(f"{where}: {field} must be {known}, got {brief(head[field], 40)!r}")
        return cls(file, where, offset, length, head)

    def number(self, field: str) -> float:
        return numbers([self.head.get(field)], f"{self.where}: {field}")[0]

    def whole(self, field: str) -> int:
        value = self.head.get(field)
        if type(value) is not int or not 0 < value <= MAX_SIDE_PX:
            raise InputError(f"{self.where}: {field} must be a size in pixels, got {brief(value, 40)!r}")
        return value

    def lens(self) -> Lens:
        """The colour camera, at the size of its images."""
        stated = self.whole("intrinsics_width"), self.whole("intrinsics_height")
        camera = camera_of(*stated, [self.number(field) for field in INTRINSICS], self.where)
        return Lens(camera.scaled(self.whole("rgb_width"), self.whole("rgb_height")))

    def pose(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(4, 4) world_from_camera, camera axes optical."""
        values = self.head.get("T_wc")
        if not isinstance(values, list) or len(values) != 16:
            raise InputError(f"{self.where}: T_wc must be 16 numbers")
        matrix = np.array(numbers(values, f"{self.where}: T_wc")).reshape(4, 4).T
        return np.asarray(rigid(matrix, self.where) @ GL_FROM_OPTICAL)

    def rgb(self) -> Colours:
        return images.decode_rgb(self._parts()[0], self.lens().camera, self.where)

    def depth_m(self, confidence: int) -> Depths:
        """(h, w) float32, NaN for no reading and for what is not sure enough."""
        shape = self.whole("depth_height"), self.whole("depth_width")
        _, packed, *sure = self._parts()
        depth_m = valid(self._image(packed, "<u2", shape) * np.float32(self.number("depth_scale")))
        if confidence and sure and len(sure[0]):
            depth_m[self._image(sure[0], "u1", shape) < confidence] = np.nan
        return depth_m

    def _image(self, packed: bytes, kind: str, shape: tuple[int, int]) -> np.ndarray[Any, np.dtype[Any]]:
        if len(packed) != np.dtype(kind).itemsize * shape[0] * shape[1]:
            raise InputError(
                f"{self.where} is damaged: an image of it has not the {shape[1]}x{shape[0]} px that it says"
            )
        return np.frombuffer(packed, kind).reshape(shape)

    def _parts(self) -> list[bytes]:
        """The JPEG, the depth and the confidence, if it is there."""
        with _opened(self.file) as data:
            data.seek(self.offset)
            message = data.read(self.length)
        parts, at = list[bytes](), 0
        while at + 4 <= len(message):
            (size,) = struct.unpack_from("<I", message, at)
            parts.append(message[at + 4 : at + 4 + size])
            at += 4 + size
        if at != self.length or len(parts) < 3:
            raise InputError(f"{self.where} is damaged or truncated")
        return parts[1:]


def _opened(file: Path) -> Any:
    check_file(file)
    try:
        return file.open("rb")
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror})") from error


def _places(file: Path) -> list[tuple[int, tuple[int, int]]]:
    """The number of each line of the index, and where its message lies and how long it is."""
    places = list[tuple[int, tuple[int, int]]]()
    for number, line in enumerate(read_text(file, MAX_TABLE_BYTES).splitlines(), 1):
        if not line.strip():
            continue
        where = f"{file} line {number}"
        row = parse_json(line.encode(), where)
        offset, length = (row.get("offset"), row.get("length")) if isinstance(row, dict) else (None, None)
        if not (isinstance(offset, int) and isinstance(length, int) and offset >= 0 < length <= MAX_BYTES):
            raise InputError(f"{where}: offset and length must say where a message lies, got {brief(line, 60)}")
        places.append((number, (offset, length)))
    if not places:
        raise InputError(f"{file} names no message")
    return places
