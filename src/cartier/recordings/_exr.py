"""One channel of an OpenEXR image: depth as the phone apps export it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError

CHANNELS = ("Z", "Y", "R")
MAX_SIDE = 1 << 13


def read_exr(path: Path) -> npt.NDArray[np.float32]:
    """(H, W) float32 of the channel Z, else Y, else R. Needs OpenEXR."""
    import OpenEXR

    try:
        low, high = OpenEXR.File(str(path), header_only=True).header()["dataWindow"]
        if max(int(high[0]) - int(low[0]), int(high[1]) - int(low[1])) >= MAX_SIDE:
            raise InputError(f"{path} claims more than {MAX_SIDE} px a side, which is no phone's depth")
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        name = next((name for name in CHANNELS if name in channels), None)
        if name is None:
            raise InputError(f"{path} has none of the channels {', '.join(CHANNELS)}")
        return np.asarray(channels[name].pixels, dtype=np.float32)
    except (RuntimeError, ValueError, KeyError, TypeError, OSError) as error:
        raise InputError(f"{path} is no readable OpenEXR image ({str(error)[:80]})") from error
