"""The doctor: what is wrong with a recording, shown by its own frames, and how it is mended.

Depth of one frame, carried into another that sees the same, must meet that one's depth. Where it does not, other readings
of poses, depth and intrinsics are tried, and the one that makes the recording consistent names the fault.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.doctor import checks
from cartier.doctor._consistency import FEWEST_PAIRS, Numbers, Verdict, judge
from cartier.doctor._diagnosis import Diagnosis, diagnose, small_camera
from cartier.doctor._edges import Registration, zoomed
from cartier.doctor._exhibit import exhibit
from cartier.doctor._home import examine_home, is_home
from cartier.doctor._jumps import Jump, jumps, stray
from cartier.doctor._mending import Mended, mended_camera
from cartier.doctor._picture import draw_report
from cartier.doctor._readings import SWAP_YZ, Reading
from cartier.doctor._report import FAULTS, Cure, Fault, Report
from cartier.doctor.sampling import Samples, is_mirror_fault, is_pose_fault, sample
from cartier.errors import InputError
from cartier.types import Camera

__all__ = [
    "FAULTS",
    "Fault",
    "Report",
    "draw_report",
    "examine",
    "examine_home",
    "is_home",
    "mend",
    "open_for_doctor",
]

CANNOT_LEVEL = "give it with --up"  # how cartier.mapping.gravity says that the cameras do not tell which way is up
NO_DEPTH = (
    "no frame has a depth image: objects are mapped from bearings, without a floor plan; poses, scale and intrinsics could not be "
    "compared with depth"
)
Progress = Callable[[int, int], None]


def open_for_doctor(path: str | Path, format: str | None = None, **options: Any) -> Recording | Report:
    """The recording at a path, or at once the report if its reader refuses its poses. Other faults raise InputError.

    ``options`` are the reader's.
    """
    try:
        return plugins.open_recording(path, format, **options)
    except InputError as error:
        if CANNOT_LEVEL in str(error):  # as it happens with inverted poses: take the world as it is
            return plugins.open_recording(path, format, **options | {"up": (0.0, 0.0, 1.0), "floor_m": 0.0})
        if not is_pose_fault(error):
            raise
        fault = "left_handed" if is_mirror_fault(error) else "bad_rotation"
        mend_it = (
            "mirror one axis of the world and one of the camera (Unity: swap y and z, change the sign of the camera's y)"
            if fault == "left_handed"
            else "write unit quaternions in the order qx qy qz qw, or orthonormal 3x3 rotations without a scale"
        )
        return Report(Path(path).name, 0, (Fault(fault, str(error), mend_it),), ("nothing else could be looked at",))


def examine(recording: Recording, progress: Progress | None = None) -> Report:
    """Look at up to 1,000 frames and say what is wrong. ``progress(done, total)`` is called after each frame read.

    Raises InputError for files that cannot be read; a pose that is no rigid motion is a finding instead.
    """
    if not len(recording):
        fault = Fault("too_few_views", "the recording holds no frame", "record the home again")
        return Report(recording.name, 0, (fault,))
    samples = sample(recording, progress)
    notes = [f"{len(samples) + len(samples.faults)} of {len(recording)} frames looked at"]
    faults = checks.refused_poses(samples)
    left_out = frozenset(samples.faults)
    if not len(samples):
        return Report(recording.name, len(recording), tuple(faults), tuple(notes))
    if not samples.has_depth:
        notes.append(NO_DEPTH)
    no_depth, without = checks.empty_depth(samples)
    samples = checks.without_depth(samples, without) if without else samples
    blur, unsharp = checks.blurred(samples)
    few = checks.few_views(samples)
    faults += [f for f in (no_depth, blur, few) if f is not None]
    levelled = optional(recording, RecordingDefaults, "level_from_world")
    level = np.eye(4) if levelled is None else np.asarray(levelled, dtype=np.float64)
    diagnosis = diagnose(samples, level)
    faults += diagnosis.faults
    cure = Cure(diagnosis.reading)
    if few is None:
        cure = _register(samples, diagnosis, recording, faults, notes)
    registered = samples if cure.registration is None else _registered(samples, cure.registration)
    kept, strays = _jump(registered, cure, faults)
    reading, upright = _level(registered, diagnosis, cure, recording, faults)
    turns = checks.rotated(reading.poses(samples.poses) if upright is None else upright @ reading.poses(samples.poses))
    if turns:
        faults.append(checks.lying(turns))
    notes += diagnosis.doubts
    if not diagnosis.mended.consistent and samples.has_depth:
        notes.append(_undecided(diagnosis.mended))
    left_out |= without | strays | (unsharp if len(unsharp) <= len(samples) // 2 else frozenset())
    cure = replace(cure, reading=reading, level=upright, left_out=left_out, kept=kept, turns=turns)
    ordered = tuple(sorted(faults, key=lambda f: FAULTS.index(f.fault)))
    shown, doubt = exhibit(samples, diagnosis), diagnosis.contradictory
    return Report(recording.name, len(recording), ordered, tuple(notes), cure, shown, doubt)


def mend(recording: Recording, report: Report) -> Recording:
    """The recording as the report would have it; frames are mended when they are asked for.

    Raises InputError if nothing of what was found can be mended.
    """
    if report.cure is None or not report.cure.changes():
        names = ", ".join(f.fault for f in report.faults)
        why = [f"not by a program ({names}): {report.faults[0].mend}"] if names else report.notes[1:]
        raise InputError(f"{recording.name}: nothing to mend; {'; '.join(why) or 'it is sound'}")
    return Mended(recording, report.cure, [f"mended by cartier doctor: {f.fault} ({f.mend})" for f in report.faults])


def _register(
    samples: Samples, diagnosis: Diagnosis, recording: Recording, faults: list[Fault], notes: list[str]
) -> Cure:
    """The cure so far, with where the depth must go, and whether the intrinsics go with it; adds the fault or a note."""
    cure = Cure(diagnosis.reading)
    found = checks.unregistered(samples, notes)
    if found is None:
        return cure
    fault, registration = found
    if _as_published(registration, recording):
        notes.append(f"as this data set is published: {fault.evidence}; --fix moves it")
    else:
        faults.append(fault)
    there = _registered(samples, registration)
    poses = cure.reading.shifted(samples.poses, samples.index)

    def score(depth_camera: bool, pairs: Numbers) -> float:
        small = _small(samples, replace(cure, registration=registration, depth_camera=depth_camera))
        return judge(there, poses, cure.reading.depth_scale, small, pairs).score

    depth_camera = all(score(True, pairs) > score(False, pairs) for pairs in (diagnosis.choosing, diagnosis.testing))
    return replace(cure, registration=registration, depth_camera=depth_camera)


def _registered(samples: Samples, moved: Registration) -> Samples:
    """The samples with their depth moved onto the colour."""
    depth_m = [zoomed(depth, moved.zoom, moved.dx, moved.dy) for depth in samples.depth_m]
    return replace(samples, depth_m=np.array(depth_m, np.float32).reshape(samples.depth_m.shape))


def _small(samples: Samples, cure: Cure) -> Camera:
    """The camera of the small images once the recording is mended."""
    return small_camera(samples, mended_camera(samples.camera, cure))


def _as_published(found: Registration, recording: Recording) -> bool:
    """Whether the depth lies beside the colour just as far as the format's own reader knows it to."""
    known = optional(recording, RecordingDefaults, "known_registration")
    if known is None:
        return False
    zoom, dx_px, dy_px = known
    width = recording.camera.width
    return bool(
        abs(found.zoom - zoom) <= 0.03 and max(abs(found.dx * width - dx_px), abs(found.dy * width - dy_px)) <= 8
    )


def _jump(samples: Samples, cure: Cure, faults: list[Fault]) -> tuple[tuple[int, int] | None, frozenset[int]]:
    """The longest piece without a jump, as first and last frame, and single frames that stand elsewhere; adds the fault."""
    poses = cure.reading.shifted(samples.poses, samples.index)
    found = jumps(samples, poses, cure.reading.depth_scale, _small(samples, cure)) if samples.has_depth else []
    fault = checks.leaps(found)
    if fault is None:
        return None, frozenset()
    faults.append(fault)
    strays, others = stray(found, poses, samples.index)
    return (_longest_piece(others, samples.length) if others else None), strays


def _longest_piece(found: list[Jump], length: int) -> tuple[int, int]:
    starts = [0, *(j.after for j in found)]
    ends = [*(j.before for j in found), length - 1]
    return max(zip(starts, ends, strict=True), key=lambda piece: piece[1] - piece[0])


def _level(
    samples: Samples, diagnosis: Diagnosis, cure: Cure, recording: Recording, faults: list[Fault]
) -> tuple[Reading, npt.NDArray[np.float64] | None]:
    """The reading with the best of the mirrors, and what levels its world; adds the fault where nothing else explains it."""
    reading = diagnosis.reading
    options = [reading]
    if any(f.fault == "left_handed" for f in diagnosis.faults) and reading.before is not None:
        options.append(replace(reading, before=SWAP_YZ))
    if samples.has_depth and not diagnosis.mended.consistent:
        return reading, None
    small = _small(samples, cure)
    tilts = [
        (option, checks.tilt(samples, option.shifted(samples.poses, samples.index), option.depth_scale, small))
        for option in options
    ]
    judged = [(option, t) for option, t in tilts if t is not None]
    if not judged:
        return reading, None
    best, tilt = min(judged, key=lambda pair: pair[1].degrees)
    if not tilt.wrong:
        return best, None
    if all(f.fault in ("time_offset", "intrinsics_resolution", "depth_scale") for f in diagnosis.faults):
        levelled = optional(recording, RecordingDefaults, "level_from_world")
        told = "" if levelled is None else "give --up X,Y,Z, or "  # only readers that level have the option
        how = f"{told}turn the poses so that gravity points along -z and z = 0 is the floor; --fix does"
        faults.append(Fault("not_level", tilt.words(), how))
    return best, tilt.level


def _undecided(verdict: Verdict) -> str:
    if verdict.seen < FEWEST_PAIRS:
        return "too few frames near in time see the same by their poses, so poses, scale and intrinsics could not be judged"
    return (
        f"{verdict.disagreeing} of {verdict.seen} pairs of frames that see the same disagree about its depth, and no reading "
        "of the numbers mends it: were depth, images and poses recorded by the same camera at the same time?"
    )
