"""Doors seen twice: a passage that was open, and in which something as high as a door stands in a later recording."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cartier
from cartier.errors import InputError
from cartier.home import Home
from cartier.reasoners import embedded
from cartier.spatial.doors import shut_doors
from cartier.types import FREE, OCCUPIED, Door, OccupancyGrid, Room
from cartier_dollhouse.mesh import box
from cartier_dollhouse.model import Scene
from cartier_dollhouse.recording import DollhouseRecording, look, pinhole
from cartier_dollhouse.scene import load_scene

ROOMS = """
name: two rooms
start: [1.0, 1.5]
rooms:
  - {name: kitchen, kind: kitchen, box: [0, 0, 3, 3], floor: "tiles:white", walls: "paint:cream"}
  - {name: bedroom, kind: bedroom, box: [3.1, 0, 6.1, 3], floor: "planks:oak", walls: "paint:white"}
doors:
  - {between: [kitchen, bedroom], at: 1.5, width: 0.9}
things:
  - {type: Fridge, at: [0.6, 2.6], face: south}
  - {type: Bed, at: [4.9, 2.1], face: west}
"""


def scene(shut: bool) -> Scene:
    """The two rooms; shut, the passage has a leaf."""
    made = load_scene(ROOMS)
    leaf = (box((3.03, 1.05, 0.0), (3.07, 1.95, 2.0), "paint:brown"),) if shut else ()
    return replace(made, structure=(*made.structure, *leaf))


def recording(shut: bool, *rooms: str) -> DollhouseRecording:
    """A turn in each room."""
    middles = {"kitchen": (1.0, 1.5), "bedroom": (3.7, 0.9)}
    turns = np.linspace(-math.pi, math.pi, 12, endpoint=False)
    poses = [look(middles[room], turn, math.radians(25), 1.2) for room in rooms for turn in turns]
    return DollhouseRecording(scene(shut), pinhole(96, 72), np.array(poses))


def mapped(found: DollhouseRecording, onto: Home | None = None) -> Home:
    detector = cartier.make("detectors", "ground_truth", truth=found.truth, source=found.name)
    return cartier.map_home(found, detector, ["object_depth"], every=1, onto=onto)


@cache
def visited_once() -> Home:
    return mapped(recording(False, "kitchen", "bedroom"))


@cache
def visited_twice(shut: bool) -> Home:
    return mapped(recording(shut, "kitchen", "kitchen", "bedroom"), visited_once())


def said(home: Home, words: str) -> tuple[str, object]:
    chosen = cartier.ask(home, words, embedded.make()).selection
    return chosen.text, None if chosen.fact is None else chosen.fact.value


def test_a_door_that_stayed_open_is_open() -> None:
    text, value = said(visited_twice(False), "is the kitchen door open?")
    assert value == "open" and text.startswith("Yes: the way between the ")


@pytest.mark.parametrize(("words", "begins"), [("open", "No"), ("closed", "Yes"), ("shut", "Yes")])
def test_a_door_that_was_shut_since_is_told(words: str, begins: str) -> None:
    text, value = said(visited_twice(True), f"is the door of the kitchen {words}?")
    assert value == "closed" and text.startswith(f"{begins}: the way between the ")
    assert text.endswith("was shut when I saw it last; it was open before.")


def test_it_is_kept_with_the_home_and_checked_when_read(tmp_path: Path) -> None:
    visited_twice(True).save(tmp_path / "home")
    home = Home.load(tmp_path / "home")
    assert said(home, "is the kitchen door shut?")[1] == "closed"
    assert not home.inventory().doors and len(home.inventory().shut_doors) == 1
    with pytest.raises(InputError):
        replace(home, settings={**home.settings, "doors": [[1e9, 0, 1]]}).save(tmp_path / "far")
        Home.load(tmp_path / "far")


def test_opened_again_it_is_open() -> None:
    again = mapped(recording(False, *(["kitchen", "bedroom"] * 4)), visited_twice(True))
    assert said(again, "is the kitchen door open?")[1] == "open" and not again.inventory().shut_doors


WALL = np.full((20, 40), FREE, np.int8)
WALL[:, 20] = OCCUPIED
HIGH = np.where(WALL == OCCUPIED, 2.0, 0.0).astype(np.float16)
SIDES = tuple(
    Room(k, name, name, np.argwhere((WALL == FREE) & part).astype(np.int32))
    for k, (name, part) in enumerate([("left", np.arange(40) < 20), ("right", np.arange(40) > 20)])
)
EARLIER = [(2.05, 1.0, 0.8)]


def plan(height_m: np.ndarray = HIGH) -> OccupancyGrid:
    return OccupancyGrid(WALL, 0.1, (0.0, 0.0), height_m)


def test_only_something_high_shuts_a_door() -> None:
    assert shut_doors(EARLIER, (), SIDES, plan()) == (Door((2.05, 1.0), (0, 1), 0.8),)
    assert shut_doors(EARLIER, (), SIDES, plan(np.minimum(HIGH, np.float16(1.1)))) == ()
    assert shut_doors([(1.2, 1.0, 0.8)], (), SIDES, plan()) == ()  # the wall is elsewhere
    aside = HIGH.copy()
    aside[abs(np.arange(len(HIGH)) - len(HIGH) // 2) < len(HIGH) // 4] = 0.5  # beside the door alone it is high
    assert shut_doors(EARLIER, (), SIDES, plan(aside)) == ()
    assert shut_doors(EARLIER, (), SIDES[:1], plan()) == ()  # behind it lies nothing that is known
    assert shut_doors(EARLIER, (Door((2.05, 1.2), (0, 1), 0.8),), SIDES, plan()) == ()  # it is open


def test_settings_hold_numbers() -> None:
    doors = visited_twice(True).settings["doors"]
    assert json.loads(json.dumps(doors)) == doors and len(doors) == 1 and doors[0][1] == pytest.approx(1.5, abs=0.1)
