"""Panorama behind the windows: a lawn, hedges and trees, a summer sky, drawn once from noise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

WIDTH, HEIGHT = 2048, 512
LOW, HIGH = -1.2, 1.8  # tangents of elevation from the lowest to the highest row


def outdoors(ways: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Colours (n, 3) of rays (n, 3) that leave the home."""
    rise = ways[:, 2] / (np.hypot(ways[:, 0], ways[:, 1]) + np.float32(1e-6))
    row = np.clip((rise - LOW) * (HEIGHT / (HIGH - LOW)), 0, HEIGHT - 1).astype(np.int32)
    col = (np.arctan2(ways[:, 1], ways[:, 0]) * np.float32(WIDTH / (2 * np.pi))).astype(np.int32) % WIDTH
    return _panorama()[row, col]


def _noise(rng: np.random.Generator, rows: float, cols: float) -> npt.NDArray[np.float64]:
    """Noise of deviation 1 that closes around the horizon, smooth over so many rows and columns."""
    field = gaussian_filter(rng.standard_normal((HEIGHT, WIDTH)), (rows, cols), mode=("nearest", "wrap"))
    return np.asarray(field / field.std())


@lru_cache(maxsize=1)
def _panorama() -> npt.NDArray[np.uint8]:
    rng = np.random.default_rng(5)
    rise = np.linspace(LOW, HIGH, HEIGHT)[:, None]
    up = np.clip(rise / 1.5, 0, 1)[..., None]
    cloud = np.clip(_noise(rng, 10, 60) * 0.7 + _noise(rng, 4, 14) * 0.25 - 0.5, 0, 1)[..., None]
    image = (1 - up) * np.array([233, 241, 247]) + up * np.array([150, 194, 234])
    image = image + 0.75 * cloud * (np.array([252, 252, 252]) - image)
    crowns, leaf, broad = _noise(rng, 60, 22)[0], _noise(rng, 1.2, 1.6), _noise(rng, 7, 9)
    for height, swell, tone in (
        (0.17, 0.055, (150, 172, 150)),
        (0.05, 0.045, (112, 144, 92)),
        (-0.06, 0.02, (92, 126, 74)),
    ):
        crowns = np.roll(crowns, 700)
        covered = rise < height + swell * crowns + 0.010 * leaf
        tree = np.array(tone) + (7 * leaf + 9 * broad)[..., None] * (1, 1, 0.8)
        image = np.where(covered[..., None], tree, image)
    lawn = np.array([150, 174, 106]) + (4 * leaf + 4 * broad)[..., None] - 25 * np.clip(-rise - 0.1, 0, 1)[..., None]
    image = np.where((rise < -0.14)[..., None], lawn, image)
    return np.asarray(np.clip(gaussian_filter(image, (0.7, 0.7, 0)), 0, 255), dtype=np.uint8)
