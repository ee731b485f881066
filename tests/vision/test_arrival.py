"""Arrival: in a room of the dollhouse, a robot looks for the box at its goal, and goes on to the next without it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

import cartier
from cartier.cli.arrive import send_and_look
from cartier.home import Home
from cartier.pipeline import ask, map_home
from cartier.robots import Sent
from cartier.types import Answer, Frame, Goal, RobotModel
from cartier.vision import look as looking
from cartier.vision import prompt
from cartier.vision.arrival import expected_box, look_there
from cartier.vision.permission import Look
from cartier_dollhouse.drive import frame_at
from cartier_dollhouse.model import Scene
from cartier_dollhouse.recording import DollhouseRecording, look, pinhole
from cartier_dollhouse.scene import load_scene
from vision.seeing_server import serving

ROOM = """name: hall
start: [1.0, 1.0]
rooms:
  - {name: hall, kind: living room, box: [0.0, 0.0, 7.0, 4.0], floor: "tiles:white", walls: "paint:white"}
things:
  - {type: Ottoman, at: [2.5, 3.2], face: south, colour: "fabric:COLOUR"}
  - {type: Ottoman, at: [5.5, 3.2], face: south, colour: "fabric:red"}
"""
Served = tuple[str, list[dict]]


class Drives:
    """Obeys the Robot contract, and remembers where it was sent."""

    name = "drives"

    def __init__(self) -> None:
        self.goals: list[Goal] = []

    def go_to(self, goal: Goal) -> str:
        self.goals.append(goal)
        return "arrived"


@pytest.fixture
def seeing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    with serving() as served:
        yield served


def room(colour: str) -> Scene:
    return load_scene(ROOM.replace("COLOUR", colour))


@pytest.fixture(scope="module")
def mapped() -> Home:
    """The map of the room while both ottomans are red."""
    standpoints = [((x, 1.0), np.pi / 2 + turn) for x in (1.5, 2.5, 3.5, 4.5, 5.5) for turn in (-0.5, 0.0, 0.5)]
    scene = room("red")
    walk = DollhouseRecording(scene, pinhole(), np.array([look(xy, yaw, 0.4) for xy, yaw in standpoints]))
    truth = cartier.make("detectors", "ground_truth", truth=walk.truth, source=walk.name)
    return map_home(walk, truth, ("object_depth",))


def permitted(url: str) -> Look:
    return Look(cartier.make("vision", "openai", model="sees", base_url=url))


def asked(home: Home) -> Answer:
    answer = ask(home, "go to the ottoman", from_xy=(1.0, 1.0))
    assert answer.goal is not None
    return answer


def told(those: Iterable[Sent]) -> list[str]:
    return [sent.text for sent in those]


@pytest.mark.parametrize(("colour", "drives", "last"), [("red", 1, 2.5), ("blue", 2, 5.5)])
def test_what_is_gone_is_looked_for_elsewhere(
    colour: str, drives: int, last: float, seeing: Served, mapped: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(looking._WORDS, "exists", "Is this really a red {label}?")  # the stand-in knows only colours
    robot, scene = Drives(), room(colour)
    allowed = permitted(seeing[0])
    lines = told(send_and_look(robot, asked(mapped), mapped, RobotModel(), allowed, lambda goal: frame_at(scene, goal)))
    assert len(robot.goals) == drives == len(seeing[1]), lines
    assert abs(robot.goals[-1].place.position[0] - last) < 0.4
    assert lines[-1].endswith("is there") and sum("is not there" in line for line in lines) == drives - 1
    assert sum("a photograph from the goal went to" in line for line in lines) == drives


def test_nobody_agreed_so_nothing_is_sent(seeing: Served, mapped: Home) -> None:
    robot, scene = Drives(), room("blue")
    allowed = Look(permitted(seeing[0]).model, "ask")
    lines = told(send_and_look(robot, asked(mapped), mapped, RobotModel(), allowed, lambda goal: frame_at(scene, goal)))
    assert len(robot.goals) == 1 and not seeing[1] and "only when the owner agrees" in lines[-1]


def test_the_box_is_where_the_object_appears(mapped: Home) -> None:
    answer = asked(mapped)
    assert answer.goal is not None
    obj = next(obj for obj in mapped.objects if obj.id == answer.selection.object_id)
    frame = frame_at(room("red"), answer.goal)
    box = expected_box(obj, frame)
    assert box is not None
    inside = frame.rgb[int(box[1]) : int(box[3]), int(box[0]) : int(box[2])].reshape(-1, 3).astype(int)
    red = (inside[:, 0] > 90) & (inside[:, 1] < 80)
    everywhere = (frame.rgb[..., 0].astype(int) > 90) & (frame.rgb[..., 1] < 80)
    assert red.mean() > 0.4 and red.sum() > 0.8 * everywhere.sum()


def test_what_is_out_of_view_cannot_be_told(seeing: Served, mapped: Home) -> None:
    answer = asked(mapped)
    assert answer.goal is not None
    obj = next(obj for obj in mapped.objects if obj.id != answer.selection.object_id)
    away = frame_at(room("red"), answer.goal, xy=(6.5, 3.9))
    told = look_there(permitted(seeing[0]), obj, answer.goal, "arrived", away)
    assert told.said == "cannot tell" and "not in the camera's view" in told.why and not seeing[1]


def test_a_reply_of_no_valid_form_is_told_as_one(seeing: Served, mapped: Home) -> None:
    answer, talks = asked(mapped), cartier.make("vision", "openai", model="ignores-grammar", base_url=seeing[0])
    assert answer.goal is not None
    obj = next(obj for obj in mapped.objects if obj.id == answer.selection.object_id)
    told = look_there(Look(talks), obj, answer.goal, "arrived", frame_at(room("red"), answer.goal))
    assert (told.said, told.why) == ("cannot tell", prompt.INVALID)


def test_what_lies_behind_the_camera_is_not_in_view(mapped: Home) -> None:
    obj, camera = mapped.objects[0], pinhole()
    x, y, z = obj.position
    for turn, in_view in ((0.0, True), (np.pi, False)):
        pose = look((x, y - 2.0), np.pi / 2 + turn, 0.0, z)
        frame = Frame(0, 0.0, np.zeros((camera.height, camera.width, 3), np.uint8), None, pose, camera)
        assert (expected_box(obj, frame) is not None) is in_view
