"""Live sources: streams of frames, one file each; ``open_source`` makes one from its form on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import Source
from cartier.errors import InputError, brief

MAX = "max"


def open_source(spec: str, **options: Any) -> Source:
    """A source by NAME, NAME:WHAT or NAME:WHAT@SPEED: ``ros2``, ``bag:walk.mcap@2``, ``exec:./robot --frames``.

    SPEED is a factor of real time, or "max". ``options`` are the source's, and replace those in the specification.

    Raises:
        InputError: The specification is none, or the source cannot be had.
        BackendError: There is no such source or option.
    """
    name, _, what = spec.partition(":")
    if "://" in spec:
        name, what = name.lower(), spec
    given: dict[str, Any] = {}
    if plugins.takes("sources", name, "speed"):
        what, _, speed = what.rpartition("@") if _ends_in_speed(what) else (what, "", "")
        given |= {"speed": 0.0 if speed == MAX else float(speed)} if speed else {}
    if what:
        given["model"] = what
    elif plugins.takes("sources", name, "model") and "model" not in options:
        raise InputError(f"source {brief(name, 40)} needs what to listen to: {brief(name, 40)}:WHAT")
    return plugins.make("sources", name, **(given | options))


def _ends_in_speed(what: str) -> bool:
    before, _, speed = what.rpartition("@")
    if not before or Path(what).exists():  # a file may have an @ in its name
        return False
    try:
        return speed == MAX or float(speed) >= 0
    except ValueError:
        return False
