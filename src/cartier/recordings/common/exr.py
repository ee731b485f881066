"""One channel of an OpenEXR image: depth as the phone apps export it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.files import check_file

CHANNELS = ("Z", "Y", "R")
MAX_SIDE, MAX_CHANNELS = 1 << 12, 4


def read_exr(path: Path) -> npt.NDArray[np.float32]:
    """(H, W) float32 of the channel Z, else Y, else R. Needs OpenEXR."""
    import OpenEXR

    check_file(path)
    try:
        header = OpenEXR.File(str(path), header_only=True).header()
        low, high = header["dataWindow"]
        width, height = (int(high[axis]) - int(low[axis]) + 1 for axis in (0, 1))
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and len(header["channels"]) <= MAX_CHANNELS):
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
