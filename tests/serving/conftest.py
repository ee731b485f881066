"""A small saved home, and servers of it: in a thread of this process, and in other processes, as people run them."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
class Beside:
    """A server in this process."""

    port: int

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"


@dataclass
class Server(Beside):
    """A server in a process of its own."""

    process: subprocess.Popen[bytes]
    log: Path


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return int(listening.getsockname()[1])


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts ``cartier COMMAND …`` that listens, and waits until it does; all are ended after the test."""
    with starting(tmp_path) as begin:
        yield begin


@pytest.fixture
def beside() -> Iterator[Callable[..., Beside]]:
    """Runs the command ``cartier COMMAND …`` that listens in a thread, which starts at once; all end after the test."""
    with running_beside() as begin:
        yield begin


@contextmanager
def running_beside() -> Iterator[Callable[..., Beside]]:
    import typer
    import uvicorn

    from cartier.cli import app

    started: list[tuple[uvicorn.Server, threading.Thread]] = []

    def begin(command: str, *words: object, **env: str) -> Beside:
        port, ready, faults = free_port(), threading.Event(), list[BaseException]()

        def serve(**settings: Any) -> None:
            server = uvicorn.Server(uvicorn.Config(**settings))
            started.append((server, threading.current_thread()))
            ready.set()
            server.run()

        def run() -> None:
            try:
                typer.main.get_command(app).main(
                    [command, *map(str, words), "--port", str(port)], standalone_mode=False
                )
            except BaseException as fault:
                faults.append(fault)
                ready.set()

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(uvicorn, "run", serve)
            for name, value in env.items():
                patch.setenv(name, value)
            threading.Thread(target=run, daemon=True).start()
            assert ready.wait(60) and not faults, faults
        while not started[-1][0].started:
            assert started[-1][1].is_alive(), faults
            time.sleep(0.005)
        return Beside(port)

    try:
        yield begin
    finally:
        for server, _ in started:
            server.should_exit = True
        for _, thread in started:
            thread.join(20)


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
