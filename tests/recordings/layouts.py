"""Tiny recordings on disk in every layout, for the tests of the readers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import exports
import numpy as np
from bags import write_bag
from PIL import Image

from cartier.contracts import Recording
from cartier.recordings import folder
from synthetic import RoomRecording, walk


def room(with_depth: bool = True, frames: int = 4) -> RoomRecording:
    """A few frames of the synthetic room."""
    whole = walk(with_depth=with_depth)
    return replace(whole, poses=whole.poses[:frames])


def write_sevenscenes(
    recording: Recording, root: Path, colour: str = "jpg", source_from_world: np.ndarray | None = None
) -> None:
    """The 7-Scenes layout, every 20th number, in a world that is moved by ``source_from_world``."""
    root.mkdir()
    for i in range(len(recording)):
        frame, stem = recording[i], f"frame-{20 * i:06d}"
        Image.fromarray(frame.rgb).save(root / f"{stem}.color.{colour}", quality=95)
        if frame.depth_m is not None:
            millimetres = np.where(np.isnan(frame.depth_m), 65535, np.rint(frame.depth_m * 1000))
            Image.fromarray(millimetres.astype(np.uint16)).save(root / f"{stem}.depth.png")
        moved = np.eye(4) if source_from_world is None else source_from_world
        np.savetxt(root / f"{stem}.pose.txt", moved @ frame.world_from_camera, delimiter="\t ")
    c = recording.camera
    np.savetxt(root / "camera-intrinsics.txt", [[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]])


class Seen(RoomRecording):
    """The synthetic room as a real recording: no truth, no instances."""

    truth = None  # type: ignore[assignment]

    def __getitem__(self, index: int):  # type: ignore[no-untyped-def]
        return replace(super().__getitem__(index), instances=None)


def seen(with_depth: bool = True) -> Recording:
    whole = room(with_depth)
    return Seen(whole.poses, whole.objects, with_depth=with_depth)


LAYOUTS: dict[str, Callable[[Path], None]] = {
    "folder": lambda path: folder.save(seen(), path),
    "folder-without-depth": lambda path: folder.save(seen(with_depth=False), path),
    "folder-simulator": lambda path: folder.save(room(), path),
    "sevenscenes": lambda path: write_sevenscenes(room(), path),
    "sevenscenes-png": lambda path: write_sevenscenes(room(), path, colour="png"),
    "sevenscenes-without-depth": lambda path: write_sevenscenes(room(with_depth=False), path),
    "rosbag-mcap": lambda path: write_bag(room(), path),
    "rosbag-mcap-zstd": lambda path: write_bag(room(), path, compression="storage"),
    "rosbag-sqlite3": lambda path: write_bag(room(), path, "sqlite3"),
    "rosbag-ros1": lambda path: write_bag(room(), path, "ros1"),
    "rosbag-ros1-bz2": lambda path: write_bag(room(), path, "ros1", "bz2"),
    "rosbag-without-depth": lambda path: write_bag(room(with_depth=False), path),
    "tum": lambda path: exports.write_tum(room(), path),
    "tum-without-depth": lambda path: exports.write_tum(room(with_depth=False), path, "jpg"),
    "scannet": lambda path: exports.write_scannet(room(), path),
    "replica": lambda path: exports.write_replica(room(), path),
    "nerfstudio": lambda path: exports.write_nerfstudio(room(), path),
    "nerfstudio-without-depth": lambda path: exports.write_nerfstudio(room(with_depth=False), path),
    "stray": lambda path: exports.write_stray(room(), path),
    "stray-video": lambda path: exports.write_stray(room(), path, video=True),
    "stray-without-depth": lambda path: exports.write_stray(room(with_depth=False), path),
    "record3d": lambda path: exports.write_record3d(room(), path),
    "record3d-export": lambda path: exports.write_record3d_export(room(), path),
    "record3d-without-depth": lambda path: exports.write_record3d(room(with_depth=False), path),
    "arcore": lambda path: exports.write_arcore(room(), path),
    "rtsm": lambda path: exports.write_rtsm(room(), path),
    "polycam": lambda path: exports.write_polycam(room(), path),
    "polycam-without-depth": lambda path: exports.write_polycam(room(with_depth=False), path),
    "scannerapp": lambda path: exports.write_scannerapp(room(), path),
    "colmap": lambda path: exports.write_colmap(room(with_depth=False), path),
    "colmap-text": lambda path: exports.write_colmap(room(with_depth=False), path, binary=False),
    "rtabmap": lambda path: exports.write_rtabmap(room(), path),
    "rtabmap-without-depth": lambda path: exports.write_rtabmap(room(with_depth=False), path, by_id=False),
    "arcore-without-depth": lambda path: exports.write_arcore(room(with_depth=False), path),
}
