"""The synthetic room by somebody whose world lies otherwise, or whose camera does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from cartier.errors import frame_number
from cartier.mapping.upright import Levelled, turned_camera
from cartier.types import Frame
from synthetic import CAMERA, THINGS, RoomRecording, walk


def world(rotation: Sequence[float] = (0, 0, 0), shift: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    """other_from_room (4, 4), of a rotation vector (rad) and a shift (m)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(rotation).as_matrix(), shift
    return matrix


@dataclass
class Lying(RoomRecording):
    """Frames moved and turned; no truth, as if it were real."""

    lies: Levelled = field(default_factory=Levelled)
    truth = None  # type: ignore[assignment]

    def __getitem__(self, index: int) -> Frame:
        frame = rendered(self.poses[frame_number(index, len(self), self.name)].tobytes())
        return self.lies.frame(replace(frame, index=index, time_s=index / 10))


@cache
def rendered(pose: bytes) -> Frame:
    return RoomRecording([np.frombuffer(pose).reshape(4, 4)], THINGS)[0]


def lying(other_from_room: np.ndarray, turns: int = 0, frames: int | None = None, first: int = 0) -> Lying:
    """A walk in another world, its images turned to the left by so many quarters."""
    whole = walk()
    camera = turned_camera(CAMERA, turns)[0]
    poses = whole.poses[first : None if frames is None else first + frames]
    return Lying(poses, whole.objects, camera=camera, lies=Levelled(other_from_room, turns))
