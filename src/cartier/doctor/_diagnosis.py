"""Which reading of poses, depth and intrinsics makes the recording consistent, one fault at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cartier.doctor._consistency import FEWEST_PAIRS, Pairs, Verdict, judge, motions
from cartier.doctor._readings import Hypothesis, Reading, hypotheses, scale_by, shift_by
from cartier.doctor._report import Fault
from cartier.doctor._sampling import Samples
from cartier.types import Camera

MOST_FAULTS = 3
CONSISTENT, BETTER, BETTER_BY = 0.25, 1.25, 0.04
SCALE_STEPS = [1 + percent / 100 for percent in range(-16, 19)]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The ``reading`` that fits best, the faults that it mends, and the verdicts on the recording as given and so read."""

    reading: Reading
    faults: tuple[Fault, ...]
    given: Verdict
    mended: Verdict

    @property
    def consistent(self) -> bool:
        return self.mended.score >= CONSISTENT

    @property
    def contradictory(self) -> bool:
        """Whether frames that overlap disagree and no reading mends it."""
        return not self.consistent and len(self.mended.pairs) >= FEWEST_PAIRS


def small_camera(samples: Samples, camera: Camera) -> Camera:
    """The camera of the small images, if ``camera`` is that of the full ones."""
    stride = samples.camera.fx / samples.small.fx
    return replace(
        samples.small, fx=camera.fx / stride, fy=camera.fy / stride, cx=camera.cx / stride, cy=camera.cy / stride
    )


def weigh(samples: Samples, reading: Reading) -> Verdict:
    """How well one reading makes the frames agree."""
    poses = reading.shifted(samples.poses, samples.index)
    return judge(samples, poses, reading.depth_scale, small_camera(samples, reading.camera(samples.camera)))


def diagnose(samples: Samples, level: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Diagnosis:
    """Take the best single change of reading as long as each makes the frames agree much better."""
    reading = Reading(level)
    given = now = weigh(samples, reading)
    faults: list[Fault] = []
    for _ in range(MOST_FAULTS):
        found = _best(samples, reading, now)
        if found is None:
            break
        hypothesis, verdict = found
        faults.append(Fault(hypothesis.fault, _evidence(hypothesis, verdict, now), hypothesis.mend))
        reading, now = hypothesis.reading, weigh(samples, hypothesis.reading)
    return Diagnosis(reading, tuple(faults), given, now)


def _best(samples: Samples, reading: Reading, now: Verdict) -> tuple[Hypothesis, Verdict] | None:
    """The best change and its verdict, or None if none is much better than ``now``.

    Where no single change helps, each is tried together with each unit of depth: two faults may hide each other.
    """
    near = len(samples) // 4
    single = [h for h in hypotheses(reading, samples.camera) if abs(h.reading.shift - reading.shift) <= near]
    best = _pick(samples, single)
    if best is None:
        return None
    if best[1].score < CONSISTENT:
        poses = [h for h in single if h.fault in ("inverted_poses", "opengl_axes", "left_handed")]
        both = [scale_by(h.reading, scale, h) for h in poses for scale in (1000.0, 1e-3, 5.0, 0.2)]
        other = _pick(samples, both)
        if other is not None and other[1].score > best[1].score:  # the unit of depth is found in the next round
            single_part = next(p for p in poses if p.words == other[0].words)
            return (single_part, other[1]) if _much_better(other[1], now) else None
    if not _much_better(best[1], now):
        return None
    return _refined(samples, reading, *best)


def _much_better(verdict: Verdict, now: Verdict) -> bool:
    return verdict.score >= CONSISTENT and verdict.score > BETTER * now.score + BETTER_BY


def _pick(samples: Samples, those: list[Hypothesis]) -> tuple[Hypothesis, Verdict] | None:
    judged = [(h, weigh(samples, h.reading)) for h in those]
    return max(judged, key=lambda pair: pair[1].score, default=None)


def _refined(samples: Samples, reading: Reading, found: Hypothesis, verdict: Verdict) -> tuple[Hypothesis, Verdict]:
    """The same change with a finer factor of depth or number of frames."""
    if found.fault == "depth_scale":
        return _finer_scale(samples, reading, found, verdict)
    if found.fault != "time_offset":
        return found, verdict
    shift = found.reading.shift - reading.shift
    finer = _pick(samples, [shift_by(reading, shift + step) for step in range(-4, 5) if step and shift + step])
    return finer if finer is not None and finer[1].score > verdict.score else (found, verdict)


def _finer_scale(samples: Samples, reading: Reading, found: Hypothesis, verdict: Verdict) -> tuple[Hypothesis, Verdict]:
    """The factor that fits the same pairs best; the known one, if it is as good."""
    pairs = Pairs(samples, verdict.pairs)
    motion = motions(found.reading.shifted(samples.poses, samples.index), verdict.pairs)
    small = small_camera(samples, found.reading.camera(samples.camera))
    fits = [
        float(np.nan_to_num(pairs.agreement(motion, found.reading.depth_scale * step, small).score).mean())
        for step in SCALE_STEPS
    ]
    best = SCALE_STEPS[int(np.argmax(fits))]
    if abs(best - 1) < 0.015:
        return found, verdict
    scale = best * found.reading.depth_scale / reading.depth_scale
    finer = scale_by(reading, scale, found)
    finer = replace(finer, words=f"the depth is too {'small' if scale > 1 else 'large'}")
    return finer, weigh(samples, finer.reading)


def _evidence(found: Hypothesis, better: Verdict, now: Verdict) -> str:
    as_given = (
        f"{_metres(now.off_m)} as given"
        if len(now.pairs) and np.isfinite(now.off_m)
        else "no two frames overlap as given"
    )
    return (
        f"{found.words}: the depth of overlapping frames agrees to {_metres(better.off_m)} if so read, {as_given} "
        f"(agreement {better.score:.2f} against {now.score:.2f}, {len(better.pairs)} pairs of frames)"
    )


def _metres(value: float) -> str:
    if not np.isfinite(value):
        return "nothing"
    return f"{value * 100:.1f} cm" if value < 1 else f"{value:.1f} m" if value < 100 else f"{value:.3g} m"
