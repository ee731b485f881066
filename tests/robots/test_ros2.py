"""A goal sent over real DDS to a second process, and what is said when nobody is there."""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from peers import LOOPBACK, any_domain, goal_at, peer

from cartier import plugins
from cartier.errors import BackendError, MissingExtra

LISTENER = Path(__file__).with_name("ros_listener.py")
GOAL = goal_at(2.5, -1.25, 1.9)


@pytest.fixture
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds: pip install 'cartier[ros]'")
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setitem(sys.modules, "rclpy", None)  # plain Python, also where ROS is sourced


@pytest.mark.usefixtures("loopback")
def test_a_goal_arrives_in_another_process() -> None:
    domain = any_domain()
    with peer(sys.executable, LISTENER, domain, "goal_pose", 1, 20) as listener:
        said = plugins.make("robots", "ros2", domain=domain).go_to(GOAL)
        heard = json.loads(listener.line())
    assert said == (
        f"sent on /goal_pose in domain {domain} over DDS, and received: x 2.500 y -1.250 m yaw 1.900 rad in frame map"
    )
    assert heard["frame"] == "map"
    assert heard["stamp"] == [0, 0]
    assert heard["position"] == [2.5, -1.25, 0.0]
    assert heard["orientation"] == [0.0, 0.0, math.sin(0.95), math.cos(0.95)]


@pytest.mark.usefixtures("loopback")
def test_the_type_hash_is_that_of_ros_and_is_told_as_ros_tells_it() -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="needs rosbags: pip install 'cartier[ros]'")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    domain = any_domain()
    with peer(sys.executable, LISTENER, domain, "goal_pose", 1, 20) as listener:
        plugins.make("robots", "ros2", domain=domain).go_to(GOAL)
        heard = json.loads(listener.line())
    assert heard["user_data"] == f"typehash={store.hash_rihs01('geometry_msgs/msg/PoseStamped')};"


@pytest.mark.usefixtures("loopback")
def test_a_namespace_and_the_domain_of_the_shell_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = any_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    with (
        peer(sys.executable, LISTENER, domain, "fleet/r2/goal_pose", 2, 20) as listener,
        peer(sys.executable, LISTENER, domain, "fleet/r2/goal_pose", 2, 20),
    ):
        robot = plugins.make("robots", "ros2", namespace="/fleet/r2/")
        said = [robot.go_to(GOAL), robot.go_to(goal_at(1.0, 2.0, 0.0))]
        heard = [json.loads(listener.line())["position"][:2] for _ in said]
    assert heard == [[2.5, -1.25], [1.0, 2.0]]
    assert all("on /fleet/r2/goal_pose" in line and "received by 2 listeners" in line for line in said)


@pytest.mark.usefixtures("loopback")
def test_a_listener_that_is_found_a_moment_after_the_first_is_waited_for() -> None:
    from cartier_ros.robots.dds import matched_listeners

    begin = time.monotonic()

    def listeners() -> int:
        age_s = time.monotonic() - begin
        return 2 if age_s > 0.2 else 1 if age_s > 0.05 else 0

    assert matched_listeners(listeners, 5.0) == 2


@pytest.mark.usefixtures("loopback")
def test_a_robot_that_is_not_there_is_said_in_time() -> None:
    domain, begin = any_domain(), time.monotonic()
    with pytest.raises(BackendError, match=rf"^no robot listens on /goal_pose in domain {domain} \(waited 0.5 s\)"):
        plugins.make("robots", "ros2", domain=domain, timeout_s=0.5).go_to(GOAL)
    assert time.monotonic() - begin < 5


@pytest.mark.usefixtures("loopback")
def test_a_robot_that_listens_but_hangs_is_said_in_time() -> None:
    from cyclonedds.domain import DomainParticipant

    domain = any_domain()
    with peer(sys.executable, LISTENER, domain, "goal_pose", 2, 30) as listener:
        known = DomainParticipant(domain)  # as long as it lives, this process remembers who listens
        plugins.make("robots", "ros2", domain=domain).go_to(GOAL)
        robot = plugins.make("robots", "ros2", domain=domain, timeout_s=1.0)
        listener.process.send_signal(signal.SIGSTOP)
        with pytest.raises(
            BackendError, match=r"^a robot listens .* but did not take the goal within 1 s; it may still take it$"
        ):
            robot.go_to(GOAL)
        listener.process.send_signal(signal.SIGCONT)
        del known


@pytest.mark.usefixtures("loopback")
def test_a_network_that_dds_cannot_use_is_one_line(monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK.replace('name="lo"', 'name="no_such_card"'))
    with pytest.raises(BackendError, match="CYCLONEDDS_URI") as caught:
        plugins.make("robots", "ros2", domain=any_domain(), timeout_s=0.5).go_to(GOAL)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"domain": 233}, "domain .* 0 to 232, got 233"),
        ({"domain": -1}, "domain"),
        ({"timeout_s": 0.0}, "timeout_s"),
        ({"timeout_s": math.nan}, "timeout_s"),
        ({"namespace": "r 2"}, "namespace"),
        ({"namespace": "a//b"}, "namespace"),
        ({"topic": "x"}, "no option 'topic'; it has domain, timeout_s, namespace, base_frame"),
    ],
)
def test_impossible_options_are_said(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(BackendError, match=complaint):
        plugins.make("robots", "ros2", **options)


def test_a_domain_in_the_shell_that_is_no_number_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "home")
    with pytest.raises(BackendError, match=r"ROS_DOMAIN_ID.* got 'home'"):
        plugins.make("robots", "ros2")


def test_without_ros_and_without_cyclonedds_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("rclpy", "cyclonedds"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"pip install .*\[ros\]'"):
        plugins.make("robots", "ros2")
