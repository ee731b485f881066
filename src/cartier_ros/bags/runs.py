"""Runs of a bag: where its clock goes back, or another recording begins, what follows is another run.

A simulation that was started anew, a clock that was set and a bag that was played twice into a recorder give several
poses for one stamp. Images, depth and transforms are cut at the same moments, and only the longest run is kept. One
stream that alone goes back a little has late messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.recordings.common.clock import FEW, restarts

SURE_S = 0.5  # a clock that only one stream shows must go back so far
PAUSE_S = 10.0  # between the files of two recordings
LATE_S = 0.5  # between the stamps of images and transforms that were recorded together, without a note
Order = npt.NDArray[np.int64]
Restarts = list[tuple[int, float]]


@dataclass(frozen=True, eq=False)
class Series:
    """A stream's stamps (s), and ``order``, numbers that grow as the messages of all streams were recorded."""

    order: Order
    times_s: npt.NDArray[np.float64]

    def sorted(self) -> tuple[Order, Series]:
        """The places of the messages as they were recorded, and the stream in that order."""
        places = np.argsort(self.order, kind="stable")
        return places, Series(self.order[places], self.times_s[places])


def longest_run(
    images: Series, others: Sequence[Series], pauses: Sequence[int], where: str
) -> tuple[list[Order] | None, list[str]]:
    """The places of the messages of the longest run in ``images`` and in each of ``others``, and a note.

    None if there is one run only. ``pauses`` are orders at which another recording begins. Raises InputError where it
    cannot be told which transforms belong to which images.
    """
    places, streams = zip(*(series.sorted() for series in (images, *others)), strict=True)
    back = [restarts(series.times_s) for series in streams]
    cuts = _cuts(back)
    odd = next((own for own in back if len(own) not in (0, len(cuts)) and cuts and _sure(own)), None)
    if odd is not None:
        raise InputError(
            f"{where}: time goes back {len(cuts)} times in one stream and {len(odd)} times in another, so that it "
            "cannot be told which poses belong to which images: record each run into a bag of its own"
        )
    leader = next((series for series, own in zip(streams, back, strict=True) if own is cuts), streams[0])
    moments = sorted({*(int(leader.order[place]) for place, _ in cuts), *pauses})
    if not moments:
        return None, []
    bounds = []
    for series, own in zip(streams, back, strict=True):
        ends = np.searchsorted(series.order, moments)
        if len(own) == len(cuts):  # the same clock, seen by each stream at its own message
            at = [moments.index(int(leader.order[place])) for place, _ in cuts]
            ends[at] = [place for place, _ in own]
        bounds.append(np.concatenate([[0], ends, [len(series.order)]]))
    sizes, posed = np.diff(bounds[0]), np.all([np.diff(ends) > 0 for ends in bounds], axis=0)
    best = int(np.where(posed, sizes, 0).argmax())
    if not posed[best]:
        raise InputError(f"{where}: time goes back, and no run by itself has images, poses and depth")
    kept = [np.sort(at[ends[best] : ends[best + 1]]) for at, ends in zip(places, bounds, strict=True)]
    causes = []
    if cuts:
        place, back_s = cuts[0]
        lasted_s = float(np.ptp(leader.times_s[:place]))
        often = "" if len(cuts) == 1 else f" ({len(cuts)} times in all)"
        causes.append(
            f"time goes back by {back_s:.3g} s after {lasted_s:.3g} s{often}: a clock or simulation began anew, "
            "or a bag was played twice"
        )
    causes += [f"{len(pauses) + 1} recordings lie in one folder"] if pauses else []
    used = f"only the longest of {len(sizes)} runs is used, {sizes[best]} of {sizes.sum()} images"
    return kept, [f"{'; '.join(causes)}; {used}"]


def _sure(own: Restarts) -> bool:
    return any(seconds >= SURE_S for _, seconds in own)


def _cuts(back: Sequence[Restarts]) -> Restarts:
    """Where the clock goes back: as the images show it, else as another stream does; [] if messages only came late.

    A transform that alone goes back more than a few times is published by two programs.
    """
    showing = [own for own in back if own]
    if not showing or (len(showing) == 1 and not _sure(showing[0])):
        return []
    return showing[0] if back[0] or len(showing) > 1 or len(showing[0]) <= FEW else []


def clock_notes(images: Series, moving: Sequence[Series], logged: bool) -> list[str]:
    """A note where images and transforms were stamped by different clocks, as far as that shows, and by how much.

    ``logged`` says that ``order`` is the time (ns) at which a message was recorded.
    """
    there = [series for series in moving if len(series.times_s)]
    if not there or not len(images.times_s):
        return []
    if logged:
        lags_s = [float(np.median(series.order / 1e9 - series.times_s)) for series in (images, *there)]
        ahead_s = min((lag_s - lags_s[0] for lag_s in lags_s[1:]), key=abs)
        if abs(ahead_s) > LATE_S:
            return [
                f"the images' stamps are {abs(ahead_s):.3g} s {'ahead of' if ahead_s > 0 else 'behind'} those of the "
                "transforms that were recorded with them: their clocks differ, or one of them came late; if the clocks "
                "differ, all poses are wrong by that time (stamp both by the robot's clock)"
            ]
    first_s, last_s = max(s.times_s.min() for s in there), min(s.times_s.max() for s in there)
    apart_s = float(max(first_s - images.times_s.max(), images.times_s.min() - last_s))
    if apart_s > PAUSE_S:
        which = "after the last" if images.times_s.min() > last_s else "before the first"
        says = f"the images' stamps are {apart_s:.3g} s {which} of the transforms'"
        return [f"{says}: their clocks differ (stamp both by the robot's clock)"]
    return []
