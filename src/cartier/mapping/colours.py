"""Colour naming: the eleven basic colour terms (Berlin and Kay 1969) of white-balanced RGB values, by prototypes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from cartier.types import Array

COLOURS = ("black", "grey", "white", "red", "orange", "yellow", "green", "blue", "purple", "pink", "brown")
LEVELS = 32  # per channel of the table
MIN_NAMED_SHARE = 0.12  # of the surface; colours with less are not named
MAX_NAMED = 3  # colours

PROTOTYPES = {
    "black": ((14, 0, 1), (8, -2, 0)),
    "grey": ((48, 2, 2), (33, 1, 2), (56, 2, 3)),
    "white": ((74, 1, 9), (88, 1, 5), (79, 0, 4)),
    "red": ((29, 46, 23), (27, 52, 41), (8, 30, 11)),
    "orange": ((65, 28, 55), (51, 38, 52), (47, 26, 47)),
    "yellow": ((59, -3, 52), (63, -2, 64), (85, -8, 59)),
    "green": ((31, -20, 23), (45, -20, 49), (54, -40, 31), (64, -32, 56), (74, -31, 31)),
    "blue": ((77, -17, -3), (38, -9, -14), (22, 9, -36), (79, -43, 0)),
    "purple": ((37, 19, -10), (31, 48, -29), (13, 32, -13), (67, 23, -17)),
    "pink": ((59, 56, -10), (63, 25, 7), (65, 47, 9)),
    "brown": ((15, 9, 12), (47, 6, 23), (25, 15, 38), (29, 6, 38), (78, 0, 33)),
}
"""CIE L*a*b* of what has a name, as it looks in a home's light: the nearest names a pixel.

Fitted on the chips of the xkcd colour survey (2010, CC0) under the lights of generated dollhouse homes
(tools/fit_colours.py; of 80 fits the one that was right most often in those homes). A white thing indoors is L* 75
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
    return table_of(PROTOTYPES)


def table_of(named: Mapping[str, Sequence[Sequence[float]]]) -> npt.NDArray[np.uint8]:
    """The table by other prototypes: of each of the eleven names its CIE L*a*b* values."""
    level = (np.arange(LEVELS) + 0.5) / LEVELS
    srgb = np.stack(np.meshgrid(level, level, level, indexing="ij"), -1).reshape(-1, 3)
    prototypes = np.array([lab for name in COLOURS for lab in named[name]])
    numbers = np.repeat(np.arange(len(COLOURS)), [len(named[name]) for name in COLOURS])
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
