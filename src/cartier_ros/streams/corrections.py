"""Corrections of poses that were sent: by a SLAM's optimised keyframes, or by jumps of the transform above odometry.

A path or a graph carries some frame of the robot, and seldom says which. It is the one of the frames that are fixed to
the camera whose poses, as they were sent, fit best: how they move, and where the one lies that was corrected least.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cartier.geometry import invert
from cartier.mapping.poses.motions import blended, moved
from cartier.types.streams import PoseUpdate
from cartier_ros.bags.graphs import Graph

Matrix = npt.NDArray[np.float64]
MOST_SENT = 20_000
NEAR_NS = 500_000_000  # a pose between two frames that are farther apart is passed over
FITS_M = 0.2  # how well the frame that a path carries must fit, a turn counted at half a metre
ARM_M = 0.5
JUMP_M, JUMP_RAD = 0.05, float(np.deg2rad(1.0))  # smaller steps of the transform above odometry are summed up
SPREAD = 200  # frames that are named when a jump is spread over the way


class Corrections:
    """What was sent, and what is known of it now."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._sent: list[Matrix] = []
        self._node_ns: dict[int, int] = {}
        self._told: dict[int, Matrix] = {}
        self._by: str | None = None
        self._world_from_odom: Matrix | None = None
        self._agreed = 0  # the first frame since the transform above odometry last jumped

    def sent(self, stamp_ns: int, world_from_camera: Matrix) -> None:
        """A frame was sent."""
        self._stamps.append(stamp_ns)
        self._sent.append(world_from_camera)
        if len(self._stamps) > MOST_SENT:
            self._stamps, self._sent = self._stamps[1::2], self._sent[1::2]
            self._agreed //= 2

    def moved(self, new_from_old: Matrix) -> PoseUpdate | None:
        """The correction of all that was sent when the world becomes another frame; None if nothing was sent."""
        self._sent = [np.asarray(new_from_old @ pose) for pose in self._sent]
        self._told = {ns: np.asarray(new_from_old @ pose) for ns, pose in self._told.items()}
        self._world_from_odom, self._agreed = new_from_old, len(self._sent)
        some = np.unique(np.linspace(0, len(self._sent) - 1, min(SPREAD, len(self._sent))).round().astype(int))
        named = {self._stamps[k]: self._sent[k] for k in some.tolist()} if self._sent else {}
        return PoseUpdate(named, "another frame of the world") if named else None

    def by_graph(self, graph: Graph, topic: str, bodies: Mapping[str, Matrix]) -> PoseUpdate | None:
        """The corrections that a path or a graph tells, or None if it tells none.

        Args:
            graph: The optimised poses, in the world that is mapped.
            topic: Where it came from. The first that corrects anything is believed, and no other one.
            bodies: body_from_camera (4, 4) of each frame that it may carry.
        """
        rows = self._by_stamp(graph)
        placed = [(ns, pose, at) for ns, pose in sorted(rows.items()) if (at := self._at(ns)) is not None]
        if not placed or self._by not in (None, topic):
            return None
        body = _carried([(pose, at) for _, pose, at in placed], bodies)
        if body is None:
            return None
        named: dict[int, Matrix] = {}
        for ns, pose, at in placed:
            k = self._nearest(ns)
            named[self._stamps[k]] = np.asarray(pose @ body @ invert(at) @ self._sent[k])
        return self._news(named, topic)

    def by_jump(self, world_from_odom: Matrix) -> PoseUpdate | None:
        """The corrections that a jump of the transform above odometry suggests, or None.

        It tells where the robot is now; the jump is spread over the way since the last one, as drift builds up. None
        once a path or a graph tells more.
        """
        before = self._world_from_odom
        if before is None or not self._sent or self._by is not None:
            self._world_from_odom = world_from_odom
            return None
        jump = np.asarray(world_from_odom @ invert(before))
        here = self._sent[-1]
        if not _far(here, np.asarray(jump @ here)):
            return None
        poses, stamps = self._sent[self._agreed :], self._stamps[self._agreed :]
        steps = [float(np.linalg.norm(b[:3, 3] - a[:3, 3])) + ARM_M * _turn(a, b) for a, b in pairwise(poses)]
        way = np.concatenate([[0.0], np.cumsum(steps)])
        shares = way / way[-1] if way[-1] > 0 else np.ones(len(way))
        some = np.unique(np.linspace(0, len(poses) - 1, min(SPREAD, len(poses))).round().astype(int))
        named = {stamps[k]: blended(poses[k], np.asarray(jump @ poses[k]), float(shares[k])) for k in some.tolist()}
        self._world_from_odom, self._agreed = world_from_odom, len(self._stamps)
        return PoseUpdate(named, "a jump above odometry, spread over the way: a guess")

    def _by_stamp(self, graph: Graph) -> dict[int, Matrix]:
        if graph.stamps_ns is None:
            return graph.poses
        for node, ns in graph.stamps_ns.items():
            self._node_ns.setdefault(node, ns)
        return {self._node_ns[node]: pose for node, pose in graph.poses.items() if node in self._node_ns}

    def _nearest(self, ns: int) -> int:
        after = bisect_left(self._stamps, ns)
        return min(
            (k for k in (after - 1, after) if 0 <= k < len(self._stamps)), key=lambda k: abs(self._stamps[k] - ns)
        )

    def _at(self, ns: int) -> Matrix | None:
        """The camera's pose at a time, as it was sent; None where no frames are near on both sides."""
        if not self._stamps or not self._stamps[0] - NEAR_NS <= ns <= self._stamps[-1] + NEAR_NS:
            return None
        after = bisect_left(self._stamps, ns - 1000)
        if after < len(self._stamps) and abs(self._stamps[after] - ns) <= 1000:  # the same stamp, as float64 has it
            return self._sent[after]
        if not 0 < after < len(self._stamps):
            return None
        one, two = self._stamps[after - 1], self._stamps[after]
        if two - one > NEAR_NS:
            return None
        return blended(self._sent[after - 1], self._sent[after], (ns - one) / (two - one))

    def _news(self, named: dict[int, Matrix], topic: str) -> PoseUpdate | None:
        """An update, if one of the poses moved since it was told."""
        as_sent = dict(zip(self._stamps, self._sent, strict=True))
        if not any(moved(pose, self._told.get(ns, as_sent[ns])) for ns, pose in named.items()):
            return None
        self._by = topic
        self._told |= named
        return PoseUpdate(named, topic)


def _carried(poses: list[tuple[Matrix, Matrix]], bodies: Mapping[str, Matrix]) -> Matrix | None:
    """body_from_camera of the frame that a path carries, by its poses and those of the camera; None if none fits."""
    best: tuple[float, Matrix] | None = None
    for body_from_camera in bodies.values():
        pairs = [(pose, np.asarray(camera @ invert(body_from_camera))) for pose, camera in poses]
        off = [_off(one, two) for one, two in pairs]
        ways = [
            _off(np.asarray(invert(a[0]) @ b[0]), np.asarray(invert(a[1]) @ b[1])) for a, b in pairwise(pairs)
        ]  # fmt: skip
        cost = float(np.median(ways)) + min(off) if ways else min(off)
        if best is None or cost < best[0]:
            best = cost, body_from_camera
    return best[1] if best is not None and best[0] <= FITS_M else None


def _off(one: Matrix, two: Matrix) -> float:
    return float(np.linalg.norm(one[:3, 3] - two[:3, 3])) + ARM_M * _turn(one, two)


def _far(one: Matrix, two: Matrix) -> bool:
    return bool(np.linalg.norm(one[:3, 3] - two[:3, 3]) >= JUMP_M or _turn(one, two) >= JUMP_RAD)


def _turn(one: Matrix, two: Matrix) -> float:
    return float(np.arccos(np.clip((np.sum(one[:3, :3] * two[:3, :3]) - 1) / 2, -1, 1)))
