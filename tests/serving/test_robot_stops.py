"""A robot that an agent sent stops with the server, whatever ends it, and when the agent asks."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mcp", reason="needs cartier[mcp]")

from mcp import Client, StdioServerParameters
from mcp_types import ElicitRequestParams, ElicitResult

from serving.conftest import Server

ROBOT = '''
"""Robot that drives for a minute and writes down what becomes of it."""
import os
from pathlib import Path
from cartier.robots.common.drives import Drives
from cartier.types import DriveProgress

LOG = Path(__file__).with_suffix(".log")


class Creeps:
    name = "creeps"

    def __init__(self):
        self.drives = Drives(self.steps, lambda: DriveProgress("stopped", "it stands"))
        self.go_to, self.drive, self.stop = self.drives.send, self.drives.watch, self.drives.stop

    def pose(self):
        return None

    def steps(self, goal, asked):
        LOG.write_text(f"driving {os.getpid()}")
        yield DriveProgress("driving", "off it creeps")
        for _ in range(120):
            if asked.wait(0.5):
                LOG.write_text("stopped")
                yield DriveProgress("stopped", "it stopped")
                return
            yield DriveProgress("driving", "it creeps")
        yield DriveProgress("arrived", "there")


def make():
    return Creeps()
'''


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    file = tmp_path / "creeps.py"
    file.write_text(ROBOT)
    return file


async def agreed(context: Any, params: ElicitRequestParams) -> ElicitResult:
    return ElicitResult(action="accept", content={"go": "yes"})


def stands(robot: Path) -> bool:
    end = time.monotonic() + 5
    while (told := robot.with_suffix(".log").read_text()) != "stopped" and time.monotonic() < end:
        time.sleep(0.02)
    return told == "stopped"


@pytest.mark.parametrize("ends_by", ["the tool", "SIGINT", "SIGHUP", "end of input"])
def test_over_stdio(ends_by: str, home: Path, robot: Path) -> None:
    line = ["-m", "cartier", "mcp", str(home), "--allow-go", str(robot)]
    env = {k: os.environ[k] for k in ("PATH", "HOME", "PYTHONPATH") if k in os.environ} | {"OMP_NUM_THREADS": "1"}

    async def run() -> None:
        parameters = StdioServerParameters(command=sys.executable, args=line, env=env)
        async with Client(parameters, elicitation_callback=agreed) as client:
            sent = await client.call_tool("go", {"entity": "chair"})
            assert sent.structured_content["sent"] == "off it creeps", sent
            word, pid = robot.with_suffix(".log").read_text().split()
            assert word == "driving"
            if ends_by == "the tool":
                told = (await client.call_tool("stop", {})).structured_content
                assert (told["robot"], told["says"]) == ("stopped", "it stopped")
            elif ends_by != "end of input":
                os.kill(int(pid), getattr(signal, ends_by))
                assert stands(robot)

    try:
        asyncio.run(run())
    except Exception:
        assert ends_by.startswith("SIG")  # the client's own view of a server that has gone
    assert stands(robot)


def test_over_http(home: Path, robot: Path, start: Callable[..., Server]) -> None:
    server = start("mcp", home, "--http", "--allow-go", robot)

    async def run() -> None:
        async with Client(f"{server.url}/mcp", elicitation_callback=agreed) as client:
            await client.call_tool("go", {"entity": "chair"})
            server.process.send_signal(signal.SIGTERM)
            assert stands(robot)

    with suppress(Exception):  # the client's own view of a server that has gone
        asyncio.run(run())
    assert stands(robot)
    assert server.process.wait(10) == 143
    assert "robot: it stopped" in server.log.read_text()
