"""The other vendor: a C++ program on Debian's Fast DDS receives the goal that cyclonedds sent, every field exact."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from peers import LOOPBACK, any_domain, fastdds_program, goal_at, peer

from cartier import plugins

SOURCES = Path(__file__).parent / "fastdds_peer"


@pytest.fixture(scope="module")
def program(pytestconfig: pytest.Config) -> Path:
    return fastdds_program(pytestconfig, SOURCES)


def test_fast_dds_receives_the_goal(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds: pip install 'cartier[ros]'")
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr("cartier_ros.robots.ros2._rclpy_is_here", lambda: False)
    goal, domain = goal_at(1 / 3, -12.345678901234567, -2.5), any_domain()
    with peer(program, domain, 20) as robot:
        said = plugins.make("robots", "ros2", domain=domain, timeout_s=10.0).go_to(goal)
        frame, *numbers = robot.line().split()
    assert said.startswith(f"sent on /goal_pose in domain {domain} over DDS, and received")
    assert frame == "map"
    assert list(map(float, numbers)) == [0, 0, goal.x, goal.y, 0, 0, 0, math.sin(-1.25), math.cos(-1.25)]
