"""Alarms to the owner's command: how many run, how often, and what becomes of the others."""

from __future__ import annotations

import threading
from typing import Any

from cartier.serving.alarms import MAX_WAITING, PAUSE_S, Alarms


class Command:
    """A command that runs until it may end; counts how many run at once."""

    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []
        self.may_end, self.most = threading.Semaphore(0), 0
        self.begun, self._running = threading.Semaphore(0), 0

    def __call__(self, alarm: dict[str, Any]) -> str:
        self._running += 1
        self.most = max(self.most, self._running)
        self.told.append(alarm)
        self.begun.release()
        assert self.may_end.acquire(timeout=20)
        self._running -= 1
        return "told"


def test_one_command_runs_at_a_time() -> None:
    command, now = Command(), [0.0]
    alarms = Alarms(command, lambda: now[0])
    for number in range(300):
        alarms.ring("kitchen", {"n": number})
    assert command.begun.acquire(timeout=20) and command.told == [{"n": 0, "left_out": 0}]
    for other in range(40):
        alarms.ring(other, {"n": 1000 + other})
    assert sum(thread.name == "cartier alarms" for thread in threading.enumerate()) == 1
    for _ in range(MAX_WAITING):
        command.may_end.release()
        assert command.begun.acquire(timeout=20)
    assert command.most == 1 and [alarm["n"] for alarm in command.told[1:]] == list(range(1000, 1000 + MAX_WAITING))
    assert sum(alarm["left_out"] for alarm in command.told) == 299 + 40 - MAX_WAITING
    command.may_end.release()


def test_a_conversation_rings_once_a_minute() -> None:
    command, now = Command(), [0.0]
    alarms = Alarms(command, lambda: now[0])
    for second in range(0, 181, 20):
        now[0] = float(second)
        alarms.ring("kitchen", {"s": second})
        command.may_end.release()
    for _ in range(4):
        assert command.begun.acquire(timeout=20)
    assert [alarm["s"] for alarm in command.told] == [0, PAUSE_S, 2 * PAUSE_S, 3 * PAUSE_S]
    assert sum(alarm["left_out"] for alarm in command.told) == 6


def test_a_command_that_raises_leaves_the_next_to_be_told() -> None:
    heard, both = [], threading.Semaphore(0)

    def tell(alarm: dict[str, Any]) -> str:
        heard.append(alarm)
        both.release()
        raise RuntimeError("broken")

    alarms = Alarms(tell)
    alarms.ring("a", {"n": 1})
    alarms.ring("b", {"n": 2})
    assert both.acquire(timeout=20) and both.acquire(timeout=20) and [alarm["n"] for alarm in heard] == [1, 2]
