"""Single checks: refused poses, empty depth, blur, viewpoints, tilt, rotated images, registration, pose jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cartier.doctor._consistency import turns_deg
from cartier.doctor._pose_jumps import PoseJump
from cartier.doctor._report import Fault
from cartier.errors import InputError
from cartier.mapping import gravity
from cartier.mapping.samples import Samples, is_mirror_fault
from cartier.mapping.upright import FLOOR_OFF_M, TURNED_BY, Z_UP
from cartier.recordings.common.edges import Registration, fits, registration
from cartier.types import Array, Camera

BLURRED_PX, BLURRED_SHARE = 6.2, 0.2
LEAST_READ, LEAST_SPREAD_M = 0.01, 1e-6
EMPTY_SHARE = 0.1
MIN_VIEWS, APART_M, APART_DEG = 8, 0.04, 4.0
TILT_DEG = 5.0
PLAUSIBLE_M = (0.15, 20.0)  # the median depth of a home
FIELD_OF_VIEW_DEG = (20.0, 140.0)
OFF_CENTRE, UNEQUAL = 0.2, 0.25  # of the image's side; of the focal lengths
SHIFTED, CLEARER, OVER_NOISE = 0.015, 1.3, 5.0
UNMIRROR = "mirror one axis of the world and one of the camera (Unity: swap y and z, change the sign of the camera's y)"


def refused_poses(samples: Samples) -> list[Fault]:
    """Poses that a frame refused: no rotations, or mirrored ones."""
    mirrored = {i: e for i, e in samples.faults.items() if is_mirror_fault(e)}
    others = {i: e for i, e in samples.faults.items() if i not in mirrored}
    faults = [Fault("left_handed", _first_of(mirrored, samples), UNMIRROR)] if mirrored else []
    return faults + ([bad_rotation(_first_of(others, samples), "leaves these frames out")] if others else [])


def bad_rotation(evidence: str, fix: str = "") -> Fault:
    """The fault of poses that are no rotations; ``fix`` is what ``--fix`` does about it."""
    how = "write unit quaternions in the order qx qy qz qw, or orthonormal 3x3 rotations without a scale"
    return Fault("bad_rotation", evidence, how, fix)


def _first_of(errors: dict[int, InputError], samples: Samples) -> str:
    return f"{len(errors)} of {len(errors) + len(samples)} poses are no rigid motions; the first: {errors[min(errors)]}"


def lens(camera: Camera) -> tuple[Fault | None, str]:
    """Intrinsics that no camera of a home has, and the lens in words."""
    c = camera
    across, high = (np.degrees(2 * np.arctan(side / 2 / f)) for side, f in ((c.width, c.fx), (c.height, c.fy)))
    told = f"{c.width}x{c.height}, {across:.0f}° by {high:.0f}°, centre at ({c.cx:.0f}, {c.cy:.0f})"
    off = max(abs(c.cx / c.width - 0.5), abs(c.cy / c.height - 0.5)) > OFF_CENTRE
    unequal = abs(c.fx / c.fy - 1) > UNEQUAL
    if off or unequal or not all(FIELD_OF_VIEW_DEG[0] <= side <= FIELD_OF_VIEW_DEG[1] for side in (across, high)):
        how = "give the intrinsics of these images: the same camera, resolution and crop"
        return Fault("lens", f"the intrinsics do not fit the images: {told}", how), told
    return None, told


def depth_unit(depth_m: Array) -> Fault | None:
    """Depth (M, h, w) whose median no home has."""
    known = depth_m[np.isfinite(depth_m)]
    median_m = float(np.median(known)) if known.size else 1.0
    if PLAUSIBLE_M[0] <= median_m <= PLAUSIBLE_M[1]:
        return None
    return Fault("depth_unit", f"half of the depth is beyond {median_m:.3g} m", "16UC1 holds millimetres, 32FC1 metres")


def empty_depth(samples: Samples) -> tuple[Fault | None, frozenset[int]]:
    """Depth images that are empty or constant, and the numbers of these frames."""
    if not samples.has_depth:
        return None, frozenset()
    black = samples.valid_share < LEAST_READ
    flat = ~black & (samples.spread_m <= LEAST_SPREAD_M * np.nanmax(samples.depth_m, axis=(1, 2), initial=0))
    bad = black | flat
    if bad.mean() < EMPTY_SHARE:
        return None, frozenset()
    evidence = (
        f"{bad.sum()} of {len(samples)} frames hold no usable depth: in {black.sum()} under 1% of the pixels have any, "
        f"in {flat.sum()} all have the same"
    )
    how = "check the depth topic or folder, and that depth is written as 16-bit PNG"
    return Fault("no_depth", evidence, how, "leaves these frames out"), frozenset(samples.index[bad].tolist())


def without_depth(samples: Samples, numbers: frozenset[int]) -> Samples:
    """The samples without the depth of some frames."""
    bad = np.isin(samples.index, list(numbers))
    depth_m = np.where(bad[:, None, None], np.float32(np.nan), samples.depth_m)
    fine = [] if bad.all() else samples.fine
    return replace(
        samples,
        depth_m=depth_m,
        valid_share=np.where(bad, 0.0, samples.valid_share),
        has_depth=not bad.all(),
        fine=fine,
    )


def blurred(samples: Samples) -> tuple[Fault | None, frozenset[int]]:
    """Frames whose sharpest edges are wide, if there are many, and their numbers."""
    known = samples.edge_px[np.isfinite(samples.edge_px)]
    if not known.size or (known > BLURRED_PX).mean() < BLURRED_SHARE:
        return None, frozenset()
    bad = np.nan_to_num(samples.edge_px) > BLURRED_PX
    evidence = (
        f"the sharpest edges are more than {BLURRED_PX:g} px wide in {bad.sum()} of {len(samples)} frames "
        f"(median {np.median(known):.1f} px; a sharp image has 1 to 5)"
    )
    how = "clean and focus the lens, add light or shorten the exposure, move slower"
    fix = "leaves the blurred frames out if at least half are sharp"
    return Fault("blur", evidence, how, fix), frozenset(samples.index[bad].tolist())


def views(poses: Array) -> int:
    """The number of different viewpoints among poses (N, 4, 4), counted up to 50."""
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
    """A recording with too few different viewpoints."""
    count = views(samples.poses)
    if count >= MIN_VIEWS:
        return None
    apart = f"({APART_M * 100:g} cm or {APART_DEG:g}° apart)"
    how = f"record at least {MIN_VIEWS} overlapping views; walk round each room and view everything from two sides"
    return Fault("too_few_views", f"{samples.length} frames from {count} different viewpoints {apart}", how)


@dataclass(frozen=True, eq=False)
class Tilt:
    """Tilt of the world: ``degrees`` between z and up, the height of the floor, and ``level``, which corrects both.

    ``floor_seen``: the floor was in view.
    """

    degrees: float
    floor_m: float
    floor_seen: bool
    level: npt.NDArray[np.float64]

    @property
    def wrong(self) -> bool:
        """Whether the world has to be levelled."""
        return self.degrees > TILT_DEG or (self.floor_seen and abs(self.floor_m) > FLOOR_OFF_M)

    def words(self) -> str:
        """The tilt as evidence of the fault."""
        floor = f", and the floor lies at {self.floor_m:.2f} m" if self.floor_seen else ""
        return f"z leans {self.degrees:.1f}° away from up by the horizontal surfaces{floor}"


def tilt(samples: Samples, poses: Array, scale: float, small: Camera) -> Tilt | None:
    """The tilt of the world of poses (M, 4, 4), by horizontal surfaces; None if there is no pose."""
    known = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    if not len(known):
        return None
    depth = (lambda i: samples.depth_m[known[i]] * np.float32(scale)) if samples.has_depth else None
    found = gravity.level(poses[known], small, depth, documented_up=Z_UP)
    degrees = float(np.degrees(np.arccos(np.clip(found.up[2], -1, 1))))
    return Tilt(degrees, found.floor_m, found.floor_seen, found.level_from_world)


def rotated(poses: Array) -> int:
    """Quarter turns to the left that bring the images of level poses (M, 4, 4) upright; 0 if most look down or up."""
    return gravity.turned(poses[np.isfinite(poses[:, 0, 0])], np.array(Z_UP))


def lying(turns: int) -> Fault:
    """Images that are turned by quarter turns."""
    off = f"up is {180 if turns == 2 else 90}° off in them"
    evidence = f"by the poses the images {gravity.LYING[turns]}, {off}: few objects are detected in such images"
    how = f"turn images, depth, intrinsics and camera axes by {TURNED_BY[turns]}, and leave the world as it is"
    return Fault("rotated_images", evidence, how, "does so")


def unregistered(samples: Samples, doubts: list[str]) -> tuple[Fault, Registration] | None:
    """Depth whose edges do not lie on those of the colour. Half of the images choose a registration, half test it."""
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
        f"({found.dx * width:+.0f}, {found.dy * width:+.0f}) px: correlation {fit:.2f}, {fit_as_given:.2f} as given"
    )
    if fit < OVER_NOISE * found.noise or fit < CLEARER * fit_as_given:
        doubts.append(f"depth_not_registered? It is left as it is, for other frames contradict that: {evidence}")
        return None
    how = "record depth registered (aligned) to colour, or warp it accordingly"
    return Fault("depth_not_registered", evidence, how, "zooms and moves it"), found


def jumping(found: list[PoseJump]) -> Fault | None:
    """Poses that jump."""
    if not found:
        return None
    worst = max(found, key=lambda j: j.way_m + j.turn_deg / 50)
    evidence = (
        f"{len(found)} jump{'s' if len(found) > 1 else ''}; the largest from frame {worst.before} to {worst.after}: "
        f"the pose moves by {worst.way_m:.2f} m and {worst.turn_deg:.0f}°, but the depth agrees better without "
        f"({worst.without:.2f} against {worst.agreement:.2f})"
    )
    how = "run the tracking again with loop closure, or cut the recording there"
    fix = "leaves out single stray frames and keeps the longest piece without a jump"
    return Fault("pose_jump", evidence, how, fix)
