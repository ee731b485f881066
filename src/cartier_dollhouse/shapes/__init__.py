"""Catalogue of furnishings by AI2-THOR's type names: ``build("Mug", colour="red")`` makes a shape.

A builder is one function, decorated with its type, its usual size and where it stands; the other modules of this
package are full of them::

    @shape("Stool", size=(0.4, 0.4, 0.65), material=("oak", "metal"), second="fabric:grey")
    def stool(size: Vec3, look: Look) -> Shape: ...

It may take ``size`` (width, depth, height in metres) as a wish: ``build`` stretches what it made to exactly that size,
with its surfaces, and puts the origin in the middle of its footprint, at the bottom. Builders must cope with sizes from
0.4 to 2.5 times the usual one along each axis.
"""

from __future__ import annotations

import difflib
import importlib
import math
import pkgutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from cartier.errors import InputError
from cartier_dollhouse.model import Part, Shape, Surface, Vec3

STANDS = ("floor", "surface", "counter", "wall", "ceiling")
BARE_MATERIALS = frozenset(
    [
        "oak",
        "walnut",
        "pine",
        "whitewood",
        "metal",
        "steel",
        "brass",
        "glass",
        "mirror",
        "paper",
        "screen",
        "plant",
        "soil",
        "light",
        "marble",
        "cardboard",
        "wicker",
        "water",
        "rubber",
    ]
)
"""Materials that need no colour; with a colon, any name is a material."""
_LARGEST_STRETCH = 6.0


@dataclass(frozen=True)
class Look:
    """What a furnishing is made of: ``main`` takes the colour asked for; ``variant`` counts the forms, from 0."""

    main: str
    second: str
    variant: int


@dataclass(frozen=True)
class TypeInfo:
    """What is known of a type: its usual size (width, depth, height) in metres, its kind (furniture, kitchen, food …),
    what it stands on (one of ``STANDS``), and how many variants of it look different."""

    size: Vec3
    kind: str
    stands: str
    variants: int


Builder = Callable[[Vec3, Look], Shape]


@dataclass(frozen=True)
class _Entry:
    info: TypeInfo
    builder: Builder
    materials: tuple[str, ...]
    seconds: tuple[str, ...]


_entries: dict[str, _Entry] = {}


def shape(
    *names: str,
    size: Vec3,
    stands: str = "floor",
    material: str | Sequence[str] = "oak",
    second: str | Sequence[str] = "metal",
    forms: int = 1,
) -> Callable[[Builder], Builder]:
    """Enters a builder under one or more type names.

    ``material`` and ``second`` are what it is made of if no colour is asked for; of several, the variant chooses.
    ``forms`` says how many variants the builder itself tells apart.
    """
    assert stands in STANDS, stands
    materials = (material,) if isinstance(material, str) else tuple(material)
    seconds = (second,) if isinstance(second, str) else tuple(second)

    def enter(builder: Builder) -> Builder:
        kind = builder.__module__.rpartition(".")[2]
        variants = max(forms, len(materials))
        for name in names:
            assert name not in _entries, f"two builders of {name}"
            _entries[name] = _Entry(TypeInfo(size, kind, stands, variants), builder, materials, seconds)
        return builder

    return enter


def types() -> list[str]:
    """The names of all types, sorted."""
    return sorted(_known())


def info(type: str) -> TypeInfo:
    """A type's usual size, kind and standing. Raises InputError, with a close match, for an unknown one."""
    return _entry(type).info


def build(type: str, size: Vec3 | None = None, colour: str | None = None, variant: int = 0) -> Shape:
    """The shape of a type, of exactly the size asked for (width, depth, height in metres) or of its usual one.

    ``colour`` is a colour (``petrol``, in the type's own cloth or paint), a wood (``walnut``) or a material with its
    colour (``leather:brown``). Variants differ in form or material; any number will do, they repeat.
    Raises InputError for an unknown type and for a size that is no size or out of all proportion.
    """
    entry = _entry(type)
    usual = entry.info.size
    wanted = usual if size is None else size
    if not all(
        math.isfinite(w) and u / _LARGEST_STRETCH <= w <= u * _LARGEST_STRETCH
        for w, u in zip(wanted, usual, strict=True)
    ):
        raise InputError(
            f"a {type} cannot have the size {_metres(wanted)}: it is usually {_metres(usual)} (width, depth, height)"
        )
    number = variant % entry.info.variants
    main = entry.materials[number % len(entry.materials)]
    look = Look(_material(main, colour), entry.seconds[number % len(entry.seconds)], number)
    return _fitted(entry.builder(wanted, look), wanted)


def _entry(type: str) -> _Entry:
    known = _known()
    if type not in known:
        close = difflib.get_close_matches(type, known, 1, cutoff=0.5)
        lower = [name for name in known if name.lower() == type.lower()]
        hint = f"did you mean {(lower or close)[0]!r}?" if lower or close else f"there are {', '.join(sorted(known))}"
        raise InputError(f"unknown type of thing {type!r}: {hint}")
    return known[type]


@cache
def _known() -> dict[str, _Entry]:
    for module in sorted(module.name for module in pkgutil.iter_modules(__path__)):
        importlib.import_module(f"{__name__}.{module}")
    return _entries


def _material(usual: str, colour: str | None) -> str:
    """The colour asked for, in the type's own material; woods and bare metals become painted ones."""
    if colour is None:
        return usual
    if ":" in colour or colour in BARE_MATERIALS:
        return colour
    family = usual.partition(":")[0]
    return f"{'paint' if family in BARE_MATERIALS or family == 'print' else family}:{colour}"


def _fitted(made: Shape, size: Vec3) -> Shape:
    """The shape stretched to exactly this size, its footprint's middle and its bottom in the origin."""
    points = np.concatenate([part.vertices for part in made.parts]).astype(np.float64)
    low, high = points.min(0), points.max(0)
    scale = np.array(size) / (high - low)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])

    def part_fitted(part: Part) -> Part:
        return replace(part, vertices=((part.vertices - origin) * scale).astype(np.float32))

    def surface_fitted(surface: Surface) -> Surface:
        (x1, y1), (x2, y2) = ((np.array(xy) - origin[:2]) * scale[:2] for xy in (surface.low_xy, surface.high_xy))
        z, clear = (surface.z - origin[2]) * scale[2], surface.clear_m * scale[2]
        return Surface(surface.name, float(z), (float(x1), float(y1)), (float(x2), float(y2)), float(clear))

    return Shape(tuple(map(part_fitted, made.parts)), tuple(map(surface_fitted, made.surfaces)))


def _metres(size: Vec3) -> str:
    return " x ".join(f"{length:g}" for length in size) + " m"
