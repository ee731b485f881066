"""nerfstudio: transforms.json with camera-to-world matrices in OpenGL axes, intrinsics for all or for each frame.

``ns-process-data`` and instant-ngp write it. Distortion (``k1 k2 p1 p2 k3``, or the fisheye's ``k1``-``k4``) is
removed; frames of other intrinsics are resampled to those of the first. Depth is ``depth_file_path``, a 16-bit PNG, a
``.npy`` or an ``.exr`` (needs OpenEXR) in units of ``depth_unit_scale_factor`` metres (default 0.001), or instant-ngp's
``depth_path`` in units of ``integer_depth_scale``. The scale is metric from a phone's LiDAR, but not from COLMAP.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Recording
from cartier.errors import MAX_SIDE_PX, InputError, brief
from cartier.io.files import read_json, read_npy
from cartier.io.images import image_size
from cartier.recordings.common.depth import read_exr, valid
from cartier.recordings.common.files import absolute_notes, inside, numbers, relative
from cartier.recordings.common.lens import Lens, camera_of, straight
from cartier.recordings.common.posed import Depths, PosedImages, Source, View, png_depth
from cartier.recordings.common.poses import GL_FROM_OPTICAL, USUAL_WAY_M, Matrix, lost, pose_numbers, rigid
from cartier.types import Array, Camera

FILE, EXR = "transforms.json", ".exr"
PLAUSIBLE_WAY_M = (0.1, 6.0)  # of cameras from their middle, in a home
FRAMES_PER_SECOND = 30.0
DEPTH_UNIT_M = 0.001
DEPTH_KEYS = {"depth_file_path": "depth_unit_scale_factor", "depth_path": "integer_depth_scale"}  # and their units
MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV_FISHEYE")
MAX_DEPTH_BYTES = 1 << 28
NEAR_M = 0.02  # nothing is nearer to a camera that moves through a home
SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")


def matches(path: Path) -> bool:
    """Whether a folder holds a transforms.json."""
    return (path / FILE).is_file()


def open(path: str | Path, up: Sequence[float] | None = None, floor_m: float | None = None) -> Recording:
    """Read a folder; ``up`` (x, y, z in its world) and ``floor_m`` (along up) override the estimates."""
    root = Path(path)
    where = str(root / FILE)
    head = read_json(root / FILE)
    frames = head.get("frames") if isinstance(head, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(f"{where} must hold an object with a list 'frames'")
    there: list[tuple[View, Matrix]] = []
    missing = 0
    for number, frame in enumerate(frames):
        place = f"{where}: frame {number}"
        colour = _image(root, frame.get("file_path"), place)
        if colour is None:
            missing += 1
            continue
        there.append((_view(root, head, frame, number, colour, place), _pose(frame.get("transform_matrix"), place)))
    notes = [f"{missing} frames left out: their images are missing"] if missing else []
    notes += absolute_notes((frame.get("file_path") for frame in frames), FILE)
    if not there:
        raise InputError(f"{where} names {len(frames)} frames, but none of their images is there")
    there.sort(key=lambda item: item[0].colour.as_posix())
    views = [view for view, _ in there]
    if any(view.depth is not None and view.depth.suffix == EXR for view in views):
        import OpenEXR  # noqa: F401  # a missing package is reported at once, not at some frame
    partly = sum(view.depth is None for view in views)
    if 0 < partly < len(views):
        raise InputError(f"{where}: {partly} of {len(views)} frames have no {_depth_key(frames)}; give all or none")
    if "time" not in frames[0]:
        notes.append(f"times assumed: {FRAMES_PER_SECOND:g} frames per second, in the order of the file names")
    files = [FILE, *relative(root, *(path for view in views for path in (view.colour, view.depth)))]
    unit = DEPTH_KEYS[_depth_key(frames)]
    unit_m = _number(head, unit, DEPTH_UNIT_M, where)
    if not 1e-6 <= unit_m <= 1:
        raise InputError(f"{where}: {unit} must be from a millionth to 1 metre, got {unit_m:g}")
    if not partly and unit not in head:
        notes.append(f"{FILE} does not say {unit}: depth is taken in units of {DEPTH_UNIT_M:g} m")
    views = [_timed(view, number) for number, view in enumerate(views)]
    poses, scale_guessed = np.array([pose for _, pose in there]), not any(view.depth for view in views)
    poses[:, :3, 3] *= _metres_per_unit(poses, "colmap_im_id" in frames[0], notes) if scale_guessed else 1.0
    if not scale_guessed:
        notes.append("the scale is taken as metres, as its depth has it")
    read = partial(_depth, unit_m=unit_m, unit=unit)
    source = Source(root, "nerfstudio 2", views, poses, files, notes, read, scale_guessed=scale_guessed, clocked=False)
    return PosedImages(source, up, floor_m)


def _metres_per_unit(poses: Array, colmap: bool, notes: list[str]) -> float:
    """1 if poses without depth may well be metric, as ARKit's; else the scale that is usual for homes."""
    positions = poses[~lost(poses), :3, 3]
    way = float(np.median(np.linalg.norm(positions - np.median(positions, axis=0), axis=1)))
    if way < 1e-12 or (PLAUSIBLE_WAY_M[0] <= way <= PLAUSIBLE_WAY_M[1] and not colmap):
        notes.append("without depth the scale is a guess: the poses are taken as metres; COLMAP's are not")
        return 1.0
    notes.append(f"without depth the scale is a guess, by which the cameras stand {USUAL_WAY_M:g} m from their middle")
    return USUAL_WAY_M / way


def _depth_key(frames: Sequence[dict[str, Any]]) -> str:
    """The field that names depth images, by the first of nerfstudio's and instant-ngp's that is there."""
    return next((key for key in DEPTH_KEYS if any(key in frame for frame in frames)), next(iter(DEPTH_KEYS)))


def _depth(path: Path, unit_m: float, unit: str) -> Depths:
    """(h, w) float32 metres of a 16-bit PNG, a .npy or an OpenEXR image."""
    if path.suffix not in (".npy", EXR):
        return png_depth(path, 1 / unit_m)
    raw = read_exr(path) if path.suffix == EXR else read_npy(path, MAX_DEPTH_BYTES)
    raw = raw.reshape(raw.shape[:2]) if raw.ndim == 3 and raw.shape[2] == 1 else raw
    if raw.ndim != 2 or not raw.size or raw.dtype.kind not in "uif":
        raise InputError(f"{path} must hold an image of depths (height, width), got {raw.shape} {raw.dtype}")
    depth_m = valid(raw.astype(np.float32) * np.float32(unit_m))
    if np.isfinite(depth_m).any() and float(np.nanmedian(depth_m)) < NEAR_M:
        raise InputError(
            f'{path}: its depth is {float(np.nanmedian(depth_m)):.2g} m in units of {unit_m:g} m: write "{unit}": 1.0 '
            f"into {FILE} if it is in metres"
        )
    return depth_m


def _image(root: Path, name: object, where: str) -> Path | None:
    """The image of a ``file_path``, which may lack its suffix; None if there is none."""
    path = root / inside(name, where, root, ("", *SUFFIXES))
    return next((p for p in (path, *(path.with_name(path.name + s) for s in SUFFIXES)) if p.is_file()), None)


def _view(root: Path, head: dict[str, Any], frame: dict[str, Any], number: int, colour: Path, where: str) -> View:
    fields = {**head, **frame}
    size = (fields.get("w"), fields.get("h"))
    if not all(type(side) is int or (type(side) is float and side.is_integer()) for side in size):
        size = image_size(colour)
    width, height = (int(side or 0) for side in size)
    if not 0 < width <= MAX_SIDE_PX or not 0 < height <= MAX_SIDE_PX:
        raise InputError(f"{where}: w and h must be 1 to {MAX_SIDE_PX} px, got {brief(size, 40)}")
    if "fl_x" in fields:
        fx = _number(fields, "fl_x", None, where)
    elif "camera_angle_x" in fields:
        angle_rad = _number(fields, "camera_angle_x", None, where)
        if not 0 < angle_rad < np.pi:
            raise InputError(f"{where}: camera_angle_x must be above 0 and below pi, got {angle_rad:g}")
        fx = width / 2 / np.tan(angle_rad / 2)
    else:
        raise InputError(f"{where}: there are no intrinsics, neither fl_x nor camera_angle_x")
    fy = _number(fields, "fl_y", fx, where)
    # COLMAP's and nerfstudio's pixel (0, 0) is the corner of the top-left pixel, ours is its centre
    cx, cy = _number(fields, "cx", width / 2, where) - 0.5, _number(fields, "cy", height / 2, where) - 0.5
    depth = frame.get(_depth_key([frame]))
    measured = None if depth is None else root / inside(depth, where, root)
    time_s = _number(frame, "time", number / FRAMES_PER_SECOND, where) if "time" in frame else np.nan
    return View(time_s, colour, _lens(camera_of(width, height, (fx, fy, cx, cy), where), fields, where), measured)


def _lens(camera: Camera, fields: dict[str, Any], where: str) -> Lens:
    model = fields.get("camera_model", "OPENCV")
    if model not in MODELS:
        mend = "reproject its panoramas to perspective images" if model == "EQUIRECTANGULAR" else "undistort its images"
        raise InputError(
            f"{where}: camera_model {brief(model, 40)!r} is not read; cartier reads {', '.join(MODELS)}: {mend}"
        )
    fisheye = model == "OPENCV_FISHEYE" or fields.get("is_fisheye") is True
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    values = tuple(_number(fields, name, 0.0, where) for name in names)
    if fisheye:  # without coefficients it bends all the same
        return Lens(camera, "equidistant", values)
    return straight(camera, "plumb_bob", values)


def _timed(view: View, number: int) -> View:
    return View(number / FRAMES_PER_SECOND, view.colour, view.lens, view.depth) if np.isnan(view.time_s) else view


def _pose(value: object, where: str) -> Matrix:
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or not all(isinstance(row, list) and len(row) == 4 for row in rows):
        raise InputError(f"{where}: transform_matrix must be 4x4")
    matrix = np.eye(4)
    matrix[: len(rows)] = [pose_numbers(row, where) for row in rows]
    return rigid(matrix, where) @ GL_FROM_OPTICAL


def _number(fields: dict[str, Any], name: str, default: float | None, where: str) -> float:
    value = fields.get(name, default)
    if type(value) not in (int, float, np.float64):
        raise InputError(f"{where}: {name} must be a number, got {brief(value, 40)!r}")
    return numbers([value], f"{where}: {name}")[0]
