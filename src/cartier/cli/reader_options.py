"""Options of the recordings' readers, shared by every command that opens a recording."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from cartier import plugins
from cartier.cli.common import numbers
from cartier.errors import CartierError

if TYPE_CHECKING:
    from cartier.contracts import Recording
    from cartier.home import Home

MOST_NUMBERS = 9  # of one option


@dataclass(frozen=True)
class Topics:
    """Topics and frames, of a bag as of a robot."""

    colour: Annotated[str | None, typer.Option(help="The topic of colour images.")] = None
    depth: Annotated[str | None, typer.Option(help="The topic of depth images.")] = None
    info: Annotated[str | None, typer.Option(help="The topic of the colour camera's CameraInfo.")] = None
    frame: Annotated[str | None, typer.Option(help="The tf frame to map in.")] = None
    odometry: Annotated[
        str | None, typer.Option(help="The topic (Odometry or PoseStamped) of the poses, instead of /tf.")
    ] = None
    extrinsic: Annotated[
        str | None, typer.Option(help="X,Y,Z,QX,QY,QZ,QW: the pose of the camera in the frame of --odometry.")
    ] = None
    detections: Annotated[
        str | None,
        typer.Option(help="The topic of detections (vision_msgs, or yolo_ros's) to take instead of a detector's."),
    ] = None

    def given(self) -> dict[str, Any]:
        """Those that are given, as the parameters of a reader or a source."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class Robot(Topics):
    """Topics of a robot, and where they are."""

    domain: Annotated[int | None, typer.Option(help="The DDS domain of ros2. Default: ROS_DOMAIN_ID, else 0.")] = None


@dataclass(frozen=True)
class Reader(Topics):
    """Options of the recordings' readers: the parameters of their ``open``."""

    format: Annotated[
        str | None, typer.Option(help="The recording's format ('cartier list'), if it is not detected.")
    ] = None
    up: Annotated[
        str | None, typer.Option(help="X,Y,Z: the up direction in the recording's own world, if estimated wrongly.")
    ] = None
    floor_m: Annotated[
        float | None,
        typer.Option("--floor", help="The height of the floor along up in metres, if estimated wrongly."),
    ] = None
    confidence: Annotated[
        int | None, typer.Option(help="The least confidence of a phone's depth, in its app's numbers; 0 for all.")
    ] = None
    camera: Annotated[
        str | None,
        typer.Option(help="FX,FY,CX,CY[,K1,K2,P1,P2[,K3]] in pixels, if the recording has no intrinsics."),
    ] = None

    def given(self) -> dict[str, Any]:
        up = numbers(self.up, 3, "--up")
        return super().given() | ({} if up is None else {"up": up})


def remembered(stored: Any) -> dict[str, Any]:
    """The reader's options that a saved home stores, but for unsafe ones: no path to code, no unexpected type."""
    from cartier import plugins

    formats = [backend.name for backend in plugins.backends("recordings")]
    kept = {}
    for name, hint in get_type_hints(Reader).items():
        kind = get_args(hint)[0]
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
