"""Transform buffer: the last seconds of a robot's moving frames, interpolated and never extrapolated."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import invert
from cartier.recordings.common.poses import interpolated
from cartier_ros.bags.tf import MAX_DEPTH, WORLDS, checked, checked_rows

KEPT_S = 10.0
MAX_GAP_S = 0.3  # between two samples of a frame that moves; a robot turns by 17 degrees meanwhile
SPEED_M_S, TURN_RAD_S = 5.0, 10.0  # no home robot is faster
STILL_M, STILL_RAD = 0.02, 0.02  # what a sample may be off by itself
SAME_S = 1e-6  # the same stamp, but for the precision of float64
MAX_FRAMES = 1000
Matrix = npt.NDArray[np.float64]


class Lookup(NamedTuple):
    """(4, 4) target_from_source, or None and why: ``wait`` (it may still come) or a reason of a fault."""

    matrix: Matrix | None
    why: str = ""


@dataclass
class Link:
    """A frame below its parent: when (s), and where: rows ``t x y z qx qy qz qw``. The stamps rise."""

    parent: str
    static: bool
    stamps_s: list[float] = field(default_factory=list)
    rows: list[Matrix] = field(default_factory=list)
    other_parent: str = ""
    other_s: float = 0.0
    """When another parent was last told of; a single stray message spoils only what is near it in time."""
    disputed_s: set[float] = field(default_factory=set)
    """Stamps for which two different poses came."""


class Circle(InputError):
    """A transform that would close a circle."""


class TransformBuffer:
    """Obeys one clock: a sample from before the newest of its frame shows that the clock went back."""

    def __init__(self) -> None:
        self._links: dict[str, Link] = {}

    def add(self, parent: str, child: str, stamp_s: float, pose: Sequence[float], static: bool) -> bool:
        """Take in a sample; returns whether the clock is sound.

        Args:
            parent, child: The frames.
            stamp_s: When (s).
            pose: ``x y z qx qy qz qw`` (m), parent_from_child.
            static: Whether it never changes.

        Raises:
            Circle: It would close a circle.
            InputError: It is no pose, or there are too many frames.
        """
        row = checked_rows(np.array([[stamp_s, *pose]]), child)[0]
        link = self._links.get(child)
        if (link is None or link.parent != parent) and child in (above := self.chain(parent)):
            names = " -> ".join([*above[:6], parent])
            raise Circle(f"the transforms run in a circle: {names}; that of {child!r} in {parent!r} is left out")
        if link is None or (static and not link.static):
            if len(self._links) >= MAX_FRAMES:
                raise InputError(f"there are more than {MAX_FRAMES} frames: is something naming frames at random?")
            link = self._links[child] = Link(parent, static)
        if link.parent != parent:
            link.other_parent = parent
            link.other_s = float("inf") if static else max(stamp_s, link.other_s)
            return True
        if static:
            link.stamps_s, link.rows = [stamp_s], [row]
            return True
        return True if link.static else _append(link, stamp_s, row)

    def drop(self, child: str) -> None:
        """Forget all that was said of where a frame is."""
        self._links.pop(child, None)

    def forget_moving(self) -> None:
        """Drop all samples of frames that move, after the clock jumped."""
        self._links = {child: link for child, link in self._links.items() if link.static}

    def chain(self, frame: str) -> list[str]:
        """The frames from one up to its root, itself first."""
        names = [frame]
        while (link := self._links.get(names[-1])) is not None and len(names) <= MAX_DEPTH:
            names.append(link.parent)
        return names

    def world(self, frame: str) -> str | None:
        """The frame to map in: ``map``, ``odom``, ``world`` or the root, in this order; None without a parent."""
        chain = self.chain(frame)
        return next((name for name in WORLDS if name in chain[1:]), chain[-1] if len(chain) > 1 else None)

    def moves(self, frame: str) -> bool:
        """Whether some transform above a frame changes with time."""
        return any(name in self._links and not self._links[name].static for name in self.chain(frame))

    def parents(self, frame: str) -> tuple[str, str] | None:
        """The two parents of the first frame from this one up that has two."""
        for name in self.chain(frame):
            link = self._links.get(name)
            if link is not None and link.other_parent:
                return link.parent, link.other_parent
        return None

    def lookup(self, target: str, source: str, time_s: float) -> Lookup:
        """Where ``source`` was in ``target`` at a time."""
        chain = self.chain(source)
        if target not in chain:
            return Lookup(None, "wait")
        total, why = np.eye(4), ""
        for child in chain[: chain.index(target)]:
            link = self._links[child]
            if link.other_parent and time_s <= link.other_s + KEPT_S:
                return Lookup(None, "two_parents")
            matrix, here = _at(link, child, time_s)
            why = here if why in ("", "wait") and here else why
            if matrix is not None:
                total = np.asarray(matrix @ total)
        return Lookup(None, why) if why else Lookup(total)

    def newest(self, target: str, source: str) -> Matrix | None:
        """Where ``source`` was last in ``target``, (4, 4), or None if no transform leads there."""
        chain = self.chain(source)
        links = [self._links[child] for child in chain[: chain.index(target)]] if target in chain else []
        if not links:
            return None
        times_s = [link.stamps_s[-1] for link in links if not link.static]
        return self.lookup(target, source, min(times_s, default=0.0)).matrix

    def fixed(self, target: str, source: str) -> Matrix | None:
        """target_from_source (4, 4) along static transforms alone, or None if they do not connect the two."""
        up, down = self._still(source), self._still(target)
        common = next((name for name in up if name in down), None)
        return None if common is None else np.asarray(invert(down[common]) @ up[common])

    def _still(self, frame: str) -> dict[str, Matrix]:
        found, total = {frame: np.eye(4)}, np.eye(4)
        for child in self.chain(frame)[:-1]:
            link = self._links[child]
            if not link.static:
                break
            total = np.asarray(checked(link.rows[0][None], child)[0] @ total)
            found[link.parent] = total
        return found


def _append(link: Link, stamp_s: float, row: Matrix) -> bool:
    """Add a sample to the end; False if it is older than the last. One that came before changes nothing."""
    if link.stamps_s and stamp_s <= link.stamps_s[-1]:
        at = bisect_left(link.stamps_s, stamp_s)
        if link.stamps_s[at] != stamp_s:
            return False
        if not np.allclose(link.rows[at][1:], row[1:], atol=1e-6):
            link.disputed_s.add(stamp_s)
        return True
    link.stamps_s.append(stamp_s)
    link.rows.append(row)
    old = bisect_left(link.stamps_s, stamp_s - KEPT_S)
    if old > len(link.rows) // 2:  # rarely, since it moves the rest
        del link.stamps_s[:old], link.rows[:old]
        link.disputed_s = {s for s in link.disputed_s if s >= link.stamps_s[0]}
    return True


def _at(link: Link, child: str, time_s: float) -> tuple[Matrix | None, str]:
    """(4, 4) parent_from_child at a time, or why there is none."""
    if link.static:
        return checked(link.rows[0][None], child)[0], ""
    if time_s > link.stamps_s[-1]:
        return None, "wait"
    if time_s < link.stamps_s[0]:
        return None, "too_early"
    after = min(max(bisect_left(link.stamps_s, time_s), 1), max(len(link.rows) - 1, 0))
    before = max(after - 1, 0)
    if link.disputed_s & {link.stamps_s[before], link.stamps_s[after]}:
        return None, "pose_jump"
    found = interpolated(np.array([link.rows[before], link.rows[after]]), np.array([time_s]))
    if min(abs(time_s - link.stamps_s[k]) for k in (before, after)) > SAME_S:
        span_s = link.stamps_s[after] - link.stamps_s[before]
        moved_m, turned = _motion(link.rows[before], link.rows[after])
        if moved_m > STILL_M + SPEED_M_S * span_s or turned > STILL_RAD + TURN_RAD_S * span_s:
            return None, "pose_jump"
        if span_s > MAX_GAP_S and (moved_m > STILL_M or turned > STILL_RAD):
            return None, "pose_gap"
    return found.matrices()[0], ""


def _motion(one: Matrix, two: Matrix) -> tuple[float, float]:
    """How far (m) and by how much (rad) two samples differ."""
    turn = 2 * np.arccos(np.clip(abs(float(one[4:] @ two[4:])), 0, 1))
    return float(np.linalg.norm(one[1:4] - two[1:4])), float(turn)
