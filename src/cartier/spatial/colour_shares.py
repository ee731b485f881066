"""How much of an object's surface has a colour that words name."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from cartier.types import MapObject

BESIDE = {
    "white": ("grey", "yellow"), "black": ("grey", "brown"), "grey": ("white", "black"),
    "brown": ("orange", "red", "black", "yellow"), "yellow": ("orange", "brown"), "orange": ("brown", "red", "yellow"),
    "red": ("brown", "orange", "pink"), "pink": ("red", "purple"), "blue": ("purple", "grey"),
    "green": ("blue", "yellow"), "purple": ("blue", "pink"),
}  # fmt: skip
"""Names that a colour may get in warm light or in shadow."""


def coloured_share(obj: MapObject, colours: Sequence[str]) -> float:
    """The share of an object's surface with one of the colours; similar colours count for a third."""
    near = {other for colour in colours for other in BESIDE.get(colour, ())} - set(colours)
    return share(obj, colours) + share(obj, near) / 3


def share(obj: MapObject, colours: Collection[str]) -> float:
    return sum(share for name, share in obj.colours if name in colours)
