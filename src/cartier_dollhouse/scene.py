"""Home files: from YAML to a Scene; every fault is named by its line.

Coordinates are the world's. Furnishings on others are placed in the frame of what they stand on: ``at`` is the offset
from the middle of its surface, ``face: south`` is the way it faces itself. Ids count from 1, each furnishing before
those on it.
"""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path

from cartier.errors import InputError
from cartier.io.files import read_text
from cartier_dollhouse import clashes
from cartier_dollhouse.builder import Builder
from cartier_dollhouse.floors import split_name, with_options
from cartier_dollhouse.form import MAX_BYTES, Fault, read
from cartier_dollhouse.model import Scene

ROBOT_RADIUS_M = 0.2  # of the robot that must have room at the start


def load_scene(source: Path | str) -> Scene:
    """A home from a file, or from YAML text (a string with a line break).

    Raises InputError with the first fault's file, line and reason, and how many more there are.
    """
    return _sound(*_text(source))


def check(text: str, file: str = "home") -> list[str]:
    """All faults of a home's YAML text, one line each: ``file:line: reason``. Empty if the home is sound."""
    return [f"{file}:{fault.line}: {fault.reason}" for fault in _build(text)[1]]


def homes() -> list[str]:
    """The names of the homes that come with the program."""
    folder = resources.files("cartier_dollhouse") / "homes"
    return sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load_home(name: str) -> Scene:
    """A home that comes with the program, by name; one made from a seed, by a whole number; or a home file, by path.

    ``+rugs`` after any of them lays rugs, ``+narrow`` makes its doors narrow. Raises InputError for an unknown name or
    a faulty file.
    """
    plain, options = split_name(name)
    if options:
        return with_options(load_home(plain), options)
    if name.isdecimal():
        from cartier_dollhouse.generate import generate  # it may build on this module

        return _sound(generate(int(name)), f"generated home {name}")
    if name.endswith((".yaml", ".yml")):
        return load_scene(Path(name))
    if name not in homes():
        close = difflib.get_close_matches(name, homes(), 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(
            f"no home {name!r}: {hint}there are {', '.join(homes())}, any whole number, and home files (.yaml)"
        )
    file = resources.files("cartier_dollhouse") / "homes" / f"{name}.yaml"
    return _sound(file.read_text("utf-8"), f"{name}.yaml")


def _text(source: Path | str) -> tuple[str, str]:
    if isinstance(source, str) and "\n" in source:
        return source, "home"
    return read_text(Path(source), MAX_BYTES), str(source)


def _sound(text: str, file: str) -> Scene:
    scene, faults = _build(text)
    if scene is None or faults:
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise InputError(f"{file}:{faults[0].line}: {faults[0].reason}{more}")
    return scene


def _build(text: str) -> tuple[Scene | None, list[Fault]]:
    """The scene, as far as the text allows, and all faults in the order of their lines."""
    found = read(text)
    if found.form is None:
        return None, sorted(found.faults, key=lambda fault: fault.line)
    builder = Builder(found, found.form)
    scene = builder.scene()
    faults = builder.faults
    faults += [Fault(builder.line_of(thing), reason) for thing, reason in clashes.of_things(scene)]
    if not faults and not clashes.start_is_free(scene, ROBOT_RADIUS_M):
        x, y = scene.start_xy
        at = f"start [{x:g}, {y:g}]"
        reason = f"{at} is not free: a robot of radius {ROBOT_RADIUS_M} m hits a wall or furniture there"
        faults.append(Fault(found.line(("start",)), reason))
    return scene, sorted(faults, key=lambda fault: fault.line)
