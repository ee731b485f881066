"""The colours of objects by the eleven names that people use (Berlin and Kay 1969), from the pixels of their surfaces."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cartier.types import Array

COLOURS = ("black", "grey", "white", "red", "orange", "yellow", "green", "blue", "purple", "pink", "brown")
LEVELS = 32  # per channel of the table
SHARE = 0.12  # of the surface under which a colour goes unnamed
MOST = 3  # colours that are named


def colour_shares(rgb: npt.NDArray[np.uint8], pixels: npt.NDArray[np.intp], own: npt.NDArray[np.bool_]) -> Array:
    """For N objects the share (N, 11) of each colour among their ``own`` (N, K) of the ``pixels`` (N, K), flat into ``rgb`` (H, W, 3)."""
    values = rgb.reshape(-1, 3)[pixels] >> 3
    index = (values[..., 0].astype(np.intp) * LEVELS + values[..., 1]) * LEVELS + values[..., 2]
    names = _table()[index] + np.arange(len(pixels))[:, None] * len(COLOURS)
    counts = np.bincount(names[own], minlength=len(pixels) * len(COLOURS)).reshape(len(pixels), len(COLOURS))
    return np.asarray(counts / np.maximum(counts.sum(1, keepdims=True), 1))


def named_shares(weights: Array) -> tuple[tuple[str, float], ...]:
    """The colours (name, share) that make up an object, the largest first; () where no pixel was seen."""
    total = float(weights.sum())
    if total <= 0:
        return ()
    shares = weights / total
    largest = [int(i) for i in np.argsort(-shares, kind="stable")[:MOST]]
    return tuple((COLOURS[i], round(float(shares[i]), 3)) for i in largest if shares[i] >= SHARE or i == largest[0])


@cache
def _table() -> npt.NDArray[np.uint8]:
    """The colour's number for each of 32 x 32 x 32 values of red, green and blue, by hue, chroma and lightness in CIE L*a*b*."""
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
