"""Shapes of seats, beds and tables."""

from __future__ import annotations

from cartier_dollhouse.mesh import box, cylinder, lathe, slab
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import front, legs, loft, oval, padded, pipe, top_surface


def _upholstered(size: Vec3, look: Look, arm: float, seats: int) -> Shape:
    """Arms, seat cushions and leaning back cushions on short legs."""
    w, d, h = size
    seat, low, back = 0.48 * h, 0.1 * h, 0.2 * d
    inner, front_y, back_y = w / 2 - arm, -d / 2, d / 2 - back
    parts = legs(w - 0.06, d - 0.06, low, 0.06, look.second, taper=0.7)
    parts += [
        padded((-inner, front_y + 0.03, low), (inner, d / 2, 0.3 * h), look.main, 0.02),
        padded((-w / 2, front_y, low), (-inner, d / 2, 0.66 * h), look.main, 0.05),
        padded((inner, front_y, low), (w / 2, d / 2, 0.66 * h), look.main, 0.05),
        padded((-inner, d / 2 - 0.5 * back, low), (inner, d / 2, 0.92 * h), look.main, 0.05),
    ]
    wide = 2 * inner / seats
    for i in range(seats):
        x1, x2 = -inner + i * wide, -inner + (i + 1) * wide
        parts.append(padded((x1, front_y, 0.3 * h), (x2, back_y, seat), look.main, 0.04))
        parts.append(padded((x1, back_y, 0.46 * h), (x2, d / 2 - 0.05 * d, h), look.main, 0.06))
    return Shape(tuple(parts), (Surface("seat", seat, (-inner, front_y + 0.02), (inner, back_y)),))


@shape(
    "Sofa",
    size=(2.1, 0.93, 0.88),
    material=("fabric:petrol", "fabric:grey", "leather:brown", "fabric:sand"),
    second="walnut",
)
def sofa(size: Vec3, look: Look) -> Shape:
    arm = min(0.12, 0.15 * size[0])
    return _upholstered(size, look, arm, max(1, round((size[0] - 2 * arm) / 0.8)))


@shape(
    "ArmChair",
    size=(0.88, 0.88, 0.9),
    material=("fabric:mustard", "leather:brown", "fabric:terracotta"),
    second="walnut",
)
def arm_chair(size: Vec3, look: Look) -> Shape:
    return _upholstered(size, look, 0.17 * size[0], 1)


@shape("Chair", size=(0.45, 0.5, 0.88), material=("oak", "walnut", "paint:white"), second="fabric:grey", forms=3)
def chair(size: Vec3, look: Look) -> Shape:
    """Four legs, a seat, and a back of slats, of one board, or upholstered."""
    w, d, h = size
    seat, t = 0.51 * h, min(0.036, 0.1 * w)
    parts = [
        *legs(w, d, seat - 0.02, t, look.main, taper=0.75),
        box((-w / 2, -d / 2, seat - 0.03), (w / 2, d / 2, seat), look.main),
        box((-w / 2 + t, -d / 2 + 0.01, seat - 0.08), (w / 2 - t, -d / 2 + 0.03, seat - 0.03), look.main),
        box((-w / 2, d / 2 - t, seat), (-w / 2 + t, d / 2, h), look.main),
        box((w / 2 - t, d / 2 - t, seat), (w / 2, d / 2, h), look.main),
        box((-w / 2 + t, d / 2 - 0.8 * t, h - 0.09), (w / 2 - t, d / 2 - 0.1 * t, h), look.main),
    ]
    if look.variant == 1:
        parts.append(box((-w / 2 + t, d / 2 - 0.7 * t, 0.68 * h), (w / 2 - t, d / 2 - 0.2 * t, h - 0.13), look.main))
    elif look.variant == 2:
        parts.append(padded((-w / 2 + t, d / 2 - t, 0.62 * h), (w / 2 - t, d / 2, h - 0.1), look.second, 0.02))
    else:
        for x in (-0.25, 0.0, 0.25):
            parts.append(slab(0.1 * w, 0.4 * t, seat, h - 0.05, look.main, x * w, d / 2 - 0.5 * t))
    return Shape(tuple(parts), (Surface("seat", seat, (-w / 2 + 0.01, -d / 2 + 0.01), (w / 2 - 0.01, d / 2 - t)),))


@shape("Stool", size=(0.38, 0.38, 0.66), material=("oak", "metal", "paint:red"), second="fabric:grey", forms=3)
def stool(size: Vec3, look: Look) -> Shape:
    """A round seat on four splayed legs with rungs, or on one pillar; with a cushion or without."""
    w, d, h = size
    r = min(w, d) / 2
    soft = look.variant == 1
    parts: list[Part] = [cylinder(r, h - (0.07 if soft else 0.035), h, look.second if soft else look.main)]
    if look.variant == 1:
        parts += [cylinder(0.03, 0.02, h - 0.06, look.main, sides=12), cylinder(0.9 * r, 0, 0.025, look.main)]
        rest = [(0.55 * r, 0.34 * h), (0.6 * r, 0.34 * h + 0.01), (0.55 * r, 0.34 * h + 0.02), (0.55 * r, 0.34 * h)]
        parts.append(lathe(rest, look.main))
        parts += [slab(1.1 * r, 0.02, 0.34 * h, 0.34 * h + 0.02, look.main)]
    else:
        foot, top = 0.68 * r, 0.5 * r
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        parts += [pipe([(x * foot, y * foot, 0), (x * top, y * top, h - 0.03)], 0.016, look.main) for x, y in corners]
        rung = foot + (top - foot) * 0.35
        for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
            ends: list[Vec3] = [(ax * rung, ay * rung, 0.35 * h), (bx * rung, by * rung, 0.35 * h)]
            parts.append(pipe(ends, 0.01, look.main, 6))
    return Shape(tuple(parts), (top_surface("seat", 1.4 * r, 1.4 * r, h),))


@shape("Ottoman", size=(0.8, 0.52, 0.43), material=("fabric:grey", "leather:brown", "fabric:terracotta"), second="oak")
def ottoman(size: Vec3, look: Look) -> Shape:
    w, d, h = size
    parts = [
        *legs(w - 0.08, d - 0.08, 0.18 * h, 0.04, look.second, taper=0.6),
        padded((-0.49 * w, -0.49 * d, 0.18 * h), (0.49 * w, 0.49 * d, 0.66 * h), look.main, 0.02),
        padded((-w / 2, -d / 2, 0.64 * h), (w / 2, d / 2, h), look.main, 0.05),
        cylinder(0.015, h - 0.01, h + 0.002, look.second, sides=10),
    ]
    return Shape(tuple(parts), (top_surface("top", w, d, h, edge=0.02),))


@shape("Footstool", size=(0.42, 0.34, 0.4), material=("fabric:terracotta", "leather:brown"), second="walnut")
def footstool(size: Vec3, look: Look) -> Shape:
    w, d, h = size
    parts = [
        *legs(w, d, 0.72 * h, min(0.04, 0.1 * w), look.second, taper=0.5, splay=0.02),
        box((-0.46 * w, -0.46 * d, 0.58 * h), (0.46 * w, 0.46 * d, 0.72 * h), look.second),
        padded((-w / 2, -d / 2, 0.7 * h), (w / 2, d / 2, h), look.main, 0.05),
    ]
    return Shape(tuple(parts), (top_surface("top", w, d, h, edge=0.02),))


@shape("Bench", size=(1.2, 0.4, 0.46), material=("oak", "walnut"))
def bench(size: Vec3, look: Look) -> Shape:
    """Three planks on two trestles with a stretcher."""
    w, d, h = size
    plank = d / 3
    parts = [
        box((-w / 2, -d / 2 + i * plank + 0.004, h - 0.04), (w / 2, -d / 2 + (i + 1) * plank - 0.004, h), look.main)
        for i in range(3)
    ]
    for x in (-0.4 * w, 0.4 * w):
        parts += [slab(0.05, 0.06, 0, h - 0.04, look.main, x, y) for y in (-0.36 * d, 0.36 * d)]
        parts.append(slab(0.05, 0.9 * d, h - 0.09, h - 0.04, look.main, x))
    parts.append(slab(0.8 * w, 0.05, 0.35 * h, 0.35 * h + 0.05, look.main))
    parts += [slab(0.04, 0.72 * d, 0.35 * h, 0.35 * h + 0.05, look.main, x) for x in (-0.4 * w, 0.4 * w)]
    return Shape(tuple(parts), (top_surface("seat", w, d, h),))


@shape("Bed", size=(1.6, 2.15, 0.95), material=("fabric:petrol", "fabric:sage", "fabric:terracotta"), second="walnut")
def bed(size: Vec3, look: Look) -> Shape:
    """Frame, headboard at the back, mattress with a white sheet, and a cover of the colour over its lower part."""
    w, d, h = size
    rail, mattress, cover = 0.32, 0.5, 0.52
    head = d / 2 - 0.06
    scale = min(1.0, 0.75 * h / cover)
    rail, mattress, cover = rail * scale, mattress * scale, cover * scale
    fold = -d / 2 + 0.68 * d
    parts = [
        *legs(w, d - 0.02, 0.16 * scale, 0.07, look.second),
        box((-w / 2, -d / 2, 0.14 * scale), (w / 2, head, rail), look.second),
        box((-w / 2, head, 0.12 * scale), (w / 2, d / 2, h), look.second),
        box((-0.44 * w, head - 0.015, cover + 0.2 * (h - cover)), (-0.01, head, h - 0.12 * (h - cover)), look.second),
        box((0.01, head - 0.015, cover + 0.2 * (h - cover)), (0.44 * w, head, h - 0.12 * (h - cover)), look.second),
        padded((-w / 2 + 0.02, -d / 2 + 0.03, rail), (w / 2 - 0.02, head, mattress), "fabric:white", 0.05),
        padded((-w / 2 + 0.005, -d / 2 + 0.01, rail - 0.05), (w / 2 - 0.005, fold, cover), look.main, 0.03),
        padded((-w / 2 + 0.003, fold - 0.2, rail), (w / 2 - 0.003, fold, cover + 0.01), "fabric:white", 0.02),
    ]
    edge = w / 2 - 0.02
    return Shape(tuple(parts), (Surface("mattress", cover, (-edge, -d / 2 + 0.02), (edge, head - 0.02)),))


def _table(size: Vec3, look: Look, leg: float, taper: float = 0.7) -> list[Part]:
    """A top on an apron and four tapered legs."""
    w, d, h = size
    t, inset = 0.03, min(0.04, 0.06 * d)
    a, b = w / 2 - inset - leg / 2, d / 2 - inset - leg / 2
    low = h - t - min(0.08, 0.15 * h)
    parts = [box((-w / 2, -d / 2, h - t), (w / 2, d / 2, h), look.main)]
    parts += legs(w - 2 * inset, d - 2 * inset, h - t, leg, look.main, taper)
    parts += [slab(2 * a, 0.02, low, h - t, look.main, 0, y) for y in (-b, b)]
    return parts + [slab(0.02, 2 * b, low, h - t, look.main, x) for x in (-a, a)]


def _round_table(size: Vec3, look: Look) -> list[Part]:
    """A round or oval top on a turned pillar with a broad foot."""
    w, d, h = size
    r = w / 2
    pillar = [(0.0, 0.0), (0.55 * r, 0.0), (0.5 * r, 0.03), (0.1 * r, 0.1 * h), (0.07 * r, 0.5 * h)]
    pillar += [(0.1 * r, 0.8 * h), (0.3 * r, h - 0.03), (0.0, h - 0.03)]
    top = [(0.0, h - 0.03), (r - 0.01, h - 0.03), (r, h - 0.015), (r - 0.005, h), (0.0, h)]
    parts = [lathe(pillar, look.main), lathe(top, look.main, sides=32)]
    squash = d / w
    for part in parts:
        part.vertices[:, 1] *= squash
    return parts


@shape("DiningTable", size=(1.5, 0.9, 0.75), material=("oak", "walnut"), forms=2)
def dining_table(size: Vec3, look: Look) -> Shape:
    if look.variant == 1:
        return Shape(tuple(_round_table(size, look)), (top_surface("top", 0.7 * size[0], 0.7 * size[1], size[2]),))
    return Shape(tuple(_table(size, look, 0.07)), (top_surface("top", *size),))


@shape("CoffeeTable", size=(1.1, 0.62, 0.44), material=("oak", "walnut", "whitewood"), second="glass")
def coffee_table(size: Vec3, look: Look) -> Shape:
    """A low table with a shelf under its top."""
    w, d, h = size
    shelf = 0.32 * h
    parts = _table(size, look, 0.05, 0.9)
    parts.append(slab(w - 0.12, d - 0.1, shelf - 0.02, shelf, look.main))
    lower = top_surface("shelf", w - 0.2, d - 0.18, shelf, h - 0.03 - min(0.08, 0.15 * h) - shelf)
    return Shape(tuple(parts), (top_surface("top", *size), lower))


@shape("SideTable", size=(0.5, 0.42, 0.58), material=("oak", "walnut", "whitewood"), second="brass", forms=2)
def side_table(size: Vec3, look: Look) -> Shape:
    """A bedside table: a drawer under the top, an open shelf below; or a small table with a shelf."""
    w, d, h = size
    shelf, drawer = 0.22 * h, 0.68 * h
    surfaces = (
        top_surface("top", *size),
        top_surface("shelf", w - 0.1, d - 0.08, shelf, (drawer if look.variant != 1 else 0.8 * h) - shelf),
    )
    if look.variant == 1:
        parts = _table(size, look, 0.035)
        return Shape((*parts, slab(w - 0.09, d - 0.08, shelf - 0.02, shelf, look.main)), surfaces)
    t, y = 0.03, -d / 2 + 0.012
    parts = [
        *legs(w - 0.02, d - 0.03, h - t, t, look.main, taper=0.8),
        box((-w / 2, -d / 2, h - 0.025), (w / 2, d / 2, h), look.main),
        box((-w / 2 + 0.015, y + 0.02, drawer), (w / 2 - 0.015, d / 2 - 0.02, h - 0.025), look.main),
        *front((-w / 2 + 0.02, y, drawer), (w / 2 - 0.02, y + 0.02, h - 0.025), look.main, look.second, "knob"),
        slab(w - 0.05, d - 0.05, shelf - 0.02, shelf, look.main),
    ]
    return Shape(tuple(parts), surfaces)


@shape("Desk", size=(1.4, 0.62, 0.75), material=("oak", "walnut", "whitewood"), second="metal")
def desk(size: Vec3, look: Look) -> Shape:
    """A top with drawers on the right, knee room in the middle and a side on the left."""
    w, d, h = size
    t, pedestal = 0.03, min(0.4, 0.35 * w)
    left, y = w / 2 - pedestal - 0.02, -d / 2 + 0.03
    parts = [
        box((-w / 2, -d / 2, h - t), (w / 2, d / 2, h), look.main),
        box((-w / 2 + 0.02, -d / 2 + 0.03, 0), (-w / 2 + 0.05, d / 2 - 0.02, h - t), look.main),
        box((-w / 2 + 0.05, d / 2 - 0.06, 0.45 * h), (left, d / 2 - 0.04, h - t), look.main),
        box((left, y + 0.02, 0.06), (w / 2 - 0.02, d / 2 - 0.02, h - t), look.main),
        box((left + 0.02, y + 0.05, 0), (w / 2 - 0.04, d / 2 - 0.04, 0.06), look.main),
    ]
    step = (h - t - 0.06) / 3
    for i in range(3):
        z = 0.06 + i * step
        parts += front((left, y, z), (w / 2 - 0.02, y + 0.02, z + step), look.main, look.second, "bar")
    return Shape(tuple(parts), (top_surface("top", *size),))


@shape("DogBed", size=(0.9, 0.75, 0.2), material=("fabric:brown", "fabric:grey"), second="fabric:cream")
def dog_bed(size: Vec3, look: Look) -> Shape:
    """A soft oval rim, lower at the front, around a cushion."""
    w, d, h = size
    outline = [(0.03, 0.0), (0, 0.35 * h), (0.01, 0.75 * h), (0.05, h), (0.1, 0.85 * h), (0.13, 0.4 * h)]
    rim = loft([oval(w - 2 * inset, d - 2 * inset, z) for inset, z in outline], look.main)
    dip = (rim.vertices[:, 1] < -0.3 * d) & (rim.vertices[:, 2] > 0.5 * h)
    rim.vertices[dip, 2] *= 0.65
    pad = loft([oval(w - 2 * i, d - 2 * i, z * h) for i, z in ((0.1, 0.2), (0.1, 0.42), (0.16, 0.5))], look.second)
    return Shape((rim, pad), (top_surface("cushion", 0.5 * w, 0.5 * d, 0.5 * h),))
