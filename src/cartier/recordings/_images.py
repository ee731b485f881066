"""Colour, depth and instance images to and from disk: size known beforehand, one clear line on a fault."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
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
        raise InputError(_fault(path, error, str(path))) from error


def read_rgb(path: Path, camera: Camera) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8 of a JPEG or PNG of the camera's size; grey, palette and alpha are converted."""
    return _rgb(_decode(path, camera, str(path)), str(path))


def decode_rgb(data: bytes, camera: Camera, where: str) -> npt.NDArray[np.uint8]:
    """As ``read_rgb``, of a JPEG or PNG in memory; ``where`` names it in errors."""
    return _rgb(_decode(BytesIO(data), camera, where), where)


def read_depth(path: Path, camera: Camera, per_metre: float = 1000.0) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of a 16-bit PNG in 1/per_metre m; 0 and 65535, which mean no reading, become NaN."""
    unit = "millimetres" if per_metre == 1000 else f"1/{per_metre:g} m"
    return metres(_grey16(_decode(path, camera, str(path)), str(path), f"depth in {unit}"), per_metre)


def decode_grey16(data: bytes, camera: Camera, where: str) -> npt.NDArray[np.uint16]:
    """(H, W) uint16 of a 16-bit PNG in memory."""
    return _grey16(_decode(BytesIO(data), camera, where), where, "depth")


def metres(raw: npt.NDArray[np.uint16], per_metre: float = 1000.0) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of integer depth; 0 and 65535 become NaN."""
    depth_m = raw.astype(np.float32)
    depth_m /= np.float32(per_metre)
    np.copyto(depth_m, np.nan, where=(raw - np.uint16(1)) >= 65534)  # 0 wraps around: both values in one pass
    return depth_m


def read_grey8(path: Path, camera: Camera) -> npt.NDArray[np.uint8]:
    """(H, W) uint8 of an 8-bit grey PNG: a confidence."""
    image = _decode(path, camera, str(path))
    if image.mode not in ("L", "P", "1"):
        raise InputError(f"{path} must be an 8-bit grey PNG, but it is a {image.mode} {image.format}")
    return np.asarray(image).astype(np.uint8, copy=False)


def read_instances(path: Path, camera: Camera) -> npt.NDArray[np.int32]:
    """(H, W) int32 object ids of a 16-bit PNG; 0 = none."""
    return _grey16(_decode(path, camera, str(path)), str(path), "instance ids").astype(np.int32)


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


def _rgb(image: Image.Image, where: str) -> npt.NDArray[np.uint8]:
    if image.mode in (*GREY16, "F"):
        raise InputError(f"{where} must be a colour image, but it is a {image.mode} one: is it a depth image?")
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def _grey16(image: Image.Image, where: str, what: str) -> npt.NDArray[np.uint16]:
    if image.mode not in GREY16:
        raise InputError(f"{where} must be a 16-bit grey PNG ({what}), but it is a {image.mode} {image.format}")
    return np.asarray(image).astype(np.uint16, copy=False)


def _decode(source: Path | BytesIO, camera: Camera, where: str) -> Image.Image:
    """The loaded image; its size is checked before a single pixel is decoded."""
    try:
        with Image.open(source, formats=("JPEG", "PNG")) as image:
            if image.size != (camera.width, camera.height):
                raise InputError(
                    f"{where} is {image.width}x{image.height} px, but the camera's images are "
                    f"{camera.width}x{camera.height}"
                )
            image.load()
            return image
    except (*DAMAGED, *BOMB) as error:
        raise InputError(_fault(source, error, where)) from error


def _fault(source: Path | BytesIO, error: Exception, where: str) -> str:
    if isinstance(error, FileNotFoundError):
        return f"{where} is missing"
    if isinstance(error, UnidentifiedImageError):
        size = source.stat().st_size if isinstance(source, Path) else len(source.getbuffer())
        return f"{where} is {'not a JPEG or PNG image' if size else 'empty'}"
    if isinstance(error, BOMB):
        return f"{where} claims more than {Image.MAX_IMAGE_PIXELS} px, which is no camera image"
    if isinstance(error, OSError) and error.strerror:
        return f"{where} cannot be read ({error.strerror})"
    return f"{where} is damaged or truncated ({error})"
