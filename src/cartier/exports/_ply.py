"""PLY (binary, little-endian): the boxes of a home as a coloured mesh, z up, in metres of the map frame."""

from __future__ import annotations

import numpy as np

from cartier.exports._scene import FACES, boxes, corners
from cartier.home import Home

VERTEX = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write(home: Home) -> bytes:
    """The file's bytes."""
    every = boxes(home)
    vertices = np.zeros(8 * len(every), VERTEX)
    points = np.concatenate([corners(box) for box in every])
    colours = np.repeat([box.rgb for box in every], 8, axis=0)
    for axis, name in enumerate("xyz"):
        vertices[name] = points[:, axis]
    for axis, name in enumerate(("red", "green", "blue")):
        vertices[name] = colours[:, axis]
    faces = np.zeros(12 * len(every), FACE)
    faces["count"] = 3
    faces["corners"] = (8 * np.arange(len(every))[:, None, None] + FACES).reshape(-1, 3)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment cartier: metres, z up, the map frame",
        f"element vertex {len(vertices)}",
    ]
    lines += [f"property float {name}" for name in "xyz"] + [f"property uchar {name}" for name in VERTEX.names[3:]]  # type: ignore[index]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(lines).encode("ascii") + vertices.tobytes() + faces.tobytes()
