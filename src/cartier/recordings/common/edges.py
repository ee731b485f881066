"""Registration of depth to colour: by how much depth edges must be zoomed and moved to lie on colour edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from cartier.types import Array, Camera

EDGE_STEP = 0.06  # relative step of depth that counts as an edge
REACH = 32  # px of the fine images: the largest shift that is tried
ZOOMS = (0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25)


@dataclass(frozen=True)
class Registration:
    """How to register depth to colour: zoom it by ``zoom`` about the middle, then move it by ``dx``, ``dy``.

    The shifts are in image widths. ``fit`` and ``fit_as_given`` correlate depth edges with colour edges, registered and
    as given; ``noise`` is the standard deviation of that correlation over all shifts.
    """

    zoom: float
    dx: float
    dy: float
    fit: float
    fit_as_given: float
    noise: float

    def corner_shift(self) -> float:
        """The largest shift of a corner of a 4:3 image, in image widths."""
        return float(np.hypot(abs(self.zoom - 1) * 0.5 + abs(self.dx), abs(self.zoom - 1) * 0.375 + abs(self.dy)))

    def register(self, depth_m: Array) -> Array:
        """A depth image (H, W) registered to its colour image."""
        return zoomed(depth_m, self.zoom, self.dx, self.dy)

    def camera(self, depth_camera: Camera) -> Camera:
        """The camera of a depth camera's images once they are registered."""
        c = depth_camera
        middle_x, middle_y = (c.width - 1) / 2, (c.height - 1) / 2
        return replace(
            c, fx=c.fx * self.zoom, fy=c.fy * self.zoom,
            cx=(c.cx - middle_x) * self.zoom + middle_x + self.dx * c.width,
            cy=(c.cy - middle_y) * self.zoom + middle_y + self.dy * c.width,
        )  # fmt: skip


def registration(images: Sequence[tuple[Array, Array]]) -> Registration | None:
    """Find the registration by edges, from (grey, depth) images of the same size; None without edges."""
    colour = [_Spectrum.of(_colour_edges(grey)) for grey, _ in images]
    filled = [_filled(depth) for _, depth in images]
    if not images:
        return None
    width = images[0][0].shape[1]
    as_given = _correlation(colour, filled, 1.0)
    tried = {1.0: as_given}
    tried |= {zoom: _correlation(colour[::2], filled[::2], zoom) for zoom in ZOOMS if zoom != 1}
    coarse = max(tried, key=lambda z: float(tried[z].max()))
    for zoom in (coarse + step / 100 for step in range(-4, 5) if step):
        tried[round(zoom, 2)] = _correlation(colour[::2], filled[::2], zoom)
    best = max(tried, key=lambda z: float(tried[z].max()))
    field = as_given if best == 1 else _correlation(colour, filled, best)
    row, col = np.unravel_index(int(field.argmax()), field.shape)
    noise = float(field.std())
    if noise == 0:
        return None
    middle = float(as_given[REACH, REACH])
    return Registration(best, (int(col) - REACH) / width, (int(row) - REACH) / width, float(field.max()), middle, noise)


def fits(images: Sequence[tuple[Array, Array]], found: Registration) -> tuple[float, float]:
    """The correlation of edges in other images of that size: registered, and as given."""
    colour = [_Spectrum.of(_colour_edges(grey)) for grey, _ in images]
    filled = [_filled(depth) for _, depth in images]
    width = images[0][0].shape[1]
    row, col = REACH + round(found.dy * width), REACH + round(found.dx * width)
    there = _correlation(colour, filled, found.zoom)[row, col]
    return float(there), float(_correlation(colour, filled, 1.0)[REACH, REACH])


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """The transform of an image of edges less its mean, padded to ``shape``, and its norm."""

    transform: Array
    shape: tuple[int, ...]
    norm: np.floating[Any]

    @classmethod
    def of(cls, edges: Array) -> _Spectrum:
        shape = tuple(next_fast_len(n + REACH, real=True) for n in edges.shape)
        level = edges - edges.mean()
        return cls(rfft2(level, shape), shape, np.linalg.norm(level))


def _correlation(colour: Sequence[_Spectrum], depth: Sequence[Array], zoom: float) -> Array:
    """Mean normalised correlation (2 REACH + 1, same) of colour edges with those of the zoomed depth, by shift."""
    total = np.zeros((2 * REACH + 1, 2 * REACH + 1))
    for a, z in zip(colour, depth, strict=True):
        e = _depth_edges(z if zoom == 1 else zoomed(z, zoom))
        if not e.any():
            continue
        b = _Spectrum.of(e)
        product = irfft2(a.transform * np.conj(b.transform), a.shape)
        near = np.concatenate([product[-REACH:], product[: REACH + 1]])
        near = np.concatenate([near[:, -REACH:], near[:, : REACH + 1]], axis=1)
        total += near / max(float(a.norm * b.norm), 1e-9)
    return total / max(len(colour), 1)


def zoomed(image: Array, zoom: float, dx: float = 0.0, dy: float = 0.0) -> Array:
    """A float image (H, W) zoomed about its middle, then moved by dx, dy (in widths); nearest pixel, NaN outside."""
    height, width = image.shape
    cols = np.rint((np.arange(width) - (width - 1) / 2 - dx * width) / zoom + (width - 1) / 2).astype(int)
    rows = np.rint((np.arange(height) - (height - 1) / 2 - dy * width) / zoom + (height - 1) / 2).astype(int)
    moved = image[rows.clip(0, height - 1)].take(cols.clip(0, width - 1), axis=1)  # faster than both at once
    moved[(rows < 0) | (rows >= height)] = moved[:, (cols < 0) | (cols >= width)] = np.nan
    return np.asarray(moved)


def _colour_edges(grey: Array) -> Array:
    edges = np.zeros(grey.shape, np.float32)
    edges[:, 1:-1] = np.abs(grey[:, 2:] - grey[:, :-2])
    edges[1:-1] = np.maximum(edges[1:-1], np.abs(grey[2:] - grey[:-2]))
    return np.minimum(edges, np.float32(0.2))


def _depth_edges(depth_m: Array) -> Array:
    edges = np.zeros(depth_m.shape, np.float32)
    with np.errstate(invalid="ignore"):
        across = np.abs(depth_m[:, 2:] - depth_m[:, :-2]) > EDGE_STEP * np.minimum(depth_m[:, 2:], depth_m[:, :-2])
        down = np.abs(depth_m[2:] - depth_m[:-2]) > EDGE_STEP * np.minimum(depth_m[2:], depth_m[:-2])
    edges[:, 1:-1] = across
    edges[1:-1] = np.maximum(edges[1:-1], down)
    return edges


def _filled(depth_m: Array) -> Array:
    """Holes filled with the farther neighbour in the row: a sensor's shadow falls on the background."""
    width = depth_m.shape[1]
    read, cols = np.isfinite(depth_m), np.arange(width)
    left = np.maximum.accumulate(np.where(read, cols, -1), axis=1)
    right = np.minimum.accumulate(np.where(read, cols, width)[:, ::-1], axis=1)[:, ::-1]
    on_left = np.where(left >= 0, np.take_along_axis(depth_m, left.clip(0), 1), np.nan)
    on_right = np.where(right < width, np.take_along_axis(depth_m, right.clip(0, width - 1), 1), np.nan)
    return np.where(read, depth_m, np.fmax(on_left, on_right))
