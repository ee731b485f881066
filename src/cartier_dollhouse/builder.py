"""Builder of scenes from home forms; what cannot be placed is noted with its line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence

import numpy as np

from cartier.errors import InputError
from cartier.io.strict_yaml import Path
from cartier_dollhouse import clashes, openings, shapes
from cartier_dollhouse.form import DIRECTIONS, Fault, FrontDoorForm, HomeForm, Read, ThingForm, WindowForm
from cartier_dollhouse.materials import KINDS, colour, material
from cartier_dollhouse.model import Opening, Room, Scene, Shape, Surface, Thing, Vec3
from cartier_dollhouse.walls import structure


class Builder:
    """Places what a form describes; what cannot be placed is noted and left out."""

    def __init__(self, found: Read, form: HomeForm) -> None:
        self.faults: list[Fault] = []
        self._read, self._form = found, form
        self._things: list[Thing] = []
        self._keys: list[Path] = []  # of the furnishings, in their order
        self._ids: dict[str, Thing] = {}
        self._shapes: dict[tuple[object, ...], Shape] = {}
        self._rooms = {room.name: Room(room.name, room.kind, room.box, room.floor, room.walls) for room in form.rooms}

    def line_of(self, thing: Thing) -> int:
        return self._read.line(self._keys[thing.id - 1])

    def scene(self) -> Scene:
        rooms = self._sound_rooms()
        holes = self._openings(rooms)
        for i, thing in enumerate(self._form.things):
            self._place(thing, ("things", i), None)
        form = self._form
        return Scene(
            form.name, form.about, tuple(rooms), tuple(holes), tuple(self._things),
            structure(rooms, holes, form.height), form.height, form.start,
        )  # fmt: skip

    def _fault(self, key: Path, reason: str) -> None:
        self.faults.append(Fault(self._read.line(key), reason))

    def _sound_rooms(self) -> list[Room]:
        names: set[str] = set()
        rooms: list[Room] = []
        for i, form in enumerate(self._form.rooms):
            x1, y1, x2, y2 = form.box
            if x2 - x1 < 0.5 or y2 - y1 < 0.5:
                self._fault(
                    ("rooms", i, "box"), f"room {form.name!r}: the box must be [x1, y1, x2, y2], x1 < x2, y1 < y2"
                )
            if form.name in names:
                self._fault(("rooms", i, "name"), f"there are two rooms {form.name!r}")
            names.add(form.name)
            for name in (form.floor, form.walls):
                try:
                    _check_material(name)
                except InputError as error:
                    self._fault(("rooms", i), str(error))
            room = Room(form.name, form.kind, form.box, form.floor, form.walls)
            for other in rooms:
                gaps = [max(room.box[k] - other.box[k + 2], other.box[k] - room.box[k + 2]) for k in (0, 1)]
                if max(gaps) < openings.GAP_M[0] - 1e-6:
                    pair = f"{other.name!r} and {room.name!r}"
                    reason = f"rooms {pair} must lie {openings.GAP_M[0]} m apart or more, for a wall"
                    self._fault(("rooms", i, "box"), reason)
            rooms.append(room)
        return rooms

    def _room(self, name: str, key: Path) -> Room | None:
        if name not in self._rooms:
            close = difflib.get_close_matches(name, self._rooms, 1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(self._rooms)}"
            self._fault(key, f"unknown room {name!r}: {hint}")
        return self._rooms.get(name)

    def _openings(self, rooms: Sequence[Room]) -> list[Opening]:
        made: list[Opening] = []
        for i, door in enumerate(self._form.doors):
            key: Path = ("doors", i)
            pair = [self._room(name, key) for name in door.between]
            if pair[0] and pair[1] and self._low_enough(door.height, key):
                try:
                    made.append(openings.doorway(pair[0], pair[1], door.at, door.width, door.height))
                except InputError as error:
                    self._fault(key, str(error))
        holes: list[tuple[Path, str, WindowForm | FrontDoorForm]]
        holes = [(("windows", i), "window", window) for i, window in enumerate(self._form.windows)]
        if self._form.front_door:
            holes.append((("front_door",), "front_door", self._form.front_door))
        for key, kind, form in holes:
            low = form.sill if isinstance(form, WindowForm) else 0.0
            room = self._room(form.room, key)
            if room and self._low_enough(low + form.height, key):
                try:
                    made.append(
                        openings.hole(kind, room, rooms, form.side, form.at, form.width, (low, low + form.height))
                    )
                except InputError as error:
                    self._fault(key, str(error))
        return made

    def _low_enough(self, top: float, key: Path) -> bool:
        if top > self._form.height - 0.05:
            self._fault(key, f"it reaches up to {top:g} m: the rooms are {self._form.height:g} m high")
        return top <= self._form.height - 0.05

    def _place(self, form: ThingForm, key: Path, parent: Thing | None) -> None:
        """One furnishing and all that is on it; after a fault, what is on it is only tried for its types."""
        shape = self._shape(form, key)
        placed = self._pose(form, shape, key, parent) if shape else None
        if shape and placed:
            at, yaw, on = placed
            thing = Thing(len(self._things) + 1, form.type, shape, at, yaw, on)
            self._things.append(thing)
            self._keys.append(key)
            if form.id in self._ids:
                self._fault(key, f"there are two things with id {form.id!r}")
            elif form.id:
                self._ids[form.id] = thing
            for i, child in enumerate(form.things):
                self._place(child, (*key, "things", i), thing)
        else:
            for i, child in enumerate(form.things):
                self._shape(child, (*key, "things", i))

    def _shape(self, form: ThingForm, key: Path) -> Shape | None:
        look = (form.type, form.size, form.colour, form.variant)
        if look not in self._shapes:
            try:
                shape = shapes.build(form.type, form.size, form.colour, form.variant)
                for name in {part.material for part in shape.parts}:
                    _check_material(name)
                self._shapes[look] = shape
            except InputError as error:
                self._fault(key, str(error))
                return None
        return self._shapes[look]

    def _pose(self, form: ThingForm, shape: Shape, key: Path, parent: Thing | None) -> tuple[Vec3, float, int] | None:
        """(origin, yaw, id of what it stands on or 0), or None after a fault."""
        if form.wall:
            return self._on_wall(form, shape, key, parent)
        at = (0.0, 0.0) if form.at is None and (parent or form.on) else form.at
        if not isinstance(at, tuple):
            self._fault(key, "'at' must be [x, y], unless the thing hangs on a wall (`wall: north`)")
            return None
        if parent or form.on:
            return self._on_surface(form, at, shape, key, parent)
        if form.room and not self._room(form.room, key):
            return None
        stands = shapes.info(form.type).stands
        if form.height is None and stands == "wall":
            self._fault(key, f"a {form.type} hangs on a wall: give `room`, `wall` and `height` (or a `height` alone)")
        elif form.height is None and stands in ("surface", "counter"):
            self._fault(key, f"this {form.type} stands on no surface: nest it under `things` of what it stands on")
        else:
            z = self._form.height - shape.size[2] if stands == "ceiling" else 0.0
            return (*at, z if form.height is None else form.height), form.yaw, 0
        return None

    def _on_wall(
        self, form: ThingForm, shape: Shape, key: Path, parent: Thing | None
    ) -> tuple[Vec3, float, int] | None:
        assert form.wall
        if parent or form.on or not form.room or not isinstance(form.at, float | int):
            self._fault(
                key,
                "a thing on a wall needs `room`, `wall`, and `at`: one number along the wall; and stands on nothing",
            )
            return None
        room = self._room(form.room, key)
        if room is None:
            return None
        if form.height is None and shapes.info(form.type).stands != "floor":
            self._fault(key, f"how high hangs this {form.type}? Give the `height` of its lower edge")
            return None
        (axis, sign), face = openings.NORMALS[form.wall], openings.face_of(room, form.wall)
        back = max(float(part.vertices[:, 1].max()) for part in shape.parts)
        away = face - sign * back
        x, y = (away, form.at) if axis == 0 else (form.at, away)
        opposite = {"north": "south", "south": "north", "east": "west", "west": "east"}[form.wall]
        return (x, y, form.height or 0.0), DIRECTIONS[opposite], 0

    def _on_surface(
        self, form: ThingForm, at: tuple[float, float], shape: Shape, key: Path, parent: Thing | None
    ) -> tuple[Vec3, float, int] | None:
        name = form.on
        if parent is None:
            assert form.on
            owner, _, rest = form.on.partition(".")
            parent, name = self._ids.get(owner), rest or None
            if parent is None:
                close = difflib.get_close_matches(owner, self._ids, 1)
                hint = f"did you mean {close[0]!r}?" if close else "give that thing an `id`, above this one"
                self._fault(key, f"no thing with id {owner!r} to stand on: {hint}")
                return None
        surface = self._surface(parent, name, key)
        if surface is None:
            return None
        misfit = clashes.fit(shape, form.yaw, at, surface, parent)
        if misfit:
            self._fault(key, f"this {form.type} {misfit}")
            return None
        middle = [(low + high) / 2 for low, high in zip(surface.low_xy, surface.high_xy, strict=True)]
        z = surface.z + (form.height or 0.0)
        x, y, z = parent.to_world(np.array([middle[0] + at[0], middle[1] + at[1], z])).tolist()
        return (x, y, z), math.remainder(parent.yaw + form.yaw, math.tau), parent.id

    def _surface(self, parent: Thing, name: str | None, key: Path) -> Surface | None:
        known = {surface.name: surface for surface in parent.shape.surfaces}
        if name is None and known:
            return parent.shape.surfaces[0]
        if name in known:
            return known[name]
        if known:
            self._fault(key, f"unknown surface {name!r} of a {parent.type}: it has {', '.join(known)}")
        else:
            self._fault(key, f"nothing can stand on a {parent.type}: it has no surface")
        return None


def _check_material(name: str) -> None:
    """Raises InputError for a name that is no material, without drawing the texture of one that is."""
    kind, _, variant = name.partition(":")
    if kind in KINDS:
        if variant and name != "screen:on":
            colour(variant)
    elif kind != "print" or not variant.isdecimal():
        material(name)
