"""Latest transforms of a robot: where one frame is in another now."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier_ros.bags.bag import decoded, frame_name
from cartier_ros.bags.tf import MAX_DEPTH, checked

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
MAX_FRAMES = 1000
Matrix = npt.NDArray[np.float64]


class Latest:
    """The newest sample of each frame, whatever its stamp says."""

    def __init__(self) -> None:
        self._links: dict[str, tuple[str, Matrix]] = {}

    def add(self, data: bytes) -> bool:
        """Take in the bytes of a TFMessage; returns whether all of it could be used."""
        try:
            items = decoded(data, TF_MESSAGE, "cdr", "a transform").transforms
            for item in items:
                self._take(item)
        except InputError:
            return False
        return bool(items)

    def lookup(self, target: str, source: str) -> Matrix | None:
        """target_from_source (4, 4), or None if no transforms lead from one to the other."""
        total, frame = np.eye(4), source
        for _ in range(MAX_DEPTH):
            if frame == target:
                return total
            if frame not in self._links:
                return None
            frame, parent_from_frame = self._links[frame]
            total = parent_from_frame @ total
        return None

    def _take(self, item: Any) -> None:
        parent, child = (frame_name(str(name), "/tf") for name in (item.header.frame_id, item.child_frame_id))
        t, q = item.transform.translation, item.transform.rotation
        matrix = checked(np.array([[0.0, t.x, t.y, t.z, q.x, q.y, q.z, q.w]]), child)[0]
        if child in self._links or len(self._links) < MAX_FRAMES:
            self._links[child] = parent, matrix
