"""When a goal leaves and when it does not; the printed command; the built-in robot."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from peers import HOME, answer, goal_at

from cartier import plugins
from cartier.contracts import Robot
from cartier.errors import BackendError, InputError
from cartier.robots import send
from cartier.types import Answer, Goal, Place

metres = st.floats(-200, 200)
angles = st.floats(-math.pi, math.pi)


class Recorder:
    """A robot that only remembers."""

    name = "recorder"

    def __init__(self) -> None:
        self.goals: list[Goal] = []

    def go_to(self, goal: Goal) -> str:
        self.goals.append(goal)
        return "off it goes"


GOAL = goal_at(1.0, 2.0, 0.5)


@pytest.mark.parametrize("status", ["found", "likely_near"])
def test_found_and_near_are_sent(status: str) -> None:
    robot = Recorder()
    assert send(robot, answer(status, GOAL)).text == "off it goes"
    assert robot.goals == [GOAL]


@pytest.mark.parametrize(
    ("told", "why"),
    [
        (answer("not_found", None), "nothing was sent: no object here serves the request"),
        (answer("clarify", None), "nothing was sent: answer the question first: which one?"),
        (
            answer("found", None, ("another note", "no goal: no pose within 2.0 m of the chair can be reached")),
            "nothing was sent: no goal: no pose within 2.0 m of the chair can be reached",
        ),
        (answer("likely_near", None, ("another note",)), "nothing was sent: the chair has no goal"),
        (answer("answered", None, ("another note",)), "nothing was sent: the answer is in words"),
        (answer("not_found", GOAL), "nothing was sent: no object here serves the request"),  # a goal alone is no reason
        (answer("clarify", GOAL), "nothing was sent: answer the question first: which one?"),
    ],
)
def test_else_nothing_is_sent_and_the_reason_said(told: Answer, why: str) -> None:
    robot = Recorder()
    sent = send(robot, told)
    assert (sent.text, sent.exit_code) == (why, 4)
    assert robot.goals == []


def test_of_several_needs_the_first_that_can_be_served_is_and_the_others_are_named() -> None:
    robot, sofa = Recorder(), goal_at(3.0, 1.0, 0.0, "sofa")
    line = send(robot, answer("not_found", None, next=(answer("found", GOAL), answer("found", sofa)))).text
    assert robot.goals == [GOAL]
    assert line == "off it goes; after that: sofa"


def test_every_robot_obeys_the_contract_by_name() -> None:
    names = [backend.name for backend in plugins.backends("robots")]
    assert names == ["dollhouse", "print", "ros2"]
    assert all(backend.summary for backend in plugins.backends("robots"))


@given(metres, metres, angles)
@example(1e-5, -1e-7, 1e-9)  # Python writes these with an exponent, which YAML 1.1 reads as text
def test_the_printed_command_holds_the_goal(x: float, y: float, yaw: float) -> None:
    robot: Robot = plugins.make("robots", "print")
    line = robot.go_to(goal_at(x, y, yaw))
    assert "\n" not in line
    words = shlex.split(line[line.index("ros2 action") :])
    assert words[:5] == ["ros2", "action", "send_goal", "/navigate_to_pose", "nav2_msgs/action/NavigateToPose"]
    (message,) = (yaml.safe_load(word) for word in words[5:])
    assert message["pose"]["header"] == {"frame_id": "map"}
    pose = message["pose"]["pose"]
    position, turn = pose["position"], pose["orientation"]
    assert all(isinstance(v, float) for v in (*position.values(), *turn.values()))
    assert (position["z"], turn["x"], turn["y"]) == (0.0, 0.0, 0.0)
    assert (position["x"], position["y"]) == pytest.approx((x, y), abs=1e-6)
    assert math.hypot(turn["z"], turn["w"]) == pytest.approx(1, abs=1e-5)
    # REP-103: what a quaternion about z does to the robot's own forward axis.
    forward = 1 - 2 * turn["z"] ** 2, 2 * turn["z"] * turn["w"]
    assert forward == pytest.approx((math.cos(yaw), math.sin(yaw)), abs=1e-5)


TABLE = Place("dining table", (2.4, 1.2, 0.7), 1.0, 0, None, (1.9, 0.8, 0.0), (2.9, 1.6, 0.75))


def way(*xy: tuple[float, float], yaw: float = 0.0) -> Goal:
    return Goal(*xy[-1], yaw, np.array(xy), 0.0, TABLE, True)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    file: Path = tmp_path_factory.mktemp("home") / "tiny.yaml"
    file.write_text(HOME, encoding="utf-8")
    made: Robot = plugins.make("robots", "dollhouse", home=str(file))
    return made


def test_the_built_in_robot_arrives_and_says_what_it_sees(robot: Robot) -> None:
    assert robot.go_to(way((1.0, 1.0), (1.0, 2.2), (2.4, 2.2), yaw=-math.pi / 2)) == (
        "arrived after 2.60 m through tiny without a bump: x 2.400 y 2.200 m yaw -1.571 rad in frame map, "
        "with the dining table in view"
    )
    assert "with the dining table not in view" in robot.go_to(way((1.0, 1.0), (1.0, 2.2), yaw=math.pi))


def test_the_built_in_robot_stops_at_what_is_in_the_way(robot: Robot) -> None:
    line = robot.go_to(way((1.0, 1.2), (3.4, 1.2)))
    assert line.startswith("bumped after 0.")
    x = float(line.split("stopped at x ")[1].split()[0])
    assert 1.9 - 0.2 - 0.05 <= x <= 1.9 - 0.2  # its rim touches the table's edge
    assert line.endswith(f"{3.4 - x:.2f} m short of the dining table's goal")


def test_no_robot_can_stand_in_a_table_or_start_in_one(robot: Robot) -> None:
    with pytest.raises(InputError, match=r"goal \(2.40, 1.20\) .* no robot can stand there"):
        robot.go_to(way((1.0, 1.0), (2.4, 1.2)))
    with pytest.raises(InputError, match="cannot start at"):
        robot.go_to(way((2.4, 1.2), (1.0, 1.0)))


@pytest.mark.parametrize("home", ["studio", "dollhouse studio"])
def test_a_home_is_known_by_its_name_and_by_its_recordings_name(home: str) -> None:
    assert plugins.make("robots", "dollhouse", home=home).name == "dollhouse"


def test_a_map_of_another_home_is_refused() -> None:
    with pytest.raises(InputError, match="drives in homes of the dollhouse, and 'kitchen' is none"):
        plugins.make("robots", "dollhouse", home="kitchen")
    with pytest.raises(BackendError, match="which home"):
        plugins.make("robots", "dollhouse")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", [0, 1, 2])
def test_a_goal_that_is_no_pose_never_comes_to_a_robot(field: int, wrong: float) -> None:
    pose = [1.0, 2.0, 0.5]
    pose[field] = wrong
    with pytest.raises(InputError, match="goal for the dining table: x, y and yaw must be 3 finite numbers"):
        Goal(*pose, np.zeros((1, 2)), 0.0, TABLE, True)  # type: ignore[call-arg]
    with pytest.raises(InputError, match="goal for the dining table: its path must be"):
        way((1.0, 1.0), (wrong, 2.0), (1.0, 2.2))


@pytest.mark.parametrize("radius_m", [0.0, -1.0, math.nan, 50.0])
def test_the_built_in_robot_has_a_radius(radius_m: float) -> None:
    with pytest.raises(InputError, match="radius must be above 0 and at most 5 m"):
        plugins.make("robots", "dollhouse", home="studio", radius_m=radius_m)
