"""A home as a Rerun file: photos with boxes, objects, rooms and floor plan, and with the recording its frames, depth and path.

A wrong listing is found in one look: scrub along ``frame`` to the view that made it, and see its box and where it was put. The
file opens in the viewer of rerun.io (``rerun FILE.rrd``). Needs rerun-sdk.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.home import Home
from cartier.types import FREE, OCCUPIED, Array, MapObject, OccupancyGrid

TIMELINE = "frame"
SURE, UNSURE, PATH = (209, 73, 91), (200, 160, 60), (66, 105, 178)
CELLS = {FREE: (238, 238, 232), OCCUPIED: (60, 60, 66)}
UNSEEN = (176, 176, 172)
DEPTH_WIDTH = 320  # px; a map is no point cloud
JPEG_QUALITY = 75


def write_rrd(
    home: Home, file: Path, recording: Recording | None = None, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a home to ``file``, whole or not at all; frames, depth and the camera's path only with its ``recording``.

    Raises InputError if the home was not mapped from the recording, or the file cannot be written.
    """
    first = None if recording is None else _first_frame(home, recording)
    try:
        with tempfile.TemporaryDirectory(dir=file.absolute().parent, prefix=f".{file.name}.") as beside:
            out = rr.RecordingStream("cartier", recording_id=home.id)
            out.save(Path(beside) / "home.rrd", default_blueprint=_blueprint())
            _still(out, home)
            if recording is not None and first is not None:
                _moving(out, recording, first, progress)
            _views(out, home, photos=recording is None)
            out.flush()
            out.disconnect()
            (Path(beside) / "home.rrd").replace(file)
    except OSError as error:
        raise InputError(f"{file} cannot be written ({error.strerror or error})") from error


def _first_frame(home: Home, recording: Recording) -> int:
    """The number that the recording's first frame has in the home."""
    first, sha256 = 0, recording.fingerprint()
    for row in home.settings["recordings"]:
        if row["sha256"] == sha256:
            return first
        first += int(row["frames"])
    names = ", ".join(row["recording"] for row in home.settings["recordings"])
    raise InputError(
        f"{home.name} was not mapped from {recording.name} as it is read now, but from {names}: give that recording, "
        "or leave it out"
    )


def _blueprint() -> Any:
    space = rrb.Spatial3DView(origin="/", name="home")
    beside = rrb.Vertical(
        rrb.Spatial2DView(origin="/camera/image", name="picture"),
        rrb.TextDocumentView(origin="/about", name="about"),
        row_shares=[3, 2],
    )
    return rrb.Blueprint(rrb.Horizontal(space, beside, column_shares=[3, 2]), rrb.TimePanel(timeline=TIMELINE))


def _still(out: Any, home: Home) -> None:
    """What does not change with time: the floor plan, rooms, objects, and what the home says of itself."""
    out.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    notes = "\n".join(f"- {note}" for note in home.notes)
    about = f"# {home.name}\n\n{len(home.names)} kinds of confirmed objects by {home.detector}\n\n{notes}\n"
    out.log("about", rr.TextDocument(about, media_type="text/markdown"), static=True)
    if home.grid is not None:
        out.log("home/floor_plan", _floor_plan(home.grid), static=True)
        centres = [home.grid.centre(room.cells).mean(axis=0) for room in home.rooms]
        if centres:
            points = np.column_stack([centres, np.zeros(len(centres))])
            names = [room.name for room in home.rooms]
            out.log("home/rooms", rr.Points3D(points, labels=names, radii=0.05, colors=PATH), static=True)
    for name, colour, some in (
        ("confirmed", SURE, [thing for thing in home.objects if thing.confirmed]),
        ("tentative", UNSURE, [thing for thing in home.objects if not thing.confirmed]),
    ):
        if some:
            out.log(f"home/objects/{name}", _boxes(some, colour), static=True)


def _boxes(things: Sequence[MapObject], colour: tuple[int, int, int]) -> Any:
    low, high = (np.array([getattr(thing, side) for thing in things]) for side in ("box_min", "box_max"))
    labels = [f"{thing.label} {thing.id} ({thing.probability:.0%})" for thing in things]
    return rr.Boxes3D(centers=(low + high) / 2, half_sizes=(high - low) / 2, labels=labels, colors=colour)


def _floor_plan(grid: OccupancyGrid) -> Any:
    """The grid as a picture that lies on the floor."""
    picture = np.full((*grid.cells.shape, 3), UNSEEN, np.uint8)
    for value, colour in CELLS.items():
        picture[grid.cells == value] = colour
    (x, y), (rows, columns) = grid.origin_xy, grid.cells.shape
    right, far = x + columns * grid.resolution_m, y + rows * grid.resolution_m
    return rr.Mesh3D(
        vertex_positions=[(x, y, 0), (right, y, 0), (right, far, 0), (x, far, 0)],
        vertex_texcoords=[(0, 0), (1, 0), (1, 1), (0, 1)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        albedo_texture=picture,
    )


def _views(out: Any, home: Home, photos: bool) -> None:
    """The evidence: in each frame that shows an object, its boxes, a line to it, and the photo if nothing better is there."""
    shown: dict[int, list[tuple[MapObject, Any]]] = defaultdict(list)
    for thing in home.objects:
        for view in thing.views:
            shown[view.frame].append((thing, view))
    for frame, pairs in sorted(shown.items()):
        out.set_time(TIMELINE, sequence=frame)
        if photos and frame in home.photos:
            out.log("camera/image", rr.EncodedImage(contents=home.photos[frame], media_type="image/jpeg"))
        colours = [SURE if thing.confirmed else UNSURE for thing, _ in pairs]
        labels = [f"{view.label} {view.score:.2f}, object {thing.id}" for thing, view in pairs]
        boxes = np.array([view.box_xyxy for _, view in pairs])
        out.log(
            "camera/image/boxes",
            rr.Boxes2D(array=boxes, array_format=rr.Box2DFormat.XYXY, labels=labels, colors=colours),
        )
        ends = [view.surface if view.surface is not None else thing.position for thing, view in pairs]
        strips = [np.array([view.camera, end]) for (_, view), end in zip(pairs, ends, strict=True)]
        out.log("home/sight", rr.LineStrips3D(strips, colors=colours))
        out.set_time(TIMELINE, sequence=frame + 1)
        for name in ("camera/image/boxes", "home/sight"):
            out.log(name, rr.Clear(recursive=False))


def _moving(out: Any, recording: Recording, first: int, progress: Callable[[int, int], None] | None) -> None:
    """Every frame: the camera, its picture and depth; and the whole path."""
    path = []
    for number in range(len(recording)):
        frame = recording[number]
        pose, camera = frame.world_from_camera, frame.camera
        path.append(pose[:3, 3])
        out.set_time(TIMELINE, sequence=first + number)
        out.log("camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        out.log("camera/image", _pinhole(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy))
        out.log("camera/image", rr.Image(frame.rgb).compress(jpeg_quality=JPEG_QUALITY))
        if frame.depth_m is not None:
            step = max(1, camera.width // DEPTH_WIDTH)
            small: Array = np.nan_to_num(frame.depth_m[::step, ::step] * 1000).clip(0, 65535).astype(np.uint16)
            height, width = small.shape
            out.log(
                "camera/depth",
                _pinhole(width, height, camera.fx / step, camera.fy / step, camera.cx / step, camera.cy / step),
            )
            out.log("camera/depth", rr.DepthImage(small, meter=1000.0))
        if progress is not None:
            progress(number + 1, len(recording))
    out.log("home/path", rr.LineStrips3D([np.array(path)], colors=PATH), static=True)


def _pinhole(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Any:
    """Rerun's pixel (0, 0) is the corner of the first pixel, ours its centre."""
    return rr.Pinhole(
        resolution=(width, height), focal_length=(fx, fy), principal_point=(cx + 0.5, cy + 0.5),
        camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.3,
    )  # fmt: skip
