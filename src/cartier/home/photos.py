"""Photographs of a home: JPEGs and nothing else, whatever a home from elsewhere keeps under their names."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.home.data import HomeData

JPEG_BEGINS = b"\xff\xd8\xff"


def check_photo(data: bytes, where: str) -> bytes:
    """The bytes of a photograph. Raises InputError, with ``where``, if they do not begin as a JPEG's do."""
    if not data.startswith(JPEG_BEGINS):
        raise InputError(f"{where} is {'no JPEG' if data else 'empty'}: map the recording again")
    return data


def photo_of(home: HomeData, frame: int) -> npt.NDArray[np.uint8] | None:
    """A frame's photograph, RGB (H, W, 3); None if the home does not keep it. Raises InputError if it is damaged."""
    from cartier.io.images import decode_jpeg  # Pillow, which asking a home need not load

    data, where = home.photos.get(frame), f"{home.name}'s photo of frame {frame}"
    return None if data is None else decode_jpeg(check_photo(data, where), where)
