"""Deadlines: work runs in a thread of its own, and nobody waits for it beyond its time."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")


class Late(Exception):
    """Work did not end in time; ``thread`` is still running it."""

    def __init__(self, thread: threading.Thread) -> None:
        super().__init__()
        self.thread = thread


def within(seconds: float, work: Callable[[], Value]) -> Value:
    """What the work returns or raises. Raises Late if it takes longer than the given seconds."""
    done: queue.SimpleQueue[tuple[Value | None, BaseException | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            done.put((work(), None))
        except BaseException as error:
            done.put((None, error))

    thread = threading.Thread(target=run, name="cartier request", daemon=True)
    thread.start()
    try:
        value, error = done.get(timeout=max(0.0, seconds))
    except queue.Empty:
        raise Late(thread) from None
    if error is not None:
        raise error
    return value  # type: ignore[return-value]
