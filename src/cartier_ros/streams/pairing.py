"""Pairing of colour, depth and pose by header stamps: nothing is extrapolated, and every image left out has a reason.

An image waits at most half a second for its depth and its transforms; one that comes out of order meanwhile is sorted
in. After the clock jumped, a second of the stream is left out: what is late from before the jump cannot be told from
what is new. Where depth comes at a lower rate, the colour images between two depth images are passed over.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

from cartier.types.streams import Fault
from cartier_ros.streams.transforms import Lookup, Matrix

SLOP_NS = 20_000_000
WAIT_S = 0.5
QUARANTINE_S = 1.0
MOST_WAITING = 64  # images: two seconds at 30 Hz
MOST_DEPTH = 64
MOST_LATE = 3  # images of one kind in a row: more, and it is the clock that went back
HOLE = 0.6  # of the usual step to its neighbours: an image that came late fits into the hole that it left
SLOWER, USUAL, KNOWN = 1.4, 1.5, 4  # depth's step in colour's, its longest in its own, and steps that tell it
REMEMBERED = 128  # stamps, to tell an image that comes twice from one that comes late


BETWEEN = ("between", "")


class Paired(NamedTuple):
    """A colour image, its depth image (None for streams without) and its pose, (4, 4) world_from_camera."""

    stamp_ns: int
    colour: Any
    depth: Any
    world_from_camera: Matrix


@dataclass
class Waiting:
    """An image that has arrived at ``arrived_s``, by a steady clock."""

    stamp_ns: int
    image: Any
    arrived_s: float


class Pairer:
    """Pairs images in the order of their stamps.

    Args:
        lookup: The pose at a stamp (ns).
        with_depth: Whether a frame needs a depth image.
        forget: Called when the clock jumped: the transforms of before are void.
    """

    def __init__(self, lookup: Callable[[int], Lookup], with_depth: bool, forget: Callable[[], None]) -> None:
        self._lookup, self._with_depth, self._forget = lookup, with_depth, forget
        self._waiting: list[Waiting] = []
        self._depth: list[Waiting] = []
        self._newest: dict[str, int] = {}
        self._seen: dict[str, deque[int]] = {"colour": deque(maxlen=REMEMBERED), "depth": deque(maxlen=REMEMBERED)}
        self._late = {"colour": 0, "depth": 0}
        self._decided_ns = self._partner_ns = -(2**63)
        self.between = 0
        """Colour images that were passed over, because depth comes at a lower rate."""
        self._quiet_until_s = float("-inf")
        self._faults: list[Fault] = []

    def colour(self, stamp_ns: int, image: Any, now_s: float) -> None:
        """Take in a colour image that has just arrived."""
        if not self._in_order("colour", stamp_ns, now_s):
            return
        insort(self._waiting, Waiting(stamp_ns, image, now_s), key=lambda each: each.stamp_ns)
        if len(self._waiting) > MOST_WAITING:
            self._waiting.pop(0)
            self._drop("busy", f"more than {MOST_WAITING} images wait for their transforms")

    def depth(self, stamp_ns: int, image: Any, now_s: float) -> None:
        """Take in a depth image that has just arrived."""
        if self._in_order("depth", stamp_ns, now_s):
            insort(self._depth, Waiting(stamp_ns, image, now_s), key=lambda each: each.stamp_ns)
            del self._depth[:-MOST_DEPTH]

    def quiet(self, now_s: float) -> bool:
        """Whether all is left out now, because the clock has just jumped."""
        return now_s < self._quiet_until_s

    def clock_jumped(self, now_s: float, why: str) -> None:
        """Forget all that is older than now."""
        frames = len(self._waiting)
        self._waiting, self._depth, self._newest = [], [], {}
        self._decided_ns = self._partner_ns = -(2**63)
        self._late = {"colour": 0, "depth": 0}
        for seen in self._seen.values():
            seen.clear()
        self._quiet_until_s = now_s + QUARANTINE_S
        self._forget()
        self._drop("clock", f"{why}: one second of the stream is left out", frames)

    def poll(self, now_s: float) -> list[Paired | Fault]:
        """The frames that are complete now, in order, and what was left out since the last call."""
        done: list[Paired | Fault] = []
        while self._waiting:
            first = self._waiting[0]
            paired, why = self._complete(first, now_s - first.arrived_s >= WAIT_S)
            if paired is None and not why:
                break
            self._waiting.pop(0)
            self._decided_ns = first.stamp_ns
            if paired is None and why == BETWEEN:
                self.between += 1
            elif paired is None:
                self._drop(*why)
            else:
                done.append(paired)
        done += self._faults
        self._faults = []
        return done

    def _complete(self, first: Waiting, late: bool) -> tuple[Paired | None, tuple[str, str] | tuple[()]]:
        """The frame of an image, or the reason why there will be none; neither while that may change."""
        at = f"the image at {first.stamp_ns / 1e9:.3f} s"
        found = self._lookup(first.stamp_ns)
        if found.matrix is None and found.why != "wait":
            return None, (found.why, f"{at} has no pose")
        partner = self._partner(first.stamp_ns) if self._with_depth else None
        passed = bool(self._depth) and self._depth[-1].stamp_ns >= first.stamp_ns
        if self._with_depth and partner is None and passed and self._depth[-1].stamp_ns > first.stamp_ns + SLOP_NS:
            if self._is_between(first.stamp_ns):
                return None, BETWEEN
            return None, ("no_depth", f"{at} has no depth within {SLOP_NS // 10**6} ms")
        if found.matrix is not None and (not self._with_depth or (partner is not None and (passed or late))):
            if partner is not None:
                self._depth = [each for each in self._depth if each.stamp_ns > partner.stamp_ns]
                self._partner_ns = partner.stamp_ns
            return Paired(first.stamp_ns, first.image, partner and partner.image, found.matrix), ()
        if not late:
            return None, ()
        if found.matrix is None:
            return None, ("no_pose", f"{at} had no transforms after {WAIT_S:g} s")
        return None, ("no_depth", f"{at} had no depth after {WAIT_S:g} s")

    def _partner(self, stamp_ns: int) -> Waiting | None:
        near = [each for each in self._depth if abs(each.stamp_ns - stamp_ns) <= SLOP_NS]
        return min(near, key=lambda each: abs(each.stamp_ns - stamp_ns), default=None)

    def _in_order(self, kind: str, stamp_ns: int, now_s: float) -> bool:
        """Whether an image is newer than all of its kind; if not, it is dropped."""
        if self.quiet(now_s):
            self._drop_colour(kind, "clock", "an image from around a jump of the clock")
            return False
        newest = self._newest.get(kind)
        if newest is not None and stamp_ns <= newest:
            return self._sorted_in(kind, stamp_ns, newest, now_s)
        self._newest[kind], self._late[kind] = stamp_ns, 0
        self._seen[kind].append(stamp_ns)
        return True

    def _sorted_in(self, kind: str, stamp_ns: int, newest: int, now_s: float) -> bool:
        """Whether an image that is not newer than all of its kind is still of use; if not, it is dropped."""
        if stamp_ns in self._seen[kind]:
            self._drop_colour(kind, "double", f"an image at {stamp_ns / 1e9:.3f} s came twice")
            return False
        self._late[kind] += 1
        step, apart = _usual_step(self._seen[kind]), min(abs(stamp_ns - seen) for seen in self._seen[kind])
        fits = step is not None and apart >= HOLE * step
        if not fits or newest - stamp_ns > WAIT_S * 1e9 or self._late[kind] > MOST_LATE:
            self.clock_jumped(now_s, f"{kind} went back from {newest / 1e9:.3f} to {stamp_ns / 1e9:.3f} s")
            return False
        if stamp_ns <= self._decided_ns:
            self._drop_colour(kind, "late", f"an image at {stamp_ns / 1e9:.3f} s came after later ones were taken")
            return False
        self._seen[kind].append(stamp_ns)
        return True

    def _is_between(self, stamp_ns: int) -> bool:
        """Whether a colour image lies between two depth images in a row of a stream that is slower than colour's."""
        depth, colour = (_usual_step(self._seen[kind]) for kind in ("depth", "colour"))
        after = next((each.stamp_ns for each in self._depth if each.stamp_ns > stamp_ns), None)
        if depth is None or colour is None or after is None or depth < SLOWER * colour:
            return False
        return self._partner_ns < stamp_ns < after <= self._partner_ns + USUAL * depth

    def _drop_colour(self, kind: str, reason: str, text: str) -> None:
        if kind == "colour":  # frames are counted by their colour images
            self._drop(reason, text)

    def _drop(self, reason: str, text: str, frames: int = 1) -> None:
        self._faults.append(Fault(reason, text, frames))


def _usual_step(stamps_ns: deque[int]) -> float | None:
    """The median step of the last stamps (ns), or None before it is known."""
    last = sorted(stamps_ns)
    return median(b - a for a, b in pairwise(last)) if len(last) > KNOWN else None
