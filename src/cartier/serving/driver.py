"""Robot that agents send: one drive at a time, which ends with the server."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from cartier.contracts import DrivingRobot, Robot
from cartier.errors import BackendError
from cartier.types import DriveProgress, Goal


class Driver:
    """Follows the drive that was sent last, and stops it. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._robot: DrivingRobot | None = None
        self._last: DriveProgress | None = None

    def go(self, robot: Robot, goal: Goal) -> str:
        """Send a robot; returns what it says of the goal. Raises CartierError if it does not take it."""
        if not isinstance(robot, DrivingRobot):
            return robot.go_to(goal)
        self.stop()  # a later goal replaces the one before
        with self._lock:
            self._robot, self._last = robot, None
        drive = robot.drive(goal)
        first = next(drive)
        if first.ended and first.status != "arrived":
            raise BackendError(first.text)
        self._last = first
        threading.Thread(target=self._follow, args=(drive,), name="follow", daemon=True).start()
        return first.text

    def stop(self) -> DriveProgress:
        """Stop the robot; returns what became of it. Raises CartierError if it cannot be reached."""
        with self._lock:
            robot, last = self._robot, self._last
        if robot is None or (last is not None and last.ended):
            return last or DriveProgress("stopped", "no robot was sent")
        return robot.stop()

    def _follow(self, drive: Iterator[DriveProgress]) -> None:
        for self._last in drive:
            pass
