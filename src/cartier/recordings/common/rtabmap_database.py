"""RTAB-Map's database: its nodes, the calibration of their cameras, and their compressed images."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.images import GREY16, decoded_size, metres, opened
from cartier.recordings.common.depth import unpack_rvl, valid
from cartier.recordings.common.files import numbers
from cartier.recordings.common.lens import camera_of
from cartier.recordings.common.posed import Depths
from cartier.recordings.common.poses import Matrix
from cartier.recordings.common.sqlite import SqliteFile
from cartier.types import Array, Camera

MAX_BYTES = 1 << 28
MAX_NODES = 1_000_000
HEAD = struct.Struct("<11i")  # version (3), kind, width, height, sizes of K, D, R, P and the local transform
MONO = 0
RVL = b"DEPTHRVL"
MAX_SIDE = 4096  # px


@dataclass(frozen=True, eq=False)
class Node:
    """One node: its id, time, base_from_camera @ pose as world_from_camera (4, 4), and its camera."""

    id: int
    time_s: float
    world_from_camera: Matrix
    camera: Camera


class Database:
    """A .db file, opened read-only."""

    def __init__(self, path: Path) -> None:
        kinds = ("TABLE", "INDEX", "UNIQUE INDEX", "TRIGGER")  # triggers act on writing alone
        self.path = path
        self._file = SqliteFile(path, "RTAB-Map database", ("Node", "Data"), kinds, MAX_BYTES)
        if not {"image", "depth", "calibration"} <= set(self._file.columns("Data")):
            raise InputError(f"{path} was written by an RTAB-Map older than 0.11: {_anew(path)}")

    def nodes(self) -> tuple[list[Node], list[str]]:
        """The nodes that have an image, a pose and a calibrated camera, by time, and notes on the others."""
        best = self._optimised()
        rows = self._file.ask(
            "SELECT Node.id, Node.stamp, Node.pose, Data.calibration, Node.map_id FROM Node JOIN Data "
            "ON Node.id = Data.id WHERE length(Data.image) > 0 "
            f"ORDER BY Node.stamp, Node.id LIMIT {MAX_NODES}"
        )
        found, lost = [], 0
        sessions = Counter(session for *_, session in rows)
        longest = sessions.most_common(1)[0][0] if sessions and not best else None
        for key, stamp, raw, calibration, session in rows:
            if longest is not None and session != longest:
                continue  # its odometry began anew, elsewhere
            where = f"{self.path}: node {brief(key, 20)}"
            pose = best.get(key) if best else _matrix(raw, where)
            if pose is None or not calibration:
                lost += 1
                continue
            camera, base_from_camera = self._calibration(key, calibration, where)
            found.append(Node(key, numbers([stamp], where)[0], pose @ base_from_camera, camera))
        notes = [f"{lost} nodes left out: they have no pose or no calibration"] if lost else []
        if longest is not None and len(sessions) > 1:
            used = f"{sessions[longest]} of {sessions.total()} nodes"
            notes.append(f"{len(sessions)} sessions that no optimised graph binds: only the longest is used, {used}")
        odometry = "poses are the odometry's: the file holds no optimised graph (open it in RTAB-Map and save it)"
        return found, [*notes, "poses are those of the optimised graph" if best else odometry]

    def colour(self, key: int) -> bytes:
        """A JPEG or PNG."""
        return self._file.blob("Data", "image", key)

    def has_depth(self) -> set[int]:
        """The ids of the nodes with depth."""
        return {key for (key,) in self._file.ask("SELECT id FROM Data WHERE length(depth) > 0")}

    def depth(self, key: int) -> Depths:
        """(h, w) float32 metres, of millimetres as RVL or 16-bit PNG, or of a PNG whose channels are float32 metres."""
        data, where = self._file.blob("Data", "depth", key), f"{self.path}: depth of node {key}"
        if data.startswith(RVL):
            return metres(_rvl(data, where))
        with opened(BytesIO(data), where) as image:
            image.load()
            pixels = np.asarray(image)
            if image.mode in GREY16:
                return metres(pixels.astype(np.uint16))
            if image.mode != "RGBA":
                raise InputError(f"{where} is a {image.mode} {image.format}, which is no depth")
        packed = np.ascontiguousarray(pixels[..., [2, 1, 0, 3]])  # its bytes were stored as blue, green, red, alpha
        return valid(packed.view("<f4")[..., 0])

    def _calibration(self, key: int, data: bytes, where: str) -> tuple[Camera, Matrix]:
        """The camera, and base_from_camera (4, 4) with optical axes, of a blob as RTAB-Map's CameraModel writes it."""
        damaged = f"{where}: its calibration is damaged, or of an RTAB-Map older than 0.18: {_anew(self.path)}"
        if not isinstance(data, bytes) or len(data) < HEAD.size:
            raise InputError(damaged)
        *_, kind, width, height, k, d, r, p, moved = HEAD.unpack_from(data)
        if kind != MONO:
            raise InputError(f"{where} is of a stereo camera; cartier reads databases with depth images")
        size = HEAD.size + 8 * (k + d + r + p) + 4 * moved
        if k != 9 or p not in (0, 12) or moved not in (0, 12) or min(d, r) < 0 or len(data) < size:
            raise InputError(damaged)
        if len(data) > size:
            raise InputError(f"{where} is of several cameras; cartier reads databases of one")
        values = np.frombuffer(data, "<f8", k + d + r + p, HEAD.size)
        matrix = values[-12:].reshape(3, 4) if p else values[:9].reshape(3, 3)
        if width <= 0 or height <= 0:  # some programs leave it out
            width, height = decoded_size(self.colour(key), where)
        intrinsics = matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        camera = camera_of(width, height, intrinsics, where)
        return camera, _rows(np.frombuffer(data, "<f4", moved, size - 4 * moved)) if moved else np.eye(4)

    def _optimised(self) -> dict[int, Matrix]:
        """The poses (4, 4) of the optimised graph by node; {} if there is none."""
        if not {"opt_ids", "opt_poses"} <= set(self._file.columns("Admin")):
            return {}
        there = "length(opt_ids) > 0 AND length(opt_poses) > 0"
        rows = self._file.ask(f"SELECT opt_ids, opt_poses FROM Admin WHERE {there}")
        if not rows:
            return {}
        where = f"{self.path}: its optimised graph"
        ids, poses = _array(rows[-1][0], "<i4", where), _array(rows[-1][1], "<f4", where)
        if len(poses) != 12 * len(ids):
            raise InputError(f"{where} has {len(ids)} nodes, but {len(poses)} numbers of poses")
        return {int(key): _rows(row) for key, row in zip(ids, poses.reshape(-1, 12), strict=True)}


def _array(data: object, kind: str, where: str) -> Array:
    """The numbers of a matrix that RTAB-Map compressed: a zlib stream, then its rows, columns and type in 12 bytes."""
    try:
        if not isinstance(data, bytes):
            raise ValueError("no bytes")
        stream = zlib.decompressobj()
        plain = stream.decompress(data, 64 * MAX_NODES)
        if not stream.eof:
            raise ValueError("it does not end, or is too long")
        return np.frombuffer(plain, kind)
    except (ValueError, zlib.error) as error:
        raise InputError(f"{where} is damaged ({brief(error)})") from error


def _rvl(data: bytes, where: str) -> npt.NDArray[np.uint16]:
    """(h, w) of RTAB-Map's own RVL file: the signature, columns and rows, and the stream."""
    try:
        width, height = struct.unpack_from("<2I", data, len(RVL))
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
            raise ValueError(f"it claims {width}x{height} px")
        return unpack_rvl(data[len(RVL) + 8 :], width, height)
    except (ValueError, struct.error) as error:
        raise InputError(f"{where} is damaged ({brief(error)})") from error


def _matrix(raw: object, where: str) -> Matrix | None:
    """A 3x4 float32 pose as (4, 4); None for the null pose of a node that was never placed."""
    if not isinstance(raw, bytes) or len(raw) != 48:
        if raw is None or raw == b"":
            return None
        raise InputError(f"{where}: its pose is damaged")
    values = np.frombuffer(raw, "<f4")
    return _rows(values) if values.any() else None


def _rows(values: Array) -> Matrix:
    matrix = np.eye(4)
    matrix[:3] = np.asarray(values, dtype=np.float64).reshape(3, 4)
    return matrix if np.isfinite(matrix).all() else np.full((4, 4), np.nan)


def _anew(path: Path) -> str:
    return f"'rtabmap-reprocess {path.name} NEW.db' writes it anew"
