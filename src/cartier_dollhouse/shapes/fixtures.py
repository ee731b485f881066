"""Shapes of lamps, a screen, plants, and a vacuum cleaner."""

from __future__ import annotations

import math

import numpy as np

from cartier_dollhouse.mesh import box, cylinder, lathe, moved, slab, sphere, tilted
from cartier_dollhouse.model import Part, Shape, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import (
    loft,
    padded,
    pipe,
)


@shape(
    "Television", size=(1.14, 0.24, 0.72), stands="surface", material=("screen", "screen:on"), second="black", forms=2
)
def television(size: Vec3, look: Look) -> Shape:
    """A flat screen in a thin frame on two feet; the second is switched on."""
    w, d, h = size
    foot, y, screen = 0.09 * h, 0.1 * d, "screen:on" if look.variant == 1 else "screen"
    edge = 0.012
    parts = [
        box((-w / 2, y - 0.015, foot), (w / 2, y + 0.02, h), look.second),
        box((-0.35 * w, y + 0.02, foot + 0.05 * h), (0.35 * w, y + 0.05, foot + 0.5 * h), look.second),
        box((-w / 2 + edge, y - 0.018, foot + 1.8 * edge), (w / 2 - edge, y - 0.015, h - edge), screen),
        slab(0.06, 0.003, foot + 0.4 * edge, foot + edge, "metal", 0, y - 0.016),
    ]
    for x in (-0.33 * w, 0.33 * w):
        for end in (-d / 2 + 0.01, d / 2 - 0.01):
            parts.append(pipe([(x, y, foot + 0.03), (x, end, 0.01)], 0.01, look.second, 6))
    return Shape(tuple(parts))


@shape("FloorLamp", size=(0.42, 0.42, 1.65), material="light", second=("black", "brass", "oak"), forms=3)
def floor_lamp(size: Vec3, look: Look) -> Shape:
    """A shade on a pole with a foot; the third stands on three legs."""
    w, d, h = size
    r = min(w, d) / 2
    low = h - min(0.32, 0.24 * h)
    shade = [(r, low), (0.7 * r, h), (0.68 * r, h), (0.97 * r, low)]
    parts = [lathe([*shade, shade[0]], "light", sides=24), sphere(0.16 * r, (0, 0, low + 0.1), "light", sides=10)]
    if look.variant == 2:
        top = (0.0, 0.0, low + 0.03)
        legs = [
            (0.9 * r * math.cos(a), 0.9 * r * math.sin(a), 0.0)
            for a in np.linspace(0.5, 0.5 + math.tau, 3, endpoint=False)
        ]
        parts += [pipe([leg, top], 0.014, look.second) for leg in legs]
        return Shape((*parts, cylinder(0.035, low - 0.02, low + 0.05, look.second, sides=12)))
    foot = [(0, 0), (0.68 * r, 0), (0.68 * r, 0.015), (0.1 * r, 0.035), (0, 0.035)]
    cross = [pipe([(-0.68 * r, 0, h - 0.02), (0.68 * r, 0, h - 0.02)], 0.005, look.second, 5)]
    return Shape((*parts, lathe(foot, look.second), cylinder(0.013, 0.02, h - 0.015, look.second, sides=10), *cross))


@shape(
    "DeskLamp",
    size=(0.24, 0.26, 0.45),
    stands="surface",
    material=("paint:mustard", "black", "paint:petrol"),
    second="metal",
    forms=2,
)
def desk_lamp(size: Vec3, look: Look) -> Shape:
    """A round foot, two jointed arms and a tilted shade with its bulb to the front; the second has a cloth shade."""
    w, d, h = size
    r = 0.36 * min(w, d)
    if look.variant == 1:
        shade = [(0.5 * w, 0.5 * h), (0.34 * w, h), (0.32 * w, h), (0.48 * w, 0.5 * h), (0.5 * w, 0.5 * h)]
        belly = [
            (0, 0),
            (r, 0),
            (0.9 * r, 0.05 * h),
            (0.3 * r, 0.1 * h),
            (0.6 * r, 0.22 * h),
            (0.5 * r, 0.38 * h),
            (0.12 * r, 0.5 * h),
            (0.1 * r, 0.75 * h),
            (0, 0.75 * h),
        ]
        return Shape(
            (lathe(shade, "light"), lathe(belly, look.main), sphere(0.1 * w, (0, 0, 0.75 * h), "light", sides=10))
        )
    back, elbow, head = 0.2 * d, (0.0, 0.42 * d, 0.55 * h), (0.0, -0.08 * d, 0.9 * h)
    cone = [
        (0.03 * w, 0.0),
        (0.12 * w, 0.01),
        (0.16 * w, 0.05 * h),
        (0.36 * w, 0.26 * h),
        (0.33 * w, 0.26 * h),
        (0.12 * w, 0.07 * h),
        (0.0, 0.06 * h),
    ]
    shade_part = tilted(lathe([(0.0, 0.0), *cone], look.main), 0, math.radians(140))
    bulb = tilted(sphere(0.13 * w, (0, 0, 0.17 * h), "light", sides=12), 0, math.radians(140))
    parts = [
        lathe([(0, 0), (r, 0), (r, 0.03 * h), (0.2 * r, 0.06 * h), (0, 0.06 * h)], look.main, 0, back - 0.4 * r),
        pipe([(0, back - 0.4 * r, 0.04 * h), elbow], 0.007, look.second),
        pipe([elbow, head], 0.007, look.second),
        sphere(0.014, elbow, look.main, sides=8),
        moved(shade_part, head),
        moved(bulb, head),
    ]
    return Shape(tuple(parts))


def _leaf(root: Vec3, tip: Vec3, wide: float, sag: float) -> Part:
    """A leaf like a boat, closed and thin, from its root to its tip, bent upward in the middle by ``sag``."""
    start, end = np.array(root), np.array(tip)
    along = end - start
    side = np.cross(along, (0.0, 0.0, 1.0))
    norm = float(np.linalg.norm(side))
    side = side / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    up = np.cross(side, along / np.linalg.norm(along))
    middle = start + 0.5 * along + sag * up
    rings = []
    for centre, half in ((start, 0.12), (middle, 1.0), (start + 0.8 * along + 0.6 * sag * up, 0.6), (end, 0.05)):
        reach, thick = side * half * wide / 2, up * 0.003
        rings.append(np.array([centre - reach, centre + thick, centre + reach, centre - thick]))
    return loft(rings, "plant")


@shape(
    "HousePlant",
    size=(0.42, 0.42, 0.75),
    material=("ceramic:terracotta", "ceramic:white", "ceramic:charcoal"),
    second="soil",
    forms=3,
)
def house_plant(size: Vec3, look: Look) -> Shape:
    """A pot with broad arching leaves on stems; the second has upright blades, the third is a cactus."""
    w, d, h = size
    r = min(w, d) / 2
    pot, p = min(0.36 * h, 0.75 * r + 0.05), min(0.62 * r, 0.3 * h)
    outline = [
        (0, 0),
        (0.7 * p, 0),
        (p, 0.85 * pot),
        (1.08 * p, 0.85 * pot),
        (1.08 * p, pot),
        (0.92 * p, pot),
        (0.88 * p, 0.86 * pot),
        (0, 0.86 * pot),
    ]
    parts = [lathe(outline, look.main), cylinder(0.9 * p, 0.85 * pot, 0.9 * pot, look.second)]
    golden = 2.39996
    if look.variant == 2:
        ribs = 0.75 * p
        parts.append(
            lathe(
                [(0, 0.88 * pot), (0.8 * ribs, 0.9 * pot), (ribs, 0.6 * h), (0.8 * ribs, 0.9 * h), (0, h)],
                "plant",
                sides=8,
            )
        )
        arms: list[list[Vec3]] = [
            [(0, 0, 0.5 * h), (r * 0.75, 0, 0.52 * h), (r * 0.82, 0, 0.6 * h), (r * 0.82, 0, 0.8 * h)],
            [(0, 0, 0.62 * h), (-r * 0.7, 0, 0.65 * h), (-r * 0.8, 0, 0.72 * h), (-r * 0.8, 0, 0.86 * h)],
        ]
        return Shape((*parts, *(pipe(arm, 0.15 * r, "plant") for arm in arms)))
    n = 13 if look.variant == 1 else 17
    for i in range(n):
        a, f = golden * i, i / (n - 1)
        if look.variant == 1:
            root = (0.5 * p * f * math.cos(a), 0.5 * p * f * math.sin(a), 0.88 * pot)
            tip = (0.7 * r * f * math.cos(a), 0.7 * r * f * math.sin(a), h * (1 - 0.35 * f) + 0.0)
            parts.append(_leaf(root, tip, 0.32 * p + 0.02, 0.02))
            continue
        z = pot + (h - pot) * (0.25 + 0.6 * f)
        stem = (0.22 * r * math.cos(a), 0.22 * r * math.sin(a), z - 0.05 * h)
        reach = r * (0.98 - 0.5 * f)
        tip = (reach * math.cos(a), reach * math.sin(a), min(h, z + (0.02 + 0.14 * f) * h))
        parts.append(_leaf(stem, tip, 0.42 * r, 0.05 * h))
        if i % 3 == 0:
            parts.append(
                pipe([(0.1 * stem[0], 0.1 * stem[1], 0.88 * pot), stem], 0.006 + 0.004 * h, "plastic:olivedrab", 5)
            )
    return Shape(tuple(parts))


@shape(
    "VacuumCleaner", size=(0.3, 0.34, 1.1), material=("plastic:red", "plastic:petrol", "plastic:grey"), second="black"
)
def vacuum_cleaner(size: Vec3, look: Look) -> Shape:
    """An upright one: floor head with wheels, slanting body with a dust cylinder, pole and looped handle."""
    w, d, h = size
    y1, y2 = -0.12 * d, 0.36 * d
    lean = math.atan2(y2 - y1, 0.95 * h)

    def along(part: Part) -> Part:
        return moved(tilted(part, 0, -lean), (0, y1, 0.05 * h))

    loop = [(0.0, 0.8), (0.02, 0.87), (0.05, 0.91), (0.09, 0.91), (0.1, 0.87), (0.09, 0.83), (0.03, 0.8)]
    grip: list[Vec3] = [(0, y * h, z * h) for y, z in loop]
    parts = [
        padded((-w / 2, -d / 2, 0.012), (w / 2, 0.02 * d, 0.09 * h), look.main, 0.03),
        box((-0.46 * w, -d / 2 + 0.005, 0), (0.46 * w, -0.04 * d, 0.02), look.second),
        *(
            moved(tilted(cylinder(0.045, -0.012, 0.012, "rubber", sides=12), 1, math.pi / 2), (x, 0.06 * d, 0.045))
            for x in (-0.32 * w, 0.32 * w)
        ),
        along(padded((-0.2 * w, -0.08 * d, 0.06 * h), (0.2 * w, 0.12 * d, 0.56 * h), look.main, 0.03)),
        along(moved(cylinder(0.17 * w, 0.16 * h, 0.4 * h, "glass", sides=16), (0, -0.1 * d, 0))),
        along(moved(cylinder(0.1 * w, 0.17 * h, 0.39 * h, look.second, sides=12), (0, -0.1 * d, 0))),
        along(moved(cylinder(0.18 * w, 0.4 * h, 0.45 * h, look.second, sides=16), (0, -0.1 * d, 0))),
        along(pipe([(0, 0.02 * d, 0.5 * h), (0, 0.02 * d, 0.82 * h)], 0.016, "metal")),
        along(pipe(grip, 0.014, look.second)),
        along(pipe([(0, 0.14 * d, 0.1 * h), (0.06, 0.2 * d, 0.3 * h), (0.02, 0.16 * d, 0.6 * h)], 0.014, look.second)),
    ]
    return Shape(tuple(parts))
