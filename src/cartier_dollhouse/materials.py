"""Materials by name, as ``oak``, ``tiles:blue`` or ``print:7``: a tileable texture and how it is laid on a surface."""

from __future__ import annotations

import difflib
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from PIL import ImageColor

from cartier.errors import InputError
from cartier_dollhouse import textures
from cartier_dollhouse.textures import Colour, Image


@dataclass(frozen=True, eq=False)
class Material:
    """``texture`` (SIZE, SIZE, 3) uint8 sRGB repeats every ``tile_m`` metres, or fills the whole part where that is 0.

    ``glow`` is how bright it shines by itself (0: not at all, 1: like well lit paper). ``hard`` says that depth sensors
    fail on it.
    """

    name: str
    texture: npt.NDArray[np.uint8]
    tile_m: float
    glow: float
    hard: bool

    @cached_property
    def albedo(self) -> npt.NDArray[np.float64]:
        """How much red, green and blue light it throws back on the whole (linear, 0 to 1)."""
        return np.asarray(((self.texture[::4, ::4] / 255.0) ** 2.2).mean((0, 1)), dtype=np.float64)


@dataclass(frozen=True)
class _Kind:
    draw: Callable[[Colour, int], Image]
    colour: str
    tile_m: float
    glow: float = 0.0
    hard: bool = False


WOODS = {
    "oak": "#b98f5e", "walnut": "#6f4a32", "pine": "#d3ab73", "whitewood": "#e4ddd0", "birch": "#d9c19a",
    "cherry": "#91563a", "beech": "#cfa679", "ash": "#cbb593", "teak": "#8f6239",
}  # fmt: skip
COLOURS = WOODS | {
    "petrol": "#1f5a66", "cream": "#efe6d2", "mustard": "#c9982f", "terracotta": "#b8644a", "sage": "#9aa88a",
    "charcoal": "#3a3d40", "sand": "#d6c3a1", "dark": "#4a4744", "light": "#cfcac2",
}  # fmt: skip
KINDS = {
    **{wood: _Kind(textures.wood, wood, 0.9) for wood in WOODS},
    "wood": _Kind(textures.wood, "oak", 0.9),
    "planks": _Kind(textures.planks, "oak", 1.2),
    "tiles": _Kind(textures.tiles, "white", 1.0),
    "carpet": _Kind(textures.carpet, "grey", 0.5),
    "rug": _Kind(textures.rug, "crimson", 0.0),
    "fabric": _Kind(textures.fabric, "grey", 0.25),
    "stripes": _Kind(textures.stripes, "petrol", 0.5),
    "leather": _Kind(textures.leather, "brown", 0.4),
    "metal": _Kind(textures.brushed, "#9a9da1", 0.5),
    "steel": _Kind(textures.brushed, "#b9bcc0", 0.5),
    "brass": _Kind(textures.brushed, "#b8954e", 0.5),
    "black": _Kind(textures.plain, "#242526", 0.5, hard=True),
    "plastic": _Kind(textures.plain, "white", 0.5),
    "ceramic": _Kind(textures.plain, "white", 0.5),
    "rubber": _Kind(textures.plain, "#35363a", 0.5),
    "glass": _Kind(textures.mirror, "#c3d6da", 0.0, hard=True),
    "mirror": _Kind(textures.mirror, "#b4c4cf", 0.0, hard=True),
    "paint": _Kind(textures.plaster, "cream", 1.5),
    "paper": _Kind(textures.paper, "#f3f0e8", 0.2),
    "screen": _Kind(textures.screen, "#17191d", 0.0, hard=True),
    "plant": _Kind(textures.leaves, "#5a8144", 0.15),
    "soil": _Kind(textures.mottled, "#4a3728", 0.2),
    "food": _Kind(textures.mottled, "#c8a063", 0.12),
    "light": _Kind(textures.plain, "#fff3dc", 0.5, glow=1.3),
    "marble": _Kind(textures.marble, "#e9e6e1", 1.2),
    "stone": _Kind(textures.stone, "#8b8882", 0.6),
    "cardboard": _Kind(textures.plaster, "#b38d61", 0.5),
    "wicker": _Kind(textures.wicker, "#b58b57", 0.12),
    "water": _Kind(textures.plain, "#8fb9c4", 0.5),
}  # fmt: skip


@lru_cache(maxsize=512)
def material(name: str) -> Material:
    """The material of a name ``kind`` or ``kind:colour``; an InputError with close matches where there is none."""
    kind_name, _, variant = name.partition(":")
    seed = zlib.crc32(name.encode()) % 10_000
    if kind_name == "print":
        if variant and not variant.isdecimal():
            raise InputError(f"material {name!r}: a print has a number, as print:7")
        return Material(name, _bytes(textures.print_(int(variant or 0) % 100_000)), 0.0, 0.0, False)
    if name == "screen:on":
        return Material(name, _bytes(textures.picture((1, 1, 1), seed)), 0.0, 1.1, True)
    kind = KINDS.get(kind_name)
    if kind is None:
        raise InputError(f"there is no material {kind_name!r}{_close(kind_name, [*KINDS, 'print'])}")
    tint = colour(variant or kind.colour)
    dark = max(tint) < 0.2
    return Material(name, _bytes(kind.draw(tint, seed)), kind.tile_m, kind.glow, kind.hard or dark)


def colour(name: str) -> Colour:
    """A colour by its CSS name or one of ours, as sRGB in 0 to 1: the garish ones are toned down to what paint and dye
    do."""
    code = COLOURS.get(name, name)
    if not code.startswith("#") and code not in ImageColor.colormap:
        raise InputError(f"there is no colour {name!r}{_close(name, [*COLOURS, *ImageColor.colormap])}")
    try:
        rgb = np.array(ImageColor.getrgb(code)[:3]) / 255
    except ValueError:
        raise InputError(f"{name!r} is not a colour: give a name, or #rrggbb") from None
    if name not in COLOURS:
        rgb = 0.78 * rgb + 0.22 * (rgb @ (0.3, 0.59, 0.11))
    red, green, blue = (0.05 + 0.88 * rgb).tolist()
    return red, green, blue


def _close(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, 3, 0.5)
    return f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(sorted(known)[:40])}"


def _bytes(image: Image) -> npt.NDArray[np.uint8]:
    return np.asarray(np.clip(image * 255 + 0.5, 0, 255), dtype=np.uint8)
