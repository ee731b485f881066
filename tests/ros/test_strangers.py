"""Strangers' programs under real ROS 2 drive the dollhouse's robot; skipped without the environments of build.py."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cartier_ros.dds.domain import LAST_DOMAIN

pytest.importorskip("cyclonedds", reason="needs cartier[ros]")
HERE = Path(__file__).parent
FOLDER = Path(os.environ.get("CARTIER_TEST_ROS") or "~/.cache/cartier/ros").expanduser()
POSES = ["2.5,1.5,1.57", "1.5,2.5,3.0", "1.6,1.3,0.0"]


@pytest.fixture(params=["jazzy", "kilted"])
def environment(request: pytest.FixtureRequest) -> dict[str, str]:
    file = FOLDER / request.param / "env"
    if not file.is_file():
        pytest.skip(f"needs ROS 2 {request.param}: python tests/ros/build.py {request.param}")
    domain = str(1 + time.time_ns() % (LAST_DOMAIN - 130))
    read = dict(line.split("=", 1) for line in file.read_text().splitlines())
    return os.environ | read | {"ROS_DOMAIN_ID": domain}


@contextmanager
def played(environment: dict[str, str]) -> Iterator[None]:
    ours = os.environ | {"ROS_DOMAIN_ID": environment["ROS_DOMAIN_ID"], "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [sys.executable, "-m", "cartier", "play", "dollhouse:studio", "--ros"]
    with subprocess.Popen(command, env=ours, stdout=subprocess.PIPE, text=True) as robot:
        try:
            yield
        finally:
            robot.terminate()
            out, _ = robot.communicate(timeout=20)
    assert robot.returncode == 0 and "the robot stands at" in out


def lines_of(environment: dict[str, str], script: str, *words: str) -> list[str]:
    ran = subprocess.run(
        ["python", script, *words], cwd=HERE, env=environment, capture_output=True, text=True, timeout=120
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout.splitlines()


def test_three_poses_are_reached(environment: dict[str, str]) -> None:
    with played(environment):
        for line in lines_of(environment, "three_poses.py", *POSES):
            _, reached, off_m, count = line.split()
            assert reached == "reached" and float(off_m) < 0.25 and int(count) > 20, line


def test_the_corners_of_the_action(environment: dict[str, str]) -> None:
    with played(environment):
        told = lines_of(environment, "strange_wishes.py", "2.5,1.5", "1.5,2.5")
    assert told[0].split()[1:] == [
        "base_link<odom", "camera_color_optical_frame<camera_link", "camera_link<base_link", "odom<map", "map",
    ]  # fmt: skip
    assert told[1:] == [
        "preempted 6", "driving 2 map", "cancelled 1 5", "all cancelled 1 5", "none left 0 0",
        "outside 6 204 False", "no frame 6 9002 False", "no number 6 204 True", "from here 4 0 False", "by topic True",
    ]  # fmt: skip
