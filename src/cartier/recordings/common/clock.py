"""Clocks that go back: where a series of time stamps, in the order in which it was written, begins anew."""

from __future__ import annotations

import numpy as np

from cartier.types import Array

MOST_RESTARTS = 100


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
