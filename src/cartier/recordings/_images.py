"""Colour, depth and instance images to and from disk: size known beforehand, one clear line on a fault."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from cartier.errors import InputError
from cartier.types import Array, Camera

JPEG_QUALITY = 95
PNG_LEVEL = 3  # twice as fast to write as Pillow's 6, a sixth larger, and as fast to read
GREY16 = ("I;16", "I;16B", "I")  # Pillow before 10.3 reads a 16-bit PNG as "I"
DAMAGED = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error)
BOMB = (Image.DecompressionBombError, Image.DecompressionBombWarning)


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) from the header alone."""
    try:
        with Image.open(path, formats=("JPEG", "PNG")) as image:
            return image.size
    except (*DAMAGED, *BOMB) as error:
        raise InputError(_fault(path, error)) from error


def read_rgb(path: Path, camera: Camera) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8 of a JPEG or PNG of the camera's size; grey, palette and alpha are converted."""
    image = _decode(path, camera)
    if image.mode in (*GREY16, "F"):
        raise InputError(f"{path} must be a colour image, but it is a {image.mode} one: is it a depth image?")
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def read_depth(path: Path, camera: Camera) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of a 16-bit PNG in millimetres; 0 and 65535, which mean no reading, become NaN."""
    raw = _grey16(path, camera, "depth in millimetres")
    depth_m = raw.astype(np.float32)
    depth_m /= np.float32(1000)
    np.copyto(depth_m, np.nan, where=(raw - np.uint16(1)) >= 65534)  # 0 wraps around: both values in one pass
    return depth_m


def read_instances(path: Path, camera: Camera) -> npt.NDArray[np.int32]:
    """(H, W) int32 object ids of a 16-bit PNG; 0 = none."""
    return _grey16(path, camera, "instance ids").astype(np.int32)


def write_rgb(path: Path, rgb: npt.NDArray[np.uint8]) -> None:
    Image.fromarray(rgb).save(path, "JPEG", quality=JPEG_QUALITY)


def write_depth(path: Path, depth_m: Array) -> None:
    """Millimetres in a 16-bit PNG; 0 where there is no reading or it does not fit (below 0.5 mm, above 65.534 m)."""
    millimetres = np.rint(depth_m * 1e3)
    fits = (millimetres >= 1) & (millimetres <= 65534)
    _write_grey16(path, np.where(fits, millimetres, 0))


def write_instances(path: Path, instances: Array) -> None:
    """Object ids in a 16-bit PNG; an InputError if one does not fit."""
    if instances.min() < 0 or instances.max() > 65535:
        raise InputError(f"{path.name}: instance ids must be 0 to 65535, got {instances.min()} to {instances.max()}")
    _write_grey16(path, instances)


def _write_grey16(path: Path, values: Array) -> None:
    Image.fromarray(values.astype(np.uint16)).save(path, "PNG", compress_level=PNG_LEVEL)


def _grey16(path: Path, camera: Camera, what: str) -> npt.NDArray[np.uint16]:
    image = _decode(path, camera)
    if image.mode not in GREY16:
        raise InputError(f"{path} must be a 16-bit grey PNG ({what}), but it is a {image.mode} {image.format}")
    return np.asarray(image).astype(np.uint16, copy=False)


def _decode(path: Path, camera: Camera) -> Image.Image:
    """The loaded image; its size is checked before a single pixel is decoded."""
    try:
        with Image.open(path, formats=("JPEG", "PNG")) as image:
            if image.size != (camera.width, camera.height):
                raise InputError(
                    f"{path} is {image.width}x{image.height} px, but the camera's images are "
                    f"{camera.width}x{camera.height}"
                )
            image.load()
            return image
    except (*DAMAGED, *BOMB) as error:
        raise InputError(_fault(path, error)) from error


def _fault(path: Path, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"{path} is missing"
    if isinstance(error, UnidentifiedImageError):
        return f"{path} is {'empty' if path.stat().st_size == 0 else 'not a JPEG or PNG image'}"
    if isinstance(error, BOMB):
        return f"{path} claims more than {Image.MAX_IMAGE_PIXELS} px, which is no camera image"
    if isinstance(error, OSError) and error.strerror:
        return f"{path} cannot be read ({error.strerror})"
    return f"{path} is damaged or truncated ({error})"
