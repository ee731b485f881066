"""A frame's pixels to the tensor that a network wants, and its boxes back to the frame's pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image

from cartier.detectors.sidecar import Sidecar
from cartier.types import Array, Floats

PAD = (114, 114, 114)  # the grey that YOLOs are trained with


@dataclass(frozen=True)
class Placement:
    """Where the frame lies in the network's input: input = frame * scale + offset, in pixels."""

    scale: tuple[float, float]
    offset: tuple[int, int]

    def to_frame(self, boxes_xyxy: Array) -> Floats:
        """Boxes (N, 4) in input pixels as boxes in frame pixels."""
        return np.asarray((boxes_xyxy - self.offset * 2) / (self.scale * 2))


def to_tensor(
    rgb: npt.NDArray[np.uint8], size: tuple[int, int], sidecar: Sidecar
) -> tuple[npt.NDArray[np.float32], Placement]:
    """An image (H, W, 3) as (1, 3, h, w) float32 for an input of ``size`` (w, h), and where it lies in there."""
    image, placement = _resized(Image.fromarray(rgb), size, sidecar.resize)
    planes = image.split()[:: -1 if sidecar.channels == "bgr" else 1]  # one by one: numpy is slow on every third byte
    std = np.array(sidecar.std, np.float32)[:, None, None]
    mean = np.array(sidecar.mean, np.float32)[:, None, None]
    pixels = np.stack([np.asarray(plane, np.float32) for plane in planes])
    return (pixels * (1 / (np.float32(sidecar.scale) * std)) - mean / std)[None], placement


def _resized(image: Image.Image, size: tuple[int, int], resize: str) -> tuple[Image.Image, Placement]:
    if resize == "stretch":
        scale = (size[0] / image.width, size[1] / image.height)
        return image.resize(size, Image.Resampling.BILINEAR), Placement(scale, (0, 0))
    ratio = min(size[0] / image.width, size[1] / image.height)
    inner = max(1, round(image.width * ratio)), max(1, round(image.height * ratio))
    corner = (0, 0) if resize == "letterbox_top_left" else ((size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2)
    canvas = Image.new("RGB", size, PAD)
    canvas.paste(image.resize(inner, Image.Resampling.BILINEAR), corner)
    return canvas, Placement((inner[0] / image.width, inner[1] / image.height), corner)
