"""Robots that are watched and stopped: the laws over each of them, over real DDS to a robot in another process."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from peers import HOME, LOOPBACK, Peer, answer, any_domain, goal_at, peer

from cartier import plugins
from cartier.contracts import DrivingRobot
from cartier.errors import BackendError, InputError
from cartier.robots import Sent, send
from cartier.testing import check_robot
from cartier.types import DriveProgress, Goal

DRIVER = Path(__file__).with_name("ros_driver.py")
GOAL = goal_at(2.0, -1.0, 1.5)


@pytest.fixture
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cyclonedds", "rosbags"):
        pytest.importorskip(name, reason="needs cartier[ros]")
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setitem(sys.modules, "rclpy", None)  # plain Python, also where ROS is sourced


def near(pose: tuple[float, float, float] | None, goal: Goal) -> bool:
    assert pose is not None
    return math.dist(pose[:2], (goal.x, goal.y)) < 0.3 and abs(math.remainder(pose[2] - goal.yaw, math.tau)) < 0.3


@pytest.mark.usefixtures("loopback")
def test_a_drive_over_dds_is_watched_until_it_arrives() -> None:
    domain = any_domain()
    with peer(sys.executable, DRIVER, domain, "drives", 60):
        robot: DrivingRobot = plugins.make("robots", "ros2", domain=domain)
        told = list(robot.drive(GOAL))
        assert near(robot.pose(), GOAL)
    assert [each.status for each in told[:-1]] == ["driving"] * (len(told) - 1)
    assert told[-1].status == "arrived"
    assert told[-1].text.startswith("arrived at the chair: x 2.000 y -1.000 m yaw 1.500 rad")
    left_m = [each.left_m for each in told if each.left_m is not None]
    assert left_m == sorted(left_m, reverse=True) and left_m[0] > 0.8


@pytest.mark.usefixtures("loopback")
def test_the_laws_hold_over_dds() -> None:
    domain = any_domain()
    with peer(sys.executable, DRIVER, domain, "drives", 90):
        check_robot(lambda: plugins.make("robots", "ros2", domain=domain), GOAL)


def goals(robot: Peer) -> Iterator[tuple[float, float, float]]:
    while True:
        word, *numbers = robot.line().split()
        assert word == "goal"
        x, y, yaw = map(float, numbers)
        yield x, y, yaw


@pytest.mark.usefixtures("loopback")
def test_a_stop_over_dds_sends_the_robot_where_it_is() -> None:
    domain = any_domain()
    with peer(sys.executable, DRIVER, domain, "drives", 60, 0.5) as process:
        robot: DrivingRobot = plugins.make("robots", "ros2", domain=domain)
        told = list[DriveProgress]()
        said = list[DriveProgress]()
        for progress in robot.drive(goal_at(10.0, 0.0, 0.0)):
            told.append(progress)
            if len(told) == 3:
                threading.Thread(target=lambda: said.append(robot.stop())).start()
        sent = goals(process)
        assert next(sent) == (10.0, 0.0, 0.0)
        x, y, _ = next(sent)
    assert told[-1].status == "stopped"
    assert 0 < x < 4 and abs(y) < 0.01
    assert said == [told[-1]]
    assert told[-1].text.startswith("asked to stay where it is, and stands at x ")


@pytest.mark.usefixtures("loopback")
@pytest.mark.parametrize(
    ("form", "status", "says"),
    [
        ("stuck", "failed", r"has not moved for \d s, 1.7\d m short"),
        ("mute", "unknown", "received.*; no transforms lead from 'map' to the robot's base"),
        ("dies", "failed", r"transforms stopped coming 1.\d+ m short"),
    ],
)
def test_a_drive_that_does_not_arrive_says_why(
    form: str, status: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cartier_ros.robots.dds.STUCK_S", 1.0)
    monkeypatch.setattr("cartier_ros.robots.dds.SILENT_S", 1.0)
    domain = any_domain()
    with peer(sys.executable, DRIVER, domain, form, 60):
        robot = plugins.make("robots", "ros2", domain=domain, timeout_s=1.0)
        last = list(robot.drive(GOAL))[-1]
        if form == "mute":
            end = robot.stop()
            assert end.status == "unknown" and "it may still be driving" in end.text
    assert last.status == status
    assert re.search(says, last.text), last.text


@pytest.mark.usefixtures("loopback")
def test_a_robot_that_is_not_there_is_not_watched() -> None:
    with pytest.raises(BackendError, match="no robot listens"):
        next(plugins.make("robots", "ros2", domain=any_domain(), timeout_s=0.3).drive(GOAL))


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> str:
    file: Path = tmp_path_factory.mktemp("home") / "tiny.yaml"
    file.write_text(HOME, encoding="utf-8")
    return str(file)


WAY = Goal(1.0, 1.8, 0.5, np.array([[1.0, 1.0], [1.0, 1.8]]), 0.8, GOAL.place, True)


def test_the_built_in_robot_is_watched(home: str) -> None:
    check_robot(lambda: plugins.make("robots", "dollhouse", home=home, speed_m_s=5.0), WAY)
    robot: DrivingRobot = plugins.make("robots", "dollhouse", home=home, speed_m_s=0)
    assert robot.pose() is None
    told = list(robot.drive(WAY))
    assert told[-1].text == robot.go_to(WAY)
    assert robot.pose() == told[-1].pose
    assert near(robot.pose(), WAY)
    assert told[0].pose is not None and told[0].pose[:2] == (1.0, 1.0)
    assert len(told) == 5  # each quarter of a metre of 0.8 m, and the end


def test_the_built_in_robot_takes_its_time(home: str) -> None:
    robot: DrivingRobot = plugins.make("robots", "dollhouse", home=home, speed_m_s=0.5)
    drive = robot.drive(WAY)
    next(drive)
    robot.stop()
    last = list(drive)[-1]
    assert last.status == "stopped"
    assert robot.pose() == last.pose == (1.0, 1.0, pytest.approx(math.pi / 2))
    with pytest.raises(InputError, match="speed_m_s"):
        plugins.make("robots", "dollhouse", home=home, speed_m_s=-1)


class Drives:
    """A robot whose drive is interrupted by the person, or is told as it is given."""

    name = "test"

    def __init__(self, told: list[DriveProgress | BaseException]) -> None:
        self.told, self.stops = told, 0

    def go_to(self, goal: Goal) -> str:
        return "sent"

    def drive(self, goal: Goal) -> Iterator[DriveProgress]:
        for each in self.told:
            if isinstance(each, BaseException):
                raise each
            yield each

    def pose(self) -> tuple[float, float, float] | None:
        return None

    def stop(self) -> DriveProgress:
        self.stops += 1
        return DriveProgress("stopped", "it stands")


ON = DriveProgress("driving", "1.0 m to the chair")


def test_who_watches_is_told_how_it_ends() -> None:
    found, seen = answer("found", GOAL), list[DriveProgress]()
    sent = send(Drives([ON, DriveProgress("arrived", "there")]), found, seen.append)
    assert (sent.text, sent.end, sent.signal, sent.exit_code) == ("there", seen[-1], None, 0)
    assert [each.status for each in seen] == ["driving", "arrived"]
    assert send(Drives([]), found) == Sent("sent")  # nobody watches
    assert send(plugins.make("robots", "print"), found, seen.append).text.startswith("chair: ")


@pytest.mark.parametrize(("status", "code"), [("arrived", 0), ("failed", 1), ("unknown", 3), ("stopped", 1)])
def test_the_exit_code_says_what_became_of_it(status: str, code: int) -> None:
    sent = send(Drives([ON, DriveProgress(status, "so")]), answer("found", GOAL), lambda _: None)
    assert sent.exit_code == code
    assert Sent("", DriveProgress(status, "so"), signal.SIGTERM).exit_code == (143 if status == "stopped" else code)


class Fails(Exception):
    """What goes wrong in a program that watches."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("moment", ["at once", "later", "twice"])
def test_a_signal_stops_the_robot(home: str, number: signal.Signals, moment: str) -> None:
    robot = plugins.make("robots", "dollhouse", home=home, speed_m_s=0.5)

    def watch(progress: DriveProgress) -> None:
        if not progress.ended and (moment != "later" or progress.left_m < 0.7):
            for _ in range(2 if moment == "twice" else 1):
                signal.raise_signal(number)

    before = signal.getsignal(number)
    sent = send(robot, answer("found", WAY), watch)
    assert sent.end is not None and sent.end.status == "stopped"
    assert sent.exit_code == 128 + number
    assert signal.getsignal(number) is before


def test_a_stop_before_the_first_word_holds(home: str) -> None:
    robot: DrivingRobot = plugins.make("robots", "dollhouse", home=home, speed_m_s=0.5)
    drive = robot.drive(WAY)
    robot.stop()
    assert [each.status for each in drive] == ["driving", "stopped"]


def test_what_fails_while_it_watches_stops_the_robot(home: str) -> None:
    def watch(progress: DriveProgress) -> None:
        raise Fails

    robot: DrivingRobot = plugins.make("robots", "dollhouse", home=home, speed_m_s=0.5)
    with pytest.raises(Fails):
        send(robot, answer("found", WAY), watch)
    assert robot.pose() == (1.0, 1.0, pytest.approx(math.pi / 2))


def test_the_end_of_a_program_stops_its_robot(home: str) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_driving import WAY; from cartier import plugins\n"
        "robot = plugins.make('robots', 'dollhouse', home=sys.argv[2], speed_m_s=0.5)\n"
        "drive = robot.drive(WAY); next(drive)\n"
        "import atexit; drives = robot._drives\n"
        "import cartier.robots.common.drives as d; atexit.unregister(d._stop_all)\n"
        "atexit.register(lambda: print(drives._latest.end.status)); atexit.register(d._stop_all)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parent), home], capture_output=True, text=True
    )
    assert done.stdout.strip() == "stopped", done.stderr


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ([ON], "must end"),
        ([], "must end"),
        ([DriveProgress("arrived", "there")], "must say where it is"),
        ([DriveProgress("failed", "no"), ON], "after the end"),
    ],
)
def test_the_laws_notice_a_robot_that_breaks_them(told: list[DriveProgress], says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        check_robot(lambda: Drives(list(told)))


@pytest.mark.parametrize(("status", "text"), [("lost", "?"), ("driving", ""), ("driving", "two\nlines")])
def test_progress_is_one_line_with_a_known_status(status: str, text: str) -> None:
    with pytest.raises(InputError):
        DriveProgress(status, text)
