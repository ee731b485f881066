"""Diagnosis: which reading of poses, depth and intrinsics makes the recording consistent, one fault at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cartier.doctor._consistency import FEWEST_PAIRS, Numbers, Pairs, Verdict, judge, motions, much_better, near_pairs
from cartier.doctor._report import Fault
from cartier.doctor.checks import PLAUSIBLE_M, tilt
from cartier.doctor.hypotheses import UNITS, Hypothesis, Reading, depth_by, hypotheses, positions_by, shift_by
from cartier.mapping.samples import Samples
from cartier.types import Camera

MOST_FAULTS = 3
SETTLED, TIED, LEAN_DEG = 0.8, 0.005, 30
MOST_OFF, UNIT = 1.6, 0.03  # a factor of depth that a sensor may be off by; how near to a unit's one is that unit
SCALE_STEPS = [1 + percent / 100 for percent in range(-16, 19)]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The ``reading`` that fits best, the faults that it repairs, and how consistent the recording then is.

    ``choosing`` and ``testing`` (P, 2) are the pairs of frames that chose the reading and that tested it. ``doubts``
    describe changes that only the choosing pairs support.
    """

    reading: Reading
    faults: tuple[Fault, ...]
    doubts: tuple[str, ...]
    repaired: Verdict
    choosing: Numbers
    testing: Numbers

    @property
    def contradictory(self) -> bool:
        """Whether overlapping frames disagree and no reading repairs it."""
        return not self.repaired.consistent and self.repaired.seen >= FEWEST_PAIRS


def small_camera(samples: Samples, camera: Camera) -> Camera:
    """The camera of the small images, if ``camera`` is that of the full ones."""
    stride = samples.camera.fx / samples.small.fx
    return replace(
        samples.small, fx=camera.fx / stride, fy=camera.fy / stride, cx=camera.cx / stride, cy=camera.cy / stride
    )


def weigh(reading: Reading, pairs: Pairs) -> Verdict:
    """How well one reading makes pairs of frames agree."""
    samples = pairs.samples
    poses = reading.shifted(samples.poses, samples.index)
    return judge(pairs, poses, reading.depth_scale, small_camera(samples, reading.camera(samples.camera)))


def diagnose(samples: Samples, level: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Diagnosis:
    """Accept the best change of reading as long as it makes the choosing and the testing frames agree much better."""
    choosing, testing = (Pairs(samples, pairs) for pairs in near_pairs(samples))
    both = Pairs(samples, np.concatenate([choosing.pairs, testing.pairs]))
    reading = Reading(level)
    faults: list[Fault] = []
    doubts: list[str] = []
    while len(faults) < MOST_FAULTS and (found := _best(reading, choosing)):
        better, now = (weigh(r, testing) for r in (found[-1].reading, reading))
        if not much_better(better, now):
            doubts += [
                f"{h.words}? It is left as it is, for other frames contradict that: {_evidence(better, now)}"
                for h in found
            ]
            break
        unsure = next((h for h in found if h.fault == "depth_scale" and not _known(h, reading)), None)
        if unsure is not None:
            told = f"{unsure.words}, by a factor that no unit has: {_evidence(better, now)}"
            faults.append(Fault("depth_scale", told, "in which unit is the depth?"))
            break
        faults += [Fault(h.fault, f"{h.words}: {_evidence(better, now)}", h.repair) for h in found]
        reading = found[-1].reading
    return Diagnosis(reading, tuple(faults), tuple(doubts), weigh(reading, both), choosing.pairs, testing.pairs)


def _known(found: Hypothesis, now: Reading) -> bool:
    """Whether a factor of depth is that of a unit, or a small one, as of a sensor that is off."""
    factor = found.reading.depth_scale / now.depth_scale
    return max(factor, 1 / factor) < MOST_OFF or any(abs(factor / unit - 1) < UNIT for unit in UNITS)


def _best(reading: Reading, pairs: Pairs) -> list[Hypothesis]:
    """The change that makes the pairs agree best, in one or two steps; empty if it is not much better than ``reading``.

    If no single change suffices, each change of the poses is tried with each unit of depth: two faults may hide each
    other. Among changes that fit equally well, the most upright world wins.
    """
    if len(pairs) < FEWEST_PAIRS:
        return []
    samples, now = pairs.samples, weigh(reading, pairs)
    near = len(samples) // 4
    single = [h for h in hypotheses(reading, samples.camera) if abs(h.reading.shift - reading.shift) <= near]
    best = _fitting(single, pairs)
    first: dict[Hypothesis, Hypothesis] = {}
    if max(best[0][1].score, now.score) < SETTLED:
        poses = [h for h in single if h.fault in ("inverted_poses", "opengl_axes", "left_handed")]
        both = {depth_by(h.reading, scale): h for h in poses for scale in (1000.0, 1e-3, 5.0, 0.2)}
        others = _fitting(list(both), pairs)
        if others[0][1].fit > best[0][1].fit + TIED:
            first, best = both, others
    if not much_better(best[0][1], now):
        return []
    found, verdict = best[0] if len(best) == 1 else min(best, key=lambda judged: _lean(samples, judged[0].reading))
    before = [first[found]] if first else []
    return [*before, _refined(pairs, before[0].reading if before else reading, found, verdict)]


def _fitting(those: list[Hypothesis], pairs: Pairs) -> list[tuple[Hypothesis, Verdict]]:
    """The hypotheses that fit best or nearly as well, best first."""
    judged = [(h, weigh(h.reading, pairs)) for h in those]
    judged.sort(key=lambda pair: -pair[1].fit)
    return [pair for pair in judged if pair[1].fit >= judged[0][1].fit - TIED]


def _lean(samples: Samples, reading: Reading) -> int:
    """How far the world of a reading leans, in coarse steps."""
    small = small_camera(samples, reading.camera(samples.camera))
    found = tilt(samples, reading.shifted(samples.poses, samples.index), reading.depth_scale, small)
    return round((180 if found is None else found.degrees) / LEAN_DEG)


def _refined(pairs: Pairs, reading: Reading, found: Hypothesis, verdict: Verdict) -> Hypothesis:
    """The same change with a finer factor of depth or number of frames to shift."""
    if found.fault == "depth_scale":
        return _of_poses(pairs.samples, reading, _finer_scale(pairs, reading, found))
    if found.fault != "time_offset":
        return found
    shift = found.reading.shift - reading.shift
    steps = [shift_by(reading, shift + step) for step in range(-4, 5) if step and shift + step]
    finer, fits = _fitting(steps, pairs)[0]
    return finer if fits.fit > verdict.fit else found


def _finer_scale(pairs: Pairs, reading: Reading, found: Hypothesis) -> Hypothesis:
    """The factor that fits the same pairs best; the known unit if it is as good."""
    samples = pairs.samples
    motion = motions(found.reading.shifted(samples.poses, samples.index), pairs.pairs)
    small = small_camera(samples, found.reading.camera(samples.camera))
    fits = [
        float(np.nan_to_num(pairs.agreement(motion, found.reading.depth_scale * step, small).met).mean())
        for step in SCALE_STEPS
    ]
    best = SCALE_STEPS[int(np.argmax(fits))]
    if abs(best - 1) < 0.015:
        return found
    return depth_by(reading, best * found.reading.depth_scale / reading.depth_scale)


def _of_poses(samples: Samples, reading: Reading, found: Hypothesis) -> Hypothesis:
    """The same change applied to the positions instead, if only the depth as given is plausible for a home."""
    scale = found.reading.depth_scale / reading.depth_scale
    median_m = float(np.nanmedian(samples.depth_m)) * reading.depth_scale
    low, high = PLAUSIBLE_M
    if low <= median_m <= high and not low <= median_m * scale <= high:
        return positions_by(reading, 1 / scale)
    return found


def _evidence(better: Verdict, now: Verdict) -> str:
    known = now.seen >= FEWEST_PAIRS and np.isfinite(now.off_m)
    as_given = f"{_metres(now.off_m)} as given" if known else "no two frames overlap as given"
    return (
        f"the depth of overlapping frames agrees to {_metres(better.off_m)} with it, {as_given} "
        f"(agreement {better.score:.2f} against {now.score:.2f}, {len(better.pairs)} pairs of frames)"
    )


def _metres(value: float) -> str:
    if not np.isfinite(value):
        return "nothing"
    return f"{value * 100:.1f} cm" if value < 1 else f"{value:.1f} m" if value < 100 else f"{value:.3g} m"
