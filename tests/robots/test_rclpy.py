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
    """A ROS whose one action server is as told: absent, silent, refusing or willing.

    A drive takes three spins and ends with ``status``; a request to cancel ends it as cancelled.
    """

    def __init__(self, server: str, status: int = 4, why: str = "") -> None:
        self.server, self.sent, self.inits, self.open = server, [], [], 0
        self.action, self.status, self.why, self.spins, self.feedback = "", status, why, 0, None

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

    def send(self, goal: Any, feedback_callback: Any = None) -> Any:
        self.sent.append(goal)
        self.feedback = feedback_callback
        handle = SimpleNamespace(
            accepted=self.server == "willing", get_result_async=self.drive, cancel_goal_async=self.cancel
        )
        return SimpleNamespace(done=lambda: self.server != "silent", result=lambda: handle)

    def drive(self) -> Any:
        told = SimpleNamespace(error_code=104, error_msg=self.why)
        return SimpleNamespace(
            done=lambda: self.spins >= 3, result=lambda: SimpleNamespace(status=self.status, result=told), driving=True
        )

    def cancel(self) -> Any:
        self.spins, self.status = 3, 5
        return SimpleNamespace(done=lambda: True)

    def spin(self, node: Any, future: Any, executor: Any = None, timeout_sec: float | None = None) -> None:
        assert executor.context is node.context
        assert timeout_sec is not None
        if hasattr(future, "driving"):
            self.spins += 1
            position, turn = (
                SimpleNamespace(x=self.spins / 2, y=1.0, z=0.0),
                SimpleNamespace(z=math.sin(0.5), w=math.cos(0.5)),
            )
            pose = SimpleNamespace(pose=SimpleNamespace(position=position, orientation=turn))
            self.feedback(
                SimpleNamespace(feedback=SimpleNamespace(current_pose=pose, distance_remaining=3.0 - self.spins))
            )


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


@pytest.mark.parametrize(
    ("status", "why", "ends", "says"),
    [
        (4, "", "arrived", "Nav2 says that it arrived at the chair"),
        (6, "no\nvalid path", "failed", "Nav2 gave up the drive to the chair: no valid path"),
        (6, "", "failed", "error 104"),
        (5, "", "stopped", "was cancelled"),
    ],
)
def test_a_drive_tells_the_feedback_and_the_result(
    status: int, why: str, ends: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ros = StandIn("willing", status, why)
    ros.install(monkeypatch)
    robot = plugins.make("robots", "ros2", domain=7)
    told = list(robot.drive(GOAL))
    assert [(each.status, each.left_m) for each in told[:-1]] == [("driving", 2.0), ("driving", 1.0)]
    assert told[0].pose == (0.5, 1.0, pytest.approx(1.0))
    assert told[-1].status == ends
    assert says in told[-1].text
    assert robot.pose() == ((GOAL.x, GOAL.y, GOAL.yaw) if ends == "arrived" else (1.5, 1.0, pytest.approx(1.0)))
    assert ros.open == 0


def test_a_stop_cancels_the_action(monkeypatch: pytest.MonkeyPatch) -> None:
    ros = StandIn("willing")
    ros.install(monkeypatch)
    robot = plugins.make("robots", "ros2", domain=7)
    assert robot.stop() == "nothing was driving: only a drive can be cancelled"
    drive = robot.drive(GOAL)
    next(drive)
    assert robot.stop() == "the drive is being cancelled"
    assert list(drive)[-1].status == "stopped"
    assert ros.status == 5
