"""Shapes of storage: shelves, drawers, cabinets, a safe, a trolley, a laundry basket."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cylinder, moved, slab, tilted
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import (
    case,
    facing,
    front,
    legs,
    loft,
    padded,
    pipe,
    rectangle,
    top_surface,
)


@shape("ShelvingUnit", size=(0.95, 0.34, 1.5), material=("oak", "whitewood", "walnut"), second="metal", forms=3)
def shelving_unit(size: Vec3, look: Look) -> Shape:
    """A bookcase with a back; or (the third) boards in an open frame of metal. The lowest shelf has the most room."""
    w, d, h = size
    t, open_frame = min(0.025, 0.1 * w), look.variant == 2
    rows = max(2, round(h / 0.48))
    first, step = 0.08, (h - 0.08 - t) / (rows + 0.4)
    heights = [first, *(first + (i + 0.4) * step for i in range(1, rows))]
    if open_frame:
        posts = [
            slab(t, t, 0, h, look.second, x, y)
            for x in (-w / 2 + t / 2, w / 2 - t / 2)
            for y in (-d / 2 + t / 2, d / 2 - t / 2)
        ]
        parts = [*posts, box((-w / 2, -d / 2, h - t), (w / 2, d / 2, h), look.main)]
    else:
        parts = case((-w / 2, -d / 2, 0), (w / 2, d / 2, h), t, look.main)
        parts.append(box((-w / 2 + t, -d / 2 + 0.02, t), (w / 2 - t, -d / 2 + 0.035, first - t), look.main))
    parts += [slab(w - 2 * t, d - t, z - t, z, look.main, 0, -t / 2) for z in heights]
    surfaces = []
    for i, (z, above) in enumerate(zip(heights, [*heights[1:], h], strict=True)):
        low, high = (-w / 2 + t + 0.005, -d / 2 + 0.005), (w / 2 - t - 0.005, d / 2 - t - 0.005)
        surfaces.append(Surface(f"shelf {i + 1}", z, low, high, above - t - z))
    return Shape(tuple(parts), (*surfaces, top_surface("top", w - 2 * t, d - 2 * t, h)))


@shape("Shelf", size=(0.8, 0.22, 0.16), stands="wall", material=("oak", "walnut", "whitewood"), second="metal")
def shelf(size: Vec3, look: Look) -> Shape:
    """A board on two brackets."""
    w, d, h = size
    parts = [box((-w / 2, -d / 2, h - 0.025), (w / 2, d / 2, h), look.main)]
    for x in (-0.35 * w, 0.35 * w):
        parts.append(slab(0.025, 0.012, 0, h - 0.025, look.second, x, d / 2 - 0.006))
        brace: list[Vec3] = [(x, d / 2 - 0.01, 0.012), (x, -0.3 * d, h - 0.03)]
        parts += [
            pipe(brace, 0.008, look.second, 6),
            slab(0.025, 0.85 * d, h - 0.033, h - 0.025, look.second, x, 0.05 * d),
        ]
    return Shape(tuple(parts), (top_surface("top", w, d, h),))


@shape(
    "Dresser",
    size=(1.2, 0.5, 0.92),
    material=("oak", "walnut", "whitewood", "pine"),
    second=("brass", "metal"),
    forms=4,
)
def dresser(size: Vec3, look: Look) -> Shape:
    """A chest of drawers on feet."""
    w, d, h = size
    foot, y = min(0.1, 0.15 * h), -d / 2 + 0.022
    rows, columns = max(2, round((h - foot) / 0.26)), 2 if w > 0.9 else 1
    handle = "bar" if look.variant % 2 else "knob"
    parts = legs(w - 0.04, d - 0.06, foot, 0.05, look.main, taper=0.6)
    parts += case((-w / 2 + 0.01, y + 0.02, foot), (w / 2 - 0.01, d / 2, h - 0.02), 0.02, look.main)
    parts.append(box((-w / 2, -d / 2, h - 0.025), (w / 2, d / 2, h), look.main))
    wide, tall = (w - 0.06) / columns, (h - foot - 0.065) / rows
    for i in range(rows):
        for j in range(columns):
            x, z = -w / 2 + 0.03 + j * wide, foot + 0.02 + i * tall
            parts += front((x, y, z), (x + wide, y + 0.02, z + tall), look.main, look.second, handle)
    return Shape(tuple(parts), (top_surface("top", w, d, h),))


@shape("TVStand", size=(1.5, 0.45, 0.52), material=("oak", "walnut", "whitewood"), second="metal")
def tv_stand(size: Vec3, look: Look) -> Shape:
    """A low board: doors left and right, an open compartment with a shelf in the middle."""
    w, d, h = size
    foot, t, y = 0.2 * h, 0.022, -d / 2 + 0.02
    side = w / 2 - t - 0.27 * w
    middle = foot + t + (h - foot - 2 * t) * 0.5
    parts = legs(w - 0.1, d - 0.06, foot, 0.045, look.main, taper=0.6)
    parts += case((-w / 2, y, foot), (w / 2, d / 2, h), t, look.main)
    parts.append(box((-w / 2, -d / 2, h - t), (w / 2, y, h), look.main))
    parts += [slab(t, d - 0.05, foot + t, h - t, look.main, x, 0.005) for x in (-side, side)]
    parts.append(slab(2 * side - t, d - 0.06, middle - 0.015, middle, look.main, 0, 0.01))
    for sign, handle in ((-1, "right"), (1, "left")):
        inner, outer = sorted((sign * side, sign * (w / 2 - t)))
        parts += front((inner, y, foot + t), (outer, y + 0.018, h - t), look.main, look.second, handle)
    low, high = (-side + t, -d / 2 + 0.05), (side - t, d / 2 - 0.03)
    shelves = [
        Surface("shelf 1", foot + t, low, high, middle - 0.015 - foot - t),
        Surface("shelf 2", middle, low, high, h - t - middle),
    ]
    return Shape(tuple(parts), (top_surface("top", w, d, h), *shelves))


@shape(
    "Cabinet",
    size=(0.8, 0.35, 0.7),
    stands="wall",
    material=("paint:white", "oak", "paint:sage"),
    second="metal",
    forms=2,
)
def cabinet(size: Vec3, look: Look) -> Shape:
    """A wall cabinet: a door on its left half, the right half open with its shelves to be seen; the second is
    closed."""
    w, d, h = size
    t, y, shelf_z = 0.018, -d / 2 + 0.04, 0.5 * h
    parts = case((-w / 2, y, 0), (w / 2, d / 2, h), t, look.main)
    parts += [
        box((-t / 2, y, t), (t / 2, d / 2 - t, h - t), look.main),
        box((-w / 2 + t, y + 0.01, shelf_z - t), (w / 2 - t, d / 2 - t / 2, shelf_z), look.main),
        *front((-w / 2, y - 0.018, 0), (0, y, h), look.main, look.second, "right"),
    ]
    if look.variant == 1:
        parts += front((0, y - 0.018, 0), (w / 2, y, h), look.main, look.second, "left")
    low, high = (t, y + 0.015), (w / 2 - t - 0.005, d / 2 - t)
    lower, upper = (
        Surface("shelf 1", t, low, high, shelf_z - 2 * t),
        Surface("shelf 2", shelf_z, low, high, h - t - shelf_z),
    )
    return Shape(tuple(parts), (lower, upper))


@shape("Safe", size=(0.42, 0.45, 0.42), material=("paint:charcoal", "steel"), second="steel", forms=2)
def safe(size: Vec3, look: Look) -> Shape:
    """A strongbox with a dial, a wheel of three spokes and hinges."""
    w, d, h = size
    y = -d / 2 + 0.045
    parts = case((-w / 2, y + 0.02, 0.02), (w / 2, d / 2, h), 0.035, look.main)
    parts += [cylinder(0.025, 0, 0.02, "rubber", x, z, 10) for x in (-0.4 * w, 0.4 * w) for z in (-0.3 * d, 0.4 * d)]
    parts += [
        box((-w / 2 + 0.008, y + 0.012, 0.028), (w / 2 - 0.008, y + 0.035, h - 0.008), look.main),
        box((-0.4 * w, y, 0.02 + 0.08 * h), (0.4 * w, y + 0.012, 0.92 * h), look.main),
        facing(cylinder(0.1 * w, 0, 0.018, look.second), (-0.14 * w, y, 0.62 * h)),
        facing(cylinder(0.05 * w, 0, 0.035, "black", sides=12), (-0.14 * w, y, 0.62 * h)),
        facing(cylinder(0.035 * w, 0, 0.045, look.second, sides=12), (0.17 * w, y, 0.5 * h)),
    ]
    for i in range(3):
        spoke = tilted(slab(0.022 * w, 0.012, 0, 0.15 * w, look.second), 1, i * math.tau / 3 + 0.3)
        parts.append(moved(spoke, (0.17 * w, y - 0.036, 0.5 * h)))
    parts += [slab(0.02, 0.02, z * h, (z + 0.14) * h, look.second, w / 2 - 0.03, y - 0.004) for z in (0.18, 0.7)]
    return Shape(tuple(parts), (top_surface("top", w, d - 0.06, h, edge=0.02),))


@shape("Cart", size=(0.7, 0.5, 0.92), material=("metal", "brass", "paint:white"), second="oak")
def cart(size: Vec3, look: Look) -> Shape:
    """A serving trolley: three trays in a frame of tubes, with a handle and four castors."""
    w, d, h = size
    wheel, r, grip = 0.04, 0.012, 0.09
    x1, x2 = -w / 2 + r, w / 2 - r - grip
    y1, y2 = -d / 2 + r, d / 2 - r
    parts: list[Part] = []
    for x in (x1, x2):
        for y in (y1, y2):
            parts.append(pipe([(x, y, 2 * wheel), (x, y, h - 0.02)], r, look.main))
            parts.append(
                moved(
                    tilted(cylinder(wheel, -0.012, 0.012, "rubber", sides=12), 0, math.pi / 2),
                    (x, y + (0.012 if y < 0 else -0.012), wheel),
                )
            )
    handle: list[Vec3] = [(x2, y1, h - 0.05), (w / 2 - r, y1, h - r), (w / 2 - r, y2, h - r), (x2, y2, h - 0.05)]
    parts.append(pipe(handle, r, look.main))
    heights = (0.2 * h, 0.55 * h, h - 0.1)
    surfaces = []
    for z, above in zip(heights, (*heights[1:], h + 2.0), strict=True):
        parts.append(box((x1, y1, z - 0.015), (x2, y2, z), look.second))
        parts += [pipe([(x1, y, z + 0.03), (x2, y, z + 0.03)], 0.006, look.main, 6) for y in (y1, y2)]
        parts.append(pipe([(x1, y1, z + 0.03), (x1, y2, z + 0.03)], 0.006, look.main, 6))
        surfaces.append(Surface("", z, (x1 + 0.02, y1 + 0.02), (x2 - 0.02, y2 - 0.02), min(2.0, above - z - 0.015)))
    names = ("shelf 1", "shelf 2", "top")
    named = [Surface(n, s.z, s.low_xy, s.high_xy, s.clear_m) for n, s in zip(names, surfaces, strict=True)]
    return Shape(tuple(parts), (named[2], named[0], named[1]))


@shape("LaundryHamper", size=(0.5, 0.44, 0.66), material=("wicker", "fabric:grey"), second="fabric:white", forms=2)
def laundry_hamper(size: Vec3, look: Look) -> Shape:
    """An open basket with bands, two handles, and some washing in it."""
    w, d, h = size
    low, high = (-w / 2 + 0.02, -d / 2 + 0.01), (w / 2 - 0.02, d / 2 - 0.01)
    outline = [(0.06, 0.0), (0.0, 0.94 * h), (0.015, 0.94 * h), (0.07, 0.03)]
    grow = [rectangle((low[0] + i, low[1] + i), (high[0] - i, high[1] - i), z, 0.08) for i, z in outline]
    parts = [loft(grow, look.main)]
    for z, inset in ((0.02 * h, 0.05), (0.5 * h, 0.02), (0.9 * h, -0.01)):
        a, b = (low[0] + inset, low[1] + inset), (high[0] - inset, high[1] - inset)
        inner = (a[0] + 0.02, a[1] + 0.02), (b[0] - 0.02, b[1] - 0.02)
        top = z + 0.05 * h
        band = [rectangle(a, b, z, 0.09), rectangle(a, b, top, 0.09)]
        parts.append(loft([*band, rectangle(*inner, top, 0.08), rectangle(*inner, z, 0.08)], look.main, ends=False))
    for x in (low[0], high[0]):
        out = math.copysign(0.012, x)
        parts.append(
            pipe(
                [(x, -0.07, 0.78 * h), (x + out, -0.05, 0.84 * h), (x + out, 0.05, 0.84 * h), (x, 0.07, 0.78 * h)],
                0.008,
                look.main,
                6,
            )
        )
    parts += [
        padded((-0.3 * w, -0.3 * d, 0.3 * h), (0.25 * w, 0.25 * d, 0.98 * h), look.second, 0.12),
        padded((-0.1 * w, -0.2 * d, 0.3 * h), (0.34 * w, 0.3 * d, h), "fabric:petrol", 0.12),
    ]
    return Shape(tuple(parts))
