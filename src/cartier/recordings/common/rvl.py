"""RVL, the lossless depth images of Wilson, "Fast Lossless Depth Image Compression" (ISS 2017), from numpy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

MAX_NIBBLES = 10  # of one number: 30 bits, which count the pixels of any image
SHIFTS = np.arange(28, -4, -4, dtype=np.uint32)


def unpacked(data: bytes, width: int, height: int) -> npt.NDArray[np.uint16]:
    """(height, width) of a stream of 32-bit words, first nibble highest; ValueError if it holds another number of pixels.

    Numbers are nibbles of 3 bits, lowest first, each but the last with its fourth bit set. They are, in turns: how many zeros
    follow, how many other pixels, and their differences from the pixel before (2d for d >= 0, -2d - 1 else).
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
