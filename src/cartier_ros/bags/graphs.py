"""Optimised poses in ROS messages: ``nav_msgs/Path`` of a SLAM's keyframes, RTAB-Map's ``MapGraph`` and ``MapData``.

A graph names its poses by the numbers of nodes; ``MapData`` tells the stamp of its first node, which is the newest, and
a ``MapGraph`` alone is as old as its newest node. The nodes' images, whose layout changes from version to version, are
not read.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartier.errors import InputError, brief
from cartier.recordings.common.poses import matrices
from cartier_ros.bags.bag import decoded, frame_name
from cartier_ros.bags.tf import checked_rows

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

PATH = "nav_msgs/msg/Path"
MAP_GRAPH, MAP_DATA = "rtabmap_msgs/msg/MapGraph", "rtabmap_msgs/msg/MapData"
GRAPHS = (PATH, MAP_GRAPH, MAP_DATA)
HEAD = "rtabmap_msgs/msg/MapDataHead"  # of a MapData with a node, up to its stamp
LINK = "int32 from_id\nint32 to_id\nint32 type\ngeometry_msgs/Transform transform\nfloat64[36] information"
GRAPH = (
    "std_msgs/Header header\ngeometry_msgs/Transform map_to_odom\nint32[] poses_id\ngeometry_msgs/Pose[] poses\n"
    "rtabmap_msgs/Link[] links"
)
NODES = "\nuint32 nodes\nint32 id\nint32 map_id\nint32 weight\nfloat64 stamp"
MOST_POSES = 200_000
Matrix = np.ndarray[Any, np.dtype[np.float64]]


class Graph(NamedTuple):
    """Poses (4, 4) of something that a world's frame carries, by stamp (ns) or by a node's number, and known stamps."""

    world: str
    poses: dict[int, Matrix]
    stamps_ns: dict[int, int] | None
    """The stamps of some nodes by their numbers; None where the poses are given by stamp."""


def read_graph(data: bytes, kind: str, encoding: str, where: str) -> Graph:
    """The poses of a message. Raises InputError for a damaged one."""
    if kind == PATH:
        path = decoded(data, kind, encoding, where)
        stamps = [ns_of(each.header.stamp) for each in path.poses]
        return Graph(_world(path, where), _poses([each.pose for each in path.poses], stamps, where), None)
    told = _head(data, kind, encoding, where)
    graph = told.graph if kind == MAP_DATA else told
    ids = [int(number) for number in graph.poses_id]
    if len(ids) != len(graph.poses):
        raise InputError(f"{where} has {len(ids)} nodes and {len(graph.poses)} poses")
    if kind == MAP_DATA:
        known = {int(told.id): round(told.stamp * 1e9)} if told.nodes and abs(told.stamp) < 1e10 else {}
    else:
        known = {max(ids): ns_of(graph.header.stamp)} if ids else {}
    return Graph(_world(graph, where), _poses(graph.poses, ids, where), known)


def _head(data: bytes, kind: str, encoding: str, where: str) -> Any:
    """A MapGraph, or a MapData as far as the stamp of its first node."""
    types = _types(encoding)
    if kind == MAP_DATA:
        data += bytes(32)  # a MapData without nodes ends early
    definition = types.get_msgdef(HEAD if kind == MAP_DATA else MAP_GRAPH)
    try:
        if encoding == "ros1":
            return definition.deserialize_ros1(data, 0, definition.cls, types)[0]
        read = definition.deserialize_cdr_le if data[1] & 1 else definition.deserialize_cdr_be
        return read(data[4:], 0, definition.cls, types)[0]
    except (struct.error, UnicodeDecodeError, ValueError, IndexError, AssertionError) as error:
        raise InputError(f"{where} is damaged ({brief(error)})") from error


def _poses(poses: Any, keys: list[int], where: str) -> dict[int, Matrix]:
    if len(keys) > MOST_POSES:
        raise InputError(f"{where} has {len(keys)} poses; cartier reads up to {MOST_POSES}")
    if not keys:
        return {}
    rows = [
        (0.0, p.position.x, p.position.y, p.position.z, *(getattr(p.orientation, axis) for axis in "xyzw"))
        for p in poses
    ]
    return dict(zip(keys, matrices(checked_rows(np.array(rows, np.float64), where)[:, 1:]), strict=True))


def _world(message: Any, where: str) -> str:
    return frame_name(str(message.header.frame_id), where)


def ns_of(stamp: Any) -> int:
    """A stamp of a message in nanoseconds."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


@cache
def _types(encoding: str) -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_JAZZY)
    for name, text in (
        ("rtabmap_msgs/msg/Link", LINK),
        (MAP_GRAPH, GRAPH),
        (HEAD, f"std_msgs/Header header\nrtabmap_msgs/MapGraph graph{NODES}"),
    ):
        store.register(get_types_from_msg(text, name))
    return store
