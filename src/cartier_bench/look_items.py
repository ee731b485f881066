"""Questions of ``cartier bench look``: rooms of the dollhouse made for them, so that every answer is known.

Each room has places in a row; at each something stands that one question is about, and a camera goes along an arc
before it (or behind it, or low). Which of several is meant, its state and its colour are the room's own truth.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from cartier_dollhouse.model import Scene
    from cartier_dollhouse.recording import DollhouseRecording, Poses
    from cartier_dollhouse.states import State

Kind = Literal["attribute", "state", "which", "exists on", "hidden side"]
KINDS: tuple[Kind, ...] = ("attribute", "state", "which", "exists on", "hidden side")
CANNOT_TELL = "cannot tell"
PLACES_X = (2.5, 7.5, 12.5, 17.5)
"""Where the middles of the places are, along the room (m): so far apart that one is not seen from before another."""
PLACE_Y, ROOM = 6.4, (0.0, 0.0, 20.0, 9.0)
TALL = ("Fridge", "FloorLamp")
ARC_DEG = (-40, -20, 0, 20, 40)
"""From where each place is seen, around the direction that it faces."""
CARPETS = ("planks:oak", "tiles:white", "carpet:grey")
WALLS = ("paint:cream", "paint:lightblue", "paint:white")


@dataclass(frozen=True)
class Placed:
    """Something that stands at a place: its type, colour and variant, its state, and how far to the right (m)."""

    type: str
    colour: str = ""
    variant: int = 0
    state: State | None = None
    right_m: float = 0.0
    size: tuple[float, ...] = ()


@dataclass(frozen=True)
class LookItem:
    """A question with its true answer, and what stands where it is asked.

    Args:
        id: Its name, which says nothing of the truth.
        room: The name of the room.
        kind: What is asked.
        label: Of what.
        words: The question, as a person asks the robot.
        plain: The same about a whole photograph, for who has no list.
        attribute: As in ``VisualQuestion``.
        choices: The closed set of answers to ``plain``.
        truth: The answer, one of ``choices``, or "cannot tell".
        things: What stands at the place; the first one that is not on another is in its middle.
        support: The type of what they stand on; empty for the floor.
        away_m: How far the camera is from the place, over the floor.
        eye_m: How high it is.
        behind: Whether what stands there turns its back to the camera.
    """

    id: str
    room: str
    kind: Kind
    label: str
    words: str
    plain: str
    attribute: str
    choices: tuple[str, ...]
    truth: str
    things: tuple[Placed, ...] = field(repr=False)
    support: str = ""
    away_m: float = 1.5
    eye_m: float = 1.5
    behind: bool = False

    @property
    def face(self) -> str:
        """Which way the place faces; the cameras are in the south."""
        return "north" if self.behind else "south"


@cache
def items() -> tuple[LookItem, ...]:
    """All questions of ``look_rooms.toml``, room by room; four rooms of each kind of floor and wall."""
    table = tomllib.loads(Path(__file__).with_name("look_rooms.toml").read_text("utf-8"))
    made = list[LookItem]()
    for room, rows in table["rooms"].items():
        for number, row in enumerate(rows, start=1):
            choices = ("left", "right") if row["kind"] == "which" else tuple(table["choices"][row["attribute"]])
            things = tuple(Placed(**each | {"size": tuple(each.get("size", ()))}) for each in row["things"])
            made.append(LookItem(f"{room}-{number}", room, choices=choices, **row | {"things": things}))
    return tuple(made)


def scene_of(room: str, asked: Sequence[LookItem]) -> Scene:
    """The room with everything that its questions are about, in its state."""
    from cartier_dollhouse.scene import load_scene
    from cartier_dollhouse.states import State, with_states

    number, lines, states, count = sum(map(ord, room)), list[str](), dict[int, State](), 0
    for x, each in zip(PLACES_X, asked, strict=False):
        at_x, at_y = x, PLACE_Y
        if each.support:
            count += 1
            lines.append(f"  - {{type: {each.support}, at: [{x}, {PLACE_Y}], face: {each.face}, things: [")
            at_x, at_y = 0.0, 0.0
        for thing in each.things:
            count += 1
            if thing.state is not None:
                states[count] = thing.state
            lines.append(_line(thing, at_x, at_y, each))
        if each.support:
            lines.append("    ]}")
    text = "\n".join([
        f"name: {room}", "start: [0.6, 0.6]", "rooms:",
        f'  - {{name: room, kind: living room, box: {list(ROOM)}, floor: "{CARPETS[number % len(CARPETS)]}", '
        f'walls: "{WALLS[number % len(WALLS)]}"}}',
        "windows:", "  - {room: room, side: south, at: 4.0, width: 2.0, sill: 0.9, height: 1.3}",
        "  - {room: room, side: south, at: 9.0, width: 2.0, sill: 0.9, height: 1.3}",
        "things:", *lines, "",
    ])  # fmt: skip
    return with_states(load_scene(text), states)


def walk(scene: Scene, asked: Sequence[LookItem]) -> DollhouseRecording:
    """A recording of all places of a room, one after the other; the camera looks at each from its arc."""
    from cartier_dollhouse.recording import DollhouseRecording, pinhole

    poses = [_pose(x, each, degrees) for x, each in zip(PLACES_X, asked, strict=False) for degrees in ARC_DEG]
    return DollhouseRecording(scene, pinhole(), np.array(poses))


def _line(thing: Placed, x: float, y: float, each: LookItem) -> str:
    """A furnishing of the home file."""
    face = "south" if each.support else each.face  # of its support, whose frame this is
    parts = [f"type: {thing.type}", f"at: {[round(x + thing.right_m, 3), y]}", f"face: {face}"]
    parts += [f'colour: "{thing.colour}"'] if thing.colour else []
    parts += [f"variant: {thing.variant}"] if thing.variant else []
    parts += [f"size: {list(thing.size)}"] if thing.size else []
    inner = f"{{{', '.join(parts)}}}"
    return f"    {inner}," if each.support else f"  - {inner}"


def _pose(x: float, each: LookItem, degrees: float) -> Poses:
    """A pose on the arc, looking at the middle of what stands at the place."""
    from cartier_dollhouse.recording import look

    turn = math.radians(degrees)
    at = (x - each.away_m * math.sin(turn), PLACE_Y - each.away_m * math.cos(turn))
    yaw = math.atan2(PLACE_Y - at[1], x - at[0])
    height = 0.9 if each.support or each.things[0].type in TALL else 0.4
    return look(at, yaw, math.atan2(each.eye_m - height, each.away_m), each.eye_m)
