"""Rerun file of a home: photos with boxes, objects, points, rooms, floor plan; with the recording frames, depth, path.

To explain a false positive, move along the time line ``frame`` to where the object appears: boxes there made it.
An object appears with its first box, in its final state; with the recording, floor plan and path grow. Each frame says
whether the detector processed it. The file opens in the viewer of rerun.io (``rerun FILE.rrd``). Needs rerun-sdk.
"""

from __future__ import annotations

import colorsys
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cartier.contracts import Recording
from cartier.home import Home
from cartier.home.detection_log import ProcessedFrame
from cartier.io.atomic import replaced_file
from cartier.mapping.occupancy import OccupancyMapper
from cartier.navigation.planning import room_middle
from cartier.render.mapped_frames import as_mapped, first_frame_of
from cartier.types import FREE, OCCUPIED, UNKNOWN, Array, MapObject, OccupancyGrid, Room, View

TIMELINE = "frame"
CONFIRMED, TENTATIVE, NONE, PATH = (209, 73, 91), (200, 160, 60), (130, 130, 130), (66, 105, 178)
CELLS = {FREE: (238, 238, 232), OCCUPIED: (60, 60, 66)}
UNSEEN = (176, 176, 172)
ROOM_SHARE = 0.35  # opacity of a room's colour on its floor
GOLDEN = 0.618  # step of the hue from room to room: neighbours in the list differ
BLUE = 0.55  # the hue of the first room: red is for objects
STEPS = 60  # in which floor plan and path grow
DEPTH_WIDTH = 320  # px: enough to judge a map
JPEG_QUALITY = 75


def write_rrd(
    home: Home, file: Path, recording: Recording | None = None, progress: Callable[[int, int], None] | None = None
) -> None:
    """Write a home to ``file``, atomically; frames, depth and the camera's path only with its ``recording``.

    Raises InputError if the home was not mapped from the recording, or the file cannot be written.
    """
    first = None if recording is None else first_frame_of(home, recording)
    recording = None if recording is None else as_mapped(home, recording)
    with replaced_file(file) as beside:
        out = rr.RecordingStream("cartier", recording_id=home.id)
        out.save(beside, default_blueprint=blueprint(recording is not None))
        looked, least = _looked(home)
        _still(out, home, looked is not None, least)
        if recording is None or first is None:
            out.set_time(TIMELINE, sequence=0)
            _floor_plan(out, home, home.grid)
            _points(out, home)
            _photos(out, home)
        else:
            _moving(out, home, recording, first, progress)
            own = range(
                first, first + len(recording)
            )  # of a home with several recordings, only the boxes on this one's frames
            looked = None if looked is None else {n: seen for n, seen in looked.items() if n in own}
        if looked is not None:
            _detections(out, home, looked)
        _objects(out, home, looked or {})
        _sights(out, home)
        out.flush()
        out.disconnect()


def _looked(home: Home) -> tuple[dict[int, ProcessedFrame] | None, float]:
    """The detections by frame (None if the home has no log), and the score below which boxes were not kept."""
    log = home.detections()
    return (None, 0.0) if log is None else (log.looked(), log.least)


def blueprint(posed: bool) -> Any:
    """The views. Photos that are not ``posed`` have no place in space: in the 3-D view they would be an error."""
    contents = ["+ $origin/**"] if posed else ["+ $origin/**", "- /camera/**"]
    space = rrb.Spatial3DView(origin="/", name="home", contents=contents)
    beside = rrb.Vertical(
        rrb.Spatial2DView(origin="/camera/image", name="picture"),
        rrb.TextDocumentView(origin="/processed", name="processed?"),
        rrb.TextDocumentView(origin="/about", name="about"),
        row_shares=[5, 1, 2],
    )
    return rrb.Blueprint(rrb.Horizontal(space, beside, column_shares=[3, 2]), rrb.TimePanel(timeline=TIMELINE))


def _still(out: Any, home: Home, logged: bool, least: float) -> None:
    """What does not change with time: the description of the home."""
    out.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    notes = list(home.notes)
    if not logged:
        notes.append("an older cartier mapped this home and kept no detections: map it again to see boxes")
    if least:
        notes.append(f"boxes that score less than {least:.2f} are left out: they were too many to keep")
    about = f"# {home.name}\n\n{len(home.names)} kinds of confirmed objects by {home.detector}\n\n"
    about += "Red is confirmed, yellow tentative, grey a box of no object.\n\n" + "".join(f"- {n}\n" for n in notes)
    out.log("about", rr.TextDocument(about, media_type="text/markdown"), static=True)


def _objects(out: Any, home: Home, looked: Mapping[int, ProcessedFrame]) -> None:
    """Each object in its final state, from the first frame with a box of it."""
    first: dict[int, int] = {}
    for frame in sorted(looked, reverse=True):
        first |= dict.fromkeys(looked[frame].objects.tolist(), frame)
    for obj in home.objects:
        seen = [first[number] for number in (obj.id, *obj.aliases) if number in first]
        seen += [view.frame for view in obj.views]
        low, high = np.array(obj.box_min), np.array(obj.box_max)
        label = f"{obj.label} {obj.id} ({obj.probability:.0%})"
        out.set_time(TIMELINE, sequence=min(seen, default=0))
        out.log(
            f"home/objects/{'confirmed' if obj.confirmed else 'tentative'}/{obj.id}",
            rr.Boxes3D(
                centers=[(low + high) / 2],
                half_sizes=[(high - low) / 2],
                labels=[label],
                colors=_colour(obj),
                show_labels=obj.confirmed,  # the labels of dozens of tentative objects would hide the home
            ),
        )


def _colour(obj: MapObject | None) -> tuple[int, int, int]:
    return NONE if obj is None else CONFIRMED if obj.confirmed else TENTATIVE


def _floor_plan(out: Any, home: Home, grid: OccupancyGrid | None) -> None:
    """A grid as a picture on the floor, with the colours and names of the rooms where the grid is known."""
    if grid is None:
        return
    picture = np.full((*grid.cells.shape, 3), UNSEEN, np.uint8)
    for value, colour in CELLS.items():
        picture[grid.cells == value] = colour
    shown: list[tuple[str, Any, Any]] = []  # name, middle, colour
    for room in home.rooms:
        cells = _known_cells(home, room, grid)
        if len(cells):
            hue = tuple(round(255 * part) for part in colorsys.hsv_to_rgb((BLUE + room.id * GOLDEN) % 1, 0.75, 0.85))
            own = picture[tuple(cells.T)]
            picture[tuple(cells.T)] = np.rint(own + ROOM_SHARE * (np.array(hue) - own)).astype(np.uint8)
            shown.append((room.name, (*room_middle(room, home.grid or grid), 0.0), hue))
    known = np.argwhere(grid.cells != UNKNOWN)
    if not len(known):
        return
    first, last = known.min(axis=0), known.max(axis=0)  # crop the unknown border
    picture = np.ascontiguousarray(picture[first[0] : last[0] + 1, first[1] : last[1] + 1])
    x, y = np.array(grid.origin_xy) + first[::-1] * grid.resolution_m
    right, far = np.array(grid.origin_xy) + (last[::-1] + 1) * grid.resolution_m
    mesh = rr.Mesh3D(
        vertex_positions=[(x, y, 0), (right, y, 0), (right, far, 0), (x, far, 0)],
        vertex_texcoords=[(0, 0), (1, 0), (1, 1), (0, 1)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        albedo_texture=picture,
    )
    out.log("home/floor_plan", mesh)
    if shown:
        names, middles, colours = zip(*shown, strict=True)
        out.log("home/rooms", rr.Points3D(middles, labels=names, radii=0.05, colors=colours))


def _known_cells(home: Home, room: Room, grid: OccupancyGrid) -> Array:
    """The known cells (K, 2) of a room in another grid of the same home, perhaps of another size."""
    assert home.grid is not None
    moved = np.subtract(home.grid.origin_xy, grid.origin_xy)[::-1] / grid.resolution_m
    cells = room.cells + np.rint(moved).astype(np.int32)
    cells = cells[((cells >= 0) & (cells < grid.cells.shape)).all(axis=1)]
    return cells if grid is home.grid else cells[grid.cells[tuple(cells.T)] != UNKNOWN]


def _points(out: Any, home: Home) -> None:
    """The point cloud, if the home keeps one."""
    seen = home.cloud()
    if seen is not None:
        out.log("home/points", rr.Points3D(seen.xyz_m, colors=seen.rgb, radii=0.7 * seen.side_m))


def _photos(out: Any, home: Home) -> None:
    for frame, jpeg in home.photos.items():
        out.set_time(TIMELINE, sequence=frame)
        out.log("camera/image", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))


def _detections(out: Any, home: Home, looked: Mapping[int, ProcessedFrame]) -> None:
    """The boxes of each processed frame with their objects; and for every frame whether it was processed."""
    objs = {number: obj for obj in home.objects for number in (obj.id, *obj.aliases)}
    total = sum(int(row["frames"]) for row in home.settings.get("recordings", ()))
    for frame in sorted(looked.keys() | {frame + 1 for frame in looked} | {0}):
        out.set_time(TIMELINE, sequence=frame)
        seen = looked.get(frame)
        if seen is None and frame >= total > 0:
            continue
        out.log("processed", rr.TextDocument(_in_words(frame, seen, objs)))
        if seen is None or not len(seen.detections):
            out.log("camera/image/boxes", rr.Clear(recursive=False))
            continue
        found, owners = seen.detections, [(number, objs.get(number)) for number in seen.objects.tolist()]
        labels = [
            f"{label} {score:.2f}, {_owner(number, obj)}"
            for label, score, (number, obj) in zip(found.labels, found.scores, owners, strict=True)
        ]
        boxes = rr.Boxes2D(
            array=found.boxes_xyxy,
            array_format=rr.Box2DFormat.XYXY,
            labels=labels,
            colors=[_colour(obj) for _, obj in owners],
        )
        out.log("camera/image/boxes", boxes)


def _owner(number: int, obj: MapObject | None) -> str:
    if obj is not None:
        return f"object {obj.id}"
    return "no object" if number < 0 else f"object {number}, forgotten since"


def _in_words(frame: int, seen: ProcessedFrame | None, objs: Mapping[int, MapObject]) -> str:
    if seen is None:
        return "not processed: the detector was not run on this frame"
    owned = sum(number in objs for number in seen.objects.tolist())
    return f"processed frame {frame}: {len(seen.detections)} boxes, {owned} of objects of this home"


def _sights(out: Any, home: Home) -> None:
    """The evidence: in each best view of an object, a line from the camera to it."""
    shown: dict[int, list[tuple[MapObject, View]]] = defaultdict(list)
    for obj in home.objects:
        for view in obj.views:
            shown[view.frame].append((obj, view))
    for frame, pairs in sorted(shown.items()):
        out.set_time(TIMELINE, sequence=frame)
        ends = [view.surface if view.surface is not None else obj.position for obj, view in pairs]
        strips = [np.array([view.camera, end]) for (_, view), end in zip(pairs, ends, strict=True)]
        out.log("home/sight", rr.LineStrips3D(strips, colors=[_colour(obj) for obj, _ in pairs]))
        if frame + 1 not in shown:
            out.set_time(TIMELINE, sequence=frame + 1)
            out.log("home/sight", rr.Clear(recursive=False))


def _moving(
    out: Any, home: Home, recording: Recording, first: int, progress: Callable[[int, int], None] | None
) -> None:
    """Every frame: camera, image and depth; and in steps the path and the floor plan so far."""
    floor, path, total = OccupancyMapper(), [], len(recording)
    for number in range(total):
        frame = recording[number]
        pose, camera = frame.world_from_camera, frame.camera
        path.append(pose[:3, 3])
        out.set_time(TIMELINE, sequence=first + number)
        out.log("camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        out.log("camera/image", _pinhole(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy))
        out.log("camera/image", rr.Image(frame.rgb).compress(jpeg_quality=JPEG_QUALITY))
        if frame.depth_m is not None:
            floor.add(frame)
            step = max(1, camera.width // DEPTH_WIDTH)
            small: Array = np.nan_to_num(frame.depth_m[::step, ::step] * 1000).clip(0, 65535).astype(np.uint16)
            height, width = small.shape
            scaled = (camera.fx / step, camera.fy / step, camera.cx / step, camera.cy / step)
            out.log("camera/depth", _pinhole(width, height, *scaled))
            out.log("camera/depth", rr.DepthImage(small, meter=1000.0))
        last = number + 1 == total
        if last or number % -(-total // STEPS) == 0:
            out.log("home/path", rr.LineStrips3D([np.array(path)], colors=PATH))
            if home.grid is not None:
                _floor_plan(out, home, home.grid if last else floor.grid())
        if progress is not None:
            progress(number + 1, total)


def _pinhole(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Any:
    """Rerun's pixel (0, 0) is the corner of the first pixel, ours its centre."""
    return rr.Pinhole(
        resolution=(width, height), focal_length=(fx, fy), principal_point=(cx + 0.5, cy + 0.5),
        camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.3,
    )  # fmt: skip
