"""Shapes on walls: pictures, windows, blinds, curtains, switches."""

from __future__ import annotations

from cartier_dollhouse.mesh import box, cylinder, moved, slab, sphere, tilted
from cartier_dollhouse.model import Shape, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import (
    drape,
    facing,
    loft,
    pipe,
    rectangle,
)


@shape(
    "Painting",
    size=(0.8, 0.03, 0.6),
    stands="wall",
    material=("print:1", "print:2", "print:3"),
    second=("oak", "black", "brass"),
)
def painting(size: Vec3, look: Look) -> Shape:
    """A print in a mount and a frame."""
    w, d, h = size
    bar, mount = min(0.03, 0.1 * w), min(0.06, 0.12 * w)
    parts = [
        box((-w / 2, -d / 2, 0), (w / 2, d / 2, bar), look.second),
        box((-w / 2, -d / 2, h - bar), (w / 2, d / 2, h), look.second),
        *(box((x, -d / 2, bar), (x + bar, d / 2, h - bar), look.second) for x in (-w / 2, w / 2 - bar)),
        box((-w / 2 + bar, 0, bar), (w / 2 - bar, d / 2, h - bar), "paper"),
        box((-w / 2 + mount, -0.15 * d, mount), (w / 2 - mount, 0, h - mount), look.main),
    ]
    return Shape(tuple(parts))


@shape("Poster", size=(0.5, 0.012, 0.7), stands="wall", material=("print:11", "print:12", "print:13"), second="paper")
def poster(size: Vec3, look: Look) -> Shape:
    """A print on paper without a frame, pinned in its corners."""
    w, d, h = size
    pins = [
        facing(cylinder(0.006, 0, 0.4 * d, "plastic:red", sides=8), (x * (w / 2 - 0.025), -0.1 * d, z))
        for x in (-1, 1)
        for z in (0.025, h - 0.025)
    ]
    sheet = box((-w / 2, 0, 0), (w / 2, d / 2, h), look.second)
    return Shape((sheet, box((-w / 2 + 0.015, -0.1 * d, 0.015), (w / 2 - 0.015, 0, h - 0.015), look.main), *pins))


@shape(
    "LightSwitch",
    size=(0.085, 0.02, 0.085),
    stands="wall",
    material=("plastic:white", "brass"),
    second="plastic:lightgrey",
)
def light_switch(size: Vec3, look: Look) -> Shape:
    """A plate with a rocker, pressed at the top."""
    w, d, h = size
    plate = [
        rectangle((-w / 2 + i, -h / 2 + i), (w / 2 - i, h / 2 - i), z, 0.1 * w)
        for i, z in ((0, 0), (0, 0.5 * d), (0.06 * w, 0.6 * d))
    ]
    rocker = tilted(
        box((-0.24 * w, -0.85 * d, 0.2 * h), (0.24 * w, -0.1 * d, 0.8 * h), look.second),
        0,
        0.06,
        (0, -0.4 * d, 0.5 * h),
    )
    return Shape((facing(loft(plate, look.main), (0, d / 2, h / 2)), moved(rocker, (0, 0.2 * d, 0))))


@shape("Window", size=(1.3, 0.09, 1.2), stands="wall", material=("paint:white", "oak"), second="glass")
def window(size: Vec3, look: Look) -> Shape:
    """Two casements with a cross bar each, a sill and a handle."""
    w, d, h = size
    bar, y = min(0.06, 0.1 * w), 0.1 * d
    parts = [
        box((-w / 2, y, 0.02), (w / 2, d / 2, bar), look.main),
        box((-w / 2, y, h - bar), (w / 2, d / 2, h), look.main),
        *(box((x, y, bar), (x + bar, d / 2, h - bar), look.main) for x in (-w / 2, -bar / 2, w / 2 - bar)),
        box((-w / 2, -d / 2, 0), (w / 2, d / 2, 0.02), look.main),
        slab(0.018, 0.03, 0.42 * h, 0.54 * h, "metal", 0, y - 0.01),
    ]
    for x1, x2 in ((-w / 2 + bar, -bar / 2), (bar / 2, w / 2 - bar)):
        parts.append(box((x1, 0.25 * d, bar), (x2, 0.3 * d, h - bar), look.second))
        parts.append(box((x1, 0.15 * d, 0.62 * h), (x2, 0.4 * d, 0.62 * h + 0.4 * bar), look.main))
    return Shape(tuple(parts))


@shape("Blinds", size=(1.1, 0.05, 1.1), stands="wall", material=("plastic:white", "oak", "plastic:lightgrey"))
def blinds(size: Vec3, look: Look) -> Shape:
    """Slats under a head rail, with their cords and a pull."""
    w, d, h = size
    n = max(5, min(60, round(h / 0.05)))
    pitch = (h - 0.06) / n
    parts = [box((-w / 2, -d / 2, h - 0.045), (w / 2, d / 2, h), look.main), slab(w, 0.8 * d, 0, 0.012, look.main)]
    for i in range(1, n):
        z = 0.012 + i * pitch
        parts.append(
            tilted(box((-w / 2, -0.4 * d, z - 0.0012), (w / 2, 0.4 * d, z + 0.0012), look.main), 0, 0.6, (0, 0, z))
        )
    parts += [slab(0.004, 0.004, 0.01, h - 0.04, "paper", x * w, -0.42 * d) for x in (-0.35, 0.35)]
    return Shape((*parts, slab(0.004, 0.004, 0.35 * h, h - 0.04, "paper", 0.45 * w, -0.47 * d)))


@shape(
    "Curtains",
    size=(1.8, 0.14, 2.2),
    stands="wall",
    material=("fabric:sand", "fabric:petrol", "fabric:terracotta"),
    second="oak",
)
def curtains(size: Vec3, look: Look) -> Shape:
    """A pair drawn apart on a rod with knobs."""
    w, d, h = size
    knob = min(0.028, 0.2 * d)
    rod = h - knob
    parts = [pipe([(-w / 2 + knob, 0, rod), (w / 2 - knob, 0, rod)], 0.5 * knob, look.second)]
    parts += [sphere(knob, (x, 0, rod), look.second, sides=12) for x in (-w / 2 + knob, w / 2 - knob)]
    for x in (-0.335 * w, 0.335 * w):
        parts.append(drape(0.24 * w, d, 0, rod - 0.3 * knob, look.main, max(3, round(1.9 * w)), x))
    parts += [slab(0.015, d / 2, rod - 0.01, rod + 0.01, look.second, x, d / 4) for x in (-0.46 * w, 0.46 * w)]
    return Shape(tuple(parts))
