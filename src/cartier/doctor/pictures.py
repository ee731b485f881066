"""Checks of a stream's pictures: black, frozen, grey, colours or sides swapped against depth, made-up readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from cartier.doctor._report import Fault
from cartier.recordings.common.edges import Registration, fits
from cartier.types import Array, Frame

MOST = 24  # pictures that are looked at
BLACK, FLAT = 10.0, 2.0  # of 255: a brightest hundredth, and a spread below which a picture shows nothing
SHARE = 0.5  # of the pictures, from which on it is a fault
MOVED_M, MOVED_COS = 0.03, float(np.cos(np.radians(2.0)))
GREY, COLOURED, COLD = 3, 40, 20  # of 255: between channels at most, between them in strong colours, blue above red
COLOURED_SHARE, COLD_SHARE = (
    0.03,
    0.7,
)  # real rooms: 0.02 to 0.19 of what is strongly coloured is blue, swapped the rest
AS_GIVEN = Registration(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
FITS, BETTER = 0.04, 3.0  # real rooms: edges correlate by 0.05 to 0.21 as they should, below 0.04 otherwise
FAR_SHARE, FAR_ALIKE = 0.03, 0.33  # of the pixels at exactly the farthest depth, in so many of the pictures
FINE_WIDTH = 320
CHANGED = 0.06  # mean change of the grey values, of 1, that a still camera does not show
SIDES: dict[str, Callable[[Array], Array]] = {
    "upside down": lambda grey: grey[::-1],
    "turned by 180°": lambda grey: grey[::-1, ::-1],
    "mirrored": lambda grey: grey[:, ::-1],
}


def picture_faults(frames: Sequence[Frame]) -> Iterator[Fault]:
    """What is wrong with the pictures of these frames, which are in the order of time.

    A fault of a sort that hides others comes alone.
    """
    some = frames[:: max(1, -(-len(frames) // MOST))]
    small = np.array([frame.rgb[::8, ::8] for frame in some]).astype(np.int16)
    black = [(np.percentile(rgb, 99) < BLACK) or (rgb.std() < FLAT) for rgb in small]
    if np.mean(black) > SHARE:
        evidence = f"{sum(black)} of {len(some)} pictures are black, or of one colour"
        yield Fault("black", evidence, "take off the lens cap, add light, or set the exposure")
        return
    if len(frames) > 2 and (frozen := _frozen(frames)) > SHARE:
        evidence = f"the camera moves, and in {frozen:.0%} of its steps the picture stays the same to the last pixel"
        yield Fault("frozen", evidence, "restart the camera's driver: it sends its last picture again")
        return
    yield from _colours(small)
    yield from _sides(some)
    yield from _no_reading(some)


def pictures_change(frames: Sequence[Frame]) -> bool:
    """Whether the pictures show that the camera moves."""
    grey = np.array([frame.rgb[::16, ::16].mean(axis=2) / 255 for frame in frames])
    return len(grey) > 1 and float(np.abs(grey - np.median(grey, axis=0)).mean(axis=(1, 2)).max()) > CHANGED


def _frozen(frames: Sequence[Frame]) -> float:
    """The share of steps of a moving camera in which the picture does not change."""
    same = list[bool]()
    for one, two in pairwise(frames):
        a, b = one.world_from_camera, two.world_from_camera
        cosine = (float(np.sum(a[:3, :3] * b[:3, :3])) - 1) / 2
        if np.linalg.norm(a[:3, 3] - b[:3, 3]) > MOVED_M or cosine < MOVED_COS:
            same.append(bool(np.array_equal(one.rgb[::4, ::4], two.rgb[::4, ::4])))
    return float(np.mean(same)) if len(same) > 2 else 0.0


def _colours(small: Array) -> Iterator[Fault]:
    spread = small.max(axis=-1) - small.min(axis=-1)
    if (spread <= GREY).mean() > 0.999:
        evidence = "red, green and blue are the same in all pictures: they are grey, as an infrared camera's are"
        yield Fault("grey", evidence, "name the topic of the colour camera: --colour TOPIC")
        return
    coloured = spread > COLOURED
    bluer = small[..., 2] - small[..., 0]
    warm, cold = (float((coloured & (side > COLD)).mean()) for side in (-bluer, bluer))
    if warm + cold > COLOURED_SHARE and cold > COLD_SHARE * (warm + cold):
        evidence = (
            f"of what is strongly coloured, {cold / (warm + cold):.0%} is bluer than red; in homes that is under 20%"
        )
        yield Fault(
            "colours_swapped", f"{evidence}: red and blue are swapped", "let the encoding say rgb8 or bgr8 as it is"
        )


def _sides(frames: Sequence[Frame]) -> Iterator[Fault]:
    """Pictures whose edges lie on those of the depth only if they are turned; half of them choose, half test."""
    fine = [pair for frame in frames if (pair := _fine(frame)) is not None]
    halves = fine[::2], fine[1::2]
    if not halves[1]:
        return
    given = [fits(half, AS_GIVEN)[1] for half in halves]
    for how, turned in SIDES.items():
        found = [fits([(turned(grey), depth_m) for grey, depth_m in half], AS_GIVEN)[1] for half in halves]
        if all(f > FITS + max(g, 0.0) and f > BETTER * g for f, g in zip(found, given, strict=True)):
            evidence = (
                f"the edges of the depth lie on those of the colour if that is {how}: correlation {found[1]:.2f}, "
                f"{given[1]:.2f} as given"
            )
            mend = "turn or mirror colour and depth alike: one of the two drivers has an option for it"
            yield Fault("turned_pictures", evidence, mend)
            return


def _fine(frame: Frame) -> tuple[Array, Array] | None:
    if frame.depth_m is None:
        return None
    step = max(1, frame.camera.width // FINE_WIDTH)
    depth_m = np.array(frame.depth_m[::step, ::step], np.float32)
    depth_m[~(depth_m > 0)] = np.nan
    return frame.rgb[::step, ::step, 1].astype(np.float32) / 255, depth_m


def _no_reading(frames: Sequence[Frame]) -> Iterator[Fault]:
    """A farthest depth that is the same in many pictures, and that many of their pixels have exactly."""
    maps = [frame.depth_m[::2, ::2] for frame in frames if frame.depth_m is not None]
    known = [depth_m[np.isfinite(depth_m)] for depth_m in maps]
    farthest = [float(values.max()) for values in known if values.size]
    if not farthest:
        return
    far_m = max(set(farthest), key=farthest.count)
    at_it = np.array([float((values == np.float32(far_m)).mean()) if values.size else 0.0 for values in known])
    many = at_it > FAR_SHARE
    if far_m > 0 and many.mean() > FAR_ALIKE:
        evidence = (
            f"{np.median(at_it[many]):.0%} of the depth is exactly {far_m:g} m, its farthest, in {many.sum()} of "
            f"{len(many)} pictures"
        )
        mend = "send 0 or NaN where there is no reading; as it is, walls are mapped where nothing was measured"
        yield Fault("no_reading_far", evidence, mend)
