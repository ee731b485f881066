"""Replica, as rendered for iMAP and NICE-SLAM: results/frame000000.jpg, depth000000.png, traj.txt, cam_params.json.

``traj.txt`` holds a camera-to-world matrix per line, 16 numbers, optical axes. ``cam_params.json`` holds w, h, fx, fy,
cx, cy and ``scale``, the depth images' units per metre (6553.5); it lies in the scene's folder or the one above.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.io.files import read_json, read_text
from cartier.io.images import read_depth
from cartier.recordings.common.files import MAX_TABLE_BYTES, names_in, read_fields
from cartier.recordings.common.lens import Lens, camera_of
from cartier.recordings.common.posed import PosedImages, Source, View
from cartier.recordings.common.poses import Z_UP, pose_numbers, rigid
from cartier.types import Camera

POSES, CAMERA = "traj.txt", "cam_params.json"
COLOUR = re.compile(r"frame(\d{1,9})\.(?:jpg|png)", re.ASCII)
FIELDS = ("w", "h", "fx", "fy", "cx", "cy", "scale")
FRAMES_PER_SECOND = 30.0


def matches(path: Path) -> bool:
    """Whether a folder holds traj.txt and results/."""
    return (path / POSES).is_file() and (path / "results").is_dir()


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a scene; Replica's world has z up, and its floor's height is estimated unless ``floor_m`` is given."""
    root = Path(path)
    camera, per_metre, camera_file = _camera(root)
    names = names_in(root / "results")
    found = sorted((int(m[1]), m[0], m[1]) for m in map(COLOUR.fullmatch, names) if m)
    poses = _poses(root / POSES)
    if not found or len(found) != len(poses):
        raise InputError(f"{root} holds {len(found)} images results/frame… but {POSES} holds {len(poses)} poses")
    measured = [f"depth{digits}.png" for _, _, digits in found]
    there = [name in names for name in measured]
    if any(there) and not all(there):
        raise InputError(f"{root / 'results' / measured[there.index(False)]} is missing")
    depths = [root / "results" / name if any(there) else None for name in measured]
    views = [
        View(i / FRAMES_PER_SECOND, root / "results" / name, Lens(camera), depth)
        for i, ((_, name, _), depth) in enumerate(zip(found, depths, strict=True))
    ]
    files = [POSES, *([CAMERA] if camera_file.parent == root else []), *(f"results/{name}" for _, name, _ in found)]
    files += [f"results/{name}" for name in measured if any(there)]
    settings = f"replica 1 {camera} {per_metre}"
    notes = [f"times assumed: {FRAMES_PER_SECOND:g} frames per second"]
    read = partial(read_depth, camera=camera, per_metre=per_metre)
    source = Source(root, settings, views, poses, files, notes, read, known_up=Z_UP, handheld=False)
    return PosedImages(source, up, floor_m)


def _poses(path: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    poses = []
    for number, line in enumerate(read_text(path, MAX_TABLE_BYTES).splitlines(), 1):
        if line.strip():
            values = pose_numbers(line.split(), f"{path} line {number}")
            if len(values) != 16:
                raise InputError(f"{path} line {number}: a pose is 16 numbers, got {len(values)}")
            poses.append(rigid(np.reshape(values, (4, 4)), f"{path} line {number}"))
    return np.array(poses)


def _camera(root: Path) -> tuple[Camera, float, Path]:
    path = next((p for p in (root / CAMERA, root.resolve().parent / CAMERA) if p.is_file()), None)
    if path is None:
        raise InputError(
            f'{root / CAMERA} is missing: write {{"camera": {{"w", "h", "fx", "fy", "cx", "cy", "scale"}}}} '
            "there (for Replica: 1200, 680, 600, 600, 599.5, 339.5, 6553.5)"
        )
    head = read_json(path)
    inner = head.get("camera") if isinstance(head, dict) else None
    width, height, *intrinsics, scale = read_fields(inner, FIELDS, f"{path}: 'camera'")
    if not 1 <= scale <= 1e6:
        raise InputError(f"{path}: scale must be from 1 to a million depth units per metre, got {scale:g}")
    return camera_of(int(width), int(height), intrinsics, str(path)), scale, path
