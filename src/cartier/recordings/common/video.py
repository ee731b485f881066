"""Single frames of a video file, in any order; fast in the order of the video. Needs PyAV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_PIXELS, InputError, brief
from cartier.io.files import check_file

CODECS = (
    "h264",
    "hevc",
    "mpeg4",
    "mjpeg",
    "vp9",
    "av1",
    "prores",
)  # what phones write; FFmpeg's others are rarely read


class Video:
    """An MP4 or MOV file. Nothing but the decoder's own few frames is held in memory."""

    def __init__(self, path: Path) -> None:
        import av

        self._path = path
        check_file(path)
        try:
            # the format is said, so that a playlist in disguise cannot name other files
            self._container = av.open(str(path.resolve()), format="mp4")
            self._stream = self._container.streams.video[0]
            codec = self._stream.codec_context
            if codec.name not in CODECS or codec.width * codec.height > MAX_PIXELS:
                raise ValueError(f"{codec.width}x{codec.height} px of {codec.name}; cartier reads {', '.join(CODECS)}")
            self._pts = sorted(p.pts for p in self._container.demux(self._stream) if p.pts is not None)
        except Exception as error:  # PyAV's share no base class
            raise InputError(f"{path} is no readable MP4 video ({brief(error)})") from error
        if not self._pts:
            raise InputError(f"{path} holds no picture")
        self.size: tuple[int, int] = (codec.width, codec.height)
        self._frames: Any = None
        self._next = -1

    def __len__(self) -> int:
        return len(self._pts)

    def frame(self, number: int) -> npt.NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB of a frame by its number."""
        if not 0 <= number < len(self._pts):
            raise InputError(f"{self._path} has {len(self._pts)} pictures; frame {number} is asked for")
        try:
            if number != self._next or self._frames is None:
                self._container.seek(self._pts[number], stream=self._stream, backward=True)
                self._frames = self._container.decode(self._stream)
            self._next = number + 1
            for frame in self._frames:
                if (frame.width, frame.height) != self.size:
                    raise ValueError(f"it is {frame.width}x{frame.height} px, the video {self.size[0]}x{self.size[1]}")
                if frame.pts is not None and frame.pts >= self._pts[number]:
                    return np.asarray(frame.to_ndarray(format="rgb24"))
        except Exception as error:  # PyAV's share no base class
            raise InputError(f"{self._path}: frame {number} cannot be decoded ({brief(error)})") from error
        raise InputError(f"{self._path} is damaged or truncated: frame {number} cannot be decoded")
