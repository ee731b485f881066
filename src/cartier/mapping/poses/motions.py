"""Poses that were corrected: which moved, what lies between two, and a recording with other poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.types import Frame

Matrix = npt.NDArray[np.float64]
MOVED_M, MOVED_RAD = 0.02, float(np.deg2rad(0.5))  # less than a cell of the floor plan at the range of depth
PoseOf = Callable[[int, Matrix], Matrix]
"""The pose (4, 4) of a frame by its number and the pose that its recording tells."""


def moved(one: Matrix, other: Matrix) -> bool:
    """Whether two poses (4, 4) differ by 2 cm or half a degree."""
    cosine = (float(np.sum(one[:3, :3] * other[:3, :3])) - 1) / 2
    turned = float(np.arccos(np.clip(cosine, -1, 1)))
    return bool(np.linalg.norm(one[:3, 3] - other[:3, 3]) >= MOVED_M or turned >= MOVED_RAD)


def blended(one: Matrix, two: Matrix, share: float) -> Matrix:
    """A pose (4, 4) between two, ``share`` of the way from the first to the second."""
    from scipy.spatial.transform import Rotation

    between = Rotation.from_matrix(one[:3, :3].T @ two[:3, :3]).as_rotvec() * share
    pose = np.eye(4)
    pose[:3, :3] = one[:3, :3] @ Rotation.from_rotvec(between).as_matrix()
    pose[:3, 3] = one[:3, 3] + share * (two[:3, 3] - one[:3, 3])
    return pose


class Reposed:
    """Obeys the Recording contract; all but the poses is that of ``recording``, its fingerprint, too."""

    def __init__(self, recording: Recording, pose_of: PoseOf) -> None:
        self._recording, self._pose_of = recording, pose_of

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recording, name)

    def __len__(self) -> int:
        return len(self._recording)

    def __getitem__(self, index: int) -> Frame:
        frame = self._recording[index]
        return replace(frame, world_from_camera=self._pose_of(frame.index, frame.world_from_camera))
