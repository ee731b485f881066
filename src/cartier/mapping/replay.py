"""Frames that are in a map, mapped again: with corrected poses, in the order of their times, or onto another home."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartier.mapping.poses.motions import Matrix
from cartier.mapping.prefetch import read_ahead
from cartier.mapping.state import MapState
from cartier.types import Detections, Frame

REREADERS = 2  # threads that read kept frames again: a live session has more to do


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A keyframe that is in a map and can be read again.

    Args:
        stamp_ns: When it was taken (ns).
        world_from_camera: (4, 4) the pose that the map has of it.
        key: What tells it from other frames.
        read: Reads the frame, numbered as it was when it was added, and its detections.
    """

    stamp_ns: int
    world_from_camera: Matrix
    key: int
    read: Callable[[], tuple[Frame, Detections]]


def frame_key(frame: Frame) -> int:
    """What tells a frame from all others, 64 bits: its time and its pixels. A corrected pose makes no new frame."""
    pixels = np.ascontiguousarray(frame.rgb[::16, ::16]).tobytes()
    content = round(frame.time_s * 1e6).to_bytes(12, "big", signed=True) + pixels
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little", signed=True)


def replay(state: MapState, kept: Sequence[KeptFrame], progress: Callable[[int, int], None] | None = None) -> MapState:
    """Add kept frames to a map, in their order and with the poses that they have now.

    Args:
        state: The map, which is changed.
        kept: The frames; one that is in the map already changes nothing.
        progress: Called after each frame with the number of frames done and of all frames.

    Returns:
        The same map.

    Raises:
        InputError: A frame cannot be read.
    """
    reads = read_ahead((each.read for each in kept), REREADERS)
    for done, (each, (frame, detections)) in enumerate(zip(kept, reads, strict=True), 1):
        frame = replace(frame, world_from_camera=each.world_from_camera)
        if state.add_depth(frame, each.key):
            state.add_detections(frame, detections)
        if progress is not None:
            progress(done, len(kept))
    return state
