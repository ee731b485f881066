"""The way through rclpy, against a stand-in: no ROS runs where these tests run.

The stand-in has the names and signatures of rclpy's own source (Humble to Kilted) and nothing behind them. What it
cannot show is that a real Nav2 takes the goal; what it shows is what is sent, and what is said of each outcome.
"""

from __future__ import annotations

import math
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from peers import goal_at

from cartier import plugins
from cartier.errors import BackendError

GOAL = goal_at(2.5, -1.25, 1.9)


class StandIn:
    """A ROS whose one action server is as told: absent, silent, refusing or willing."""

    def __init__(self, server: str) -> None:
        self.server, self.sent, self.inits, self.open = server, [], [], 0
        self.action = ""

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        rclpy = self._module("rclpy", init=self.init, shutdown=self.shutdown, create_node=self.create_node)
        rclpy.spin_until_future_complete = self.spin
        modules = [
            rclpy,
            self._module("rclpy.action", ActionClient=self.client),
            self._module("rclpy.context", Context=SimpleNamespace),
            self._module("rclpy.executors", SingleThreadedExecutor=lambda *, context: SimpleNamespace(context=context)),
            self._module("nav2_msgs"),
            self._module("nav2_msgs.action", NavigateToPose=SimpleNamespace(Goal=self.message)),
        ]
        for module in modules:
            monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setitem(
            sys.modules, "cartier.robots.rclpy_action", None
        )  # so that undoing forgets what is imported now
        del sys.modules["cartier.robots.rclpy_action"]

    @staticmethod
    def _module(name: str, **content: Any) -> Any:
        module = ModuleType(name)
        module.__dict__.update(content)
        return module

    @staticmethod
    def message() -> Any:
        header = SimpleNamespace(stamp=(0, 0), frame_id="")
        pose = SimpleNamespace(
            position=SimpleNamespace(x=0.0, y=0.0, z=0.0), orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        )
        return SimpleNamespace(pose=SimpleNamespace(header=header, pose=pose), behavior_tree="")

    def init(self, *, args: Any = None, context: Any = None, domain_id: int | None = None) -> None:
        assert context is not None  # never the context of the program around
        self.inits.append((args, domain_id))
        self.open += 1

    def shutdown(self, *, context: Any = None) -> None:
        self.open -= 1

    def create_node(self, node_name: str, *, context: Any = None) -> Any:
        return SimpleNamespace(name=node_name, context=context)

    def client(self, node: Any, action_type: Any, action_name: str) -> Any:
        self.action = action_name
        return SimpleNamespace(
            wait_for_server=lambda timeout_sec=None: self.server != "absent", send_goal_async=self.send
        )

    def send(self, goal: Any) -> Any:
        self.sent.append(goal)
        return SimpleNamespace(
            done=lambda: self.server != "silent", result=lambda: SimpleNamespace(accepted=self.server == "willing")
        )

    def spin(self, node: Any, future: Any, executor: Any = None, timeout_sec: float | None = None) -> None:
        assert executor.context is node.context
        assert timeout_sec is not None


def test_the_goal_is_sent_as_an_action_and_its_acceptance_said(monkeypatch: pytest.MonkeyPatch) -> None:
    ros = StandIn("willing")
    ros.install(monkeypatch)
    said = plugins.make("robots", "ros2", domain=7, namespace="r2").go_to(GOAL)
    assert said == "accepted by /r2/navigate_to_pose in domain 7: x 2.500 y -1.250 m yaw 1.900 rad in frame map"
    assert ros.action == "r2/navigate_to_pose"
    assert ros.inits == [([], 7)]
    assert ros.open == 0
    (goal,) = ros.sent
    pose = goal.pose.pose
    assert (goal.pose.header.frame_id, goal.pose.header.stamp) == ("map", (0, 0))
    assert (pose.position.x, pose.position.y, pose.position.z) == (2.5, -1.25, 0.0)
    assert (pose.orientation.x, pose.orientation.y) == (0.0, 0.0)
    assert (pose.orientation.z, pose.orientation.w) == (math.sin(0.95), math.cos(0.95))


@pytest.mark.parametrize(
    ("server", "complaint"),
    [
        ("absent", r"^no robot serves the action /navigate_to_pose in domain 7 \(waited 0.5 s\)"),
        ("silent", "did not answer within 0.5 s"),
        ("refusing", "refused the goal: x 2.500"),
    ],
)
def test_each_failure_is_said(server: str, complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ros = StandIn(server)
    ros.install(monkeypatch)
    with pytest.raises(BackendError, match=complaint):
        plugins.make("robots", "ros2", domain=7, timeout_s=0.5).go_to(GOAL)
    assert ros.open == 0
