"""Signals that stop a robot: Ctrl-C, a request to end, a closed terminal."""

from __future__ import annotations

import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from cartier.contracts import DrivingRobot
from cartier.errors import CartierError
from cartier.robots.common.drives import SLACK_S, STOP_S

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


class Signals:
    """The signals that came. The first one wakes a thread; a handler may do no more, whatever it interrupts.

    Args:
        act: What that thread does then, with the signal's number.
    """

    def __init__(self, act: Callable[[int], object]) -> None:
        self.came, self._act, self._first_s = list[int](), act, 0.0
        self._asked: queue.SimpleQueue[int] = queue.SimpleQueue()  # its put may interrupt itself
        self._thread = threading.Thread(target=self._run, name="stop", daemon=True)
        self._thread.start()

    def note(self, number: int, frame: Any = None) -> None:
        """The handler. A further signal has no effect, unless what the first one began does not end in time."""
        self.came.append(number)
        if len(self.came) == 1:
            self._first_s = time.monotonic()
            self._asked.put(number)
        elif time.monotonic() - self._first_s > STOP_S + 2 * SLACK_S:
            raise KeyboardInterrupt

    def end(self) -> None:
        """Wait until what the first signal began is done."""
        self._asked.put(0)
        self._thread.join(STOP_S + 2 * SLACK_S)

    def _run(self) -> None:
        number = self._asked.get()
        if number:
            with suppress(CartierError):
                self._act(number)


@contextmanager
def signals_do(act: Callable[[int], object]) -> Iterator[Signals]:
    """Until the block is left, a signal does this instead of ending the program. In the main thread only."""
    signals = Signals(act)
    main = threading.current_thread() is threading.main_thread()
    numbers = [number for name in NAMES if main and (number := getattr(signal, name, None)) is not None]
    before = {number: signal.getsignal(number) for number in numbers}
    taken = [number for number in numbers if before[number] not in (None, signal.SIG_IGN)]  # nohup holds
    for number in taken:
        signal.signal(number, signals.note)
    try:
        yield signals
    finally:
        signals.end()
        for number in taken:
            signal.signal(number, before[number])


@contextmanager
def stopped_by_signals(robot: DrivingRobot) -> Iterator[list[int]]:
    """Until the block is left, signals stop the robot instead of the program; yields those that came."""
    with signals_do(lambda number: robot.stop()) as signals:
        yield signals.came
