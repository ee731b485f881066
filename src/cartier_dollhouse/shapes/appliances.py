"""Shapes of appliances: fridge, microwave, toaster, coffee machine, kettle, washing machine, dryer."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cylinder, lathe, slab, sphere
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import (
    case,
    facing,
    front,
    padded,
    pipe,
    top_surface,
)


@shape("Fridge", size=(0.8, 0.7, 1.84), material=("steel", "paint:cream", "paint:mustard"), second="metal", forms=2)
def fridge(size: Vec3, look: Look) -> Shape:
    """A fridge over a freezer, hollow, with three glass shelves; the second stands open, a half door to each side."""
    w, d, h = size
    t, split = 0.04, 0.34 * h
    opened = look.variant == 1
    door = min(0.45 * d, w / 2) if opened else 0.06
    y = -d / 2 + door + (0.0 if opened else 0.025)
    parts = case((-w / 2, y, 0.03), (w / 2, d / 2, h), t, look.main, "plastic:white")
    parts += [slab(0.05, 0.05, 0, 0.03, "black", x, z) for x in (-0.42 * w, 0.42 * w) for z in (y + 0.06, d / 2 - 0.06)]
    parts += [
        box((-w / 2 + t, y, split - 0.03), (w / 2 - t, d / 2 - t / 2, split), "plastic:white"),
        box((-w / 2 + t, y + 0.02, 0.28 * split), (w / 2 - t, d / 2 - t / 2, 0.28 * split + 0.01), "plastic:white"),
    ]
    low, high = (-w / 2 + t + 0.005, y + 0.015), (w / 2 - t - 0.005, d / 2 - t / 2 - 0.005)
    heights = [split + (h - t - split) * i / 3 for i in range(3)]
    parts += [box((low[0], low[1], z - 0.008), (high[0], high[1], z), "plastic:lightgrey") for z in heights[1:]]
    tops = [z - 0.008 for z in heights[1:]] + [h - t]
    surfaces = [
        Surface(f"shelf {i + 1}", z, low, high, top - z) for i, (z, top) in enumerate(zip(heights, tops, strict=True))
    ]
    freezer = Surface("freezer", 0.28 * split + 0.01, low, high, split - 0.03 - 0.28 * split - 0.01)
    if opened:
        for sign in (-1, 1):
            near, far = sorted((sign * (w / 2 - 0.05), sign * w / 2))
            parts.append(box((near, -d / 2, split), (far, y, h), look.main))
            inner = sign * (w / 2 - 0.05)
            rack = sorted((inner, inner - sign * 0.05))
            parts += [
                box((rack[0], -d / 2 + 0.03, z + 0.05), (rack[1], y - 0.03, z + 0.1), "plastic:white") for z in heights
            ]
        parts += front((-w / 2, y - 0.03, 0.04), (w / 2, y, split - 0.01), look.main, look.second, "bar")
        return Shape(tuple(parts), (*surfaces, freezer, top_surface("top", w, 0.5 * d, h)))
    for z1, z2, bar in (
        (0.04, split - 0.005, (split - 0.3, split - 0.06)),
        (split + 0.005, h, (split + 0.08, split + 0.5)),
    ):
        parts.append(padded((-w / 2, y - 0.06, z1), (w / 2, y, z2), look.main, 0.012))
        x = w / 2 - 0.07
        parts.append(box((x - 0.01, -d / 2, bar[0]), (x + 0.01, y - 0.05, bar[1]), look.second))
    return Shape(tuple(parts), (*surfaces, freezer, top_surface("top", w, 0.75 * d, h, edge=0.02)))


@shape(
    "Microwave",
    size=(0.52, 0.36, 0.3),
    stands="surface",
    material=("steel", "plastic:white", "plastic:black"),
    second="black",
)
def microwave(size: Vec3, look: Look) -> Shape:
    """A dark window in a door with a handle, a panel with display, keys and a dial on the right."""
    w, d, h = size
    y, split = -d / 2 + 0.03, 0.22 * w
    foot = 0.015
    parts = case((-w / 2, y, foot), (w / 2, d / 2, h), 0.015, look.main)
    parts += [slab(0.04, 0.04, 0, foot, "rubber", x, z) for x in (-0.4 * w, 0.4 * w) for z in (-0.3 * d, 0.35 * d)]
    parts += [
        box((-w / 2, y - 0.015, foot), (split, y, h), look.main),
        box((-w / 2 + 0.035, y - 0.019, foot + 0.04), (split - 0.05, y - 0.015, h - 0.035), "screen"),
        box((split, y - 0.012, foot), (w / 2, y, h), look.second),
        box((split, y, foot + 0.015), (split + 0.01, d / 2 - 0.01, h - 0.015), "plastic:lightgrey"),
        box((split + 0.015, y - 0.016, h - 0.075), (w / 2 - 0.015, y - 0.012, h - 0.03), "paint:lightgreen"),
        box((split - 0.032, -d / 2, foot + 0.05), (split - 0.016, y - 0.01, h - 0.04), "metal"),
        facing(cylinder(0.025, 0, 0.014, "metal", sides=14), ((split + w / 2) / 2, y - 0.012, foot + 0.055)),
    ]
    step = (w / 2 - split - 0.03) / 3
    for i in range(3):
        for j in range(3):
            x, z = split + 0.015 + i * step, foot + 0.1 + j * 0.03
            if z + 0.03 < h - 0.08:
                parts.append(
                    box((x + 0.003, y - 0.016, z), (x + step - 0.003, y - 0.012, z + 0.02), "plastic:lightgrey")
                )
    inside = Surface(
        "inside", foot + 0.015, (-w / 2 + 0.02, y + 0.005), (split - 0.005, d / 2 - 0.015), h - foot - 0.03
    )
    return Shape(tuple(parts), (Surface("top", h, (-w / 2 + 0.02, y + 0.01), (w / 2 - 0.02, d / 2 - 0.02)), inside))


@shape(
    "Toaster",
    size=(0.18, 0.3, 0.2),
    stands="surface",
    material=("steel", "plastic:red", "plastic:cream"),
    second="black",
    forms=3,
)
def toaster(size: Vec3, look: Look) -> Shape:
    """Two long slots, with bread looking out, a lever and a dial at the front end."""
    w, d, h = size
    wall, slot, foot, y1, y2 = 0.16 * w, 0.2 * w, 0.05 * h, -0.46 * d, d / 2
    top = 0.9 * h
    parts = [slab(0.9 * w, 0.84 * d, 0, foot, look.second, 0, 0.02 * d)]
    parts.append(box((-w / 2, y1, foot), (w / 2, y2, 0.3 * h), look.main))
    for x in (-w / 2 + wall / 2, 0.0, w / 2 - wall / 2):
        wide = wall if x else w - 2 * wall - 2 * slot
        parts.append(padded((x - wide / 2, y1, 0.25 * h), (x + wide / 2, y2, top), look.main, 0.02))
    parts += [
        box((-w / 2 + 0.02, a, 0.25 * h), (w / 2 - 0.02, b, top - 0.012), look.main)
        for a, b in ((y1 + 0.005, y1 + 0.12 * d), (y2 - 0.12 * d, y2 - 0.005))
    ]
    middle = w / 2 - wall - slot / 2
    parts += [
        padded((x - 0.3 * slot, -0.3 * d, 0.3 * h), (x + 0.3 * slot, 0.34 * d, h), "food:peru", 0.01)
        for x in (-middle, middle)
    ]
    parts += [
        box((-0.1 * w, y1 - 0.004, 0.3 * h), (0.1 * w, y1, 0.8 * h), look.second),
        box((-0.16 * w, -d / 2, 0.62 * h), (0.16 * w, y1, 0.68 * h), look.second),
        facing(cylinder(0.09 * w, 0, 0.03 * d, look.second, sides=12), (0.3 * w, y1, 0.25 * h)),
    ]
    return Shape(tuple(parts))


@shape(
    "CoffeeMachine",
    size=(0.34, 0.36, 0.4),
    stands="surface",
    material=("plastic:black", "plastic:red", "steel"),
    second="steel",
    forms=3,
)
def coffee_machine(size: Vec3, look: Look) -> Shape:
    """A filter machine, the jug of coffee on its plate; the third is an espresso machine with its filter holder."""
    w, d, h = size
    if look.variant == 2:
        return Shape(
            tuple(_espresso(size, look)),
            (Surface("tray", 0.1 * h, (-0.3 * w, -0.47 * d), (0.3 * w, -0.1 * d), 0.28 * h),),
        )
    back = 0.12 * d
    r, y, base = 0.3 * min(w, d), -0.17 * d, 0.1 * h
    jug = [
        (0, base),
        (0.8 * r, base),
        (r, base + 0.12 * h),
        (0.95 * r, base + 0.25 * h),
        (0.62 * r, base + 0.38 * h),
        (0.7 * r, base + 0.42 * h),
        (0, base + 0.42 * h),
    ]
    coffee = [
        (0, base + 0.01),
        (0.76 * r, base + 0.01),
        (1.02 * r, base + 0.12 * h),
        (1.0 * r, base + 0.2 * h),
        (0, base + 0.2 * h),
    ]
    handle: list[Vec3] = [
        (0.9 * r, y - 0.1 * r, base + 0.36 * h),
        (1.5 * r, y - 0.3 * r, base + 0.34 * h),
        (1.45 * r, y - 0.3 * r, base + 0.16 * h),
        (0.95 * r, y - 0.1 * r, base + 0.1 * h),
    ]
    parts = [
        padded((-w / 2, -d / 2, 0), (w / 2, d / 2, 0.9 * base), look.main, 0.02),
        padded((-w / 2, back, 0.5 * base), (w / 2, d / 2, h), look.main, 0.02),
        padded((-w / 2, -0.46 * d, 0.66 * h), (w / 2, 0.3 * d, h), look.main, 0.03),
        cylinder(0.95 * r, 0.8 * base, base, look.second, 0, y),
        cylinder(0.45 * r, 0.58 * h, 0.67 * h, "black", 0, y, 14),
        lathe(jug, "glass", 0, y),
        lathe(coffee, "plastic:saddlebrown", 0, y),
        cylinder(0.66 * r, base + 0.42 * h, base + 0.46 * h, "black", 0, y, 16),
        pipe(handle, 0.01, "black"),
        box((-0.3 * w, -0.475 * d, 0.76 * h), (0.3 * w, -0.455 * d, 0.92 * h), look.second),
    ]
    parts += [
        facing(cylinder(0.035 * h, 0, 0.02 * d, c, sides=12), (x * w, -0.475 * d, 0.84 * h))
        for x, c in ((-0.15, "plastic:red"), (0.12, "black"))
    ]
    return Shape(tuple(parts))


def _espresso(size: Vec3, look: Look) -> list[Part]:
    w, d, h = size
    y = -0.26 * d
    spout: list[Vec3] = [(0, y - 0.02, 0.52 * h), (0, -d / 2 + 0.01, 0.5 * h)]
    wand: list[Vec3] = [(0.36 * w, y, 0.62 * h), (0.44 * w, y - 0.06, 0.5 * h), (0.42 * w, y - 0.08, 0.2 * h)]
    parts = [
        padded((-w / 2, -d / 2, 0), (w / 2, d / 2, 0.1 * h), look.main, 0.01),
        padded((-w / 2, -0.02 * d, 0.06 * h), (w / 2, d / 2, 0.94 * h), look.main, 0.02),
        padded((-w / 2, -0.44 * d, 0.64 * h), (w / 2, 0.1 * d, 0.94 * h), look.main, 0.02),
        cylinder(0.14 * w, 0.54 * h, 0.66 * h, "metal", 0, y),
        cylinder(0.12 * w, 0.48 * h, 0.54 * h, "black", 0, y),
        pipe(spout, 0.014, "black"),
        pipe([(0, y, 0.5 * h), (0, y, 0.42 * h)], 0.01, "metal"),
        pipe(wand, 0.008, "metal", 6),
        facing(cylinder(0.1 * w, 0, 0.02, "paint:white", sides=16), (-0.26 * w, -0.44 * d, 0.8 * h)),
    ]
    parts += [
        facing(cylinder(0.04 * w, 0, 0.02, "black", sides=10), (x * w, -0.44 * d, 0.8 * h)) for x in (0.1, 0.26, 0.4)
    ]
    parts += [slab(0.8 * w, 0.015, 0.1 * h, 0.11 * h, "black", 0, (-0.45 + 0.08 * i) * d) for i in range(5)]
    return (
        parts
        + [pipe([(-0.45 * w, z, h - 0.01), (0.45 * w, z, h - 0.01)], 0.008, "metal", 6) for z in (-0.3 * d, 0.4 * d)]
        + [slab(0.9 * w, 0.7 * d, 0.93 * h, 0.95 * h, "metal", 0, 0.05 * d)]
    )


@shape(
    "Kettle",
    size=(0.22, 0.2, 0.21),
    stands="surface",
    material=("steel", "ceramic:red", "paint:petrol"),
    second="black",
)
def kettle(size: Vec3, look: Look) -> Shape:
    """A bellied can with a spout to the left, a bow handle over its lid and a knob."""
    w, d, h = size
    r, z = 0.48 * min(w, d), 0.7 * h
    belly = [
        (0, 0),
        (0.9 * r, 0),
        (r, 0.12 * h),
        (0.92 * r, 0.4 * h),
        (0.55 * r, 0.64 * h),
        (0.5 * r, 0.68 * h),
        (0, z),
    ]
    spout: list[Vec3] = [(-0.8 * r, 0, 0.3 * h), (-1.1 * r, 0, 0.42 * h), (-1.3 * r, 0, 0.68 * h)]
    bow: list[Vec3] = [
        (0.8 * r * math.cos(a), 0, 0.5 * h + 0.46 * h * math.sin(a)) for a in (math.pi * i / 10 for i in range(11))
    ]
    parts = [lathe(belly, look.main), pipe(spout, 0.16 * r, look.main), pipe(bow, 0.09 * r, look.second)]
    return Shape((*parts, sphere(0.13 * r, (0, 0, 0.73 * h), look.second, sides=10)))


def _laundry_machine(size: Vec3, look: Look, door: str) -> list[Part]:
    w, d, h = size
    y, z, r = -d / 2 + 0.045, 0.45 * h, min(0.31 * w, 0.3 * h)
    panel = h - 0.15
    parts = case((-w / 2, y, 0.03), (w / 2, d / 2, h), 0.02, look.main)
    parts += [cylinder(0.025, 0, 0.03, "rubber", a, b, 8) for a in (-0.42 * w, 0.42 * w) for b in (-0.36 * d, 0.4 * d)]
    ring = [(1.0, 0.0), (1.02, 0.02), (0.9, 0.04), (0.74, 0.03), (0.74, 0.0), (1.0, 0.0)]
    glass = [(0.0, 0.0), (0.75, 0.0), (0.75, 0.026), (0.4, 0.034), (0.0, 0.036)]
    parts += [
        box((-w / 2, y - 0.005, 0.03), (w / 2, y + 0.015, h), look.main),
        facing(lathe([(a * r, b) for a, b in ring], look.second, sides=28), (0, y - 0.005, z)),
        facing(lathe([(a * r, b) for a, b in glass], door, sides=28), (0, y - 0.005, z)),
        box((-w / 2 + 0.01, y - 0.009, panel + 0.015), (w / 2 - 0.01, y - 0.005, h - 0.015), "plastic:lightgrey"),
        box((0.2 * w, y - 0.013, panel + 0.04), (0.42 * w, y - 0.009, h - 0.035), "screen"),
        facing(cylinder(0.045, 0, 0.035, look.second, sides=16), (0.02 * w, y - 0.009, h - 0.075)),
        box((0.86 * r, y - 0.045, z - 0.05), (0.98 * r, y - 0.01, z + 0.05), "black"),
    ]
    return parts


@shape("WashingMachine", size=(0.6, 0.6, 0.86), material=("plastic:white", "steel"), second="metal")
def washing_machine(size: Vec3, look: Look) -> Shape:
    w, d, h = size
    y = -d / 2 + 0.04
    drawer = front((-0.46 * w, y - 0.012, h - 0.125), (-0.16 * w, y, h - 0.025), look.main, "metal", "bar")
    return Shape((*_laundry_machine(size, look, "screen"), *drawer), (top_surface("top", w, d - 0.1, h),))


@shape("ClothesDryer", size=(0.6, 0.6, 0.88), material=("plastic:lightgrey", "plastic:white"), second="plastic:white")
def clothes_dryer(size: Vec3, look: Look) -> Shape:
    """Like a washing machine, with a closed white door and an air grille at the foot."""
    w, d, h = size
    y = -d / 2 + 0.04
    slits = [slab(0.5 * w, 0.008, 0.05 + 0.02 * i, 0.06 + 0.02 * i, "black", 0, y - 0.002) for i in range(4)]
    return Shape((*_laundry_machine(size, look, "plastic:gainsboro"), *slits), (top_surface("top", w, d - 0.1, h),))
