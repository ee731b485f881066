"""Colour naming: the eleven basic colour terms (Berlin and Kay 1969) of RGB values and of objects' surfaces."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cartier.types import Array

COLOURS = ("black", "grey", "white", "red", "orange", "yellow", "green", "blue", "purple", "pink", "brown")
LEVELS = 32  # per channel of the table
MIN_NAMED_SHARE = 0.12  # of the surface; colours with less are not named
MAX_NAMED = 3  # colours


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
    """The number of the colour of each of 32 x 32 x 32 RGB values, by hue, chroma and lightness in CIE L*a*b*."""
    level = (np.arange(LEVELS) + 0.5) / LEVELS
    srgb = np.stack(np.meshgrid(level, level, level, indexing="ij"), -1).reshape(-1, 3)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = linear @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    f = np.cbrt(xyz / (0.9505, 1.0, 1.089))
    f = np.where(f > 6 / 29, f, (xyz / (0.9505, 1.0, 1.089)) / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness, a, b = 116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])
    chroma, hue = np.hypot(a, b), np.degrees(np.arctan2(b, a)) % 360
    edges = (20.0, 48.0, 75.0, 110.0, 190.0, 285.0, 325.0, 350.0)  # red, orange, yellow, green, blue, purple, pink, red
    names = np.array(["red", "red", "orange", "yellow", "green", "blue", "purple", "pink", "red"])
    found = names[np.searchsorted(edges, hue)].astype("<U6")
    warm = (hue < 85) | (hue > 350)
    found[warm & (hue > 30) & (lightness < 55)] = "brown"
    found[warm & (hue >= 48) & (chroma < 32) & (lightness < 72)] = "brown"
    found[(found == "red") & (lightness > 65)] = "pink"
    found[(found == "red") & (lightness < 22)] = "brown"
    grey = chroma < 9 + 4 * (lightness > 80)
    found[grey & (lightness < 25)] = "black"
    found[(lightness < 14) & (chroma < 20)] = "black"
    found[grey & (lightness >= 25) & (lightness < 82)] = "grey"
    found[grey & (lightness >= 82)] = "white"
    number = {name: n for n, name in enumerate(COLOURS)}
    return np.array([number[str(name)] for name in found], np.uint8)
