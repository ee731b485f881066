"""Images of a chosen colour and depth topic as the arrays of frames: undistorted, and depth registered to colour."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cartier.io.images import check_depth
from cartier.recordings.common.lens import registered, resampled
from cartier.types import Camera
from cartier_ros.bags.images import colour as colour_image
from cartier_ros.bags.images import depth as depth_image
from cartier_ros.bags.topics import Choice


class FrameImages:
    """Decodes the messages of a ``Choice``. ``colour_from_depth`` (4, 4) is None where depth lies on colour already."""

    def __init__(self, choice: Choice, colour_from_depth: npt.NDArray[np.float64] | None) -> None:
        self.camera: Camera = choice.colour_lens.camera
        self._choice, self._colour_from_depth = choice, colour_from_depth

    def rgb(self, message: Any, where: str) -> npt.NDArray[np.uint8]:
        """(H, W, 3) of an image of the colour topic."""
        lens = self._choice.colour_lens
        return np.asarray(resampled(colour_image(message, lens.camera, where), lens, self.camera, 0), dtype=np.uint8)

    def depth_m(self, message: Any, where: str) -> npt.NDArray[np.float32] | None:
        """(H, W) in metres of an image of the depth topic, as the colour camera sees it."""
        lens = self._choice.depth_lens
        if lens is None:
            return None
        depth_m = depth_image(message, lens.camera, where)
        check_depth(depth_m, where)
        if self._colour_from_depth is None:
            return np.asarray(resampled(depth_m, lens, self.camera, np.nan), dtype=np.float32)
        straight = np.asarray(resampled(depth_m, lens, lens.camera, np.nan), dtype=np.float32)
        return registered(straight, lens.camera, self.camera, self._colour_from_depth)


class StaticTransforms(Protocol):
    """Transforms of which some never change."""

    def fixed(self, target: str, source: str) -> npt.NDArray[np.float64] | None:
        """target_from_source (4, 4) along static transforms alone, or None if they do not connect the two."""
        ...


def registration(choice: Choice, tree: StaticTransforms, notes: list[str]) -> npt.NDArray[np.float64] | None:
    """colour_from_depth where the two have frames of their own that the transforms of ``tree`` connect."""
    depth, colour = choice.depth, choice.colour
    if depth is None or depth.frame == colour.frame:
        return None
    matrix = tree.fixed(colour.frame, depth.frame)
    if matrix is None:
        notes.append(
            f"depth assumed to be registered to colour: no fixed transform leads from {depth.frame!r} to "
            f"{colour.frame!r}"
        )
        return None
    notes.append(f"depth of {depth.name} is reprojected into the colour camera")
    return matrix
