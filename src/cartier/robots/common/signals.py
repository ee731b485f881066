"""Signals that stop a robot: Ctrl-C, a request to end, a closed terminal."""

from __future__ import annotations

import queue
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from cartier.contracts import DrivingRobot
from cartier.errors import CartierError
from cartier.robots.common.drives import SLACK_S, STOP_S

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def stopped_by_signals(robot: DrivingRobot) -> Iterator[list[int]]:
    """Until the block is left, signals stop the robot instead of the program; yields those that came.

    A further one has no effect while the robot is waited for; if it does not end its drive in time, it interrupts.
    """
    came, first_s = list[int](), 0.0
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    asked: queue.SimpleQueue[bool] = queue.SimpleQueue()  # its put may be called while it is being called

    def stop() -> None:
        while asked.get():
            with suppress(CartierError):
                robot.stop()

    def note(number: int, frame: Any) -> None:
        nonlocal first_s
        came.append(number)
        if len(came) == 1:
            first_s = time.monotonic()
            asked.put(True)
        elif time.monotonic() - first_s > STOP_S + 2 * SLACK_S:
            raise KeyboardInterrupt

    stopper = threading.Thread(target=stop, name="stop", daemon=True)
    stopper.start()
    numbers = [number for name in NAMES if (number := getattr(signal, name, None)) is not None]
    before = {number: signal.getsignal(number) for number in numbers}
    taken = [number for number in numbers if before[number] not in (None, signal.SIG_IGN)]  # nohup holds
    for number in taken:
        signal.signal(number, note)
    try:
        yield came
    finally:
        asked.put(False)
        for number in taken:
            signal.signal(number, before[number])
