"""The camera's poses in a bag: from the tree of transforms, or from an odometry topic and the camera's place on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.recordings.common.poses import MAX_GAP_S, by_time, interpolated
from cartier.recordings.ros.bags import TRANSFORMS, Bag, frame_name
from cartier.recordings.ros.tf import Tree, checked_rows

ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
Matrices = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Found:
    """(N, 4, 4) world_from_camera, NaN where there is none; the world's frame; and notes on how they came about."""

    matrices: Matrices
    world: str
    notes: Sequence[str]


def transform_tree(bag: Bag) -> Tree:
    """All transforms of a bag; a topic whose name ends in ``tf_static`` is static."""
    tree = Tree()
    for name in bag.topics(*TRANSFORMS):
        for row in bag.index(name):
            tree.add(bag.decode(name, bag.read(row)), name.endswith("tf_static"), bag.path)
    return tree


def camera_poses(
    bag: Bag,
    tree: Tree,
    camera: str,
    times_s: npt.NDArray[np.float64],
    frame: str | None,
    odometry: str | None,
    body_from_camera: Matrices | None,
) -> Found:
    """Where the camera was at each time."""
    topics = bag.topics(ODOMETRY, POSE)
    moving = tree.moves(camera)
    if odometry is None and body_from_camera is None and (frame is not None or moving):
        return _from_tree(tree, camera, times_s, frame)
    if odometry is None:
        if len(topics) != 1:
            why = f"the frame {camera!r} hangs on nothing that moves in /tf" if not moving else "an extrinsic was given"
            there = (
                f"several topics hold poses ({brief(', '.join(topics), 200)})"
                if topics
                else "there is no odometry topic either"
            )
            raise InputError(
                f"{bag.path} has no poses for the camera: {why}, and {there}: choose with --odometry TOPIC "
                "--extrinsic X,Y,Z,QX,QY,QZ,QW"
            )
        odometry = topics[0]
    name = next((topic for topic in topics if topic.lstrip("/") == odometry.lstrip("/")), None)
    if name is None:
        there = brief(", ".join(topics), 200) or "none"
        raise InputError(f"{bag.path} has no topic {odometry!r} of type {ODOMETRY} or {POSE}; there are {there}")
    return _from_odometry(bag, name, tree, camera, times_s, body_from_camera)


def _from_tree(tree: Tree, camera: str, times_s: npt.NDArray[np.float64], frame: str | None) -> Found:
    world = frame or tree.world(camera) or ""
    poses = tree.poses(world, camera, times_s)
    notes = [f"poses from /tf: {world!r} to {camera!r}", *_left_out(poses.outside, poses.in_gaps, "transforms")]
    if frame is None and world != "map":
        notes.append(f"there is no frame 'map' above the camera: the world is {world!r}; choose with --frame NAME")
    return Found(poses.matrices, world, notes)


def _from_odometry(
    bag: Bag,
    name: str,
    tree: Tree,
    camera: str,
    times_s: npt.NDArray[np.float64],
    body_from_camera: Matrices | None,
) -> Found:
    rows, world, body = _samples(bag, name)
    if body_from_camera is None:
        body_from_camera = tree.fixed(body, camera) if body else None
    if body_from_camera is None:
        raise InputError(
            f"{bag.path}: topic {name} says where {body or 'something'!r} was, but not where the camera "
            f"{camera!r} sits on it: give --extrinsic X,Y,Z,QX,QY,QZ,QW"
        )
    samples = interpolated(checked_rows(rows, name), times_s)
    poses = samples.matrices() @ body_from_camera
    poses[samples.outside | samples.in_gaps] = np.nan
    left_out = _left_out(int(samples.outside.sum()), int((samples.in_gaps & ~samples.outside).sum()), "poses")
    return Found(poses, world, [f"poses from {name}, in frame {world!r}", *left_out])


def _samples(bag: Bag, name: str) -> tuple[npt.NDArray[np.float64], str, str]:
    """Rows ``t x y z qx qy qz qw`` by time, the frame that they are in, and the one that they move ("" if not said)."""
    rows, world, body = [], "", ""
    for row in bag.index(name):
        message = bag.decode(name, bag.read(row))
        pose = message.pose.pose if bag.type_of(name) == ODOMETRY else message.pose
        stamp, t, q = message.header.stamp, pose.position, pose.orientation
        rows.append((stamp.sec + stamp.nanosec * 1e-9, t.x, t.y, t.z, q.x, q.y, q.z, q.w))
        world = frame_name(str(message.header.frame_id), bag.path)
        body = frame_name(str(getattr(message, "child_frame_id", "")), bag.path)
    if not rows:
        raise InputError(f"{bag.path}: topic {name} holds no pose")
    return by_time(np.array(rows)), world, body


def _left_out(outside: int, in_gaps: int, what: str) -> list[str]:
    notes = []
    if outside:
        notes.append(f"{outside} images left out: taken before the first or after the last of the {what}")
    if in_gaps:
        notes.append(f"{in_gaps} images left out: the {what} have gaps of more than {MAX_GAP_S:g} s there")
    return notes
