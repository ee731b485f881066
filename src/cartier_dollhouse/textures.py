"""Procedural textures, tileable, from seeded noise: grain, weave, grout, veins, prints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.float32]
"""(SIZE, SIZE, 3) sRGB in 0 to 1, or one channel (SIZE, SIZE); row = v, column = u. Every one repeats without a
seam."""
Colour = tuple[float, float, float]
SIZE = 256


def noise(seed: int, along_u: float, along_v: float) -> Image:
    """Seamless noise of mean 0 and deviation 1, smooth over about so many texels along u and v."""
    frequency = np.fft.fftfreq(SIZE)
    keep = np.exp(-2 * ((frequency * along_u) ** 2)[None] - 2 * ((frequency * along_v) ** 2)[:, None])
    white = np.fft.fft2(np.random.default_rng(seed).standard_normal((SIZE, SIZE)))
    white[0, 0] = 0
    smooth = np.fft.ifft2(white * keep).real
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def _grid() -> tuple[Image, Image]:
    steps = (np.arange(SIZE, dtype=np.float32) + 0.5) / SIZE
    return np.broadcast_to(steps, (SIZE, SIZE)), np.broadcast_to(steps[:, None], (SIZE, SIZE))


def _shade(colour: Colour, brightness: Image) -> Image:
    """The colour, made darker and brighter by a field around 1."""
    return np.asarray(np.clip(np.asarray(colour, np.float32) * brightness[..., None], 0, 1), np.float32)


def plain(colour: Colour, seed: int) -> Image:
    return _shade(colour, 1 + 0.006 * noise(seed, 3, 3))


def plaster(colour: Colour, seed: int) -> Image:
    return _shade(colour, 1 + 0.008 * noise(seed, 2, 2) + 0.008 * noise(seed + 1, 40, 40))


def wood(colour: Colour, seed: int) -> Image:
    """Grain along u: wavy year rings, fine pores."""
    _, v = _grid()
    rings = np.sin(2 * np.pi * (7 * v + 0.5 * noise(seed, 130, 22)))
    return _shade(colour, 1 + 0.035 * rings + 0.045 * noise(seed + 1, 90, 1.5) + 0.03 * noise(seed + 2, 40, 0.5))


def planks(colour: Colour, seed: int) -> Image:
    """Eight boards across v with staggered joints, each with a tone of its own."""
    rng, u, grain = np.random.default_rng(seed), _grid()[0], noise(seed + 1, 70, 1.5)
    brightness, rows, row_texels = np.ones((SIZE, SIZE), np.float32), 8, SIZE // 8
    for row in range(rows):
        band = slice(row * row_texels, (row + 1) * row_texels)
        start = (0.37 * row + 0.1 * rng.random()) % 1
        board = ((u[band] - start) % 1 > 0.5).astype(int)
        brightness[band] = 1 + rng.uniform(-0.10, 0.08, 2)[board] + 0.05 * np.roll(grain, 53 * row, 1)[band]
        joint = np.minimum((u[band] - start) % 0.5, (start - u[band]) % 0.5) < 1.0 / SIZE
        brightness[band][joint] *= 0.72
        brightness[band.start] *= 0.72
    return _shade(colour, brightness)


def tiles(colour: Colour, seed: int) -> Image:
    """Four by four tiles; grout is darker between pale ones and paler between dark ones."""
    u, v = _grid()
    cell_u, cell_v = (u * 4).astype(int), (v * 4).astype(int)
    tone = np.random.default_rng(seed).uniform(-0.035, 0.035, (4, 4))[cell_v, cell_u]
    image = _shade(colour, 1 + tone + 0.012 * noise(seed + 1, 12, 12))
    edge = np.minimum(np.minimum(u * 4 % 1, 1 - u * 4 % 1), np.minimum(v * 4 % 1, 1 - v * 4 % 1))
    pale = np.mean(colour) > 0.72
    image[edge < 0.018] = np.asarray(colour) * 0.78 if pale else 0.45 * np.asarray(colour) + 0.45
    return image


def carpet(colour: Colour, seed: int) -> Image:
    return _shade(colour, 1 + 0.10 * noise(seed, 1, 1) + 0.05 * noise(seed + 1, 6, 6) + 0.03 * noise(seed + 2, 40, 40))


def rug(colour: Colour, seed: int) -> Image:
    """A woven rug as a whole: pale and dark borders, and by the seed stripes, diamonds or a plain field; short pile."""
    u, v = _grid()
    edge, pale = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v)), np.array([0.88, 0.83, 0.72], np.float32)
    field = (
        np.zeros((SIZE, SIZE), bool),
        (v * 11 % 1) < 0.35,
        (np.abs((u * 6 % 1) - 0.5) + np.abs((v * 6 % 1) - 0.5)) < 0.28,
    )[seed % 3]
    pile = 1 + 0.08 * noise(seed, 1, 1) + 0.05 * noise(seed + 1, 3, 3)
    image = np.where((field & (edge > 0.12))[..., None], _shade(tuple(pale.tolist()), pile), _shade(colour, pile))
    image[(edge > 0.05) & (edge < 0.085)] = pale
    image[edge < 0.02] *= 0.6
    return np.asarray(np.clip(image, 0, 1), np.float32)


def fabric(colour: Colour, seed: int) -> Image:
    """A plain weave, with threads of unequal thickness."""
    u, v = _grid()
    weave = np.sin(2 * np.pi * 32 * u) * np.sin(2 * np.pi * 32 * v)
    return _shade(colour, 1 + 0.06 * weave + 0.035 * noise(seed, 50, 0.6) + 0.035 * noise(seed + 1, 0.6, 50))


def stripes(colour: Colour, seed: int) -> Image:
    """Linen with pale stripes along u."""
    v = _grid()[1]
    pale = np.array([0.93, 0.91, 0.86], np.float32)
    return np.asarray(np.where(((v * 8 % 1) < 0.42)[..., None], fabric(colour, seed), fabric(tuple(pale), seed)))


def leather(colour: Colour, seed: int) -> Image:
    return _shade(colour, 1 - 0.06 * np.abs(noise(seed, 5, 5)) + 0.05 * noise(seed + 1, 50, 50))


def brushed(colour: Colour, seed: int) -> Image:
    """Metal: fine lines along u under a broad sheen across v."""
    v = _grid()[1]
    return _shade(colour, 1 + 0.03 * noise(seed, 80, 0.5) + 0.07 * np.sin(2 * np.pi * v))


def marble(colour: Colour, seed: int) -> Image:
    veins = np.exp(-9 * np.abs(noise(seed, 45, 30) + 0.25 * noise(seed + 1, 8, 8)))
    return _shade(colour, 1 - 0.22 * veins + 0.02 * noise(seed + 2, 30, 30))


def stone(colour: Colour, seed: int) -> Image:
    return _shade(colour, 1 + 0.10 * noise(seed, 1, 1) + 0.06 * noise(seed + 1, 5, 5))


def mottled(colour: Colour, seed: int) -> Image:
    """Food and soil: blotches and specks."""
    return _shade(colour, 1 + 0.06 * noise(seed, 14, 14) + 0.04 * noise(seed + 1, 2, 2))


def leaves(colour: Colour, seed: int) -> Image:
    """Light and dark green with a paler midrib."""
    u, v = _grid()
    rib = np.exp(-600 * (u % 0.5 - 0.25) ** 2) * 0.18
    side = 0.05 * np.sin(2 * np.pi * (16 * v + 6 * np.abs(u % 0.5 - 0.25)))
    return _shade(colour, 1 + rib + side + 0.14 * noise(seed, 24, 24))


def wicker(colour: Colour, seed: int) -> Image:
    u, v = _grid()
    over = np.sin(2 * np.pi * 8 * u) * np.sign(np.sin(2 * np.pi * 8 * v)) * np.abs(np.sin(2 * np.pi * 8 * v)) ** 0.5
    return _shade(colour, 1 + 0.2 * over + 0.05 * noise(seed, 4, 4))


def paper(colour: Colour, seed: int) -> Image:
    """Lines of writing with ragged ends."""
    u, v = _grid()
    words = noise(seed, 6, 12) > -0.7
    line = ((v * 12 % 1) > 0.55) & ((v * 12 % 1) < 0.75) & words & (u > 0.08) & (u < 0.92)
    return _shade(colour, np.where(line, 0.62, 1).astype(np.float32))


def mirror(colour: Colour, seed: int) -> Image:
    """What a mirror shows is not traced: a cool gradient with two soft gleams."""
    u, v = _grid()
    gleam = np.exp(-60 * (u + v - 0.8) ** 2) + 0.6 * np.exp(-200 * (u + v - 1.12) ** 2)
    return _shade(colour, 0.82 + 0.16 * v + 0.14 * gleam)


def screen(colour: Colour, seed: int) -> Image:
    u, v = _grid()
    return _shade(colour, 1 + 0.9 * np.exp(-14 * (u * 0.8 + v - 1.25) ** 2) * (u + v > 1.1))


def picture(colour: Colour, seed: int) -> Image:
    """A bright landscape on a screen: sky, sun, three ranges of hills."""
    u, v = _grid()
    image = np.stack([0.98 - 0.45 * v, 0.72 - 0.05 * v, 0.55 + 0.4 * v], -1)
    image[(u - 0.68) ** 2 + (v - 0.62) ** 2 < 0.008] = (1.0, 0.95, 0.75)
    ranges = ((0.52, (0.52, 0.48, 0.66)), (0.38, (0.30, 0.42, 0.56)), (0.22, (0.13, 0.31, 0.36)))
    for number, (height, tone) in enumerate(ranges):
        ridge = height + 0.05 * np.sin(2 * np.pi * (u * (number + 1) + 0.3 * number)) + 0.02 * np.sin(19 * u + number)
        image[v < ridge] = tone
    return np.asarray(image, np.float32)


PALETTES = (
    ("#f1e4d1", "#c8553d", "#2d4654", "#e9b872", "#6b8f71"),
    ("#f5efe6", "#1f3a5f", "#d98e73", "#8fb8b4", "#e6c65b"),
    ("#efe9df", "#34403a", "#a3b18a", "#d4a373", "#7f5539"),
    ("#fbf3e4", "#e07a5f", "#3d405b", "#81b29a", "#f2cc8f"),
    ("#ece7f2", "#5b5f97", "#b8b8d1", "#ffc145", "#ff6b6c"),
    ("#f4f1ea", "#14213d", "#9a8c98", "#c9ada7", "#f2a65a"),
)


def print_(seed: int) -> Image:
    """An abstract print: discs, arches, bars or hills in one palette, chosen by the seed."""
    rng = np.random.default_rng(1000 + seed)
    palette = PALETTES[int(rng.integers(len(PALETTES)))]
    ground, *tones = [np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)], np.float32) / 255 for c in palette]
    order = rng.permutation(len(tones))
    image = np.broadcast_to(ground, (SIZE, SIZE, 3)).copy()
    for layer, mask in enumerate(_MOTIFS[seed % len(_MOTIFS)](rng)):
        image[mask] = tones[order[layer % len(tones)]]
    inside = np.abs(np.stack(_grid()) - 0.5).max(0) < 0.45
    image[~inside] = ground
    return np.clip(image * (1 + 0.012 * noise(seed, 2, 2)[..., None]), 0, 1)


def _discs(rng: np.random.Generator) -> list[npt.NDArray[np.bool_]]:
    u, v = _grid()
    centres, radii = rng.uniform(0.2, 0.8, (7, 2)), rng.uniform(0.06, 0.26, 7)
    return [(u - x) ** 2 + (v - y) ** 2 < r * r for (x, y), r in zip(centres, -np.sort(-radii), strict=True)]


def _arches(rng: np.random.Generator) -> list[npt.NDArray[np.bool_]]:
    u, v = _grid()
    x, foot = rng.uniform(0.4, 0.6), rng.uniform(0.12, 0.3)
    outlines = []
    for radius in (0.36, 0.29, 0.22, 0.15, 0.08):
        top = 0.45
        outlines.append(
            ((np.abs(u - x) < radius) & (v > foot) & (v <= top)) | ((u - x) ** 2 + (v - top) ** 2 < radius**2)
        )
    return outlines


def _bars(rng: np.random.Generator) -> list[npt.NDArray[np.bool_]]:
    u, v = _grid()
    low = rng.uniform(0.05, 0.7, (8, 2))
    size = rng.uniform(0.08, 0.4, (8, 2))
    return [(u > x) & (u < x + w) & (v > y) & (v < y + h) for (x, y), (w, h) in zip(low, size, strict=True)]


def _hills(rng: np.random.Generator) -> list[npt.NDArray[np.bool_]]:
    u, v = _grid()
    sun = (u - rng.uniform(0.3, 0.7)) ** 2 + (v - 0.72) ** 2 < 0.012
    return [
        sun,
        *(
            v < base + 0.07 * np.sin(2 * np.pi * (u * rng.uniform(0.5, 1.3) + rng.random()))
            for base in (0.55, 0.4, 0.24)
        ),
    ]


_MOTIFS: tuple[Callable[[np.random.Generator], list[npt.NDArray[np.bool_]]], ...] = (_discs, _arches, _bars, _hills)
