"""Processes under ROS 2, in the environments of build.py, and drives of cartier beside them or inside of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from build import FOLDER, WHEELS
from peers import LOOPBACK, Peer, any_domain, peer

HERE = Path(__file__).parent
DISTRIBUTIONS = tuple(WHEELS)
WAYS = ("rclpy", "dds")


def missing(distribution: str) -> str:
    """Why no process can be started under a distribution; empty if it can."""
    built = (FOLDER / distribution / "built").is_file() and sys.version_info[:2] == (3, 11)
    return "" if built else f"no ROS 2 {distribution}: python3.11 tests/ros/build.py {distribution}"


class Ros:
    """A distribution, in a domain of this test alone."""

    def __init__(self, distribution: str) -> None:
        self.distribution, self.domain = distribution, any_domain()
        self.started = list[subprocess.Popen[str]]()
        lines = (FOLDER / distribution / "env").read_text().splitlines()
        shared = {"ROS_DOMAIN_ID": str(self.domain), "CYCLONEDDS_URI": LOOPBACK, "OMP_NUM_THREADS": "1"}
        plain = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        self.inside: Mapping[str, str] = plain | dict(line.split("=", 1) for line in lines) | shared
        self.beside: Mapping[str, str] = os.environ | shared | {"PYTHONPATH": os.pathsep.join(sys.path)}
        self.python = FOLDER / distribution / "bin/python"

    @contextmanager
    def peer(self, script: str, *words: object) -> Iterator[Peer]:
        """One of the scripts beside this file, under ROS."""
        with peer(self.python, HERE / script, *words, env=self.inside) as started:
            yield started

    def cartier(self, way: str, *words: object) -> subprocess.Popen[str]:
        """A Python program that uses cartier: under ROS (rclpy), or beside it (dds)."""
        if way == "rclpy":
            python, env = str(self.python), {**self.inside, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        else:
            python, env = sys.executable, dict(self.beside)
        line = [python, *map(str, words)]
        self.started.append(
            subprocess.Popen(line, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        )
        return self.started[-1]

    def close(self) -> None:
        for process in self.started:
            process.kill()
            process.wait()


@dataclass(frozen=True)
class Event:
    """A line of a process: when it was said (s), and what."""

    time_s: float
    words: str

    @classmethod
    def of(cls, line: str) -> Event:
        time_s, _, words = line.strip().partition(" ")
        return cls(float(time_s), words) if time_s[:1].isdigit() else cls(0.0, line)  # a traceback, a library's log


class Drive:
    """A program that drives a robot to a goal two metres away, and what it says."""

    def __init__(self, ros: Ros, way: str, *words: object) -> None:
        self._process = ros.cartier(way, HERE / "drive.py", *words)
        self.peer = Peer(self._process)
        self.said = list[Event]()

    def until(self, word: str, timeout_s: float = 30.0) -> Event:
        """The next line that begins so."""
        while True:
            self.said.append(Event.of(self.peer.line(timeout_s)))
            if self.said[-1].words.startswith(word):
                return self.said[-1]

    def signal(self, number: int = signal.SIGINT) -> float:
        """Send a signal; returns when."""
        self._process.send_signal(number)
        return time.time()

    def end(self, timeout_s: float = 30.0) -> tuple[int, str]:
        """Its exit code and its last line."""
        code = self._process.wait(timeout_s)
        self.peer.end()
        self.said += map(Event.of, self.peer.so_far())
        return code, self.said[-1].words.removeprefix("exit ")


def heard_by(server: Peer, *words: str, timeout_s: float = 10.0) -> Event:
    """The next event of a server that begins with one of these words."""
    while True:
        event = Event.of(server.line(timeout_s))
        if event.words.startswith(words):
            return event
