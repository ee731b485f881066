"""Jumps of the poses: a wheel that slipped or a robot that was lifted, after which all poses are off by one motion.

Around a jump, what the next samples show lies near what the samples before it showed, and not on it. There the later
part is registered to the earlier one from several turns; a jump is a motion that brings far more of it to lie on that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartier.mapping.poses.registration import Floats, Surface, about_z, lying_on, register

BEFORE, AFTER = 12, 6  # samples that are compared to notice one
LONG_BEFORE = 40  # samples that one is measured against
LOW, BESIDE_TWICE = 0.5, 2.0  # of the usual share that lies on what was seen; times as much must lie near it
LEAST_M, LEAST_RAD = 0.1, float(np.deg2rad(1.5))
GAIN, TIMES_MORE = 0.1, 1.5  # in the share that lies on what was seen before, to be believed
STARTS_RAD = np.deg2rad([0, -6, -3, 3, 6])
REACHES_M = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1)
SIGMA = np.array([np.deg2rad(10.0), 0.6, 0.6, 0.1])
POINTS, AGAINST, FEWEST = 480, 3000, 100
MOST = 3  # in one recording
WINDOW = 4  # samples around the one at which it was noticed where it may have been


@dataclass(frozen=True, eq=False)
class Jump:
    """The motion that takes it back.

    Args:
        sample: The first sample behind it.
        motion: (4, 4) world from world, a turn about z and a shift (m), for this sample and all later ones.
    """

    sample: int
    motion: Floats


def find_jumps(samples: Sequence[Surface]) -> list[Jump]:
    """The jumps between samples of a recording, in the order in which their motions apply; at most three."""
    found: list[Jump] = []
    while len(found) < MOST and (jump := _greatest(samples)) is not None:
        found.append(jump)
        samples = moved(samples, [jump])
    return found


def moved(samples: Sequence[Surface], jumps: Sequence[Jump]) -> list[Surface]:
    """The samples with jumps taken back."""
    poses = [sample.world_from_camera for sample in samples]
    for jump in jumps:
        poses[jump.sample :] = [jump.motion @ pose for pose in poses[jump.sample :]]
    return [replace(sample, world_from_camera=pose) for sample, pose in zip(samples, poses, strict=True)]


def _greatest(samples: Sequence[Surface]) -> Jump | None:
    on, near = _shares(samples)
    usual, best, gained = float(np.median(on)), None, GAIN
    for k in range(1, len(samples) - 1):
        if on[k] < LOW * usual and near[k] > BESIDE_TWICE * on[k] and on[k] == on[max(k - 2, 0) : k + 3].min():
            jump, gain = _measured(samples, k)
            if jump is not None and gain > gained:
                best, gained = jump, gain
    return best and _placed(samples, best)


def _shares(samples: Sequence[Surface]) -> tuple[Floats, Floats]:
    """The shares (n,) of what samples from each on show that lies on, and near, what those before it showed."""
    on, near = np.ones(len(samples)), np.ones(len(samples))
    for k in range(1, len(samples)):
        before = _points(samples[max(0, k - BEFORE) : k], 100)
        on[k], near[k] = lying_on(_points(samples[k : k + AFTER], 50), before)
    return on, near


def _measured(samples: Sequence[Surface], k: int) -> tuple[Jump | None, float]:
    """The jump before a sample, if there is one, and by how much the share that lies on the earlier part grows."""
    here = samples[k].world_from_camera
    points = _points(samples[k : k + AFTER], POINTS // AFTER)
    low, high = points[:, :3].min(0) - REACHES_M[0], points[:, :3].max(0) + REACHES_M[0]
    against = _points(samples[max(0, k - LONG_BEFORE) : k], 200)
    against = against[((against[:, :3] > low) & (against[:, :3] < high)).all(1)]
    if len(against) < FEWEST:
        return None, 0.0
    against = np.random.default_rng(0).permutation(against)[:AGAINST]
    part = Surface(
        here,
        np.hstack([(points[:, :3] - here[:3, 3]) @ here[:3, :3], points[:, 3:] @ here[:3, :3]]).astype(np.float32),
    )
    before = lying_on(points, against)[0]
    best, most = None, max(TIMES_MORE * before, before + GAIN)
    for turn_rad in STARTS_RAD:
        fitted = register(part, np.array([turn_rad, 0, 0, 0]), against, REACHES_M, SIGMA)
        share = 0.0 if fitted is None else lying_on(part.placed(fitted.correction), against)[0]
        if fitted is not None and share > most:
            best, most = fitted.correction, share
    if best is None or (np.linalg.norm(best[1:]) < LEAST_M and abs(best[0]) < LEAST_RAD):
        return None, 0.0
    motion = np.eye(4)
    motion[:3, :3] = about_z(float(best[0]))
    motion[:3, 3] = here[:3, 3] + best[1:] - motion[:3, :3] @ here[:3, 3]
    return Jump(k, motion), most - before


def _placed(samples: Sequence[Surface], jump: Jump) -> Jump:
    """The jump before that of the samples around it from which on the motion fits better than none does."""
    first, last = max(1, jump.sample - WINDOW), min(len(samples), jump.sample + WINDOW + 1)
    before = _points(samples[max(0, first - LONG_BEFORE) : first], 200)
    pairs = zip(samples[first:last], moved(samples[first:last], [replace(jump, sample=0)]), strict=True)
    better = [lying_on(_points([m], 300), before)[0] - lying_on(_points([s], 300), before)[0] for s, m in pairs]
    gains = [sum(better[k:]) - sum(better[:k]) for k in range(len(better))]
    return replace(jump, sample=first + int(np.argmax(gains)))


def _points(samples: Sequence[Surface], count: int) -> Floats:
    return np.concatenate([sample.placed(np.zeros(4), count) for sample in samples])
