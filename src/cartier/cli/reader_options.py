"""Options of the recordings' readers, shared by every command that opens a recording."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import plugins
from cartier.cli.common import numbers
from cartier.cli.option_groups import expanded
from cartier.errors import CartierError

if TYPE_CHECKING:
    from cartier.contracts import Recording
    from cartier.home import Home

OPTIONS: dict[str, tuple[str, type, str]] = {
    "format": ("--format", str, "The recording's format ('cartier list'), if it is not detected."),
    "up": ("--up", str, "X,Y,Z: the up direction in the recording's own world, if estimated wrongly."),
    "floor_m": ("--floor", float, "The height of the floor along up in metres, if estimated wrongly."),
    "confidence": ("--confidence", int, "The least confidence of a phone's depth, in its app's numbers; 0 for all."),
    "camera": ("--camera", str, "FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels, if the recording has no intrinsics."),
    "colour": ("--colour", str, "The topic of colour images."),
    "depth": ("--depth", str, "The topic of depth images."),
    "info": ("--info", str, "The topic of the colour camera's CameraInfo."),
    "frame": ("--frame", str, "The tf frame to map in."),
    "odometry": ("--odometry", str, "The topic (Odometry or PoseStamped) of the poses, instead of /tf."),
    "extrinsic": ("--extrinsic", str, "X,Y,Z,QX,QY,QZ,QW: the pose of the camera in the frame of --odometry."),
    "detections": (
        "--detections", str, "The topic of detections (vision_msgs, or yolo_ros's) to take instead of a detector's."
    ),
}  # fmt: skip
"""Option, type and help by the parameter of the readers' ``open``."""
TOPICS = ("colour", "depth", "info", "frame", "odometry", "extrinsic", "detections")
"""Those that name topics and frames, of a bag as of a robot."""
DOMAIN: dict[str, tuple[str, type, str]] = {
    "domain": ("--domain", int, "The DDS domain of ros2. Default: ROS_DOMAIN_ID, else 0."),
}

NOTHING: dict[str, Any] = {}
MOST_NUMBERS = 9  # of one option


def remembered(stored: Any) -> dict[str, Any]:
    """The reader's options that a saved home stores, but for unsafe ones: no path to code, no unexpected type."""
    from cartier import plugins

    formats = [backend.name for backend in plugins.backends("recordings")]
    kept = {}
    for name, (_, kind, _) in OPTIONS.items():
        value = stored.get(name) if isinstance(stored, dict) else None
        listed = isinstance(value, list) and len(value) <= MOST_NUMBERS and all(type(v) in (int, float) for v in value)
        plain = type(value) is kind or (kind is float and type(value) is int)
        if value in formats if name == "format" else listed if name == "up" else plain or (kind is str and listed):
            kept[name] = value
    return kept


def as_mapped(home: Home, path: Path, format: str | None = None) -> Recording:
    """A recording, read with the options that the home was mapped with, if they give the mapped recording."""
    tried: list[dict[str, Any]] = []
    own = {"format": format} if format else {}
    for row in home.settings.get("recordings", ()):
        reader = remembered(row.get("read_with")) | own
        if reader not in tried:
            tried.append(reader)
            with suppress(CartierError):  # they may be the options of another recording
                source = plugins.open_recording(path, **reader)
                if source.fingerprint() in (row["sha256"] for row in home.settings.get("recordings", ())):
                    return source
    return plugins.open_recording(path, **own)


def reads_recordings(command: Callable[..., None]) -> Callable[..., None]:
    """Replace the command's parameter ``reader`` by these options; it gets the given ones by name."""
    return _with_options(command, "reader", OPTIONS)


def reads_streams(command: Callable[..., None]) -> Callable[..., None]:
    """Replace the command's parameter ``topics`` by the options that say which topics of a robot are taken."""
    return _with_options(command, "topics", DOMAIN | {name: OPTIONS[name] for name in TOPICS})


def _with_options(
    command: Callable[..., None], parameter: str, options: dict[str, tuple[str, type, str]]
) -> Callable[..., None]:
    def made(given: dict[str, Any]) -> dict[str, Any]:
        chosen = {name: value for name in options if (value := given.pop(name)) is not None}
        if "up" in chosen:
            chosen["up"] = numbers(chosen["up"], 3, "--up")
        return {parameter: chosen}

    parameters = []
    for name, (option, kind, words) in options.items():
        annotation: Any = Annotated[kind | None, typer.Option(option, help=words)]
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation))
    return expanded(command, {parameter: parameters}, made)
