"""Where the camera was at each image: the tree of /tf and /tf_static, interpolated, never extrapolated."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.geometry import invert
from cartier.recordings.common.poses import Interpolated, by_time, interpolated, lost, matrices
from cartier.types import Array
from cartier_ros.bags.bag import frame_name
from cartier_ros.bags.runs import Series

WORLDS = ("map", "odom", "world")
MAX_DEPTH = 64
MAX_NUMBER = 1e12  # metres and seconds; beyond it squares lose their sense


@dataclass
class Edge:
    """The samples of one child frame: its parent, and rows ``t x y z qx qy qz qw`` in seconds and metres."""

    parent: str
    static: bool
    samples: array[float] = field(default_factory=lambda: array("d"))
    order: array[int] = field(default_factory=lambda: array("q"))
    """Of each sample; see ``runs.Series``."""
    kept: npt.NDArray[np.int64] | None = None
    """Which samples are of the run that is read; None for all."""

    def add(self, order: int, stamp: Any, pose: Any) -> None:
        """Take in a Transform or a Pose."""
        t, q = getattr(pose, "translation", None) or pose.position, getattr(pose, "rotation", None) or pose.orientation
        self.samples.extend((stamp.sec + stamp.nanosec * 1e-9, t.x, t.y, t.z, q.x, q.y, q.z, q.w))
        self.order.append(order)

    def rows(self) -> npt.NDArray[np.float64]:
        """(N, 8) as they came."""
        rows = np.frombuffer(self.samples, np.float64).reshape(-1, 8)
        return np.asarray(rows if self.kept is None else rows[self.kept])

    def series(self) -> Series:
        """The stamps of the samples."""
        order = np.frombuffer(self.order, np.int64)
        return Series(order if self.kept is None else order[self.kept], self.rows()[:, 0])

    def table(self) -> npt.NDArray[np.float64]:
        """(N, 8) by time, one row per time; of equal times the last."""
        return np.asarray(self.rows()[-1:]) if self.static else by_time(self.rows())


@dataclass(frozen=True, eq=False)
class Poses:
    """(N, 4, 4) poses, NaN where there is none, and why: images outside of the transforms' time, in gaps, and lost."""

    matrices: npt.NDArray[np.float64]
    outside: int
    in_gaps: int
    lost: int

    @classmethod
    def of(cls, steps: Sequence[npt.NDArray[np.float64] | Interpolated], count: int) -> Poses:
        """The product of transforms, the last one first: each fixed, or at ``count`` times."""
        total = np.tile(np.eye(4), (count, 1, 1))
        outside, gaps, lost = np.zeros((3, count), bool)
        for step in steps:
            if isinstance(step, Interpolated):
                outside, gaps, lost = outside | step.outside, gaps | step.in_gaps, lost | step.lost
            total = (step.matrices() if isinstance(step, Interpolated) else step) @ total
        total[outside | gaps | lost] = np.nan
        gaps, lost = gaps & ~outside, lost & ~(outside | gaps)
        return cls(total, *(int(why.sum()) for why in (outside, gaps, lost)))


class Tree:
    """The transforms of a bag."""

    def __init__(self) -> None:
        self._edges: dict[str, Edge] = {}
        self._torn: dict[str, str] = {}

    def add(self, message: Any, static: bool, bag: Path, order: int) -> None:
        """Take in a TFMessage of a bag."""
        for item in message.transforms:
            child, parent = frame_name(item.child_frame_id, bag), frame_name(item.header.frame_id, bag)
            edge = self._edges.get(child)
            if edge is None or (static and not edge.static):
                edge = self._edges[child] = Edge(parent, static)
            if edge.static and not static:
                continue
            if edge.parent != parent and not static:
                self._torn[child] = parent
            edge.parent = parent
            edge.add(order, item.header.stamp, item.transform)

    def chain(self, frame: str) -> list[str]:
        """The frames from one up to its root, itself first."""
        names = [frame]
        while names[-1] in self._edges:
            parent = self._edges[names[-1]].parent
            if parent in names or len(names) > MAX_DEPTH:
                raise InputError(f"the transforms run in a circle: {brief(' -> '.join([*names[:6], parent]), 200)}")
            names.append(parent)
        return names

    def world(self, frame: str) -> str | None:
        """The frame to map in: ``map``, ``odom``, ``world`` or the root, in this order; None without a parent."""
        chain = self.chain(frame)
        return next((name for name in WORLDS if name in chain[1:]), chain[-1] if len(chain) > 1 else None)

    def moving(self, frame: str) -> list[Edge]:
        """The transforms above a frame that change with time."""
        edges = (self._edges[name] for name in self.chain(frame) if name in self._edges)
        return [edge for edge in edges if not edge.static]

    def fixed(self, target: str, source: str) -> npt.NDArray[np.float64] | None:
        """target_from_source (4, 4) along static transforms alone, or None if they do not connect the two."""
        up, down = self._still(source), self._still(target)
        common = next((name for name in up if name in down), None)
        return None if common is None else invert(down[common]) @ up[common]

    def _still(self, frame: str) -> dict[str, npt.NDArray[np.float64]]:
        """ancestor_from_frame for a frame and its ancestors, as far up as the transforms are static."""
        found, total = {frame: np.eye(4)}, np.eye(4)
        for child in self.chain(frame)[:-1]:
            edge = self._edges[child]
            if not edge.static:
                break
            total = np.asarray(checked(edge.table(), child)[0] @ total)
            found[edge.parent] = total
        return found

    def poses(self, target: str, source: str, times_s: Array) -> Poses:
        """target_from_source at each time."""
        chain = self.chain(source)
        if target not in chain:
            raise InputError(
                f"no transform leads from {target!r} to {source!r}: above it are "
                f"{brief(', '.join(chain[1:]), 200) or 'none'}"
            )
        steps = list[npt.NDArray[np.float64] | Interpolated]()
        for child in chain[: chain.index(target)]:
            if child in self._torn:
                parents = f"{self._edges[child].parent!r} and {self._torn[child]!r}"
                raise InputError(f"frame {child!r} has two parents in /tf, {parents}: two programs publish it")
            table, static = self._edges[child].table(), self._edges[child].static
            steps.append(
                checked(table, child)[0] if static else interpolated(checked_rows(table, child, True), times_s)
            )
        return Poses.of(steps, len(times_s))


def checked_rows(table: Array, what: str, may_be_lost: bool = False) -> npt.NDArray[np.float64]:
    """Samples (N, 8) with quaternions of length 1, NaN where a tracker lost its pose if that may be.

    Raises InputError for a pose that is none.
    """
    gone = lost(table[:, 1:]) if may_be_lost else np.zeros(len(table), bool)
    known = table[~gone]
    sane = bool((np.abs(known) < MAX_NUMBER).all())  # false for NaN too
    lengths = np.linalg.norm(known[:, 4:], axis=1) if sane else np.zeros(1)
    if not (np.abs(lengths - 1) < 0.01).all():
        raise InputError(f"the pose of {what!r} holds NaN, infinity or a quaternion that is not of length 1")
    out = np.full(table.shape, np.nan)
    out[:, 0] = table[:, 0]
    out[~gone, 1:] = np.hstack([known[:, 1:4], known[:, 4:] / lengths[:, None]])
    return out


def checked(table: Array, what: str) -> npt.NDArray[np.float64]:
    """Matrices (N, 4, 4) of samples (N, 8)."""
    return matrices(checked_rows(table, what)[:, 1:])


def extrinsic_matrix(numbers: Sequence[float] | str) -> npt.NDArray[np.float64]:
    """body_from_camera (4, 4) of x, y, z, qx, qy, qz, qw."""
    try:
        row = [float(v) for v in (numbers.split(",") if isinstance(numbers, str) else numbers)]
    except (TypeError, ValueError):
        row = []
    if len(row) != 7:
        raise InputError(f"extrinsic must be x,y,z,qx,qy,qz,qw of the camera in the robot's frame, got {numbers!r}")
    return np.asarray(checked(np.array([[0.0, *row]]), "extrinsic")[0])
