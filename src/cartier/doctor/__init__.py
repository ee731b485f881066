"""The doctor: what is wrong with a recording, shown by its own frames, and how it is mended.

Depth of one frame, carried into another that sees the same, must meet that one's depth. Where it does not, other readings
of poses, depth and intrinsics are tried, and the one that makes the recording consistent names the fault.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Recording
from cartier.doctor import _checks
from cartier.doctor._consistency import judge
from cartier.doctor._diagnosis import Diagnosis, diagnose, small_camera
from cartier.doctor._edges import Registration, zoomed
from cartier.doctor._exhibit import exhibit
from cartier.doctor._jumps import Jump, jumps, stray
from cartier.doctor._mending import Mended, mended_camera
from cartier.doctor._picture import draw_report
from cartier.doctor._readings import SWAP_YZ, Reading
from cartier.doctor._report import FAULTS, Cure, Fault, Report
from cartier.doctor._sampling import Samples, is_mirror_fault, is_pose_fault, sample
from cartier.errors import InputError

__all__ = ["FAULTS", "Fault", "Report", "draw_report", "examine", "mend", "open_for_doctor"]

CANNOT_LEVEL = "give it with up="  # how cartier.mapping.gravity says that the cameras do not tell which way is up
Progress = Callable[[int, int], None]


def open_for_doctor(path: str | Path, format: str | None = None) -> Recording | Report:
    """The recording at a path, or at once the report if its reader refuses its poses. Other faults raise InputError."""
    try:
        return plugins.open_recording(path, format)
    except InputError as error:
        if CANNOT_LEVEL in str(error):  # as it happens with inverted poses: take the world as it is
            return plugins.open_recording(path, format, up=(0.0, 0.0, 1.0), floor_m=0.0)
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
    faults = _checks.refused_poses(samples)
    left_out = frozenset(samples.faults)
    if not len(samples):
        return Report(recording.name, len(recording), tuple(faults), tuple(notes))
    no_depth, without = _checks.empty_depth(samples)
    samples = _checks.without_depth(samples, without) if without else samples
    blur, unsharp = _checks.blurred(samples)
    faults += [f for f in (no_depth, blur, _checks.few_views(samples)) if f is not None]
    level = np.asarray(getattr(recording, "level_from_world", np.eye(4)), dtype=np.float64)
    diagnosis = diagnose(samples, level)
    faults += diagnosis.faults
    registration, depth_camera = _register(samples, diagnosis, faults)
    if registration is not None and _as_published(registration, recording):
        found = next(f for f in faults if f.fault == "depth_not_registered")
        faults.remove(found)
        notes.append(f"as this data set is published: {found.evidence}; --fix moves it")
    kept, strays = _jump(samples, diagnosis.reading, faults)
    reading, upright = _level(samples, diagnosis, faults, level)
    if not diagnosis.consistent and samples.has_depth:
        notes.append(_undecided(diagnosis))
    left_out |= without | strays | (unsharp if len(unsharp) <= len(samples) // 2 else frozenset())
    cure = Cure(reading, upright, registration, depth_camera, left_out, kept)
    ordered = tuple(sorted(faults, key=lambda f: FAULTS.index(f.fault)))
    shown, doubt = exhibit(samples, diagnosis), diagnosis.contradictory
    return Report(recording.name, len(recording), ordered, tuple(notes), cure, shown, doubt)


def mend(recording: Recording, report: Report) -> Recording:
    """The recording as the report would have it; frames are mended when they are asked for.

    Raises InputError if nothing of what was found can be mended.
    """
    if report.cure is None or not report.cure.changes():
        names = ", ".join(f.fault for f in report.faults)
        raise InputError(
            f"{recording.name}: nothing to mend"
            + (f" by a program ({names}): {report.faults[0].mend}" if names else "")
        )
    return Mended(recording, report.cure, [f"mended by cartier doctor: {f.fault} ({f.mend})" for f in report.faults])


def _register(samples: Samples, diagnosis: Diagnosis, faults: list[Fault]) -> tuple[Registration | None, bool]:
    """Where the depth must go, and whether the intrinsics must go with it; adds the fault."""
    found = _checks.unregistered(samples)
    if found is None:
        return None, False
    fault, registration = found
    faults.append(fault)
    reading = diagnosis.reading
    moved = np.array([zoomed(d, registration.zoom, registration.dx, registration.dy) for d in samples.depth_m])
    there = replace(samples, depth_m=moved.reshape(samples.depth_m.shape).astype(np.float32))
    poses = reading.shifted(samples.poses, samples.index)
    scores = []
    for depth_camera in (False, True):
        cure = Cure(reading, registration=registration, depth_camera=depth_camera)
        camera = small_camera(samples, mended_camera(samples.camera, cure))
        scores.append(judge(there, poses, reading.depth_scale, camera).score)
    return registration, scores[1] > scores[0]


def _as_published(found: Registration, recording: Recording) -> bool:
    """Whether the depth lies beside the colour just as far as the format's own reader knows it to."""
    known = getattr(recording, "known_registration", None)
    if known is None:
        return False
    zoom, dx_px, dy_px = known
    width = recording.camera.width
    return bool(
        abs(found.zoom - zoom) <= 0.03 and max(abs(found.dx * width - dx_px), abs(found.dy * width - dy_px)) <= 8
    )


def _jump(samples: Samples, reading: Reading, faults: list[Fault]) -> tuple[tuple[int, int] | None, frozenset[int]]:
    """The longest piece without a jump, as first and last frame, and single frames that stand elsewhere; adds the fault."""
    poses = reading.shifted(samples.poses, samples.index)
    small = small_camera(samples, reading.camera(samples.camera))
    found = jumps(samples, poses, reading.depth_scale, small) if samples.has_depth else []
    fault = _checks.leaps(found)
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
    samples: Samples, diagnosis: Diagnosis, faults: list[Fault], level: npt.NDArray[np.float64]
) -> tuple[Reading, npt.NDArray[np.float64] | None]:
    """The reading with the best of the mirrors, and what levels its world; adds the fault where nothing else explains it."""
    reading = diagnosis.reading
    options = [reading]
    if any(f.fault == "left_handed" for f in diagnosis.faults) and reading.before is not None:
        options.append(replace(reading, before=SWAP_YZ))
    if samples.has_depth and not diagnosis.consistent:
        return reading, None
    small = small_camera(samples, reading.camera(samples.camera))
    tilts = [
        (option, _checks.tilt(samples, option.shifted(samples.poses, samples.index), option.depth_scale, small))
        for option in options
    ]
    judged = [(option, t) for option, t in tilts if t is not None]
    if not judged:
        return reading, None
    best, tilt = min(judged, key=lambda pair: pair[1].degrees)
    if not tilt.wrong:
        return best, None
    if all(f.fault in ("time_offset", "intrinsics_resolution", "depth_scale") for f in diagnosis.faults):
        how = "give the reader up=x,y,z, or turn the poses so that gravity points along -z and z = 0 is the floor"
        faults.append(Fault("not_level", tilt.words(), how))
    return best, tilt.level


def _undecided(diagnosis: Diagnosis) -> str:
    verdict = diagnosis.mended
    if not diagnosis.contradictory:
        return "too few frames share a view by their poses, so poses, scale and intrinsics could not be judged"
    return (
        f"overlapping frames disagree by {verdict.off_m:.2f} m and no reading of the numbers mends it: "
        "were depth, images and poses recorded by the same camera at the same time?"
    )
