"""PLY export (binary, little-endian): the boxes of a home as a coloured mesh, and its point cloud; z up, metres."""

from __future__ import annotations

import numpy as np

from cartier.exports.scene import FACES, boxes, corners
from cartier.home import Home
from cartier.types import Array

VERTEX = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write(home: Home) -> bytes:
    """The file's bytes."""
    every = boxes(home)
    vertices = _vertices(
        np.concatenate([corners(box) for box in every]), np.repeat([box.rgb for box in every], 8, axis=0)
    )
    faces = np.zeros(12 * len(every), FACE)
    faces["count"] = 3
    faces["corners"] = (8 * np.arange(len(every))[:, None, None] + FACES).reshape(-1, 3)
    more = [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return _head(len(vertices), more) + vertices.tobytes() + faces.tobytes()


def points(home: Home) -> bytes | None:
    """The file's bytes for the point cloud; None if the home has none."""
    cloud = home.cloud()
    return None if cloud is None else _head(len(cloud.rgb), []) + _vertices(cloud.xyz_m, cloud.rgb).tobytes()


def _vertices(xyz_m: Array, rgb: Array) -> Array:
    vertices = np.zeros(len(rgb), VERTEX)
    for values, names in ((xyz_m, ("x", "y", "z")), (rgb, ("red", "green", "blue"))):
        for axis, name in enumerate(names):
            vertices[name] = values[:, axis]
    return vertices


def _head(count: int, more: list[str]) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", "comment cartier: metres, z up, the map frame"]
    lines += [f"element vertex {count}", *(f"property float {name}" for name in "xyz")]
    lines += [*(f"property uchar {name}" for name in ("red", "green", "blue")), *more, "end_header", ""]
    return "\n".join(lines).encode("ascii")
