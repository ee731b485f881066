"""What the robots' tests share: goals, DDS kept to this machine, and peers in processes of their own."""

from __future__ import annotations

import os
import queue
import random
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from cartier.types import Answer, Goal, Place, Selection

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex></Discovery>'
    "</Domain></CycloneDDS>"
)


def goal_at(x: float, y: float, yaw: float, label: str = "chair") -> Goal:
    return Goal(
        x, y, yaw, np.array([[0.0, 0.0], [x, y]]), float(np.hypot(x, y)), Place(label, (x, y, 0.5), 1.0, 0), True
    )


def answer(status: str, goal: Goal | None, notes: tuple[str, ...] = (), next: tuple[Answer, ...] = ()) -> Answer:
    named = "chair" if status in ("found", "likely_near") else None
    chosen = Selection(status, named, "because", "which one?" if status == "clarify" else None)
    return Answer("words", chosen, goal and goal.place, goal, "test", "test", "test", "test", {}, notes, None, next)


def any_domain() -> int:
    """A DDS domain of this test alone: its ports lie below those that Linux hands out."""
    return random.SystemRandom().randint(1, 100)


class Peer:
    """A process and the lines that it has printed so far."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self._lines = process, queue.Queue[str]()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line.strip())

    def end(self) -> None:
        self.process.kill()
        self._reader.join(10)  # before its pipe is closed

    def line(self, timeout_s: float = 20.0) -> str:
        return self._lines.get(timeout=timeout_s)


@contextmanager
def peer(*command: object) -> Iterator[Peer]:
    """A peer that says "ready" first; ended when the block is left."""
    words: Sequence[str] = [str(word) for word in command]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, text=True, env=os.environ | {"CYCLONEDDS_URI": LOOPBACK}
    ) as process:
        started = Peer(process)
        try:
            assert started.line() == "ready"
            yield started
        finally:
            started.end()
