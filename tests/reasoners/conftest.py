"""A real engine behind real HTTP on this machine, and no way to any other machine."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
Asked = Callable[[str], list[dict[str, Any]]]


@pytest.fixture(autouse=True)
def only_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    connect = socket.socket.connect

    def guarded(self: socket.socket, address: Any) -> None:
        assert self.family == socket.AF_UNIX or address[0] == "127.0.0.1", f"a test wants to reach {address}"
        connect(self, address)

    monkeypatch.setattr(socket.socket, "connect", guarded)
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@pytest.fixture(scope="session")
def tiny_model(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A GGUF file of random weights. Many threads would only wait for each other on so small a model."""
    pytest.importorskip("mistralrs", reason="needs the mistralrs wheel (an inference engine)")
    pytest.importorskip("gguf", reason="needs gguf to write the tiny model")
    from llm_server import write_tiny_llama

    model = tmp_path_factory.mktemp("model") / "tiny.gguf"
    write_tiny_llama(model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAYON_NUM_THREADS", "1")
        yield model


@pytest.fixture(scope="session")
def server(tiny_model: Path) -> Iterator[str]:
    """The address of llm_server.py with a random-weight model; the model's name in a request is its behaviour."""
    process = subprocess.Popen(
        [sys.executable, HERE / "llm_server.py", tiny_model],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    port = next(line.split()[1] for line in process.stdout if line.startswith("port "))  # after the engine's own log
    yield f"http://127.0.0.1:{port}"
    process.kill()
    process.wait()


@pytest.fixture
def asked(server: str) -> Asked:
    """The requests that a behaviour has had so far."""

    def read(behaviour: str) -> list[dict[str, Any]]:
        with urllib.request.urlopen(f"{server}/{behaviour}") as reply:
            requests: list[dict[str, Any]] = json.load(reply)
            return requests

    return read
