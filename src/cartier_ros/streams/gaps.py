"""Images that are missing in a stream, told by the steps of their stamps."""

from __future__ import annotations

from collections import deque
from statistics import median

KNOWN = 10  # steps, before the usual one is known
REMEMBERED = 50
MISSING = 1.6  # of the usual step
LONGEST_NS = 10**10  # a camera that paused


class Gaps:
    """Counts the images of one topic that did not arrive."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._steps_ns: deque[int] = deque(maxlen=REMEMBERED)

    def add(self, stamp_ns: int) -> int:
        """Take in the stamp of an image; returns how many are missing before it."""
        step_ns = 0 if self._last_ns is None else stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        if not 0 < step_ns < LONGEST_NS:
            self._steps_ns.clear()  # the clock jumped, or the camera paused
            return 0
        usual_ns = median(self._steps_ns) if len(self._steps_ns) >= KNOWN else step_ns
        self._steps_ns.append(step_ns)
        return round(step_ns / usual_ns) - 1 if step_ns > MISSING * usual_ns else 0
