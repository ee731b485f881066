"""Spool of a live session: checksummed records, only ever appended: a kill costs the last one at most.

The file begins with ``MAGIC``. A record is a head (``HEAD``: marker, kind, length and CRC-32 of what follows) and its
content: a line of JSON, then the bytes that it announces. Kinds: ``BEGIN`` says what the session is, ``KEYFRAME`` is a
frame, written before it is looked at, ``SEEN`` holds the detections of a keyframe before it, ``POSES`` corrects poses
of keyframes before it, ``END`` says that the session ended whole and its home was saved. Poses, times and masks are
exact; colour is a JPEG, depth whole millimetres.
What a kill or a full disk left of a record at the end is cut off by the next writer, and passed over by readers.
"""

from __future__ import annotations

import json
import os
import struct
import threading
import time
import zlib
from bisect import bisect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief, check_pose
from cartier.io.atomic import append_whole, sync
from cartier.io.files import check_file, parse_json
from cartier.types import Camera, Detections, Frame

MAGIC = b"cartier spool 1\n"
SUFFIX = ".spool"
HEAD = struct.Struct("<4sBxxxII")  # marker, kind, length, CRC-32
SEEN_OF = struct.Struct("<Q")  # where the keyframe starts of which the detections are
MARKER = b"CKF\x01"
BEGIN, KEYFRAME, POSES, END, SEEN = 1, 2, 3, 4, 5
MAX_RECORD = 1 << 28
FLUSH_S = 1.0  # at most so much may be lost if the machine itself stops


@dataclass(frozen=True)
class Place:
    """Where a whole record lies in a spool."""

    kind: int
    start: int
    length: int


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A frame, its stamp (ns), its detections (None before it was looked at) and its pose by odometry (4, 4), if known.

    Read from a spool, the frame has the pose of the last correction that came after it.
    """

    frame: Frame
    stamp_ns: int
    detections: Detections | None
    odom_from_camera: npt.NDArray[np.float64] | None


class Spool:
    """The whole records of a spool, read one at a time.

    Raises InputError if the file is no spool. ``damaged`` counts records in its middle that cannot be read, ``end`` is
    where the last whole record ends, ``seen`` are the records of detections by where their keyframes start.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.damaged, self.end = path, 0, len(MAGIC)
        self.seen: dict[int, Place] = {}
        check_file(path)
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path} is no spool of cartier's")
            self.places = tuple(self._scan(file, path.stat().st_size))
        self._corrected: list[tuple[int, Mapping[int, npt.NDArray[np.float64]]]] | None = None

    def begin(self) -> dict[str, Any]:
        """What the last session is; empty if its first record is lost."""
        last = next((place for place in reversed(self.places) if place.kind == BEGIN), None)
        return {} if last is None else self._json(self._content(last))[0]

    def keyframes(self) -> tuple[Place, ...]:
        """All keyframes, as they were written."""
        return tuple(place for place in self.places if place.kind == KEYFRAME)

    def in_time(self) -> tuple[Place, ...]:
        """All keyframes, those of each session in the order of their stamps: some are looked at only at its end."""
        begun = [place.start for place in self.places if place.kind == BEGIN]
        return tuple(sorted(self.keyframes(), key=lambda place: (bisect(begun, place.start), self._stamp_ns(place))))

    def unsaved(self) -> tuple[Place, ...]:
        """The keyframes since the last session that ended whole."""
        ended = max((place.start for place in self.places if place.kind == END), default=0)
        return tuple(place for place in self.keyframes() if place.start > ended)

    @property
    def ended(self) -> bool:
        """Whether the last session ended whole."""
        return bool(self.places) and self.places[-1].kind == END

    def updates(self) -> Iterator[tuple[str, Mapping[int, npt.NDArray[np.float64]]]]:
        """Who corrected poses, and the poses by the frames' stamps (ns), in the order in which they came."""
        for place in self.places:
            if place.kind == POSES:
                yield self._update(place)

    def keyframe(self, place: Place, index: int | None = None, seen: Place | None = None) -> Keyframe:
        """One record, as frame ``index``, or as its own; ``seen`` is that of its detections, if it was written since.

        Raises InputError for one that is damaged.
        """
        from cartier.io import images

        where = f"{self.path}: the record at byte {place.start}"
        try:
            told, rest = self._json(self._content(place))
            camera = Camera(*(int(v) for v in told["camera"][:2]), *told["camera"][2:])
            number = int(told["index"]) if index is None else index
            rgb, depth = rest[: told["rgb"]], rest[told["rgb"] : told["rgb"] + told["depth"]]
            depth_m = images.metres(images.decode_grey16(depth, camera, where)) if told["depth"] else None
            frame = Frame(
                number, float(told["time_s"]), images.decode_rgb(rgb, camera, where), depth_m,
                self._pose(place, int(told["stamp_ns"]), _matrix(told["pose"], where)), camera,
            )  # fmt: skip
            seen = seen or self.seen.get(place.start)
            found, packed = told.get("detections"), rest[told["rgb"] + told["depth"] :]
            if found is None and seen is not None:  # before 0.2 they stood in the same record
                found, packed = self._json(self._content(seen))
            detections = None if found is None else _detections(number, found, packed, camera)
            odometry = None if told["odometry"] is None else _matrix(told["odometry"], where)
            return Keyframe(frame, int(told["stamp_ns"]), detections, odometry)
        except (KeyError, TypeError, ValueError, IndexError, OverflowError, zlib.error) as error:
            raise InputError(f"{where} is damaged ({brief(error)})") from error

    def _update(self, place: Place) -> tuple[str, dict[int, npt.NDArray[np.float64]]]:
        told, _ = self._json(self._content(place))
        try:
            poses = {int(ns): _matrix(pose, str(self.path)) for ns, pose in told["poses"].items()}
            return str(told["origin"]), poses
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{self.path}: the record at byte {place.start} is damaged ({brief(error)})") from error

    def _pose(self, place: Place, stamp_ns: int, sent: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The pose of a keyframe by the last correction that came after it, else as it was sent."""
        if self._corrected is None:
            updates = [each for each in self.places if each.kind == POSES]
            self._corrected = [(each.start, self._update(each)[1]) for each in updates]
        found = [poses[stamp_ns] for start, poses in self._corrected if start > place.start and stamp_ns in poses]
        return found[-1].copy() if found else sent

    def _scan(self, file: IO[bytes], size: int) -> Iterator[Place]:
        while self.end + HEAD.size <= size:
            file.seek(self.end)
            marker, kind, length, crc = HEAD.unpack(file.read(HEAD.size))
            start = self.end + HEAD.size
            if marker != MARKER or not 0 < length <= MAX_RECORD or start + length > size:
                return
            content = file.read(length)
            sound = zlib.crc32(content) == crc
            if not sound and file.read(len(MARKER)) != MARKER:
                return  # the last record, cut short and overwritten
            self.damaged += not sound
            self.end = start + length
            if sound and kind == SEEN and length >= SEEN_OF.size:
                self.seen[SEEN_OF.unpack_from(content)[0]] = Place(kind, start + SEEN_OF.size, length - SEEN_OF.size)
            elif sound and kind != SEEN:
                yield Place(kind, start, length)

    def _stamp_ns(self, place: Place) -> int:
        with self.path.open("rb") as file:
            file.seek(place.start)
            told, _ = self._json(file.readline(place.length))
        stamp_ns = told.get("stamp_ns")
        if not isinstance(stamp_ns, int):
            raise InputError(f"{self.path}: the record at byte {place.start} has no stamp")
        return stamp_ns

    def _content(self, place: Place) -> bytes:
        with self.path.open("rb") as file:
            file.seek(place.start)
            return file.read(place.length)

    def _json(self, content: bytes) -> tuple[dict[str, Any], bytes]:
        line, _, rest = content.partition(b"\n")
        told = parse_json(line, self.path)
        if not isinstance(told, dict):
            raise InputError(f"{self.path}: a record holds {brief(told, 40)}, where an object belongs")
        return told, rest


class SpoolWriter:
    """Appends to a spool, after what a kill left of its last record was cut off. One process may write at a time, in
    any thread.

    Args:
        path: The file; made if there is none.
        about: What the session is; one that was cut off goes on.

    Raises:
        InputError: The file is no spool, or cannot be written.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self._path, self._flushed_s, self._lock = path, time.monotonic(), threading.Lock()
        torn = path.exists() and path.stat().st_size < len(MAGIC) and MAGIC.startswith(path.read_bytes())
        old = Spool(path) if path.exists() and not torn else None
        end = 0 if old is None else old.end
        try:
            self._file = path.open("r+b" if path.exists() else "x+b", buffering=0)
            self._file.truncate(end)
            if not end:
                append_whole(self._file.fileno(), MAGIC)
                sync(path.absolute().parent)
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror or error}") from error
        if old is None or not old.places or old.ended:
            self._append(BEGIN, json.dumps(dict(about)).encode() + b"\n")

    def keyframe(self, kept: Keyframe) -> Place:
        """Add a keyframe, and its detections if it has some; returns where it lies."""
        from cartier.io import images

        frame = kept.frame
        rgb, depth = BytesIO(), BytesIO()
        images.write_rgb(rgb, frame.rgb)
        if frame.depth_m is not None:
            images.write_depth(depth, frame.depth_m)
        c = frame.camera
        told = {
            "stamp_ns": kept.stamp_ns, "index": frame.index, "time_s": frame.time_s,
            "camera": [c.width, c.height, c.fx, c.fy, c.cx, c.cy], "pose": frame.world_from_camera.ravel().tolist(),
            "odometry": None if kept.odom_from_camera is None else kept.odom_from_camera.ravel().tolist(),
            "rgb": len(rgb.getvalue()), "depth": len(depth.getvalue()),
        }  # fmt: skip
        place = self._append(KEYFRAME, json.dumps(told).encode() + b"\n" + rgb.getvalue() + depth.getvalue())
        if kept.detections is not None:
            self.seen(place, kept.detections)
        return place

    def seen(self, place: Place, found: Detections) -> Place:
        """Add the detections of the keyframe that lies there; returns where they lie."""
        masks = b"" if found.masks is None else zlib.compress(np.packbits(found.masks).tobytes(), 1)
        told = {
            "boxes_xyxy": found.boxes_xyxy.tolist(), "scores": found.scores.tolist(), "labels": list(found.labels)
        }  # fmt: skip
        head = SEEN_OF.pack(place.start)
        at = self._append(SEEN, head + json.dumps(told).encode() + b"\n" + masks)
        return Place(SEEN, at.start + len(head), at.length - len(head))

    def poses(self, origin: str, poses: Mapping[int, npt.NDArray[np.float64]]) -> None:
        """Add corrected poses, (4, 4) by the stamps of keyframes (ns)."""
        told = {"origin": origin, "poses": {str(ns): pose.ravel().tolist() for ns, pose in poses.items()}}
        self._append(POSES, json.dumps(told).encode() + b"\n")

    def ended(self, home_id: str) -> None:
        """Say that the session ended whole, and which home was saved."""
        self._append(END, json.dumps({"home": home_id}).encode() + b"\n")

    def close(self) -> None:
        with self._lock, self._file:
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                raise InputError(f"{self._path} cannot be written: {error.strerror or error}") from error

    def _append(self, kind: int, content: bytes) -> Place:
        record = HEAD.pack(MARKER, kind, len(content), zlib.crc32(content)) + content
        try:
            with self._lock:
                start = os.fstat(self._file.fileno()).st_size + HEAD.size
                on_disk = kind not in (KEYFRAME, SEEN) or time.monotonic() - self._flushed_s >= FLUSH_S
                append_whole(self._file.fileno(), record, on_disk)
                self._flushed_s = time.monotonic() if on_disk else self._flushed_s
        except OSError as error:
            raise InputError(f"{self._path} cannot be written: {error.strerror or error}") from error
        return Place(kind, start, len(content))


def _detections(number: int, told: Mapping[str, Any], packed: bytes, camera: Camera) -> Detections:
    masks = _unpacked(packed, (len(told["scores"]), camera.height, camera.width)) if packed else None
    return Detections(number, told["boxes_xyxy"], told["scores"], tuple(map(str, told["labels"])), masks)


def _matrix(numbers: Any, where: str) -> npt.NDArray[np.float64]:
    return check_pose(np.array(numbers, dtype=np.float64).reshape(4, 4), where)


def _unpacked(packed: bytes, shape: tuple[int, int, int]) -> npt.NDArray[np.bool_]:
    """Masks (N, H, W) from their compressed bits. Raises ValueError for others than so many."""
    size = -(-shape[0] * shape[1] * shape[2] // 8)
    bits = zlib.decompressobj().decompress(packed, size + 1)
    if len(bits) != size:
        raise ValueError("masks of another size")
    flat = np.unpackbits(np.frombuffer(bits, np.uint8), count=shape[0] * shape[1] * shape[2])
    return flat.reshape(shape).astype(bool)
