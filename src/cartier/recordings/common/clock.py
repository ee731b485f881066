"""Clocks that go back: where a series of time stamps, in the order in which it was written, begins anew."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.types import Array

MOST_RESTARTS = 100
FEW = 3  # more restarts are a stream, or a list, in no order
JUMP_M, JUMP_TIMES = 0.3, 5.0  # between two frames, and times the way between others: the camera was elsewhere


def restarts(times_s: Array) -> list[tuple[int, float]]:
    """The places at which a run begins whose clock was set back, and by how many seconds.

    One stamp that comes after its successor was late, and begins no run.
    """
    steps_s = np.diff(times_s)
    period_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    found, start = list[tuple[int, float]](), 0
    while len(found) < MOST_RESTARTS:
        highest_s = np.maximum.accumulate(times_s[start:])
        back = np.append(False, times_s[start + 1 :] < highest_s[:-1])
        begins = np.flatnonzero(back & np.append(back[1:], True))
        if not len(begins):
            break
        first = int(begins[0])
        start, seconds = start + first, float(highest_s[first - 1] + period_s - times_s[start + first])
        found.append((start, seconds))
    return found


def one_run(times_s: Array, world_from_camera: Array) -> tuple[npt.NDArray[np.bool_], list[str]]:
    """Which frames (N,) to keep where each has a pose of its own, and a note if time goes back.

    Where the camera jumps as its clock goes back, another run begins, whose world may be another; only the longest is
    kept. Where it stays, its clock was set.
    """
    keep, back = np.ones(len(times_s), bool), restarts(times_s)
    if not back:
        return keep, []
    ways_m = np.linalg.norm(np.diff(world_from_camera[:, :3, 3], axis=0), axis=1)
    far_m = max(JUMP_M, JUMP_TIMES * float(np.median(ways_m)))
    jumps = [place for place, _ in back if ways_m[place - 1] > far_m]
    says = f"time goes back by {back[0][1]:.3g} s at frame {back[0][0]}"
    says += f" ({len(back)} times in all)" if len(back) > 1 else ""
    if not jumps:
        return keep, [f"{says}, where the camera stays: its clock was set"]
    ends = np.array([0, *jumps, len(times_s)])
    best = int(np.diff(ends).argmax())
    keep[:] = False
    keep[ends[best] : ends[best + 1]] = True
    runs = f"only the longest of {len(ends) - 1} runs is used, {keep.sum()} of {len(keep)} images"
    return keep, [f"{says}, and the camera jumps by {ways_m[jumps[0] - 1]:.2g} m; {runs}"]


def check_clock(times_s: Array, where: str) -> None:
    """Raises InputError where stamps of a list begin anew a few times; a list in no order at all is no clock's."""
    back = restarts(times_s)
    if 0 < len(back) <= FEW:
        place, back_s = back[0]
        raise InputError(
            f"{where}: time goes back by {back_s:.3g} s at entry {place + 1}: several recordings or clocks in one "
            "list; give each a folder of its own"
        )
