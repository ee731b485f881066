"""Colour, depth and instance images on disk; sizes are checked before decoding, and each fault is an InputError."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from cartier.errors import MAX_FAR_M, MAX_PIXELS, InputError, brief
from cartier.io.atomic import write_file
from cartier.io.files import check_file
from cartier.types import Array, Camera

JPEG_QUALITY = 95
FORMATS = ("JPEG", "PNG")
PNG_LEVEL = 3  # twice as fast to write as Pillow's 6, a sixth larger, and as fast to read
GREY16 = ("I;16", "I;16B", "I")  # Pillow before 10.3 reads a 16-bit PNG as "I"
Size = tuple[int, int]
"""(width, height) in pixels."""


def image_size(path: Path) -> Size:
    """(width, height) from the header alone."""
    check_file(path)
    with opened(path, str(path)) as image:
        return image.size


def decoded_size(data: bytes, where: str) -> Size:
    """(width, height) of a JPEG or PNG in memory, from its header alone."""
    with opened(BytesIO(data), where) as image:
        return image.size


def read_rgb(path: Path, camera: Camera) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8 of a JPEG or PNG of the camera's size; grey, palette and alpha are converted."""
    return _rgb(_read(path, _size(camera)), str(path))


def decode_rgb(data: bytes, camera: Camera | None, where: str) -> npt.NDArray[np.uint8]:
    """As ``read_rgb``, of a JPEG or PNG in memory; of any size if ``camera`` is None. ``where`` names it in errors."""
    return _rgb(_decode(BytesIO(data), None if camera is None else _size(camera), where), where)


def decode_jpeg(data: bytes, where: str) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8 of a JPEG in memory, of any size; no other decoder sees the bytes."""
    return _rgb(_decode(BytesIO(data), None, where, ("JPEG",)), where)


def read_depth(path: Path, camera: Camera | None, per_metre: float = 1000.0) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of a 16-bit PNG in 1/per_metre m; of any size if ``camera`` is None.

    0 and 65535, which mean no reading, become NaN.
    """
    unit = "millimetres" if per_metre == 1000 else f"1/{per_metre:g} m"
    image = _read(path, None if camera is None else _size(camera))
    return metres(_grey16(image, str(path), f"depth in {unit}"), per_metre)


def decode_depth(data: bytes, camera: Camera, where: str) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of a 16-bit PNG of millimetres in memory; 0 and 65535 become NaN."""
    return metres(_grey16(_decode(BytesIO(data), _size(camera), where), where, "depth in millimetres"))


def decode_grey16(data: bytes, camera: Camera, where: str) -> npt.NDArray[np.uint16]:
    """(H, W) uint16 of a 16-bit PNG in memory."""
    return _grey16(_decode(BytesIO(data), _size(camera), where), where, "depth")


def metres(raw: npt.NDArray[np.uint16], per_metre: float = 1000.0) -> npt.NDArray[np.float32]:
    """(H, W) float32 metres of integer depth; 0 and 65535 become NaN."""
    depth_m = raw.astype(np.float32)
    depth_m /= np.float32(per_metre)
    np.copyto(depth_m, np.nan, where=(raw - np.uint16(1)) >= 65534)  # 0 wraps around: both values in one pass
    return depth_m


def check_depth(depth_m: Array, where: str) -> None:
    """Raises InputError for depth (H, W) that no camera in a home measures."""
    if (depth_m > MAX_FAR_M).any():
        raise InputError(f"{where}: its depth reaches beyond {MAX_FAR_M:g} m, which is no home: are the units metres?")


def read_grey8(path: Path, size: Size) -> npt.NDArray[np.uint8]:
    """(H, W) uint8 of an 8-bit grey PNG: a confidence."""
    image = _read(path, size)
    if image.mode not in ("L", "P", "1"):
        raise InputError(f"{path} must be an 8-bit grey PNG, but it is a {image.mode} {image.format}")
    return np.asarray(image).astype(np.uint8, copy=False)


def decode_instances(data: bytes, camera: Camera, where: str) -> npt.NDArray[np.int32]:
    """(H, W) int32 object ids of a 16-bit PNG in memory; 0 = none."""
    return _grey16(_decode(BytesIO(data), _size(camera), where), where, "instance ids").astype(np.int32)


def write_rgb(path: Path | BytesIO, rgb: npt.NDArray[np.uint8]) -> None:
    Image.fromarray(rgb).save(path, "JPEG", quality=JPEG_QUALITY)


def write_depth(path: Path | BytesIO, depth_m: Array) -> None:
    """Millimetres in a 16-bit PNG; 0 where there is no reading or it does not fit (below 0.5 mm, above 65.534 m)."""
    millimetres = np.rint(depth_m * 1e3)
    fits = (millimetres >= 1) & (millimetres <= 65534)
    _write_grey16(path, np.where(fits, millimetres, 0))


def write_instances(path: Path, instances: Array) -> None:
    """Object ids in a 16-bit PNG; an InputError if one does not fit."""
    if instances.min() < 0 or instances.max() > 65535:
        raise InputError(f"{path.name}: instance ids must be 0 to 65535, got {instances.min()} to {instances.max()}")
    _write_grey16(path, instances)


def _write_grey16(path: Path | BytesIO, values: Array) -> None:
    Image.fromarray(values.astype(np.uint16)).save(path, "PNG", compress_level=PNG_LEVEL)


def _rgb(image: Image.Image, where: str) -> npt.NDArray[np.uint8]:
    if image.mode in (*GREY16, "F"):
        raise InputError(f"{where} must be a colour image, but it is a {image.mode} one: is it a depth image?")
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def _grey16(image: Image.Image, where: str, what: str) -> npt.NDArray[np.uint16]:
    if image.mode not in GREY16:
        raise InputError(f"{where} must be a 16-bit grey PNG ({what}), but it is a {image.mode} {image.format}")
    return np.asarray(image).astype(np.uint16, copy=False)


def _read(path: Path, size: Size | None) -> Image.Image:
    check_file(path)
    return _decode(path, size, str(path))


def _decode(source: Path | BytesIO, size: Size | None, where: str, formats: tuple[str, ...] = FORMATS) -> Image.Image:
    """The loaded image; its size is checked before a single pixel is decoded."""
    with opened(source, where, formats) as image:
        if size is not None and image.size != size:
            raise InputError(
                f"{where} is {image.width}x{image.height} px, but the camera's images are {size[0]}x{size[1]}"
            )
        image.load()
        return image


@contextmanager
def opened(source: Path | BytesIO, where: str, formats: tuple[str, ...] = FORMATS) -> Iterator[Image.Image]:
    """An image whose header was read and is not too large; faults until the block ends become InputErrors.

    Only the decoders of these formats see the bytes.
    """
    try:
        with Image.open(source, formats=formats) as image:
            if image.width * image.height > MAX_PIXELS:
                raise Image.DecompressionBombError
            yield image
    except InputError:
        raise
    except Exception as error:  # Pillow's share no base class
        raise InputError(_fault(source, error, where, formats)) from error


def _size(camera: Camera) -> Size:
    return camera.width, camera.height


def _fault(source: Path | BytesIO, error: Exception, where: str, formats: tuple[str, ...]) -> str:
    if isinstance(error, UnidentifiedImageError):
        size = source.stat().st_size if isinstance(source, Path) else len(source.getbuffer())
        return f"{where} is not a {' or '.join(formats)} image" if size else f"{where} is empty"
    if isinstance(error, Image.DecompressionBombError | Image.DecompressionBombWarning):
        return f"{where} claims more than {MAX_PIXELS // 10**6} megapixels, which is no camera image"
    if isinstance(error, OSError) and error.strerror:
        return f"{where} cannot be read ({error.strerror})"
    return f"{where} is damaged or truncated ({brief(error) or type(error).__name__})"


def write_image(image: Image.Image, file: Path) -> None:
    """Write a picture by its suffix, .png without one. Raises InputError for another format, or if it cannot."""
    buffer = BytesIO()
    try:
        image.save(buffer, Image.registered_extensions()[file.suffix.lower() or ".png"])
    except KeyError as error:
        raise InputError(f"cannot draw to {file}: {file.suffix} is no image format; take .png or .jpg") from error
    write_file(file, buffer.getvalue())
