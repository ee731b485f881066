"""The camera's poses in a bag: from the tree of transforms, or from an odometry topic and the camera's place on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.recordings.common.poses import MAX_GAP_S, interpolated
from cartier_ros.bags.bag import TRANSFORMS, Bag, frame_name
from cartier_ros.bags.tf import Edge, Poses, Tree, checked_rows

ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
Matrices = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseSource:
    """Where a camera's poses come from: the samples that move, and a function from times (s) to poses."""

    moving: Sequence[Edge]
    at: Callable[[npt.NDArray[np.float64]], Poses]
    world: str
    what: str
    """What they are called: transforms or poses."""
    notes: Sequence[str]


def transform_tree(bag: Bag) -> Tree:
    """All transforms of a bag; a topic whose name ends in ``tf_static`` is static."""
    tree = Tree()
    for name in bag.topics(*TRANSFORMS):
        index = bag.index(name)
        for row, order in zip(index, bag.order(index).tolist(), strict=True):
            tree.add(bag.decode(name, bag.read(row)), name.endswith("tf_static"), bag.path, order)
    return tree


def camera_poses(
    bag: Bag,
    tree: Tree,
    camera: str,
    frame: str | None,
    odometry: str | None,
    body_from_camera: Matrices | None,
) -> PoseSource:
    """What tells where the camera was."""
    topics = bag.topics(ODOMETRY, POSE)
    moving = tree.moving(camera)
    if odometry is None and body_from_camera is None and (frame is not None or moving):
        return _from_tree(tree, camera, frame)
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
    return _from_odometry(bag, name, tree, camera, body_from_camera)


def _from_tree(tree: Tree, camera: str, frame: str | None) -> PoseSource:
    world = frame or tree.world(camera) or ""
    notes = [f"poses from /tf: {world!r} to {camera!r}"]
    if frame is None and world != "map":
        notes.append(f"there is no frame 'map' above the camera: the world is {world!r}; choose with --frame NAME")
    return PoseSource(tree.moving(camera), partial(tree.poses, world, camera), world, "transforms", notes)


def _from_odometry(bag: Bag, name: str, tree: Tree, camera: str, body_from_camera: Matrices | None) -> PoseSource:
    edge, body = _samples(bag, name)
    if body_from_camera is None:
        body_from_camera = tree.fixed(body, camera) if body else None
    if body_from_camera is None:
        raise InputError(
            f"{bag.path}: topic {name} says where {body or 'something'!r} was, but not where the camera "
            f"{camera!r} sits on it: give --extrinsic X,Y,Z,QX,QY,QZ,QW"
        )
    fixed = body_from_camera

    def at(times_s: npt.NDArray[np.float64]) -> Poses:
        return Poses.of([fixed, interpolated(checked_rows(edge.table(), name, True), times_s)], len(times_s))

    return PoseSource([edge], at, edge.parent, "poses", [f"poses from {name}, in frame {edge.parent!r}"])


def _samples(bag: Bag, name: str) -> tuple[Edge, str]:
    """The poses of a topic, and the frame that they move ("" if not said)."""
    edge, body, index = Edge("", False), "", bag.index(name)
    for row, order in zip(index, bag.order(index).tolist(), strict=True):
        message = bag.decode(name, bag.read(row))
        edge.add(order, message.header.stamp, message.pose.pose if bag.type_of(name) == ODOMETRY else message.pose)
        edge.parent = frame_name(str(message.header.frame_id), bag.path)
        body = frame_name(str(getattr(message, "child_frame_id", "")), bag.path)
    if not len(index):
        raise InputError(f"{bag.path}: topic {name} holds no pose")
    return edge, body


def left_out(poses: Poses, what: str) -> list[str]:
    """Notes on the images that have no pose."""
    why = {
        f"taken before the first or after the last of the {what}": poses.outside,
        f"the {what} have gaps of more than {MAX_GAP_S:g} s there": poses.in_gaps,
        f"the {what} beside them are NaN (tracking was lost)": poses.lost,
    }
    return [f"{count} images left out: {reason}" for reason, count in why.items() if count]
