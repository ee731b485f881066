"""What the robots' tests share: goals, DDS kept to this machine, and peers in processes of their own."""

from __future__ import annotations

import hashlib
import os
import queue
import random
import shutil
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from cartier.types import Answer, Goal, Place, Selection

LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<Peers><Peer address="localhost"/></Peers><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex></Discovery>'
    "</Domain></CycloneDDS>"
)

HOME = """
name: tiny
about: One room for tests.
start: [1.0, 1.0]
rooms:
  - {name: parlour, kind: living room, box: [0.0, 0.0, 4.0, 3.0], floor: "planks:oak", walls: "paint:cream"}
things:
  - {type: DiningTable, at: [2.4, 1.2], face: south, size: [1.0, 0.8, 0.75]}
"""
NEEDS = "libfastrtps-dev libfastcdr-dev fastddsgen g++"


def fastdds_program(config: pytest.Config, sources: Path) -> Path:
    """A peer in C++, built once for each state of its sources: that takes some seconds."""
    if not (shutil.which("fastddsgen") and shutil.which("g++") and Path("/usr/include/fastdds").is_dir()):
        pytest.skip(f"needs Fast DDS for C++: apt-get install {NEEDS}")
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(sources.iterdir()))).hexdigest()
    folder = Path(config.cache.mkdir(sources.name)) / digest[:16]
    if not (folder / "peer").is_file():
        shutil.copytree(sources, folder, dirs_exist_ok=True)
        (idl,) = sources.glob("*.idl")
        for command in (
            ["fastddsgen", "-replace", idl.name],
            ["g++", "-std=c++17", "-O0", "-o", "peer.new", "peer.cpp", f"{idl.stem}.cxx", f"{idl.stem}PubSubTypes.cxx",
             "-lfastrtps", "-lfastcdr"],
        ):  # fmt: skip
            built = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240)
            assert built.returncode == 0, built.stdout + built.stderr
        (folder / "peer.new").rename(folder / "peer")
    return folder / "peer"


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
    return next(_domains())


@cache
def _domains() -> Iterator[int]:
    """The domains of this process in any order, none twice before all were used; other workers have others."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    mine = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % workers
    domains = [domain for domain in range(1, 101) if domain % workers == mine]
    random.SystemRandom().shuffle(domains)
    return cycle(domains)


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

    def so_far(self) -> list[str]:
        return [self._lines.get() for _ in range(self._lines.qsize())]


@contextmanager
def peer(*command: object, env: Mapping[str, str] | None = None) -> Iterator[Peer]:
    """A peer that says "ready" first; ended when the block is left."""
    words: Sequence[str] = [str(word) for word in command]
    env = os.environ | {"CYCLONEDDS_URI": LOOPBACK} if env is None else env
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=env) as process:
        started = Peer(process)
        try:
            assert started.line() == "ready"
            yield started
        finally:
            started.end()
