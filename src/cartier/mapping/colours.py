"""Colour naming: the eleven basic colour terms (Berlin and Kay 1969) of white-balanced RGB values, by prototypes."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cartier.types import Array

COLOURS = ("black", "grey", "white", "red", "orange", "yellow", "green", "blue", "purple", "pink", "brown")
LEVELS = 32  # per channel of the table
MIN_NAMED_SHARE = 0.12  # of the surface; colours with less are not named
MAX_NAMED = 3  # colours

PROTOTYPES = {
    "black": ((15, 0, 1), (7, -2, 1)),
    "grey": ((32, 1, 3), (58, 2, 2), (46, 2, 3)),
    "white": ((75, 0, 7), (89, 1, 4), (81, 0, 4)),
    "red": ((27, 51, 41), (16, 38, 12), (29, 49, 28)),
    "orange": ((50, 38, 54), (68, 24, 52), (47, 27, 48)),
    "yellow": ((59, -3, 63), (66, -4, 51), (88, -8, 58)),
    "green": ((49, -22, 53), (54, -42, 32), (23, -19, 20), (81, -34, 36), (52, -25, 30)),
    "blue": ((36, -9, -14), (22, 11, -39), (77, -44, 0), (76, -16, -3)),
    "purple": ((39, 19, -9), (34, 42, -27), (16, 33, -14), (70, 24, -18)),
    "pink": ((62, 24, 8), (68, 40, 16), (58, 52, -6)),
    "brown": ((38, 8, 51), (48, 7, 22), (71, 2, 34), (20, 7, 14), (24, 14, 36)),
}
"""CIE L*a*b* of what has a name, as it looks in a home's light: the nearest names a pixel.

Fitted on the chips of the xkcd colour survey (2010, CC0) under the lights of generated dollhouse homes
(tools/fit_colours.py; of several fits the one that was right most often in those homes). A white thing indoors is L* 75
to 90.
"""
LIGHTNESS_WEIGHT = 0.7  # of L* in the distance: one surface varies more in lightness than in hue


def named_shares(weights: Array) -> tuple[tuple[str, float], ...]:
    """The main colours (name, share) of an object by their weights (11,), largest first; () without any."""
    total = float(weights.sum())
    if total <= 0:
        return ()
    shares = weights / total
    largest = [int(i) for i in np.argsort(-shares, kind="stable")[:MAX_NAMED]]
    return tuple(
        (COLOURS[i], round(float(shares[i]), 3)) for i in largest if shares[i] >= MIN_NAMED_SHARE or i == largest[0]
    )


@cache
def colour_table() -> npt.NDArray[np.uint8]:
    """The number of the colour of each of 32 x 32 x 32 RGB values: the name of the nearest prototype."""
    level = (np.arange(LEVELS) + 0.5) / LEVELS
    srgb = np.stack(np.meshgrid(level, level, level, indexing="ij"), -1).reshape(-1, 3)
    prototypes = np.array([lab for name in COLOURS for lab in PROTOTYPES[name]])
    numbers = np.repeat(np.arange(len(COLOURS)), [len(PROTOTYPES[name]) for name in COLOURS])
    scale, seen = np.array((LIGHTNESS_WEIGHT, 1, 1)), lab_of(srgb)
    away = np.square(prototypes * scale).sum(1) - 2 * seen * scale @ (prototypes * scale).T  # squared, less seen's own
    return np.asarray(numbers[away.argmin(1)], np.uint8)


def lab_of(srgb: Array) -> Array:
    """CIE L*a*b* (N, 3), D65, of sRGB values (N, 3) of 0 to 1."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = linear @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    xyz /= (0.9505, 1.0, 1.089)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)
