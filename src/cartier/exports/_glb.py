"""GLB (glTF 2.0) export: a node for each object with its attributes, floor, walls and points; y up, metres."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from cartier.exports.scene import FACES, Box, boxes, corners
from cartier.home import Home
from cartier.home.point_cloud import PointCloud

FLOAT, UNSIGNED_SHORT, ARRAY_BUFFER, POINTS = 5126, 5123, 34962, 0
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def write(home: Home) -> bytes:
    """The file's bytes."""
    every = boxes(home)
    unit = _flat(corners(Box("", (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), (0, 0, 0))), FACES)
    colours = {rgb: k for k, rgb in enumerate(dict.fromkeys(box.rgb for box in every))}
    parts: list[bytes] = []
    about: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "cartier"}, "scene": 0, "scenes": [{"name": home.name, "nodes": [0]}],
        "nodes": [{"name": "map", "children": []}], "meshes": [], "accessors": [], "bufferViews": [], "buffers": [],
        "materials": [_material(rgb) for rgb in colours],
    }  # fmt: skip
    unit_at = _add(about, parts, *unit)
    by_colour: dict[tuple[int, int, int], int] = {}
    for box in every:
        if box.obj is None:
            continue
        if box.rgb not in by_colour:
            by_colour[box.rgb] = _mesh(about, unit_at, colours[box.rgb])
        low, high = np.array(box.low), np.array(box.high)
        _node(about, box, by_colour[box.rgb], _up((low + high) / 2), np.maximum(high - low, 1e-4)[[0, 2, 1]])
    for kind in ("floor", "wall"):
        same = [box for box in every if box.obj is None and box.name == kind]
        if same:
            faces = np.concatenate([8 * k + FACES for k in range(len(same))])
            at = _add(about, parts, *_flat(np.concatenate([corners(box) for box in same]), faces))
            _add_node(about, {"name": kind, "mesh": _mesh(about, at, colours[same[0].rgb])})
    if (cloud := home.cloud()) is not None:
        _points(about, parts, cloud)
    binary = b"".join(parts)
    about["buffers"].append({"byteLength": len(binary)})
    text = json.dumps(about, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _up(points: Any) -> Any:
    """Points (..., 3) of the map frame (z up) in the frame of glTF (y up)."""
    points = np.asarray(points)
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def _flat(points: Any, faces: Any) -> tuple[Any, Any]:
    """Vertices (3F, 3) and normals (3F, 3) for flat shading."""
    vertices = _up(points)[faces].astype(np.float32)
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return vertices.reshape(-1, 3), np.repeat(normals, 3, axis=0).astype(np.float32)


def _points(about: dict[str, Any], parts: list[bytes], cloud: PointCloud) -> None:
    """Add the point cloud as a node of its own, which viewers can hide, unlit."""
    linear = np.ones((len(cloud.rgb), 4))
    linear[:, :3] = (cloud.rgb / 255) ** 2.2
    places, colours = _up(cloud.xyz_m).astype("<f4"), np.round(linear * 65535).astype("<u2")
    about["extensionsUsed"] = ["KHR_materials_unlit"]
    unlit = _append(about, "materials", {"extensions": {"KHR_materials_unlit": {}}})
    at = {"POSITION": _accessor(about, parts, places, FLOAT)}
    at["COLOR_0"] = _accessor(about, parts, colours, UNSIGNED_SHORT)
    mesh = _append(about, "meshes", {"primitives": [{"attributes": at, "mode": POINTS, "material": unlit}]})
    _add_node(about, {"name": "points", "mesh": mesh})


def _add(about: dict[str, Any], parts: list[bytes], vertices: Any, normals: Any) -> tuple[int, int]:
    """Add vertices and normals; returns the numbers of their accessors."""
    one, other = (_accessor(about, parts, values.astype("<f4"), FLOAT) for values in (vertices, normals))
    return one, other


def _accessor(about: dict[str, Any], parts: list[bytes], values: Any, kind: int) -> int:
    """Add values (N, 3 or 4); returns the number of their accessor."""
    offset = sum(map(len, parts))
    parts.append(np.ascontiguousarray(values).tobytes())
    view = {"buffer": 0, "byteOffset": offset, "byteLength": len(parts[-1]), "target": ARRAY_BUFFER}
    number = _append(about, "bufferViews", view)
    vectors = f"VEC{values.shape[1]}"
    accessor = {"bufferView": number, "componentType": kind, "count": len(values), "type": vectors}
    bounds = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if kind == FLOAT else {"normalized": True}
    return _append(about, "accessors", accessor | bounds)


def _mesh(about: dict[str, Any], at: tuple[int, int], material: int) -> int:
    primitive = {"attributes": {"POSITION": at[0], "NORMAL": at[1]}, "material": material}
    return _append(about, "meshes", {"primitives": [primitive]})


def _append(about: dict[str, Any], key: str, value: dict[str, Any]) -> int:
    """Append to one of glTF's lists; returns the number of the value."""
    about[key].append(value)
    return len(about[key]) - 1


def _add_node(about: dict[str, Any], node: dict[str, Any]) -> None:
    about["nodes"][0]["children"].append(_append(about, "nodes", node))


def _node(about: dict[str, Any], box: Box, mesh: int, middle: Any, size: Any) -> None:
    obj = box.obj
    assert obj is not None
    extras = {"id": obj.id, "label": obj.label, "names": list(obj.names), "probability": obj.probability}
    place = {"translation": middle.tolist(), "scale": size.tolist()}
    _add_node(about, {"name": box.name, "mesh": mesh, **place, "extras": extras | {"room": obj.room}})


def _material(rgb: tuple[int, int, int]) -> dict[str, Any]:
    linear = [round((v / 255) ** 2.2, 4) for v in rgb]  # glTF's factors are linear
    return {"pbrMetallicRoughness": {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}}
