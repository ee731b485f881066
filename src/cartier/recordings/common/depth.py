"""Depth images as the apps pack them: OpenEXR and RVL, and the rule for what is no reading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.files import check_file
from cartier.types import Array

CHANNELS = ("Z", "Y", "R")
MAX_SIDE_PX, MAX_CHANNELS = 1 << 12, 4
MAX_NIBBLES = 10  # of one RVL number: 30 bits, which count the pixels of any image
SHIFTS = np.arange(28, -4, -4, dtype=np.uint32)


def valid(depth_m: Array) -> npt.NDArray[np.float32]:
    """A copy as float32 with NaN in place of all that is no positive, finite depth."""
    with np.errstate(invalid="ignore", over="ignore"):
        out = np.array(depth_m, dtype=np.float32)
        out[~((out > 0) & (out < np.inf))] = np.nan
    return out


def read_exr(path: Path) -> npt.NDArray[np.float32]:
    """(H, W) float32 of the channel Z, else Y, else R. Needs OpenEXR."""
    import OpenEXR

    check_file(path)
    try:
        header = OpenEXR.File(str(path), header_only=True).header()
        low, high = header["dataWindow"]
        width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
        if not (0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX and len(header["channels"]) <= MAX_CHANNELS):
            raise InputError(
                f"{path} claims {width}x{height} px and {len(header['channels'])} channels, which is no phone's depth"
            )
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        name = next((name for name in CHANNELS if name in channels), None)
        if name is None:
            raise InputError(f"{path} has none of the channels {', '.join(CHANNELS)}")
        return np.asarray(channels[name].pixels, dtype=np.float32)
    except InputError:
        raise
    except Exception as error:  # OpenEXR's share no base class
        raise InputError(f"{path} is no readable OpenEXR image ({brief(error)})") from error


def unpack_rvl(data: bytes, width: int, height: int) -> npt.NDArray[np.uint16]:
    """(height, width) of a stream of 32-bit words, highest nibble first. Raises ValueError if the size differs.

    A number is nibbles of 3 bits, lowest first, each but the last with its fourth bit set. In turns they are: how many
    zeros follow, how many other pixels, and their differences from the pixel before (2d for d >= 0, -2d - 1 else).
    """
    words = np.frombuffer(data, "<u4", len(data) // 4)
    nibbles = ((words[:, None] >> SHIFTS) & 15).astype(np.int64).ravel()
    last = np.flatnonzero(nibbles < 8)
    if not len(last):
        raise ValueError("it holds no number")
    nibbles, first = nibbles[: last[-1] + 1], np.append(0, last[:-1] + 1)
    if (last - first).max() >= MAX_NIBBLES:
        raise ValueError("a number does not end")
    place = np.arange(len(nibbles)) - np.repeat(first, last - first + 1)
    values = np.add.reduceat((nibbles & 7) << (3 * place), first)
    size, at, i, counts = width * height, 0, 0, values.tolist()
    is_pixel, seen = np.zeros(len(values), bool), np.zeros(size, bool)
    while at < size:
        if i + 1 >= len(counts):
            raise ValueError(f"it ends after {at} of {size} pixels")
        zeros, others = counts[i : i + 2]
        at, i = at + zeros, i + 2
        if at + others > size or i + others > len(counts):
            raise ValueError(f"it holds more than {size} pixels, or ends before")
        is_pixel[i : i + others] = seen[at : at + others] = True
        at, i = at + others, i + others
    folded = values[is_pixel]
    image = np.zeros(size, np.uint16)
    image[seen] = np.cumsum((folded >> 1) ^ -(folded & 1)) & 0xFFFF
    return image.reshape(height, width)
