"""ROS image messages as arrays: raw, compressed and compressedDepth; CameraInfo as a lens (REP-104, REP-118)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io import images
from cartier.recordings.common.depth import valid
from cartier.recordings.common.lens import Lens, Model, camera_of, off_centre, straight
from cartier.types import Camera

INFO = "sensor_msgs/msg/CameraInfo"
COLOURS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}
BLUE_FIRST = ("bgr8", "bgra8", "8UC3", "8UC4")  # OpenCV's order, which is what cv_bridge means by 8UC3
GREY = ("mono8", "8UC1")
DEPTHS: dict[str, type] = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
MODELS: dict[str, Model] = {"plumb_bob": "plumb_bob", "rational_polynomial": "plumb_bob", "equidistant": "equidistant"}
MODELS |= {"radtan": "plumb_bob", "fisheye": "equidistant", "opencv_fisheye": "equidistant"}
MODELS |= {"kannala_brandt": "equidistant", "kannala_brandt4": "equidistant"}
"""OpenCV's and Kalibr's names beside those of ROS: one lens has several."""
ASPECT_TOLERANCE = 0.02
DEPTH_HEAD = struct.Struct("<i2f")  # compressed_depth_image_transport: format, and the two numbers of inverse depth
RAW_DEPTH = "compressedDepth"
VIDEOS = ("h264", "h265", "hevc", "av1", "vp9", "theora", "ffmpeg")


def encoding_of(message: Any) -> str:
    """The pixel encoding of an Image or CompressedImage, e.g. ``16UC1``; ``rgb8`` where the format is only ``jpeg``."""
    if hasattr(message, "encoding"):
        return str(message.encoding)
    first = str(message.format).split(";")[0].strip()
    return first if first in COLOURS or first in DEPTHS else "rgb8"


def is_depth(message: Any) -> bool:
    return encoding_of(message) in DEPTHS or RAW_DEPTH in getattr(message, "format", "")


def size_of(message: Any, where: str) -> tuple[int, int]:
    """(width, height) in pixels."""
    if hasattr(message, "encoding"):
        return int(message.width), int(message.height)
    return images.decoded_size(_payload(message, where), f"{where}: its first image")


def colour(message: Any, camera: Camera, where: str) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB."""
    if not hasattr(message, "encoding"):
        return images.decode_rgb(_payload(message, where), camera, where)
    name = str(message.encoding)
    if name not in COLOURS:
        raise InputError(
            f"{where}: images are encoded as {brief(name, 40)!r}; cartier reads {', '.join(COLOURS)} and JPEG or PNG"
        )
    pixels = _rows(message, camera, np.dtype(np.uint8), COLOURS[name], where)
    if COLOURS[name] == 1:
        return np.repeat(pixels, 3, axis=2)
    return np.ascontiguousarray(pixels[..., 2::-1] if name in BLUE_FIRST else pixels[..., :3])


def depth(message: Any, camera: Camera, where: str) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres; 0, negative and infinite values, which mean no reading, become NaN."""
    if not hasattr(message, "encoding"):
        return _packed_depth(message, camera, where)
    name = str(message.encoding)
    if name not in DEPTHS:
        raise InputError(
            f"{where}: depth is encoded as {brief(name, 40)!r}; cartier reads {', '.join(DEPTHS)} and compressedDepth"
        )
    kind = np.dtype(DEPTHS[name]).newbyteorder(">" if message.is_bigendian else "<")
    pixels = _rows(message, camera, kind, 1, where)[..., 0]
    return images.metres(pixels.astype(np.uint16)) if DEPTHS[name] is np.uint16 else valid(pixels)


def lens_of(info: Any, rectified: bool, size: tuple[int, int], where: str) -> tuple[Lens, str]:
    """The lens that a CameraInfo describes, of its projection matrix where the images are rectified, and a note or "".

    It is that of the region of the sensor that the images show (``_cut``), else at the CameraInfo's own size, or at
    ``size``, (width, height) of the images, if the principal point lies nearer to their middle: a driver that reduces
    images may forget either.
    """
    matrix = np.asarray(getattr(info, "k", None) if hasattr(info, "k") else info.K, dtype=np.float64).reshape(3, 3)
    if rectified:
        projection = info.p if hasattr(info, "p") else info.P
        matrix = np.asarray(projection, dtype=np.float64).reshape(3, 4)[:, :3]
    if not matrix.any():
        raise InputError(f"{where}: the CameraInfo holds no intrinsics (all zero): calibrate the camera")
    stated, values = (int(info.width), int(info.height)), matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    cut = _cut(info, values, size, where)
    if cut is None:
        centre = values[2], values[3]
        right = stated if min(stated) > 0 and off_centre(stated, centre) <= off_centre(size, centre) else size
        of = f"{where} (of {stated[0]}x{stated[1]} px, for images of {size[0]}x{size[1]})"
        cut = camera_of(*right, values, where if stated == size else of), ""
    camera, note = cut
    coefficients = np.asarray(info.d if hasattr(info, "d") else info.D, dtype=np.float64)
    if rectified or not len(coefficients):
        return Lens(camera), note
    model = MODELS.get(str(info.distortion_model).lower())
    if model == "equidistant":  # without coefficients it bends all the same
        return Lens(camera, model, tuple(coefficients.tolist()) if coefficients.any() else (0.0,) * 4), note
    if model is None and coefficients.any():
        raise InputError(
            f"{where}: distortion {brief(info.distortion_model, 40)!r} is unknown; record rectified images, or "
            f"{', '.join(MODELS)}"
        )
    beyond = slice(None) if coefficients[8:].any() else slice(8)  # OpenCV's thin prism and tilt, mostly zero
    return straight(camera, model or "pinhole", coefficients[beyond]), note


def _cut(info: Any, values: Sequence[float], size: tuple[int, int], where: str) -> tuple[Camera, str] | None:
    """The camera of the region of the sensor that the images show, and a note; None where they show all of it.

    A CameraInfo's matrices and size are the whole sensor's, and its region counts the sensor's pixels before they are
    binned (REP-104). A driver that has moved them already is known by a principal point in the middle of the region.
    """
    stated, roi = np.array([info.width, info.height], float), info.roi
    bins = np.maximum(1, [info.binning_x, info.binning_y]).astype(float)
    first, sides = np.array([[roi.x_offset, roi.y_offset], [roi.width, roi.height]], float)
    first, sides = (first, sides) if sides.all() else (np.zeros(2), stated)
    if (bins > 1).any() and tuple(sides) == size:  # some drivers give them in pixels of the images
        first, sides = first * bins, sides * bins
    held = bool((first + sides <= stated).all())
    whole = held and ((tuple(sides) == tuple(stated) and bins[0] == bins[1]) or tuple(stated) == size)
    width, height = (int(n) for n in sides // bins)
    if whole or min(width, height) < 1 or abs(size[0] / size[1] / (width / height) - 1) > ASPECT_TOLERANCE:
        return None
    focal, centre = np.array(values[:2]), np.array(values[2:])
    moved, back = (centre - first + 0.5) / bins - 0.5, (centre + 0.5) * bins - 0.5 + first
    sensor = (int(stated[0]), int(stated[1])) if held else (width, height)  # the judge: the sensor, if it is known
    told, done = (centre, back) if held else (moved, centre)
    already = off_centre(sensor, (done[0], done[1])) < off_centre(sensor, (told[0], told[1]))
    camera_of(*sensor, [*focal, *(done if already else told)], where)  # an InputError if it is neither's
    region = f"{sides[0]:.0f}x{sides[1]:.0f} px of the sensor from {first[0]:.0f}, {first[1]:.0f} on"
    region += f", binned {bins[0]:.0f}x{bins[1]:.0f}" if (bins > 1).any() else ""
    says = "its intrinsics are those of that region" if already else "its intrinsics were moved there"
    lens = values if already else [*(focal / bins).tolist(), *moved.tolist()]
    return Camera(width, height, *lens), f"{where}: the images show {region}; {says}"


def _rows(message: Any, camera: Camera, kind: np.dtype[Any], channels: int, where: str) -> npt.NDArray[Any]:
    """(H, W, channels) of a raw image; rows may be padded."""
    width, height, step = int(message.width), int(message.height), int(message.step)
    if (width, height) != (camera.width, camera.height):
        raise InputError(f"{where}: an image is {width}x{height} px, but the others are {camera.width}x{camera.height}")
    row = width * channels * kind.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if step < row or len(data) < step * (height - 1) + row:
        raise InputError(f"{where}: an image has {len(data)} bytes, too few for {height} rows of {step}")
    pixels: npt.NDArray[Any] = np.ndarray(
        (height, width, channels), kind, data.data, strides=(step, kind.itemsize * channels, kind.itemsize)
    )
    return pixels


def _payload(message: Any, where: str) -> bytes:
    """The JPEG or PNG of a CompressedImage."""
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    if any(codec in str(message.format).lower() for codec in VIDEOS):
        raise InputError(
            f"{where}: its images are a video stream ({brief(message.format, 40)}); cartier reads raw, JPEG and PNG "
            "images"
        )
    if RAW_DEPTH not in str(message.format):
        return data
    if "rvl" in str(message.format).lower():
        raise InputError(f"{where}: depth is compressed as RVL; record it as PNG (compressedDepth's format) or raw")
    if len(data) < DEPTH_HEAD.size:
        raise InputError(f"{where}: a compressedDepth message has {len(data)} bytes only")
    return data[DEPTH_HEAD.size :]


def _packed_depth(message: Any, camera: Camera, where: str) -> npt.NDArray[np.float32]:
    raw = images.decode_grey16(_payload(message, where), camera, where)
    if RAW_DEPTH not in str(message.format) or encoding_of(message) != "32FC1":
        return images.metres(raw)
    _, a, b = DEPTH_HEAD.unpack_from(np.asarray(message.data, dtype=np.uint8).tobytes()[: DEPTH_HEAD.size])
    with np.errstate(divide="ignore", invalid="ignore"):
        return valid(np.where(raw > 0, a / (raw.astype(np.float64) - b), 0))
