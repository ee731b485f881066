"""MCAP export with Foxglove's schemas as JSON: objects, rooms, floor plan and point cloud, for Lichtblick or Foxglove.

Such viewers show nothing without a transform, and hide the topics without a layout: both are written.
"""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from cartier import plugins
from cartier.errors import MissingExtra
from cartier.exports.scene import Box, boxes, called
from cartier.home import Home
from cartier.home.point_cloud import PointCloud
from cartier.io.atomic import write_file
from cartier.io.files import json_bytes
from cartier.types import OCCUPIED, UNKNOWN

FRAME, START = "map", "start"
TOPICS = {
    "/tf": "foxglove.FrameTransforms",
    "/objects": "foxglove.SceneUpdate",
    "/rooms": "foxglove.SceneUpdate",
    "/floor_plan": "foxglove.Grid",
    "/points": "foxglove.PointCloud",
}
UINT8, FLOAT32 = 1, 7  # of foxglove.NumericType
RGBA = ("red", "green", "blue", "alpha")


def write(home: Home, file: Path) -> list[Path]:
    """Write the file, and a layout beside it. Raises MissingExtra without the package mcap."""
    try:
        data = _written(home)
    except ModuleNotFoundError as error:
        raise MissingExtra(f"{file.suffix} needs the package 'mcap': {plugins.install('export', 'mcap')}") from error
    beside = file.with_suffix(".layout.json")
    write_file(file, data)
    write_file(beside, _layout())
    return [file, beside]


def _written(home: Home) -> bytes:
    from mcap.writer import Writer

    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start(profile="", library="cartier")
    time_ns = round(max((obj.last_looked_s for obj in home.objects), default=0.0) * 1e9)
    stamp = {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}
    messages = {"/tf": _transforms(home, stamp), "/objects": _objects(home, stamp), "/rooms": _rooms(home, stamp)}
    if home.grid is not None:
        messages["/floor_plan"] = _floor_plan(home, stamp)
    if (cloud := home.cloud()) is not None:
        messages["/points"] = _points(cloud, stamp)
    for topic, message in messages.items():
        schema = json.dumps({"title": TOPICS[topic], "type": "object", "properties": _properties(message)}).encode()
        number = writer.register_schema(name=TOPICS[topic], encoding="jsonschema", data=schema)
        channel = writer.register_channel(topic=topic, message_encoding="json", schema_id=number)
        data = json.dumps(message, ensure_ascii=False).encode()
        writer.add_message(channel_id=channel, log_time=max(time_ns, 0), publish_time=max(time_ns, 0), data=data)
    writer.add_metadata("cartier", {"home": home.name, "home_id": home.id, "detector": home.detector})
    writer.finish()
    return buffer.getvalue()


def _layout() -> bytes:
    """A layout for Lichtblick or Foxglove: one 3-D panel in the map frame, all topics visible."""
    panel = {
        "cameraState": {"perspective": True, "distance": 14, "phi": 40, "thetaOffset": 45, "targetOffset": [0, 0, 0]},
        "followMode": "follow-none", "followTf": FRAME, "scene": {}, "transforms": {}, "publish": {},
        "topics": {topic: {"visible": True} for topic in TOPICS if topic != "/tf"},
        "layers": {
            "grid": {"layerId": "foxglove.Grid", "visible": True, "frameId": FRAME, "size": 20, "divisions": 20},
        },
    }  # fmt: skip
    about = {"configById": {"3D!home": panel}, "globalVariables": {}, "userNodes": {}, "layout": "3D!home"}
    return json_bytes(about)


def _transforms(home: Home, stamp: dict[str, int]) -> dict[str, Any]:
    x, y = home.start_xy
    move = {"translation": {"x": x, "y": y, "z": 0.0}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    return {"transforms": [{"timestamp": stamp, "parent_frame_id": FRAME, "child_frame_id": START, **move}]}


def _objects(home: Home, stamp: dict[str, int]) -> dict[str, Any]:
    entities = []
    for box in boxes(home):
        if box.obj is None:
            continue
        middle, size = np.add(box.low, box.high) / 2, np.subtract(box.high, box.low)
        cube = {"pose": _pose(middle), "size": _xyz(size), "color": _colour(box)}
        top = (*middle[:2], box.high[2] + 0.08)
        about = {"id": box.obj.id, "label": box.obj.label, "probability": box.obj.probability}
        notes = [{"key": key, "value": str(value)} for key, value in about.items()]
        entity = _entity(f"object {box.obj.id}", stamp) | {"metadata": notes, "cubes": [cube]}
        entities.append(entity | {"texts": [_text(top, called(box.obj), 0.09)]})
    return {"deletions": [], "entities": entities}


def _rooms(home: Home, stamp: dict[str, int]) -> dict[str, Any]:
    entities = []
    for room in home.rooms if home.grid is not None else ():
        assert home.grid is not None
        x, y = home.grid.centre(np.median(room.cells, axis=0)).tolist()
        entities.append(_entity(f"room {room.id}", stamp) | {"texts": [_text((x, y, 0.05), room.name, 0.25)]})
    return {"deletions": [], "entities": entities}


def _floor_plan(home: Home, stamp: dict[str, int]) -> dict[str, Any]:
    grid = home.grid
    assert grid is not None
    shade = np.full((*grid.cells.shape, 4), (250, 250, 247, 255), np.uint8)
    shade[grid.cells == OCCUPIED] = (74, 78, 89, 255)
    shade[grid.cells == UNKNOWN] = (0, 0, 0, 0)
    return {
        "timestamp": stamp, "frame_id": FRAME, "pose": _pose((*grid.origin_xy, -0.01)),
        "column_count": grid.cells.shape[1], "cell_size": {"x": grid.resolution_m, "y": grid.resolution_m},
        "row_stride": 4 * grid.cells.shape[1], "cell_stride": 4, "fields": _fields(RGBA, UINT8),
        "data": base64.b64encode(shade.tobytes()).decode(),
    }  # fmt: skip


def _points(cloud: PointCloud, stamp: dict[str, int]) -> dict[str, Any]:
    rows = np.zeros(len(cloud.rgb), [("xyz", "<f4", 3), ("rgba", "u1", 4)])
    rows["xyz"], rows["rgba"][:, :3], rows["rgba"][:, 3] = cloud.xyz_m, cloud.rgb, 255
    return {
        "timestamp": stamp, "frame_id": FRAME, "pose": _pose((0, 0, 0)), "point_stride": rows.itemsize,
        "fields": _fields(("x", "y", "z"), FLOAT32) + _fields(RGBA, UINT8, first=12),
        "data": base64.b64encode(rows.tobytes()).decode(),
    }  # fmt: skip


def _fields(names: tuple[str, ...], kind: int, first: int = 0) -> list[dict[str, Any]]:
    """Foxglove's description of packed fields of one type, from the byte ``first`` on."""
    side = 4 if kind == FLOAT32 else 1
    return [{"name": name, "offset": first + side * k, "type": kind} for k, name in enumerate(names)]


def _entity(name: str, stamp: dict[str, int]) -> dict[str, Any]:
    lists = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models", "metadata")
    kept = {"lifetime": {"sec": 0, "nsec": 0}, "frame_locked": True}
    return {"timestamp": stamp, "frame_id": FRAME, "id": name, **kept, **{key: [] for key in lists}}


def _text(at: Any, text: str, size_m: float) -> dict[str, Any]:
    ink = {"r": 0.1, "g": 0.12, "b": 0.16, "a": 1.0}
    style = {"billboard": True, "font_size": size_m, "scale_invariant": False, "color": ink}
    return {"pose": _pose(at), **style, "text": text}


def _pose(at: Any) -> dict[str, Any]:
    return {"position": _xyz(at), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _xyz(values: Any) -> dict[str, float]:
    return {axis: float(v) for axis, v in zip("xyz", values, strict=True)}


def _colour(box: Box) -> dict[str, float]:
    return {**{name: round(v / 255, 4) for name, v in zip("rgb", box.rgb, strict=True)}, "a": 0.85}


def _properties(message: dict[str, Any]) -> dict[str, Any]:
    kinds: dict[type, str] = {dict: "object", list: "array", str: "string", int: "integer", float: "number"}
    return {
        key: {"type": kinds[type(value)]} | ({"contentEncoding": "base64"} if key == "data" else {})
        for key, value in message.items()
    }
