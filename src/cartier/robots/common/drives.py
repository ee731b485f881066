"""Drives of a robot, each in a thread of its own: no signal or exception of who watches lands in the middle of one."""

from __future__ import annotations

import atexit
import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from weakref import WeakSet

from cartier.errors import BackendError, CartierError, brief
from cartier.types import DriveProgress, Goal

STOP_S = 3.0
"""How long a robot that was asked to stop is waited for."""
SLACK_S = 1.0  # a drive bounds its own stop; a thread that hangs is not waited for much longer
Steps = Callable[[Goal, threading.Event], Iterator[DriveProgress]]
"""Sends a goal and tells the drive to its end. The first progress says that the robot has the goal. Once the event is
set, the robot is stopped, and the last progress says within ``STOP_S`` what became of it. One that is closed lets go
of the robot, which drives on."""
_drives: WeakSet[_Drive] = WeakSet()


class Drives:
    """What a robot drives: one goal at a time.

    Args:
        steps: How it drives.
        halt: Stops a robot that drives without being watched; returns what became of it.
    """

    def __init__(self, steps: Steps, halt: Callable[[], DriveProgress]) -> None:
        self._steps, self._halt = steps, halt
        self._latest: _Drive | None = None

    def watch(self, goal: Goal) -> Iterator[DriveProgress]:
        """The progress of a drive. An iterator that is closed, or left by an exception, stops the robot."""
        self._latest = drive = _Drive(self._steps, goal)  # from here on a stop holds for it
        return drive.watched()

    def send(self, goal: Goal) -> str:
        """Send a robot off; returns what it says of the goal. An exception meanwhile, such as Ctrl-C, stops it."""
        self._latest = drive = _Drive(self._steps, goal, lets_go=True)
        drive.start()
        try:
            first = drive.next()
            if first.ended and first.status != "arrived":
                raise BackendError(first.text)
            return first.text
        except CartierError:
            raise
        except BaseException:
            with suppress(CartierError):
                self.stop()
            raise

    def stop(self) -> DriveProgress:
        """Stop the robot, from any thread, and wait until it says so; returns what became of it."""
        drive = self._latest
        told = None if drive is None or drive.end is not None else drive.stop()
        return self._halt() if told is None else told


class _Drive:
    """One drive. The end of the program does not wait for its thread, but stops the robot first."""

    def __init__(self, steps: Steps, goal: Goal, lets_go: bool = False) -> None:
        self._steps, self._goal, self._lets_go = steps, goal, lets_go
        self.asked = threading.Event()
        self._told: queue.SimpleQueue[DriveProgress | BaseException] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._run, name="drive", daemon=True)
        self._started = False
        self.end: DriveProgress | None = None

    def start(self) -> None:
        _drives.add(self)
        self._started = True
        self.thread.start()

    def next(self) -> DriveProgress:
        told = self._told.get()
        if isinstance(told, BaseException):
            raise told
        return told

    def watched(self) -> Iterator[DriveProgress]:
        self.start()
        try:
            while True:
                told = self.next()
                yield told
                if told.ended:
                    return
        finally:
            self.stop()

    def stop(self) -> DriveProgress | None:
        """What became of the robot; None if this drive has not begun, or has let go of it."""
        self.asked.set()
        if self._started:
            self.thread.join(STOP_S + SLACK_S)
            if self.thread.is_alive():
                return DriveProgress("unknown", "the robot did not answer the request to stop: it may still be driving")
        return self.end

    def _run(self) -> None:
        steps = self._steps(self._goal, self.asked)
        try:
            for told in steps:
                self.end = told if told.ended else None
                self._told.put(told)
                if self._lets_go:
                    steps.close()  # type: ignore[attr-defined]  # steps are generators
                    return
            if self.end is None:
                raise RuntimeError("a drive ended without saying how")
        except BaseException as error:
            self.end = DriveProgress("failed", brief(error, 300) or type(error).__name__)
            self._told.put(error)


@atexit.register
def _stop_all() -> None:
    """The program ends: no robot that somebody watched drives on alone."""
    for drive in list(_drives):
        if drive.end is None:
            drive.asked.set()
    for drive in list(_drives):
        drive.thread.join(STOP_S + SLACK_S)
