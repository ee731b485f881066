"""Examination and repair of recordings: wrong poses, depth and intrinsics, with the frames that show them.

The depth of one frame, carried into an overlapping frame, must agree with the depth there. If it does not, other
readings of poses, depth and intrinsics are tried; the one that makes the recording consistent names the fault.
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
from cartier.doctor._consistency import FEWEST_PAIRS, Numbers, Pairs, Verdict, judge
from cartier.doctor._diagnosis import Diagnosis, diagnose, small_camera
from cartier.doctor._evidence import draw_report, evidence_pair
from cartier.doctor._home import examine_home, is_home
from cartier.doctor._pose_jumps import PoseJump, pose_jumps, split_strays
from cartier.doctor._repair import RepairedRecording, repaired_camera
from cartier.doctor._report import FAULTS, Fault, Repair, Report
from cartier.doctor.hypotheses import SWAP_YZ, Reading
from cartier.errors import InputError
from cartier.mapping.samples import Samples, is_mirror_fault, is_pose_fault, sample
from cartier.mapping.upright import Levelled, Upright
from cartier.recordings.common.edges import Registration

__all__ = [
    "FAULTS",
    "Fault",
    "Report",
    "draw_report",
    "examine",
    "examine_home",
    "is_home",
    "open_for_doctor",
    "repair",
]

CANNOT_LEVEL = "give it with --up"  # in the message of cartier.mapping.gravity if it finds no up direction
NO_DEPTH = (
    "no frame has a depth image: objects are mapped from bearings, without a floor plan; poses, scale and intrinsics "
    "could not be compared with depth"
)
Progress = Callable[[int, int], None]


def open_for_doctor(path: str | Path, format: str | None = None, **options: Any) -> Recording | Report:
    """Open a recording; if its reader refuses the poses, return the report on that instead.

    ``options`` are the reader's. Raises InputError for any other fault.
    """
    try:
        return plugins.open_recording(path, format, **options)
    except InputError as error:
        if CANNOT_LEVEL in str(error):  # inverted poses may cause this: take the world as it is
            return plugins.open_recording(path, format, **options | {"up": (0.0, 0.0, 1.0), "floor_m": 0.0})
        if not is_pose_fault(error):
            raise
        mirrored = is_mirror_fault(error)
        fault = Fault("left_handed", str(error), checks.UNMIRROR) if mirrored else checks.bad_rotation(str(error))
        return Report(Path(path).name, 0, (fault,), ("nothing else could be examined",))


def examine(recording: Recording, progress: Progress | None = None) -> Report:
    """Examine up to 1,000 frames and report what is wrong. ``progress(done, total)`` is called after each frame read.

    Raises InputError for files that cannot be read; a pose that is no rigid motion is reported as a fault instead.
    """
    if not len(recording):
        fault = Fault("too_few_views", "the recording holds no frame", "record the home again")
        return Report(recording.name, 0, (fault,))
    samples = sample(recording, progress)
    notes = [f"{len(samples) + len(samples.faults)} of {len(recording)} frames examined"]
    faults = checks.refused_poses(samples)
    if not len(samples):
        return Report(recording.name, len(recording), tuple(faults), tuple(notes))
    if not samples.has_depth:
        notes.append(NO_DEPTH)
    no_depth, empty = checks.empty_depth(samples)
    samples = checks.without_depth(samples, empty) if empty else samples
    blur, unsharp = checks.blurred(samples)
    few = checks.few_views(samples)
    faults += [f for f in (no_depth, blur, few) if f is not None]
    levelled = optional(recording, RecordingDefaults, "level_from_world")
    levelling = np.eye(4) if levelled is None else np.asarray(levelled, dtype=np.float64)
    diagnosis = diagnose(samples, levelling)
    faults += diagnosis.faults
    found = Repair(diagnosis.reading)
    if few is None:
        found = _register(samples, diagnosis, recording, faults, notes)
    registered = samples if found.registration is None else _registered(samples, found.registration)
    kept, strays = _cut_jumps(registered, found, faults)
    reading, level = _level(registered, diagnosis, found, recording, faults)
    turns = checks.rotated(reading.poses(samples.poses) if level is None else level @ reading.poses(samples.poses))
    if turns:
        faults.append(checks.lying(turns))
    notes += diagnosis.doubts
    if not diagnosis.repaired.consistent and samples.has_depth:
        notes.append(_undecided(diagnosis.repaired))
    left_out = frozenset(samples.faults) | empty | strays
    if len(unsharp) <= len(samples) // 2:
        left_out |= unsharp
    found = replace(found, reading=reading, level=level, left_out=left_out, kept=kept, turns=turns)
    ordered = tuple(sorted(faults, key=lambda f: FAULTS.index(f.fault)))
    pair = evidence_pair(samples, diagnosis)
    return Report(recording.name, len(recording), ordered, tuple(notes), found, pair, diagnosis.contradictory)


def repair(recording: Recording, report: Report) -> Recording:
    """The recording with the repairs of its report; each frame is repaired when it is read.

    Raises InputError if there is nothing to repair.
    """
    if report.repair is None or not report.repair.changes():
        names = ", ".join(f.fault for f in report.faults)
        why = [f"no program can repair {names}: {report.faults[0].repair}"] if names else report.notes[1:]
        raise InputError(f"{recording.name}: nothing to repair; {'; '.join(why) or 'it is sound'}")
    notes = [f"repaired by cartier doctor: {f.fault} ({f.repair})" for f in report.faults]
    level = np.eye(4) if report.repair.level is None else report.repair.level
    return Upright(RepairedRecording(recording, report.repair, notes), Levelled(level, report.repair.turns))


def _register(
    samples: Samples, diagnosis: Diagnosis, recording: Recording, faults: list[Fault], notes: list[str]
) -> Repair:
    """The repair, with how the depth and perhaps the intrinsics are registered; adds the fault or a note."""
    plain = Repair(diagnosis.reading)
    found = checks.unregistered(samples, notes)
    if found is None:
        return plain
    fault, registration = found
    if _as_published(registration, recording):
        notes.append(f"this data set is published so: {fault.evidence}; --fix moves it")
    else:
        faults.append(fault)
    registered = _registered(samples, registration)
    poses = plain.reading.shifted(samples.poses, samples.index)

    def score(depth_camera: bool, pairs: Numbers) -> float:
        camera = repaired_camera(samples.camera, replace(plain, registration=registration, depth_camera=depth_camera))
        return judge(Pairs(registered, pairs), poses, plain.reading.depth_scale, small_camera(samples, camera)).score

    depth_camera = all(score(True, pairs) > score(False, pairs) for pairs in (diagnosis.choosing, diagnosis.testing))
    return replace(plain, registration=registration, depth_camera=depth_camera)


def _registered(samples: Samples, moved: Registration) -> Samples:
    depth_m = [moved.register(depth_m) for depth_m in samples.depth_m]
    return replace(samples, depth_m=np.array(depth_m, np.float32).reshape(samples.depth_m.shape))


def _as_published(found: Registration, recording: Recording) -> bool:
    """Whether the depth lies beside the colour just as far as the format's own reader knows it to."""
    known = optional(recording, RecordingDefaults, "known_registration")
    if known is None:
        return False
    zoom, dx_px, dy_px = known
    width = recording.camera.width
    off_px = max(abs(found.dx * width - dx_px), abs(found.dy * width - dy_px))
    return bool(abs(found.zoom - zoom) <= 0.03 and off_px <= 8)


def _cut_jumps(samples: Samples, found: Repair, faults: list[Fault]) -> tuple[tuple[int, int] | None, frozenset[int]]:
    """The longest piece without a pose jump (first and last frame) and the stray frames; adds the fault."""
    poses = found.reading.shifted(samples.poses, samples.index)
    small = small_camera(samples, repaired_camera(samples.camera, found))
    all_jumps = pose_jumps(samples, poses, found.reading.depth_scale, small) if samples.has_depth else []
    fault = checks.jumping(all_jumps)
    if fault is None:
        return None, frozenset()
    faults.append(fault)
    strays, others = split_strays(all_jumps, poses, samples.index)
    return (_longest_piece(others, samples.length) if others else None), strays


def _longest_piece(found: list[PoseJump], length: int) -> tuple[int, int]:
    starts = [0, *(j.after for j in found)]
    ends = [*(j.before for j in found), length - 1]
    return max(zip(starts, ends, strict=True), key=lambda piece: piece[1] - piece[0])


def _level(
    samples: Samples, diagnosis: Diagnosis, found: Repair, recording: Recording, faults: list[Fault]
) -> tuple[Reading, npt.NDArray[np.float64] | None]:
    """The reading with the best mirror, and what levels its world; adds the fault if no other explains it."""
    reading = diagnosis.reading
    options = [reading]
    if any(f.fault == "left_handed" for f in diagnosis.faults) and reading.before is not None:
        options.append(replace(reading, before=SWAP_YZ))
    if samples.has_depth and not diagnosis.repaired.consistent:
        return reading, None
    small = small_camera(samples, repaired_camera(samples.camera, found))
    tilts = [
        (option, checks.tilt(samples, option.shifted(samples.poses, samples.index), option.depth_scale, small))
        for option in options
    ]
    judged = [(option, tilt) for option, tilt in tilts if tilt is not None]
    if not judged:
        return reading, None
    best, tilt = min(judged, key=lambda pair: pair[1].degrees)
    if not tilt.wrong:
        return best, None
    if all(f.fault in ("time_offset", "intrinsics_resolution", "depth_scale") for f in diagnosis.faults):
        levelled = optional(recording, RecordingDefaults, "level_from_world")
        told = "" if levelled is None else "give --up X,Y,Z, or "  # only readers that level have the option
        how = f"{told}turn the poses so that gravity points along -z and z = 0 is the floor"
        faults.append(Fault("not_level", tilt.words(), how, "does so"))
    return best, tilt.level


def _undecided(verdict: Verdict) -> str:
    if verdict.seen < FEWEST_PAIRS:
        return "too few frames near in time overlap by their poses, so poses, scale and intrinsics could not be judged"
    return (
        f"{verdict.disagreeing} of {verdict.seen} pairs of overlapping frames disagree about their depth, and no "
        "reading of the numbers that was tried repairs it: were depth, images and poses recorded by the same camera at "
        "the same time?"
    )
