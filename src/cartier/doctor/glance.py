"""What ``cartier map`` says of a recording before the work: the examination of some twenty frames that it reads anyway.

A fault that makes the map nonsense stops it. Level and turn are not here: ``mapping.upright`` corrects them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.doctor import checks
from cartier.doctor._consistency import Pairs, near_pairs
from cartier.doctor._diagnosis import SETTLED, diagnose, weigh
from cartier.doctor._report import Fault
from cartier.doctor.hypotheses import Reading
from cartier.mapping.samples import Samples

FINE = 10  # images in which depth and colour are compared: half choose, half test
NONSENSE = frozenset(
    ("depth_scale", "pose_scale", "inverted_poses", "opengl_axes", "left_handed", "depth_unit", "other_poses")
)
NAMED_BY_READING = NONSENSE - {"other_poses"}
FAR_M = 60.0


def glance(recording: Recording, samples: Samples) -> list[Fault]:
    """The faults that a few frames show, by the checks of ``examine``."""
    if not len(samples):
        return []
    lens, _ = checks.lens(samples.camera)
    no_depth, _ = checks.empty_depth(samples)
    found = (lens, checks.depth_unit(samples.depth_m), _clock(samples), _spread(samples), no_depth)
    faults = [fault for fault in found if fault is not None]
    if not samples.has_depth or NONSENSE & {fault.fault for fault in faults}:
        return faults
    doubts = _inconsistent(recording, samples)
    if not NAMED_BY_READING & {fault.fault for fault in doubts}:
        moved = checks.unregistered(replace(samples, fine=samples.fine[:: max(1, len(samples.fine) // FINE)]), [])
        doubts = doubts if moved is None else [moved[0]]  # which explains that frames disagree
    return faults + doubts


def _spread(samples: Samples) -> Fault | None:
    away_m = np.linalg.norm(samples.poses[:, :3, 3] - np.median(samples.poses[:, :3, 3], axis=0), axis=1)
    if np.median(away_m) < FAR_M:
        return None
    told = f"the cameras stand {np.median(away_m):.3g} m from their middle, which is no home"
    return Fault("pose_scale", told, "are the positions in metres?")


def _clock(samples: Samples) -> Fault | None:
    back_s = -float(np.diff(samples.times_s).min(initial=0.0))
    if not back_s:
        return None
    told = f"the times of the frames go back, once by {back_s:.3g} s"
    return Fault("time_offset", told, "were two recordings joined? give each its own, or sort the frames by time")


def _inconsistent(recording: Recording, samples: Samples) -> list[Fault]:
    """Which reading of the poses makes frames agree that do not, or that none does."""
    levelled = optional(recording, RecordingDefaults, "level_from_world")
    level = np.eye(4) if levelled is None else np.asarray(levelled, dtype=np.float64)
    given = weigh(Reading(level), Pairs(samples, np.concatenate(near_pairs(samples))))
    if given.consistent and given.score > SETTLED:
        return []
    found = diagnose(samples, level)
    verdict = found.repaired
    if found.faults or not found.contradictory:
        return list(found.faults)
    told = (
        f"{verdict.disagreeing} of {verdict.seen} pairs of frames that overlap by their poses disagree about the depth"
    )
    return [
        Fault(
            "other_poses",
            told,
            "are poses, depth and images of one run and clock, and is the focal length that of the images?",
        )
    ]
