"""The doctor's other checks: what needs no second reading of the numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cartier.doctor._consistency import turns_deg
from cartier.doctor._edges import Registration, fits, registration
from cartier.doctor._jumps import Jump
from cartier.doctor._report import Fault
from cartier.doctor.sampling import Samples, is_mirror_fault
from cartier.errors import InputError
from cartier.mapping import gravity
from cartier.types import Array, Camera

BLURRED_PX, BLURRED_SHARE = 6.2, 0.2
LEAST_READ, LEAST_SPREAD_M = 0.01, 1e-6
EMPTY_SHARE = 0.1
FEW_VIEWS, APART_M, APART_DEG = 8, 0.04, 4.0
TILT_DEG, TILT_BLIND_DEG, FLOOR_M = 5.0, 35.0, 0.3
UP_SEEN = 0.5  # how long the mean of the world's up in the images must be to say how they lie
SHIFTED, CLEARER, OVER_NOISE = 0.015, 1.3, 5.0


def refused_poses(samples: Samples) -> list[Fault]:
    """Poses that a frame refused: no rotation at all, or a mirrored one."""
    mirrored = {i: e for i, e in samples.faults.items() if is_mirror_fault(e)}
    others = {i: e for i, e in samples.faults.items() if i not in mirrored}
    faults = []
    if mirrored:
        faults.append(
            Fault(
                "left_handed", _first_of(mirrored, samples),
                "mirror one axis of the world and one of the camera (Unity: swap y and z, change the sign of the camera's y)",
            )
        )  # fmt: skip
    if others:
        faults.append(
            Fault(
                "bad_rotation", _first_of(others, samples),
                "write unit quaternions in the order qx qy qz qw, or orthonormal 3x3 rotations without a scale; "
                "--fix leaves these frames out",
            )
        )  # fmt: skip
    return faults


def _first_of(errors: dict[int, InputError], samples: Samples) -> str:
    return f"{len(errors)} of {len(errors) + len(samples)} poses are no rigid motions; the first: {errors[min(errors)]}"


def empty_depth(samples: Samples) -> tuple[Fault | None, frozenset[int]]:
    """Depth that is black or constant, and the frames where it is."""
    if not samples.has_depth:
        return None, frozenset()
    black = samples.read < LEAST_READ
    flat = ~black & (samples.spread_m <= LEAST_SPREAD_M * np.nanmax(samples.depth_m, axis=(1, 2), initial=0))
    bad = black | flat
    if bad.mean() < EMPTY_SHARE:
        return None, frozenset()
    evidence = (
        f"{bad.sum()} of {len(samples)} frames hold no usable depth: {black.sum()} have readings in under 1% of their pixels, "
        f"{flat.sum()} the same depth everywhere"
    )
    mend = "check the depth topic or folder, and that depth is written as 16-bit PNG; --fix leaves these frames out"
    return Fault("no_depth", evidence, mend), frozenset(samples.index[bad].tolist())


def without_depth(samples: Samples, numbers: frozenset[int]) -> Samples:
    """The samples with the depth of some frames taken as not read."""
    bad = np.isin(samples.index, list(numbers))
    depth_m = np.where(bad[:, None, None], np.float32(np.nan), samples.depth_m)
    fine = [] if bad.all() else samples.fine
    return replace(samples, depth_m=depth_m, read=np.where(bad, 0.0, samples.read), has_depth=not bad.all(), fine=fine)


def blurred(samples: Samples) -> tuple[Fault | None, frozenset[int]]:
    """Frames whose sharpest edges are wide, and their numbers, if there are many."""
    known = samples.edge_px[np.isfinite(samples.edge_px)]
    if not known.size or (known > BLURRED_PX).mean() < BLURRED_SHARE:
        return None, frozenset()
    bad = np.nan_to_num(samples.edge_px) > BLURRED_PX
    evidence = (
        f"the sharpest edges are more than {BLURRED_PX:g} px wide in {bad.sum()} of {len(samples)} frames "
        f"(median {np.median(known):.1f} px; a sharp image has 1 to 5)"
    )
    mend = "clean and focus the lens, add light or a shorter exposure, move slower; --fix leaves the blurred frames out if at least half are sharp"
    return Fault("blur", evidence, mend), frozenset(samples.index[bad].tolist())


def views(poses: Array) -> int:
    """How many different viewpoints there are among poses (N, 4, 4), counted up to 50."""
    kept: list[Array] = []
    for pose in poses:
        others = np.array(kept).reshape(-1, 4, 4)
        way = np.linalg.norm(others[:, :3, 3] - pose[:3, 3], axis=1)
        turn = turns_deg(np.swapaxes(others[:, :3, :3], 1, 2) @ pose[:3, :3])
        if not ((way < APART_M) & (turn < APART_DEG)).any():
            kept.append(pose)
        if len(kept) >= 50:
            break
    return len(kept)


def few_views(samples: Samples) -> Fault | None:
    there = views(samples.poses)
    if there >= FEW_VIEWS:
        return None
    evidence = (
        f"{samples.length} frames from {there} different viewpoints ({APART_M * 100:g} cm or {APART_DEG:g}° apart)"
    )
    mend = f"record at least {FEW_VIEWS} overlapping views; walk round each room and look at everything from two sides"
    return Fault("too_few_views", evidence, mend)


@dataclass(frozen=True, eq=False)
class Tilt:
    """How the world stands: ``degrees`` between its z and up, the floor's height, and the transform that mends both.

    ``blind`` says that no horizontal surface was seen, ``floor_seen`` that the floor's height was.
    """

    degrees: float
    floor_m: float
    blind: bool
    floor_seen: bool
    level: npt.NDArray[np.float64]

    @property
    def wrong(self) -> bool:
        tilted = self.degrees > (TILT_BLIND_DEG if self.blind else TILT_DEG)
        return tilted or (self.floor_seen and abs(self.floor_m) > FLOOR_M)

    def words(self) -> str:
        what = "by the cameras' own up" if self.blind else "by the horizontal surfaces"
        floor = f", and the floor lies at {self.floor_m:.2f} m" if self.floor_seen else ""
        return f"z leans {self.degrees:.1f}° away from up {what}{floor}"


def tilt(samples: Samples, poses: Array, scale: float, small: Camera) -> Tilt | None:
    """How the world of poses (M, 4, 4) stands, by the floor and other flat things; None if it cannot be said."""
    known = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    if not len(known):
        return None
    depth = (lambda i: samples.depth_m[known[i]] * np.float32(scale)) if samples.has_depth else None
    try:
        found = gravity.level(poses[known], small, depth)
    except InputError:  # cameras in every position: up cannot be guessed
        return None
    up_note, floor_note = found.notes
    degrees = float(np.degrees(np.arccos(np.clip(found.up[2], -1, 1))))
    seen = "estimated" in floor_note and "was the floor in view" not in floor_note
    return Tilt(degrees, found.floor_m, "the cameras alone" in up_note, seen, found.level_from_world)


def rotated(poses: Array) -> int:
    """How many quarter turns to the left bring the images of level poses (M, 4, 4) upright; 0 where most look straight down or up."""
    up_in_image = np.nanmean(poses[:, 2, :2], axis=0)
    return gravity.quarter_turns(up_in_image) if np.linalg.norm(up_in_image) > UP_SEEN else 0


def lying(turns: int) -> Fault:
    evidence = f"by the poses the pictures {gravity.LYING[turns]}, up is {180 if turns == 2 else 90}° off in them: few things are recognised so"
    by = ("", "90° to the left", "180°", "90° to the right")[turns]
    mend = f"turn pictures, depth, intrinsics and camera axes by {by}, and leave the world as it is; --fix does"
    return Fault("rotated_images", evidence, mend)


def unregistered(samples: Samples, doubts: list[str]) -> tuple[Fault, Registration] | None:
    """Depth whose edges lie beside those of the colour. Every other image chooses where it must go, the rest test it."""
    chosen, others = samples.fine[::2], samples.fine[1::2]
    found = registration(chosen)
    if found is None or found.corner_shift() < SHIFTED:
        return None
    if found.fit < OVER_NOISE * found.noise or found.fit < CLEARER * found.fit_as_given:
        return None
    fit, fit_as_given = fits(others, found) if others else (0.0, 0.0)
    width = samples.camera.width
    evidence = (
        f"the edges of the depth lie on those of the colour if it is zoomed by {found.zoom:.2f} and moved by "
        f"({found.dx * width:+.0f}, {found.dy * width:+.0f}) px: correlation {fit:.2f} there, {fit_as_given:.2f} as given"
    )
    if fit < OVER_NOISE * found.noise or fit < CLEARER * fit_as_given:
        doubts.append(f"depth_not_registered? --fix leaves it, for frames that did not suggest it deny it: {evidence}")
        return None
    mend = "record depth registered (aligned) to colour, or warp it so; --fix zooms and moves it"
    return Fault("depth_not_registered", evidence, mend), found


def leaps(found: list[Jump]) -> Fault | None:
    if not found:
        return None
    worst = max(found, key=lambda j: j.way_m + j.turn_deg / 50)
    evidence = (
        f"{len(found)} jump{'s' if len(found) > 1 else ''}; the largest from frame {worst.before} to {worst.after}: the pose "
        f"leaps {worst.way_m:.2f} m and {worst.turn_deg:.0f}°, but the depth agrees better without "
        f"({worst.without:.2f} against {worst.agreement:.2f})"
    )
    mend = "run the tracking again with loop closure, or cut the recording there; --fix leaves out single stray frames and keeps the longest piece without a jump"
    return Fault("pose_jump", evidence, mend)
