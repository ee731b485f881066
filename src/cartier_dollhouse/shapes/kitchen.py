"""Shapes of kitchens: counters, sinks, faucets, burners, bins."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cylinder, lathe, moved, slab, sphere
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.joinery import (
    basin,
    case,
    facing,
    front,
    loft,
    pipe,
    rectangle,
    top_surface,
)

_TOP = 0.035


def _cupboards(width: float, depth: float, height: float, look: Look) -> list[Part]:
    """A row of cupboards on a plinth, a drawer over each door; the second form has an oven in the middle."""
    y, low, high = -depth / 2 + 0.05, 0.1, height - _TOP
    parts = [slab(width - 0.02, depth - 0.1, 0, low, "black", 0, 0.04)]
    parts += case((-width / 2, y, low), (width / 2, depth / 2, high), 0.018, look.main)
    n = max(1, round(width / 0.55))
    step = width / n
    for i in range(n):
        x1, x2 = -width / 2 + i * step, -width / 2 + (i + 1) * step
        if look.variant % 2 and i == n // 2:
            parts += _oven(x1, x2, y, low, high)
            continue
        drawer = high - 0.16
        parts += front((x1, y - 0.02, drawer), (x2, y, high), look.main, "metal", "bar")
        parts += front((x1, y - 0.02, low), (x2, y, drawer), look.main, "metal", "left" if i % 2 else "right")
    return parts


def _oven(x1: float, x2: float, y: float, low: float, high: float) -> list[Part]:
    panel, middle, reach = high - 0.13, (x1 + x2) / 2, (x2 - x1) / 2
    parts = [
        box((x1 + 0.003, y - 0.02, low), (x2 - 0.003, y, high), "steel"),
        box((x1 + 0.04, y - 0.026, low + 0.08), (x2 - 0.04, y - 0.02, panel - 0.07), "screen"),
        pipe([(x1 + 0.05, y - 0.04, panel - 0.03), (x2 - 0.05, y - 0.04, panel - 0.03)], 0.008, "metal", 6),
    ]
    knobs = [middle + reach * k for k in (-0.75, -0.4, 0.4, 0.75)]
    return parts + [facing(cylinder(0.02, 0, 0.022, "black", sides=10), (x, y - 0.02, panel + 0.06)) for x in knobs]


@shape(
    "CounterTop",
    size=(2.0, 0.62, 0.9),
    material=("paint:white", "paint:sage", "oak"),
    second=("stone:dark", "marble", "stone:grey"),
    forms=3,
)
def counter_top(size: Vec3, look: Look) -> Shape:
    """Cupboards under a stone top; the second has an oven. Deeper than 1 m it goes round a corner, its arm on the
    right."""
    w, d, h = size
    arm = 0.6
    if d <= 1.0:
        top = box((-w / 2, -d / 2, h - _TOP), (w / 2, d / 2, h), look.second)
        return Shape((*_cupboards(w, d, h, look), top), (top_surface("top", w, d, h),))
    y, x = d / 2 - arm, w / 2 - arm
    plain = Look(look.main, look.second, 0)
    long_side = [moved(part, (-arm / 2, d / 2 - arm / 2, 0)) for part in _cupboards(w - arm, arm, h, look)]
    short_side = [
        moved(part, (w / 2 - arm / 2, -arm / 2, 0), -math.pi / 2) for part in _cupboards(d - arm, arm, h, plain)
    ]
    parts = [
        *long_side,
        *short_side,
        box((x + 0.05, y + 0.05, 0.1), (w / 2, d / 2, h - _TOP), look.main),
        box((-w / 2, y, h - _TOP), (w / 2, d / 2, h), look.second),
        box((x, -d / 2, h - _TOP), (w / 2, y, h), look.second),
    ]
    main = Surface("top", h, (-w / 2 + 0.01, y + 0.01), (w / 2 - 0.01, d / 2 - 0.01))
    return Shape(tuple(parts), (main, Surface("corner", h, (x + 0.01, -d / 2 + 0.01), (w / 2 - 0.01, y))))


@shape("Sink", size=(0.6, 0.44, 0.17), stands="counter", material=("ceramic:white", "steel"), second="steel", forms=2)
def sink(size: Vec3, look: Look) -> Shape:
    """An open basin to set on a counter; higher than 0.5 m it is a washbasin on a pillar."""
    w, d, h = size
    deep = h if h <= 0.5 else 0.2
    low, floor = h - deep, 0.02
    parts = [
        basin((-w / 2, -d / 2, low), (w / 2, d / 2, h), 0.022, floor, look.main, 0.07),
        lathe(
            [(0.0, low + floor), (0.028, low + floor), (0.024, low + floor + 0.004), (0.0, low + floor + 0.002)],
            look.second,
            sides=16,
        ),
        moved(facing(cylinder(0.012, 0, 0.006, look.second, sides=10), (0, 0, 0)), (0, d / 2 - 0.021, h - 0.25 * deep)),
    ]
    if low > 0:
        pillar = [
            rectangle((-x, -y + 0.03), (x, y + 0.03), z, 0.06)
            for x, y, z in ((0.12, 0.1, 0), (0.08, 0.07, 0.1), (0.07, 0.06, 0.8 * low), (0.12, 0.1, low))
        ]
        parts.append(loft(pillar, look.main))
    edge = 0.03
    return Shape(
        tuple(parts),
        (Surface("basin", low + floor + 0.002, (-w / 2 + edge, -d / 2 + edge), (w / 2 - edge, d / 2 - edge)),),
    )


@shape("Faucet", size=(0.22, 0.2, 0.26), stands="counter", material=("steel", "brass"), second="steel", forms=2)
def faucet(size: Vec3, look: Look) -> Shape:
    """A swan's neck over a foot, with two cross handles where it is wide, else with one lever."""
    w, d, h = size
    r = max(0.007, min(0.012, 0.12 * d))
    back, bend = d / 2 - max(1.8 * r, 0.14 * d), d - 2 * r - max(1.8 * r, 0.14 * d)
    arc = [
        (0.0, back - bend / 2 * (1 - math.cos(a)), h - r - bend / 2 * (1 - math.sin(a)))
        for a in (i * math.pi / 8 for i in range(9))
    ]
    neck: list[Vec3] = [(0.0, back, 0.01), *arc, (0.0, back - bend, max(0.3 * h, h - r - bend / 2 - 0.05))]
    parts = [cylinder(min(1.9 * r, 0.4 * w), 0, 0.06 * h + 0.01, look.main, 0, back, 16), pipe(neck, r, look.main, 10)]
    if w < 0.14:
        lever: list[Vec3] = [(0, back, 0.3 * h), (0.3 * w, back, 0.34 * h), (w / 2 - 0.005, back, 0.45 * h)]
        return Shape(
            (*parts, pipe(lever, 0.006, look.main, 8), sphere(1.5 * r, (0, back, 0.28 * h), look.main, 1.0, 10))
        )
    for x in (-0.36 * w, 0.36 * w):
        parts += [
            cylinder(1.7 * r, 0, 0.05 * h, look.main, x, back, 14),
            cylinder(0.8 * r, 0, 0.22 * h, look.main, x, back, 10),
            pipe([(x - 0.13 * w, back, 0.22 * h), (x + 0.13 * w, back, 0.22 * h)], 0.006, look.main, 6),
            pipe([(x, back - 0.1 * d, 0.22 * h), (x, back + 0.1 * d, 0.22 * h)], 0.006, look.main, 6),
        ]
    parts.append(slab(0.72 * w, 2 * r, 0, 0.03 * h, look.main, 0, back))
    return Shape(tuple(parts))


@shape("StoveBurner", size=(0.26, 0.26, 0.025), stands="counter", material="black", second="steel", forms=2)
def stove_burner(size: Vec3, look: Look) -> Shape:
    """An iron plate on a steel square; the second is a gas ring with a grate. Wider than 0.4 m it is a hob of four."""
    w, d, h = size
    slab_top = 0.3 * h
    parts = [box((-w / 2, -d / 2, 0), (w / 2, d / 2, slab_top), look.second if w <= 0.4 else "screen")]
    spots = [(0.0, 0.0)] if w <= 0.4 else [(x * w, y * d) for x in (-0.24, 0.24) for y in (-0.23, 0.23)]
    r = 0.42 * min(w, d) if w <= 0.4 else 0.17 * min(w, d)
    for x, y in spots:
        if look.variant == 1:
            parts.append(
                lathe([(0, slab_top), (0.4 * r, slab_top), (0.36 * r, 0.75 * h), (0, 0.75 * h)], "steel", x, y, 14)
            )
            for k in range(2):
                bar = slab(2 * r, 0.07 * r, 0.75 * h, h, look.main)
                parts.append(moved(bar, (x, y, 0), math.pi / 4 + k * math.pi / 2))
            parts.append(
                lathe(
                    [(0.9 * r, slab_top), (r, slab_top), (r, 0.8 * h), (0.9 * r, 0.8 * h), (0.9 * r, slab_top)],
                    look.main,
                    x,
                    y,
                    20,
                )
            )
        else:
            rings = [
                (0, slab_top),
                (r, slab_top),
                (r, 0.9 * h),
                (0.92 * r, h),
                (0.6 * r, h),
                (0.56 * r, 0.85 * h),
                (0.52 * r, h),
                (0, h),
            ]
            parts.append(lathe(rings, look.main, x, y, 24))
            parts.append(
                lathe(
                    [(r, slab_top), (1.08 * r, slab_top), (1.05 * r, 0.7 * h), (r, 0.75 * h), (r, slab_top)],
                    "metal",
                    x,
                    y,
                    24,
                )
            )
    return Shape(tuple(parts), (top_surface("top", w, d, h),))


@shape(
    "GarbageCan",
    size=(0.36, 0.34, 0.56),
    material=("plastic:charcoal", "steel", "plastic:petrol"),
    second="plastic:lightgrey",
    forms=3,
)
def garbage_can(size: Vec3, look: Look) -> Shape:
    """An open bin with a rim; the second is round, with a lid and a pedal."""
    w, d, h = size
    if look.variant == 1:
        r = 0.48 * min(w, d)
        can = [
            (0, 0.02),
            (r, 0.02),
            (r, 0.82 * h),
            (1.02 * r, 0.82 * h),
            (r, 0.88 * h),
            (0.75 * r, 0.96 * h),
            (0.3 * r, h),
            (0, h),
        ]
        parts = [
            lathe(can, look.main),
            cylinder(1.02 * r, 0, 0.06 * h, "black"),
            slab(0.3 * r, 0.4 * r, 0.02, 0.035, "black", 0, -1.1 * r),
        ]
        return Shape((*parts, cylinder(1.01 * r, 0.8 * h, 0.82 * h, "black")))
    outline = [
        (0.14, 0.0, 0.05),
        (0.02, 0.94 * h, 0.05),
        (0.0, 0.94 * h, 0.06),
        (0.0, h, 0.06),
        (0.035, h, 0.05),
        (0.18, 0.03, 0.04),
    ]
    rings = [rectangle((-w / 2 + i * w, -d / 2 + i * d), (w / 2 - i * w, d / 2 - i * d), z, r) for i, z, r in outline]
    floor = Surface("inside", 0.03, (-0.28 * w, -0.28 * d), (0.28 * w, 0.28 * d), 2.0)
    return Shape((loft(rings, look.main),), (floor,))
