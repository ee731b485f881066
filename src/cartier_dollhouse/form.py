"""YAML schema of a home: strictly typed, with the line of every entry, so that each fault can name its line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from cartier.io.strict_yaml import Path, YamlFault, read_yaml

MAX_BYTES = 1 << 20
MAX_FAULTS = 50
MAX_THINGS = 2000  # with those that stand on others
Side = Literal["north", "south", "east", "west"]
DIRECTIONS = {"south": 0.0, "east": math.pi / 2, "north": math.pi, "west": -math.pi / 2}
"""Yaws of furnishings that face a direction; among furnishings on others, directions in the parent's frame (south = its
front)."""

Metres = Annotated[float, Field(ge=-100, le=100)]
Length = Annotated[float, Field(gt=0, le=20)]
Pair = tuple[Metres, Metres]
Name = Annotated[str, Field(min_length=1, max_length=80)]

# What a value should be, where pydantic's own words would be about its types.
MEANT = {
    "at": "[x, y] in metres, or one number along a wall",
    "face": "north, south, east, west or degrees (0 = south, 90 = east)",
    "box": "[x1, y1, x2, y2] in metres",
    "size": "[width, depth, height] in metres, each above 0 and at most 20",
    "start": "[x, y] in metres",
    "between": "the names of two rooms",
    "wall": "north, south, east or west",
    "side": "north, south, east or west",
    "rooms": "a list of {name: …, kind: …, box: […], floor: …, walls: …}",
    "things": "a list of {type: …, at: [x, y], …}",
}


@dataclass(frozen=True)
class Fault:
    """What is wrong in a home file, and in which line."""

    line: int
    reason: str


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class RoomForm(_Form):
    """A room by its inner faces."""

    name: Name
    kind: Name
    box: tuple[Metres, Metres, Metres, Metres]
    floor: Name
    walls: Name


class DoorForm(_Form):
    """A doorway without a door; ``at`` is its middle, x or y, along the wall that two rooms share."""

    between: tuple[Name, Name]
    at: Metres
    width: Annotated[float, Field(ge=0.5, le=5)] = 0.9
    height: Annotated[float, Field(ge=1.8, le=5)] = 2.05


class WindowForm(_Form):
    """A window in an outer wall; ``at`` is its middle, x or y, along the wall."""

    room: Name
    side: Side
    at: Metres
    width: Annotated[float, Field(ge=0.3, le=10)] = 1.2
    sill: Annotated[float, Field(ge=0, le=3)] = 0.9
    height: Annotated[float, Field(ge=0.3, le=4)] = 1.3


class FrontDoorForm(_Form):
    """The closed door of the home."""

    room: Name
    side: Side
    at: Metres
    width: Annotated[float, Field(ge=0.6, le=3)] = 0.95
    height: Annotated[float, Field(ge=1.8, le=4)] = 2.05


class ThingForm(_Form):
    """A furnishing on the floor, on a wall or the ceiling, or on another furnishing (nested in it, or ``on: its
    id``)."""

    type: Name
    id: Name | None = None
    at: Pair | Metres | None = None  # nested furnishings: the middle of the surface
    face: str | float = "south"
    colour: Name | None = None
    size: tuple[Length, Length, Length] | None = None
    variant: Annotated[int, Field(ge=0, le=10_000)] = 0
    on: Name | None = None
    room: Name | None = None
    wall: Side | None = None
    height: Annotated[float, Field(ge=0, le=10)] | None = None
    things: Annotated[tuple[ThingForm, ...], Field(max_length=MAX_THINGS)] = ()

    @field_validator("face")
    @classmethod
    def _known(cls, face: str | float) -> str | float:
        if isinstance(face, str) and direction(face) is None:
            raise ValueError(face)
        return face

    @property
    def yaw(self) -> float:
        """The direction it faces, counter-clockwise from south."""
        turned = direction(self.face) if isinstance(self.face, str) else math.radians(self.face)
        assert turned is not None
        return turned


class HomeForm(_Form):
    """A home file."""

    name: Name
    about: Annotated[str, Field(max_length=2000)] = ""
    height: Annotated[float, Field(ge=2, le=6)] = 2.6
    start: Pair
    rooms: Annotated[tuple[RoomForm, ...], Field(min_length=1, max_length=60)]
    doors: Annotated[tuple[DoorForm, ...], Field(max_length=200)] = ()
    windows: Annotated[tuple[WindowForm, ...], Field(max_length=200)] = ()
    front_door: FrontDoorForm | None = None
    things: Annotated[tuple[ThingForm, ...], Field(max_length=MAX_THINGS)] = ()


def direction(word: str) -> float | None:
    """The yaw of north, S, East, …"""
    return next((yaw for name, yaw in DIRECTIONS.items() if word.lower() in (name, name[0])), None)


@dataclass(frozen=True)
class Read:
    """What a home's text holds: its form, or None with the faults that make it unreadable; and the lines of its
    entries."""

    form: HomeForm | None
    faults: tuple[Fault, ...]
    lines: dict[Path, int]

    def line(self, path: Path) -> int:
        """The line (from 1) of an entry, or of the nearest one around it."""
        while path not in self.lines and path:
            path = path[:-1]
        return self.lines.get(path, 1)


def read(text: str) -> Read:
    """The form of a home's text. Never raises for what the text holds."""
    lines: dict[Path, int] = {}
    try:
        if len(text.encode("utf-8", "replace")) > MAX_BYTES:
            raise YamlFault(1, f"the file is larger than {MAX_BYTES >> 20} MiB")
        data, lines = read_yaml(text)
        if not isinstance(data, dict):
            raise YamlFault(1, "a home file holds `name: …`, `start: …`, `rooms: …` and `things: …`")
        form = HomeForm.model_validate(data)
        if _count(form.things) > MAX_THINGS:
            raise YamlFault(1, f"a home holds {MAX_THINGS} things at most, got {_count(form.things)}")
        return Read(form, (), lines)
    except YamlFault as error:
        return Read(None, (Fault(error.line, str(error)),), lines)
    except ValidationError as error:
        return Read(None, tuple(_explained(error, Read(None, (), lines))), lines)


def _count(things: Sequence[ThingForm]) -> int:
    return sum(1 + _count(thing.things) for thing in things)


def _explained(error: ValidationError, read: Read) -> list[Fault]:
    """One fault per entry: where a value may be of several types, pydantic has one complaint for each."""
    faults: dict[Path, Fault] = {}
    for one in error.errors(include_url=False):
        location = one["loc"]
        path = next(location[:n] for n in range(len(location), -1, -1) if n == 0 or location[:n] in read.lines)
        key = next((str(word) for word in reversed(path) if isinstance(word, str)), "the file")
        if one["type"] == "missing":
            path = location
            known = ".".join(map(str, location[:-1])) or "the file"
            reason = f"{location[-1]!r} is missing in {known}"
        elif one["type"] == "extra_forbidden":
            close = difflib.get_close_matches(str(location[-1]), _keys(path), 1)
            reason = f"unknown key {location[-1]!r}" + (f": did you mean {close[0]!r}?" if close else "")
        elif key in MEANT:
            reason = f"{key!r} must be {MEANT[key]}"
        else:
            reason = f"{key!r}: {one['msg'][0].lower()}{one['msg'][1:]}, got {str(one['input'])[:60]!r}"
        faults.setdefault(path, Fault(read.line(path), reason))
    return list(faults.values())[:MAX_FAULTS]


def _keys(path: Path) -> list[str]:
    """The keys that may stand where a path ends."""
    forms: dict[str, type[BaseModel]] = {
        "rooms": RoomForm, "doors": DoorForm, "windows": WindowForm, "front_door": FrontDoorForm, "things": ThingForm,
    }  # fmt: skip
    around = next((forms[word] for word in reversed(path[:-1]) if isinstance(word, str) and word in forms), HomeForm)
    return list(around.model_fields)
