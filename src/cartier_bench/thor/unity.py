"""Conversion of AI2-THOR's metadata and images from Unity's conventions to cartier's.

Unity: metres, left-handed, x right, y up, z forward; yaw in degrees, clockwise from +z seen from above;
``cameraHorizon`` in degrees, positive looks down; the field of view is vertical. Ours: see ``cartier.types``. Swapping
y and z turns one frame into the other, and mirrors it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import BackendError
from cartier.types import Array, Camera, TrueObject

STRUCTURE = frozenset({"Floor", "Wall", "Ceiling", "Room", "Undefined"})
"""Types of the home itself rather than objects in it: they get no box, and instance id 0."""


def point(metadata: Any, key: str) -> tuple[float, float, float]:
    """The (x, y, z) that metadata holds under a key as {x, y, z}, in our world."""
    vector = field(metadata, key)
    x, y, z = (number(vector, axis, f"{key}.") for axis in "xyz")
    return x, z, y


def to_unity(xyz: Sequence[float]) -> dict[str, float]:
    """A point of our world as Unity's {x, y, z}."""
    x, y, z = map(float, xyz)
    return {"x": x, "y": z, "z": y}


def pose(metadata: Any) -> npt.NDArray[np.float64]:
    """world_from_camera (4, 4) of the agent's camera."""
    agent = field(metadata, "agent")
    yaw = math.radians(number(field(agent, "rotation"), "y", "agent.rotation."))
    down_by = math.radians(number(agent, "cameraHorizon", "agent."))
    forward = np.array([math.sin(yaw) * math.cos(down_by), math.cos(yaw) * math.cos(down_by), -math.sin(down_by)])
    right = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    world_from_camera[:3, 3] = point(metadata, "cameraPosition")
    return world_from_camera


def camera(metadata: Any) -> Camera:
    """The pinhole camera of a vertical field of view; pixels are square, pixel (0, 0) is the top-left one's centre."""
    width, height = (int(number(metadata, key)) for key in ("screenWidth", "screenHeight"))
    focal = 0.5 * height / math.tan(math.radians(number(metadata, "fov")) / 2)
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def depth(depth_m: Array, near_m: float, far_m: float) -> npt.NDArray[np.float32]:
    """The client's metric z-depth with NaN where nothing is hit.

    The client makes metres of an old build's normalised depth by multiplying with far - near, so the background lies
    there and not at the far plane.
    """
    metres = np.array(depth_m, dtype=np.float32)
    metres[~((metres > 0) & (metres < 0.999 * (far_m - near_m)))] = np.nan
    return metres


def true_objects(objects: Sequence[Mapping[str, Any]]) -> tuple[list[TrueObject], dict[str, int], list[str]]:
    """True objects with ids from 1 in the order of their objectIds, the id of each objectId, and notes.

    Objects without a box are left out, with a note; so is the home's structure.
    """
    truth: list[TrueObject] = []
    ids: dict[str, int] = {}
    without: list[str] = []
    for obj in sorted(objects, key=lambda o: str(field(o, "objectId"))):
        object_id, label = str(obj["objectId"]), type_of(obj)
        if label in STRUCTURE:
            continue
        bounds = obj.get("axisAlignedBoundingBox")
        if not bounds:
            without.append(object_id)
            continue
        centre, size = np.array(point(bounds, "center")), np.array(point(bounds, "size"))
        ids[object_id] = len(truth) + 1
        low, high = centre - size / 2, centre + size / 2
        truth.append(TrueObject(ids[object_id], label, tuple(low.tolist()), tuple(high.tolist())))
    more = f" and {len(without) - 3} more" if len(without) > 3 else ""
    notes = [f"left out, because AI2-THOR gives no box for them: {', '.join(without[:3])}{more}"] if without else []
    return truth, ids, notes


def type_of(obj: Mapping[str, Any]) -> str:
    """An object's type; older builds only have it in the objectId, ``Type|x|y|z`` or ``Parent|x|y|z|Type``."""
    fields = str(obj["objectId"]).split("|")
    return str(obj.get("objectType") or (fields[4] if len(fields) > 4 else fields[0]))


def instances(masks: Mapping[str, Array], ids: Mapping[str, int], shape: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Ids (H, W) from a mask (H, W) per objectId; 0 where no known object is."""
    image = np.zeros(shape, np.int32)
    for object_id, mask in masks.items():
        image[mask] = ids.get(object_id, 0)
    return image


def field(metadata: Any, key: str) -> Any:
    """What the build's metadata holds under a key, or a BackendError."""
    if not isinstance(metadata, Mapping) or key not in metadata:
        raise BackendError(
            f"AI2-THOR's metadata holds no {key!r}: this build does not fit the client that is installed"
        )
    return metadata[key]


def number(metadata: Any, key: str, where: str = "") -> float:
    """A finite number of the build's metadata, or a BackendError."""
    value = field(metadata, key)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise BackendError(f"AI2-THOR's metadata holds {str(value)[:40]!r} as {where}{key}, which is no number")
    return float(value)
