"""Drives over ROS 2: what an action server does with a goal, and that whatever interrupts a drive stops the robot."""

from __future__ import annotations

import signal

import pytest
from rospeers import WAYS, Drive, Ros, heard_by

SLOW = pytest.mark.slow
POSE = "goal map 1.600 1.200 0.500"


@pytest.mark.parametrize("cell", ["accepted"])
def test_an_action_is_followed(ros: Ros, cell: str) -> None:
    with ros.peer("nav_server.py", "drives", 60, 2.0) as server:
        drive = Drive(ros, "rclpy")
        assert heard_by(server, "goal").words == POSE
        code, said = drive.end()
    assert (code, said) == (0, "Nav2 says that it arrived at the chair")
    words = [event.words for event in drive.said]
    assert words[1].startswith("driving accepted by /navigate_to_pose")
    assert any(" m to the chair" in line for line in words)


@SLOW
@pytest.mark.parametrize(
    ("cell", "form", "says"),
    [
        ("refused", "refuses", "refused the goal: x 1.600 y 1.200 m"),
        ("aborted", "aborts", "Nav2 gave up the drive to the chair: no valid path"),
    ],
)
def test_a_goal_that_fails_is_told(ros: Ros, cell: str, form: str, says: str) -> None:
    with ros.peer("nav_server.py", form, 60):
        code, said = Drive(ros, "rclpy").end()
    assert code == 1
    assert says in said


@SLOW
@pytest.mark.parametrize("cell", ["goal out"])
def test_a_goal_over_dds_arrives(ros: Ros, cell: str) -> None:
    with ros.peer("nav_server.py", "drives", 60, 2.0) as server:
        drive = Drive(ros, "dds")
        assert heard_by(server, "goal").words == POSE
        code, said = drive.end()
    assert code == 0, drive.said
    assert said.startswith("arrived at the chair: x 1.600 y 1.200 m yaw 0.500 rad")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("cell", ["cancelled"])
@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(n, marks=SLOW) for n in (signal.SIGTERM, signal.SIGHUP))]
)
def test_a_signal_cancels(ros: Ros, cell: str, way: str, number: signal.Signals) -> None:
    with ros.peer("nav_server.py", "drives", 60) as server:
        drive = Drive(ros, way)
        drive.until("driving")
        heard_by(server, "goal")
        sent_s = drive.signal(number)
        drive.signal(number)  # a second one has no effect
        assert heard_by(server, "cancelled", "succeeded").words == "cancelled"
        code, said = drive.end()
    assert "the drive" in said and "was cancelled" in said
    assert code == 128 + number
    assert drive.said[-1].time_s - sent_s < 3


@SLOW
def test_a_signal_before_the_acceptance_cancels(ros: Ros) -> None:
    with ros.peer("nav_server.py", "hesitates", 60) as server:
        drive = Drive(ros, "rclpy")
        heard_by(server, "hesitates")
        drive.signal()
        code, said = drive.end()
        assert heard_by(server, "cancelled", "succeeded").words == "cancelled"
    assert (code, said) == (130, "the drive to the chair was cancelled")


@SLOW
@pytest.mark.parametrize(
    ("form", "says"),
    [("deaf", "did not say within 3 s that it cancelled"), ("dies", "the server "), ("stuck", "silent: ")],
)
def test_what_may_still_be_driving_is_told(ros: Ros, form: str, says: str) -> None:
    with ros.peer("nav_server.py", form, 60, 0.1) as server:  # twenty seconds to the goal
        drive = Drive(ros, "rclpy", 1.0)
        heard_by(server, "goal")
        if form == "deaf":
            drive.signal()
        code, said = drive.end()
    assert says in said and "it may still be driving; stop it on the robot" in said
    assert code == 3


@SLOW
@pytest.mark.parametrize("way", WAYS)
def test_the_laws_hold(ros: Ros, way: str) -> None:
    with ros.peer("nav_server.py", "drives", 90, 1.0):
        drive = Drive(ros, way, "laws")
        code, said = drive.end(80)
    assert (code, said) == (0, "the laws hold")


@SLOW
def test_nobody_serves(ros: Ros) -> None:
    code, said = Drive(ros, "rclpy").end()
    assert code == 1
    assert said.startswith(f"no robot serves the action /navigate_to_pose in domain {ros.domain}")
