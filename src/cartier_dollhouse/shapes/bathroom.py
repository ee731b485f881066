"""Shapes of bathrooms: toilet, bath, shower, and what hangs on their walls."""

from __future__ import annotations

import math

import numpy as np

from cartier_dollhouse.mesh import box, cylinder, lathe, moved, slab, tilted
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import drape, facing, loft, oval, padded, pipe, rectangle


@shape("Toilet", size=(0.42, 0.72, 0.8), material=("ceramic:white", "ceramic:ivory"), second="metal")
def toilet(size: Vec3, look: Look) -> Shape:
    """A bowl with water, a seat, the lid leaning against the cistern, a flush button."""
    w, d, h = size
    seat, tank = 0.52 * h, 0.25 * d
    long, y = 0.72 * d, -d / 2 + 0.36 * d
    bowl = [(0.5, 0.6, 0.0, 0.06), (0.46, 0.56, 0.12, 0.06), (0.6, 0.7, 0.5, 0.03), (0.88, 0.97, 0.86, 0.0)]
    bowl += [(0.9, 0.98, 0.95, 0.0), (0.66, 0.74, 0.95, 0.0), (0.5, 0.6, 0.7, 0.0), (0.22, 0.25, 0.5, 0.02)]
    ring = [(1.0, 1.0, 0.0), (1.0, 1.0, 0.05), (0.68, 0.76, 0.05), (0.66, 0.74, 0.0)]
    rings = [oval(a * 0.96 * w, b * long, seat * z, y + s * d) for a, b, z, s in bowl]
    seat_rings = [oval(a * w * 0.96, b * long, seat * (0.95 + z), y) for a, b, z in ring]
    lid = loft([oval(0.9 * w, 0.7 * (h - seat) + 0.2 * h, z, sides=20) for z in (0.0, 0.02)], look.main)
    lid_middle = (0.0, d / 2 - tank - 0.02, seat + 0.02 + 0.45 * (h - seat) + 0.05 * h)
    parts = [
        loft(rings, look.main),
        loft(seat_rings, "plastic:white", ends=False),
        loft([oval(0.56 * w, 0.62 * long, seat * 0.66, y), oval(0.57 * w, 0.63 * long, seat * 0.68, y)], "water"),
        padded((-0.3 * w, d / 2 - 0.4 * d, 0), (0.3 * w, d / 2 - 0.02, 0.9 * seat), look.main, 0.03),
        padded((-w / 2, d / 2 - tank, 0.86 * seat), (w / 2, d / 2, 0.96 * h), look.main, 0.03),
        padded((-w / 2, d / 2 - tank - 0.005, 0.94 * h), (w / 2, d / 2, h - 0.008), look.main, 0.01),
        cylinder(0.03, h - 0.01, h, look.second, 0, d / 2 - tank / 2, 14),
        moved(facing(lid, (0, 0, 0)), lid_middle),
    ]
    return Shape(tuple(parts))


@shape("Bathtub", size=(1.7, 0.78, 0.58), material=("ceramic:white",), second="metal", forms=2)
def bathtub(size: Vec3, look: Look) -> Shape:
    """An open tub in an apron, or free-standing; taps at its right end."""
    w, d, h = size
    free, rim = look.variant == 1, 0.92 * h
    low, high = (-w / 2, -d / 2), (w / 2, d / 2)

    def ring(inset: float, z: float, radius: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return rectangle((low[0] + inset, low[1] + inset), (high[0] - inset, high[1] - inset), z, radius)

    foot = (
        [ring(0.14, 0, 0.18), ring(0.06, 0.3 * h, 0.24), ring(0.02, rim - 0.03, 0.28)]
        if free
        else [ring(0.02, 0, 0.02), ring(0.02, rim - 0.04, 0.02)]
    )
    edge = [ring(0, rim - 0.03, 0.3 if free else 0.03), ring(0, rim, 0.3 if free else 0.03)]
    inside = [ring(0.07, rim, 0.22), ring(0.11, 0.5 * h, 0.2), ring(0.17, 0.2 * h, 0.16), ring(0.22, 0.15 * h, 0.12)]
    x = w / 2 - 0.035
    spout: list[Vec3] = [(x, 0, rim), (x, 0, h - 0.01), (x - 0.12, 0, h - 0.01), (x - 0.13, 0, rim + 0.01)]
    parts = [
        loft([*foot, *edge, *inside], look.main),
        pipe(spout, 0.014, look.second),
        *(cylinder(0.025, rim, h, look.second, x, y, 12) for y in (-0.12, 0.12)),
        facing(cylinder(0.03, 0, 0.01, look.second, sides=12), (0, d / 2 - 0.095, 0.65 * h)),
        cylinder(0.03, 0.15 * h, 0.15 * h + 0.004, look.second, w / 2 - 0.32, 0, 14),
    ]
    return Shape(
        tuple(parts), (Surface("basin", 0.15 * h, (-w / 2 + 0.26, -d / 2 + 0.25), (w / 2 - 0.37, d / 2 - 0.25)),)
    )


def _glass_panel(size: Vec3, look: Look, bar: float) -> list[Part]:
    w, d, h = size
    return [
        box((-w / 2 + bar, -0.004, bar), (w / 2 - bar, 0.004, h - bar), "glass"),
        box((-w / 2, -d / 2, 0), (w / 2, d / 2, bar), look.main),
        box((-w / 2, -d / 2, h - bar), (w / 2, d / 2, h), look.main),
        *(box((x, -d / 2, bar), (x + bar, d / 2, h - bar), look.main) for x in (-w / 2, w / 2 - bar)),
    ]


@shape("ShowerDoor", size=(0.9, 0.06, 1.95), material=("metal", "black"), second="steel")
def shower_door(size: Vec3, look: Look) -> Shape:
    """A framed pane with a long handle and two hinges."""
    w, d, h = size
    grip: list[Vec3] = [(0.36 * w, 0, 0.45 * h), (0.36 * w, 0, 0.62 * h)]
    hinges = [
        box((-w / 2 + 0.02, -d / 2, z * h), (-w / 2 + 0.09, d / 2, z * h + 0.08), look.second) for z in (0.15, 0.8)
    ]
    knobs = [slab(0.02, d, z * h, z * h + 0.02, look.second, 0.36 * w) for z in (0.45, 0.61)]
    posts = [moved(pipe(grip, 0.011, look.second), (0, y, 0)) for y in (-d / 2 + 0.011, d / 2 - 0.011)]
    return Shape((*_glass_panel(size, look, 0.03), *hinges, *knobs, *posts))


@shape("ShowerGlass", size=(0.9, 0.05, 1.95), material=("metal", "black"))
def shower_glass(size: Vec3, look: Look) -> Shape:
    """A fixed pane in a slender frame, frosted stripes across."""
    w, _, h = size
    stripes = [
        box((-w / 2 + 0.02, -0.006, z * h), (w / 2 - 0.02, 0.006, z * h + 0.03), "plastic:white")
        for z in (0.45, 0.5, 0.55)
    ]
    return Shape((*_glass_panel(size, look, 0.018), *stripes))


@shape("ShowerHead", size=(0.22, 0.25, 1.1), stands="wall", material=("steel", "brass"), second="black")
def shower_head(size: Vec3, look: Look) -> Shape:
    """A rail on the wall with a broad rose on an arm, a hose and the mixer at the bottom."""
    w, d, h = size
    back, front_y, rose = d / 2 - 0.03, -d / 2 + 0.11, min(w, d) / 2 - 0.005
    arm: list[Vec3] = [
        (0, back, 0.08),
        (0, back, h - 0.05),
        (0, back - 0.03, h - 0.012),
        (0, front_y, h - 0.012),
        (0, front_y, h - 0.06),
    ]
    hose: list[Vec3] = [(0.02, back - 0.02, 0.05)]
    hose += [
        (0.02 + 0.06 * math.sin(a), back - 0.02, 0.05 + 0.55 * h * a / math.pi)
        for a in (math.pi * i / 8 for i in range(1, 9))
    ]
    head = [(0, h - 0.09), (rose * 0.96, h - 0.09), (rose, h - 0.08), (0.25 * rose, h - 0.06), (0, h - 0.055)]
    nozzles = [
        cylinder(
            0.006, h - 0.094, h - 0.09, look.second, 0.6 * rose * math.cos(a), front_y + 0.6 * rose * math.sin(a), 6
        )
        for a in np.linspace(0, math.tau, 8, endpoint=False)
    ]
    bar = tilted(cylinder(0.024, -0.45 * w, 0.45 * w, look.main, sides=14), 1, math.pi / 2)
    parts = [
        pipe(arm, 0.011, look.main),
        lathe(head, look.main, 0, front_y, 24),
        *nozzles,
        moved(bar, (0, back - 0.01, 0.05)),
        *(
            moved(tilted(cylinder(0.032, -0.03, 0.03, look.main, sides=14), 1, math.pi / 2), (x, back - 0.01, 0.05))
            for x in (-0.38 * w, 0.38 * w)
        ),
        pipe(hose, 0.008, look.main, 6),
        moved(tilted(cylinder(0.022, -0.09, 0.04, look.main, sides=12), 0, 0.6), (0.02, back - 0.03, 0.62 * h)),
        *(slab(0.03, 0.04, z, z + 0.03, look.main, 0, d / 2 - 0.02) for z in (0.14, h - 0.14)),
    ]
    return Shape(tuple(parts))


@shape(
    "ShowerCurtain", size=(0.9, 0.12, 1.9), material=("fabric:lightblue", "fabric:white", "fabric:sage"), second="metal"
)
def shower_curtain(size: Vec3, look: Look) -> Shape:
    """Folds on rings on a rod; the rod is at the top of the shape."""
    w, d, h = size
    rod: list[Vec3] = [(-w / 2, 0, h - 0.015), (w / 2, 0, h - 0.015)]
    folds = max(3, round(w / 0.13))
    parts = [drape(0.94 * w, d, 0, h - 0.06, look.main, folds), pipe(rod, 0.012, look.second)]
    parts += [
        slab(0.008, 0.03, h - 0.075, h - 0.001, look.second, (i / (folds - 1) - 0.5) * 0.9 * w) for i in range(folds)
    ]
    return Shape(tuple(parts))


@shape("TowelHolder", size=(0.6, 0.1, 0.05), stands="wall", material=("steel", "brass", "black"))
def towel_holder(size: Vec3, look: Look) -> Shape:
    """A rail between two posts on round plates."""
    w, d, h = size
    r = h / 2
    parts = [pipe([(-w / 2, -d / 2 + 0.5 * r, r), (w / 2, -d / 2 + 0.5 * r, r)], 0.5 * r, look.main)]
    for x in (-0.42 * w, 0.42 * w):
        parts += [pipe([(x, d / 2, r), (x, -d / 2 + 0.5 * r, r)], 0.45 * r, look.main)]
        parts += [facing(cylinder(r, 0, 0.15 * d, look.main, sides=14), (x, d / 2, r))]
    return Shape(tuple(parts))


@shape("HandTowelHolder", size=(0.18, 0.06, 0.2), stands="wall", material=("steel", "brass", "black"))
def hand_towel_holder(size: Vec3, look: Look) -> Shape:
    """A ring that hangs from a round plate."""
    w, d, h = size
    y, r = -0.1 * d, 0.5 * w - 0.007
    turn = [math.pi / 2 + math.tau * i / 24 for i in range(25)]
    ring: list[Vec3] = [(r * math.cos(a), y, r + 0.007 + r * math.sin(a)) for a in turn]
    top = h - 0.03
    plate = facing(cylinder(0.03, 0, 0.25 * d, look.main, sides=16), (0, d / 2, top))
    return Shape((pipe(ring, 0.007, look.main), plate, pipe([(0, d / 2, top), (0, -d / 2, top)], 0.012, look.main)))


@shape(
    "ToiletPaperHanger", size=(0.17, 0.12, 0.13), stands="wall", material=("steel", "brass", "black"), second="paper"
)
def toilet_paper_hanger(size: Vec3, look: Look) -> Shape:
    """A bent wire from a plate on the wall, with a started roll on it, a leaf of it hanging down."""
    w, d, h = size
    r, y, z = 0.42 * min(h, d), -d / 2 + 0.42 * min(h, d), 0.55 * h
    wire: list[Vec3] = [(0.4 * w, d / 2, z), (0.4 * w, y + 0.02, z), (0.38 * w, y, z), (-0.46 * w, y, z)]
    roll = tilted(
        lathe(
            [(0.35 * r, -0.3 * w), (r, -0.3 * w), (r, 0.3 * w), (0.35 * r, 0.3 * w), (0.35 * r, -0.3 * w)],
            look.second,
            sides=20,
        ),
        1,
        math.pi / 2,
    )
    leaf = box((-0.3 * w, -d / 2, 0), (0.3 * w, -d / 2 + 0.003, z), look.second)
    plate = facing(cylinder(0.03, 0, 0.15 * d, look.main, sides=14), (0.36 * w, d / 2, z))
    return Shape((pipe(wire, 0.006, look.main), moved(roll, (0, y, z)), leaf, plate))


@shape("Mirror", size=(0.7, 0.04, 0.9), stands="wall", material=("oak", "black", "brass"), forms=3)
def mirror(size: Vec3, look: Look) -> Shape:
    """A framed mirror; the second has rounded corners, the third is oval."""
    w, d, h = size
    bar = min(0.045, 0.12 * w, 0.12 * h)
    if look.variant == 0:
        frame = [
            box((-w / 2, -d / 2, 0), (w / 2, d / 2, bar), look.main),
            box((-w / 2, -d / 2, h - bar), (w / 2, d / 2, h), look.main),
            *(box((x, -d / 2, bar), (x + bar, d / 2, h - bar), look.main) for x in (-w / 2, w / 2 - bar)),
        ]
        return Shape((*frame, box((-w / 2 + bar, 0, bar), (w / 2 - bar, d / 2, h - bar), "mirror")))

    def outline(inset: float, out: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        wide, tall = w - 2 * inset, h - 2 * inset
        if look.variant == 2:
            return oval(wide, tall, out, sides=32)
        return rectangle((-wide / 2, -tall / 2), (wide / 2, tall / 2), out, 0.3 * w)

    frame_part = loft(
        [outline(i, z) for i, z in ((0, 0.0), (0, 0.8 * d), (0.3 * bar, d), (bar, d), (bar, 0.5 * d))], look.main
    )
    pane = loft([outline(bar - 0.002, 0.1 * d), outline(bar - 0.002, 0.6 * d)], "mirror")
    return Shape(tuple(facing(part, (0, d / 2, h / 2)) for part in (frame_part, pane)))
