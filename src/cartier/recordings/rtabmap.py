"""RTAB-Map: its database (.db), or its export with poses of format 11: rgb/, depth/, calib/, camera_poses.txt.

``rtabmap-export --images_id --poses_camera --poses_format 11 FILE.db`` writes the export; its images may be named by id
or by time. Poses are the optimised graph's, else the odometry's; the world has z up. Images are assumed rectified,
as RTAB-Map itself assumes. Labbé and Michaud, J. Field Robotics 2019.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError, brief
from cartier.io import images
from cartier.io.files import read_text
from cartier.io.strict_yaml import YamlFault, read_yaml
from cartier.recordings.common.files import MAX_TABLE_BYTES, names_in, numbers, relative
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import Colours, PosedImages, Source, View
from cartier.recordings.common.poses import Z_UP, Matrix, matrices, read_trajectory_rows, rigid
from cartier.recordings.common.rtabmap_database import Database
from cartier.recordings.common.sqlite import is_sqlite
from cartier.types import Camera

SETTINGS = "rtabmap 1"
POSES = ("camera_poses.txt", "poses.txt")  # of the camera, and of the robot's base
PICTURES = (".jpg", ".png")
MAX_CALIBRATION = 1 << 16


def matches(path: Path) -> bool:
    """Whether a path is RTAB-Map's database, or a folder of its export."""
    if path.is_file():
        return path.suffix == ".db" and is_sqlite(path)
    return path.is_dir() and _export(path) is not None


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a database or an export."""
    root = Path(path)
    return PosedImages(_of_export(root) if root.is_dir() else _of_database(root), up, floor_m)


def _of_database(path: Path) -> Source:
    base = Database(path)
    nodes, notes = base.nodes()
    deep = base.has_depth()
    kept = [node for node in nodes if not deep or node.id in deep]
    if not kept:
        raise InputError(f"{path} holds no node with an image, a pose and a calibration")
    notes += [f"{len(nodes) - len(kept)} nodes without depth left out"] if len(kept) < len(nodes) else []
    keys = [Path(str(node.id)) for node in kept]
    views = [
        View(node.time_s, key, Lens(node.camera), key if deep else None) for node, key in zip(kept, keys, strict=True)
    ]

    def colour(view: View) -> Colours:
        data = base.colour(int(view.colour.name))
        return images.decode_rgb(data, view.lens.camera, f"{path}: image of node {view.colour}")

    poses = np.array([rigid(node.world_from_camera, f"{path}: node {node.id}") for node in kept])
    return Source(
        path.parent, SETTINGS, views, poses, [path.name], notes, lambda name: base.depth(int(name.name)), colour,
        name=path.stem, known_up=Z_UP,
    )  # fmt: skip


def _export(root: Path) -> tuple[str, str] | None:
    """The poses' file and the prefix of the folders: '' or 'NAME_'."""
    names = {name for name in names_in(root) if not name.startswith(".")}
    found = sorted(name for name in names if name.endswith(POSES[1]))
    prefixes = sorted(name.removesuffix("rgb") for name in names if name.endswith("rgb") and (root / name).is_dir())
    prefix = next((p for p in prefixes if f"{p}calib" in names), None)
    if not found or prefix is None:
        return None
    return next((name for name in found if name.endswith(POSES[0])), found[0]), prefix


def _of_export(root: Path) -> Source:
    found = _export(root)
    if found is None:
        raise InputError(f"{root} is no export of RTAB-Map: it lacks NAME_camera_poses.txt, NAME_rgb/ or NAME_calib/")
    file, prefix = found
    rows, names = read_trajectory_rows(root / file), _row_names(root / file)
    kinds = ("rgb", "depth", "calib")
    colours, depths, calibrations = (names_in(root / f"{prefix}{kind}", optional=True) for kind in kinds)
    views, poses, files = [], [], [file]
    for row, pose, either in zip(rows, matrices(rows[:, 1:]), names, strict=True):
        stem = next((s for s in either if any(s + suffix in colours for suffix in PICTURES)), None)
        if stem is None or (depths and f"{stem}.png" not in depths):
            continue
        colour = next(stem + suffix for suffix in PICTURES if stem + suffix in colours)
        calibration = f"{stem}.yaml" if f"{stem}.yaml" in calibrations else min(calibrations, default="none.yaml")
        calibration_file = root / f"{prefix}calib" / calibration
        camera, base_from_camera = _calibration(calibration_file)
        depth = root / f"{prefix}depth" / f"{stem}.png" if depths else None
        views.append(View(float(row[0]), root / f"{prefix}rgb" / colour, Lens(camera), depth))
        poses.append(rigid(pose if file.endswith(POSES[0]) else pose @ base_from_camera, f"{root / file}: pose {stem}"))
        files += relative(root, views[-1].colour, calibration_file, depth)
    if not views:
        raise InputError(f"{root}: none of the {len(rows)} poses in {file} has an image (by id or time) and depth")
    left = len(rows) - len(views)
    notes = [f"{left} poses without an image or depth left out"] if left else []
    if not file.endswith(POSES[0]):
        camera_poses = "'rtabmap-export --poses_camera' gives the camera's"
        notes.append(f"{file} is taken for poses of the robot's base; {camera_poses}")
    return Source(root, SETTINGS, views, np.array(poses), list(dict.fromkeys(files)), notes, known_up=Z_UP)


def _row_names(path: Path) -> list[tuple[str, str]]:
    """What the images of each row may be called: by the node's id, or by its time, as it is written."""
    lines = read_text(path, MAX_TABLE_BYTES).splitlines()
    words = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    if any(len(row) != 9 for row in words):
        raise InputError(f"{path} is not of poses format 11 (t x y z qx qy qz qw id): export with --poses_format 11")
    return [(row[8], row[0]) for row in words]


def _calibration(path: Path) -> tuple[Camera, Matrix]:
    """The rectified camera, and base_from_camera (4, 4) of a file of OpenCV's kind of YAML."""
    text = read_text(path, MAX_CALIBRATION)
    plain = "\n".join(line for line in text.splitlines() if not line.startswith(("%", "---")))
    try:
        fields, _ = read_yaml(plain)
    except YamlFault as fault:
        raise InputError(f"{path} line {fault.line}: {fault}") from fault
    if not isinstance(fields, dict):
        raise InputError(f"{path} must hold a calibration: image_width, image_height, camera_matrix")
    name = "projection_matrix" if "projection_matrix" in fields else "camera_matrix"
    matrix = _numbers(fields, name, path).reshape(3, -1)
    width, height = numbers([fields.get("image_width"), fields.get("image_height")], str(path))
    camera = camera_of(int(width), int(height), matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), str(path))
    moved = np.eye(4)
    if "local_transform" in fields:
        moved[:3] = _numbers(fields, "local_transform", path).reshape(3, 4)
    return camera, moved


def _numbers(fields: dict[str, Any], name: str, path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The numbers of a matrix of 3 rows."""
    value = fields.get(name)
    data = value.get("data") if isinstance(value, dict) else None
    values = numbers(data, f"{path}: {name}") if isinstance(data, Sequence) and not isinstance(data, str) else []
    size = 9 if name == "camera_matrix" else 12
    if len(values) != size:
        raise InputError(f"{path}: {name} must have data of {size} numbers, got {brief(data, 60)}")
    return np.array(values)
