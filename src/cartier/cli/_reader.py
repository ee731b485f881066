"""What a person may tell the reader of a recording, as options of every command that opens one: said here once for all."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

import typer

from cartier.cli._common import numbers

OPTIONS: dict[str, tuple[str, type, str]] = {
    "format": ("--format", str, "The recording's format, as 'cartier list' names it, if the path does not tell it."),
    "up": ("--up", str, "X,Y,Z: which way is up in the recording's own world, if it is estimated wrongly."),
    "floor_m": ("--floor", float, "Height in metres of the floor along up, if it is estimated wrongly."),
    "confidence": ("--confidence", int, "Least confidence of a phone's depth, in its app's own numbers; 0 for all."),
    "camera": ("--camera", str, "FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels, for a recording without intrinsics."),
    "colour": ("--colour", str, "A bag's topic of colour images."),
    "depth": ("--depth", str, "A bag's topic of depth images."),
    "info": ("--info", str, "A bag's topic with the colour camera's CameraInfo."),
    "frame": ("--frame", str, "A bag's frame to map in."),
    "odometry": ("--odometry", str, "A bag's topic of type Odometry or PoseStamped to take the poses from."),
    "extrinsic": ("--extrinsic", str, "X,Y,Z,QX,QY,QZ,QW: the camera in the frame that --odometry moves."),
}
"""By the name of the parameter of the readers' ``open``: the option, its type, its help."""

NOTHING: dict[str, Any] = {}
MOST_NUMBERS = 9  # of one option


def remembered(told: Any) -> dict[str, Any]:
    """Of the options that a saved home says its recording was read with, those that are safe to use: no path to code, no odd value."""
    from cartier import plugins

    formats = [backend.name for backend in plugins.backends("recordings")]
    kept = {}
    for name, (_, kind, _) in OPTIONS.items():
        value = told.get(name) if isinstance(told, dict) else None
        listed = isinstance(value, list) and len(value) <= MOST_NUMBERS and all(type(v) in (int, float) for v in value)
        plain = type(value) is kind or (kind is float and type(value) is int)
        if value in formats if name == "format" else listed if name == "up" else plain or (kind is str and listed):
            kept[name] = value
    return kept


def reads_recordings(command: Callable[..., None]) -> Callable[..., None]:
    """The command with these options in place of its parameter ``reader``, which gets those that were given, by name."""

    @functools.wraps(command)
    def with_options(**given: Any) -> None:
        reader = {name: value for name in OPTIONS if (value := given.pop(name)) is not None}
        if "up" in reader:
            reader["up"] = numbers(reader["up"], 3, "--up")
        command(**given, reader=reader)

    hints = get_type_hints(command, include_extras=True)
    own = [p.replace(annotation=hints[p.name]) for p in inspect.signature(command).parameters.values()]
    added = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[kind | None, typer.Option(option, help=words)],
        )
        for name, (option, kind, words) in OPTIONS.items()
    ]
    parameters = [p.replace(kind=p.KEYWORD_ONLY) for p in own if p.name != "reader"] + added
    with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    with_options.__annotations__ = {p.name: p.annotation for p in parameters}
    return with_options
