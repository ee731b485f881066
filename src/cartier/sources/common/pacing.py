"""Pacing of streams that are played: in their own time, faster, or as fast as they are taken; and waits that end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from cartier.errors import InputError, brief
from cartier.types.streams import Fault

QUIET_S = 0.9  # a source says something at least once in a second
MAX_SPEED = 1000.0


def check_speed(speed: float) -> float:
    """``speed`` as a factor of real time, 0 for as fast as the stream is taken. Raises InputError for another."""
    if not 0 <= speed <= MAX_SPEED:
        raise InputError(f"a speed is 0 (as fast as it goes) to {MAX_SPEED:g} times real time, got {brief(speed, 20)}")
    return float(speed)


class Pace:
    """The clock of a played stream.

    Args:
        speed: How many seconds of the stream pass in a second; 0 does not wait.
        closed: Set when the stream shall end.
    """

    def __init__(self, speed: float, closed: threading.Event) -> None:
        self._speed, self._closed = speed, closed
        self._begin: tuple[float, float] | None = None

    def until(self, stream_s: float, why: str) -> Iterator[Fault]:
        """Wait until it is ``stream_s`` on the stream's clock, or until the stream is closed; ``why`` it is silent."""
        if not self._speed:
            return
        if self._begin is None:
            self._begin = stream_s, time.monotonic()
        due = self._begin[1] + (stream_s - self._begin[0]) / self._speed
        while (left := due - time.monotonic()) > 0 and not self._closed.wait(min(left, QUIET_S)):
            if left > QUIET_S:
                yield Fault("silent", why)
