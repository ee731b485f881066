"""Video alone (rtsp://…): refused, since it says neither where the camera is nor how far away things are."""

from __future__ import annotations

from cartier.contracts import Source
from cartier.errors import InputError

NO_POSES = (
    "an RTSP stream has pictures alone: no pose of the camera and no depth, so nothing in them has a place. Let a "
    "program that knows both send frames: exec:'PROGRAM' (docs/live.md), or the robot's own topics: ros2"
)


def make(model: str) -> Source:
    """Raises InputError, always, with what to do instead."""
    raise InputError(NO_POSES)
