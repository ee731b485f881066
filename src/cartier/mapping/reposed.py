"""A recording with other poses: those of a pose graph, or of another world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.types import Frame

PoseOf = Callable[[int, npt.NDArray[np.float64]], npt.NDArray[np.float64]]
"""The pose (4, 4) of a frame by its number and the pose that its recording tells."""


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
