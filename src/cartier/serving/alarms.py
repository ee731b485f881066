"""Alarms to the owner's command: one command at a time, one a minute for a conversation, the others counted."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable
from typing import Any

PAUSE_S = 60.0
MAX_WAITING = 20  # commands; each takes ten seconds at most
MAX_REMEMBERED = 1000  # conversations that have rung


class Alarms:
    """Tells alarms to a command in one thread, for as long as any waits. Thread-safe.

    ``tell`` runs the command with the alarm's values, to its end, and returns a line that says what came of it. It gets
    ``left_out``, too: how many alarms were not told since the command before.
    """

    def __init__(self, tell: Callable[[dict[str, Any]], str], clock: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._clock = tell, clock
        self._lock = threading.Lock()
        self._rung: OrderedDict[Hashable, float] = OrderedDict()  # by conversation: when it rang last
        self._waiting: deque[dict[str, Any]] = deque()
        self._left_out, self._running = 0, False

    def ring(self, conversation: Hashable, alarm: dict[str, Any]) -> None:
        """Tell an alarm soon, without waiting for it; or count it, if its conversation rang less than a minute ago."""
        with self._lock:
            now = self._clock()
            if now - self._rung.get(conversation, -PAUSE_S) < PAUSE_S or len(self._waiting) >= MAX_WAITING:
                self._left_out += 1
                return
            self._rung.pop(conversation, None)
            self._rung[conversation] = now
            if len(self._rung) > MAX_REMEMBERED:
                self._rung.popitem(last=False)
            self._waiting.append(alarm)
            if self._running:
                return
            self._running = True
        threading.Thread(target=self._run, name="cartier alarms", daemon=True).start()

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._running = False
                    return
                alarm = self._waiting.popleft() | {"left_out": self._left_out}
                self._left_out = 0
            try:
                came = self._tell(alarm)
            except Exception:
                logging.getLogger("cartier").exception("an alarm could not be told")
            else:
                logging.getLogger("cartier").warning("on alarm: %s; left out before: %d", came, alarm["left_out"])
