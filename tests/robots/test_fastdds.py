"""The other vendor: a C++ program on Debian's Fast DDS receives the goal that cyclonedds sent, every field exact."""

from __future__ import annotations

import hashlib
import math
import shutil
import subprocess
from pathlib import Path

import pytest
from peers import LOOPBACK, any_domain, goal_at, peer

from cartier import plugins

SOURCES = Path(__file__).parent / "fastdds_peer"
NEEDS = "libfastrtps-dev libfastcdr-dev fastddsgen g++"


@pytest.fixture(scope="module")
def program(pytestconfig: pytest.Config) -> Path:
    """The peer, built from source once for each state of its sources: generating and compiling takes some seconds."""
    if not (shutil.which("fastddsgen") and shutil.which("g++") and Path("/usr/include/fastdds").is_dir()):
        pytest.skip(f"needs Fast DDS for C++: apt-get install {NEEDS}")
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(SOURCES.iterdir()))).hexdigest()
    folder = Path(pytestconfig.cache.mkdir("fastdds_peer")) / digest[:16]
    if not (folder / "peer").is_file():
        shutil.copytree(SOURCES, folder, dirs_exist_ok=True)
        for command in (
            ["fastddsgen", "-replace", "PoseStamped.idl"],
            ["g++", "-std=c++17", "-O0", "-o", "peer.new", "peer.cpp", "PoseStamped.cxx", "PoseStampedPubSubTypes.cxx",
             "-lfastrtps", "-lfastcdr"],
        ):  # fmt: skip
            built = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
            assert built.returncode == 0, built.stdout + built.stderr
        (folder / "peer.new").rename(folder / "peer")
    return folder / "peer"


def test_fast_dds_receives_the_goal(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds: pip install 'cartier[ros]'")
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr("cartier.robots.ros2._rclpy_is_here", lambda: False)
    goal, domain = goal_at(1 / 3, -12.345678901234567, -2.5), any_domain()
    with peer(program, domain, 20) as robot:
        said = plugins.make("robots", "ros2", domain=domain, timeout_s=10.0).go_to(goal)
        frame, *numbers = robot.line().split()
    assert said.startswith(f"sent on /goal_pose in domain {domain} over DDS, and received")
    assert frame == "map"
    assert list(map(float, numbers)) == [0, 0, goal.x, goal.y, 0, 0, 0, math.sin(-1.25), math.cos(-1.25)]
