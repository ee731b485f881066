"""A small saved home, and servers of it in other processes, as people run them."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from cartier.pipeline import map_home
from synthetic import THINGS, TrueBoxes, walk


@pytest.fixture(scope="session")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("serving") / "room"
    map_home(walk(), TrueBoxes(THINGS)).save(folder)
    return folder


@pytest.fixture
def home(mapped: Path, tmp_path: Path) -> Path:
    """One that a test may correct."""
    shutil.copytree(mapped, tmp_path / "room")
    return tmp_path / "room"


@dataclass
class Server:
    port: int
    process: subprocess.Popen[bytes]
    log: Path

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return int(listening.getsockname()[1])


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts ``cartier COMMAND …`` that listens, and waits until it does; all are ended after the test."""
    with starting(tmp_path) as begin:
        yield begin


@contextmanager
def starting(folder: Path) -> Iterator[Callable[..., Server]]:
    running: list[subprocess.Popen[bytes]] = []

    def begin(command: str, *words: object, **env: str) -> Server:
        port, log = free_port(), folder / f"log-{len(running)}"
        with log.open("wb") as told:
            line = [sys.executable, "-m", "cartier", command, *map(str, words), "--port", str(port)]
            running.append(
                subprocess.Popen(line, stdout=told, stderr=told, env=os.environ | {"OMP_NUM_THREADS": "1"} | env)
            )
        for _ in range(600):
            with socket.socket() as asking:
                if asking.connect_ex(("127.0.0.1", port)) == 0:
                    return Server(port, running[-1], log)
            assert running[-1].poll() is None, log.read_text()
            time.sleep(0.05)
        raise AssertionError(log.read_text())

    try:
        yield begin
    finally:
        for process in running:
            process.kill()
            process.wait()
