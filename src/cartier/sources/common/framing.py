"""Framing of frames in a pipe: a line of JSON, then the bytes of the images that it announces (docs/live.md)."""

from __future__ import annotations

from typing import IO, Any

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_PIXELS, InputError, brief, finite, need
from cartier.io import images
from cartier.io.files import parse_json
from cartier.recordings.common.poses import matrices, unit_quaternions
from cartier.types import Camera, Frame
from cartier.types.streams import Event, Fault, PoseUpdate, Stamped

MAX_LINE = 1 << 20
MAX_BYTES = MAX_PIXELS * 3
RGB, DEPTH = ("raw", "jpeg", "png"), ("raw", "png")
FIELDS = "stamp_ns, camera, pose and rgb, or fault, or poses"


def read_event(pipe: IO[bytes], count: int) -> Event | None:
    """The next event of a pipe, its frame with index ``count``; None at its end.

    Raises InputError for what is not in this framing: the pipe cannot be read on then. An image that cannot be read,
    in right framing, is a Fault.
    """
    line = pipe.readline(MAX_LINE)
    if not line:
        return None
    if not line.endswith(b"\n"):
        raise InputError(f"a line of more than {MAX_LINE} bytes, or cut short, where a line of JSON belongs")
    head = parse_json(line, "the line before an image")
    need(isinstance(head, dict), f"a line of JSON must hold an object with {FIELDS}, got {brief(head, 60)}")
    if "fault" in head:
        return Fault("silent", brief(head["fault"], 300) or "the program said nothing")
    if "poses" in head:
        return _update(head)
    rgb_size, depth_size = (_size(head, name) for name in ("rgb", "depth"))
    rgb, depth = pipe.read(rgb_size), pipe.read(depth_size)
    if len(rgb) < rgb_size or len(depth) < depth_size:
        return None  # it ended within an image
    try:
        return _frame(head, rgb, depth, count)
    except InputError as error:
        return Fault("unreadable", brief(error, 300), 1)


def _size(head: dict[str, Any], name: str) -> int:
    size = head.get(name, 0)
    need(type(size) is int and 0 <= size <= MAX_BYTES, f"{name} must be a number of bytes, got {brief(size, 40)}")
    return int(size)


def _frame(head: dict[str, Any], rgb: bytes, depth: bytes, count: int) -> Stamped:
    stamp_ns: Any = head.get("stamp_ns")
    whole = type(stamp_ns) is int and 0 <= stamp_ns < 1 << 63
    need(whole, f"stamp_ns must be whole nanoseconds, got {brief(stamp_ns, 40)}")
    lens = finite(head.get("camera", ()), 6, "camera (width, height, fx, fy, cx, cy)")
    camera = Camera(int(lens[0]), int(lens[1]), *lens[2:])
    frame = Frame(
        index=count,
        time_s=stamp_ns / 1e9,
        rgb=_rgb(rgb, str(head.get("rgb_format", "raw")), camera),
        depth_m=_depth_m(depth, str(head.get("depth_format", "raw")), camera) if depth else None,
        world_from_camera=_pose(head.get("pose", ())),
        camera=camera,
    )
    odometry = _pose(head["odometry"]) if "odometry" in head else None
    return Stamped(frame, stamp_ns, odometry)


def _pose(values: Any) -> npt.NDArray[np.float64]:
    row = np.array([finite(values, 7, "pose (x, y, z, qx, qy, qz, qw)")])
    unit_quaternions(row[:, 3:], "pose")
    return np.asarray(matrices(row)[0])


def _rgb(data: bytes, form: str, camera: Camera) -> npt.NDArray[np.uint8]:
    need(form in RGB, f"rgb_format is one of {', '.join(RGB)}, not {brief(form, 40)!r}")
    if form != "raw":
        return images.decode_rgb(data, camera, "rgb")
    size = camera.width * camera.height * 3
    need(len(data) == size, f"raw rgb of {camera.width}x{camera.height} px has {size} bytes, got {len(data)}")
    return np.frombuffer(data, np.uint8).reshape(camera.height, camera.width, 3).copy()


def _depth_m(data: bytes, form: str, camera: Camera) -> npt.NDArray[np.float32]:
    need(form in DEPTH, f"depth_format is one of {', '.join(DEPTH)}, not {brief(form, 40)!r}")
    if form == "png":
        return images.metres(images.decode_grey16(data, camera, "depth"))
    size = camera.width * camera.height * 2
    need(len(data) == size, f"raw depth (uint16, mm) has {size} bytes, got {len(data)}")
    return images.metres(np.frombuffer(data, "<u2").astype(np.uint16).reshape(camera.height, camera.width))


def _update(head: dict[str, Any]) -> PoseUpdate:
    told = head["poses"]
    need(isinstance(told, dict), f"poses must be an object of poses by stamp_ns, got {brief(told, 40)}")
    poses = {}
    for stamp, values in told.items():
        whole = stamp.isascii() and stamp.isdigit() and len(stamp) < 20  # "²" is a digit, and no number
        need(whole, f"a stamp is whole nanoseconds, got {brief(stamp, 40)!r}")
        poses[int(stamp)] = _pose(values)
    return PoseUpdate(poses, "the program")
