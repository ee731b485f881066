"""Shapes of stationery, books, cards and small devices."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cushion, cylinder, lathe, moved, slab, tilted
from cartier_dollhouse.model import Part, Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.small import hoop, lying, made, rod, rows, scaled, strip, washer


@shape(
    "Book",
    size=(0.16, 0.23, 0.03),
    stands="surface",
    material=("print:4", "plastic:petrol", "print:11", "plastic:terracotta", "plastic:mustard"),
    second="paper",
    forms=6,
)
def book(size: Vec3, look: Look) -> Shape:
    if look.variant == 5:
        return made(_open_book(look))
    cover = [slab(0.16, 0.23, z, z + 0.003, look.main) for z in (0.0, 0.027)]
    spine = box((-0.08, -0.115, 0.003), (-0.076, 0.115, 0.027), look.main)
    pages = box((-0.076, -0.111, 0.003), (0.076, 0.111, 0.027), look.second)
    title = [
        slab(0.1, 0.03, 0.0295, 0.0304, look.second, y=0.06),
        slab(0.06, 0.008, 0.0295, 0.0304, look.second, y=-0.08),
    ]
    return made([*cover, spine, pages, *title], Surface("top", 0.0304, (-0.075, -0.11), (0.075, 0.11)))


def _open_book(look: Look) -> list[Part]:
    """Two arched stacks of pages on the spread cover."""
    arch = [(0.0, 0.006, 0.11), (0.03, 0.02, 0.11), (0.08, 0.019, 0.11), (0.15, 0.005, 0.11)]
    stack = [(x, 0.003, 0.11) for x, _, _ in arch]
    parts = [slab(0.32, 0.23, 0, 0.003, look.main)]
    for turn in (-math.pi / 2, math.pi / 2):
        leaf = strip(stack, 0.003, look.second)
        vertices = leaf.vertices.copy()
        vertices[vertices[:, 2] > 0.004, 2] = [z for _, z, _ in arch for _ in (0, 1)]
        parts.append(moved(Part(vertices, leaf.faces, leaf.uv_m, leaf.material), yaw=turn))
    return parts


@shape("Newspaper", size=(0.3, 0.22, 0.02), stands="surface", material="paper", second="plastic:dimgray")
def newspaper(size: Vec3, look: Look) -> Shape:
    sheets = [
        moved(slab(0.3, 0.2, 0.004 * i, 0.004 * i + 0.0035, look.main), (0.002 * i, 0, 0), 0.02 * i - 0.03)
        for i in range(4)
    ]
    fold = lying(cylinder(0.0075, -0.148, 0.148, look.main, sides=8), 0.0078)
    top = 0.0156
    ink = [
        slab(0.26, 0.022, top, top + 0.001, "black", y=0.07),
        slab(0.12, 0.06, top, top + 0.001, look.second, x=-0.065, y=0.015),
    ]
    columns = [
        slab(0.055, 0.006, top, top + 0.001, look.second, x, y)
        for x in (0.035, 0.1)
        for y in (0.04, 0.026, 0.012, -0.002, -0.016, -0.03, -0.044)
    ]
    return made([*sheets, moved(fold, (0, 0.1, 0), math.pi / 2), *ink, *columns])


@shape("Pen", size=(0.014, 0.16, 0.014), stands="surface", material=("plastic:navy", "plastic:crimson"), second="steel")
def pen(size: Vec3, look: Look) -> Shape:
    barrel = lathe([(0, 0), (0.005, 0), (0.005, 0.12), (0, 0.12)], look.main, sides=8)
    tip = lathe([(0.005, 0.12), (0.001, 0.145), (0, 0.147)], look.second, sides=8)
    clip = box((-0.0012, 0.004, 0.004), (0.0012, 0.0065, 0.05), look.second)
    button = cylinder(0.003, -0.01, 0.0, look.second, sides=8)
    return made([lying(part, 0.005) for part in (barrel, tip, clip, button)])


@shape("Pencil", size=(0.012, 0.183, 0.012), stands="surface", material="plastic:gold", second="plastic:lightpink")
def pencil(size: Vec3, look: Look) -> Shape:
    body = lathe([(0.0045, 0.02), (0.0045, 0.155), (0, 0.155)], look.main, sides=6)
    wood = lathe([(0.0045, 0.155), (0.0015, 0.175)], "pine", sides=6)
    lead = lathe([(0.0015, 0.175), (0, 0.183)], "black", sides=6)
    ferrule = lathe([(0.0046, 0.01), (0.0048, 0.01), (0.0048, 0.022), (0.004, 0.022)], "metal", sides=6)
    rubber = lathe([(0, 0), (0.0044, 0), (0.0044, 0.012)], look.second, sides=6)
    return made([lying(part, 0.005) for part in (body, wood, lead, ferrule, rubber)])


@shape(
    "CreditCard",
    size=(0.086, 0.054, 0.004),
    stands="surface",
    material=("plastic:royalblue", "plastic:darkgoldenrod"),
    second="brass",
)
def credit_card(size: Vec3, look: Look) -> Shape:
    chip = slab(0.013, 0.011, 0.002, 0.0032, look.second, x=-0.026, y=0.004)
    band = slab(0.0858, 0.009, 0.002, 0.003, "black", y=0.018)
    digits = rows((-0.026, -0.009, 0.009, 0.026), (-0.011,), 0.012, 0.004, 0.002, 0.003, "plastic:white")
    return made([slab(0.086, 0.054, 0, 0.0025, look.main), chip, band, *digits])


@shape("KeyChain", size=(0.1, 0.08, 0.01), stands="surface", material="leather:brown", second="brass")
def key_chain(size: Vec3, look: Look) -> Shape:
    ring = hoop(0.014, 0.0015, (0, 0, 0.005), "steel", 2, 4, 10)
    fob = cushion((-0.01, -0.055, 0.001), (0.01, -0.012, 0.008), look.main, round_m=0.002, steps=2)
    keys = []
    for yaw, z, metal in ((-0.75, 0.002, look.second), (0.55, 0.005, "steel")):
        bow = washer(0.004, 0.011, z, z + 0.002, metal, 7)
        teeth = [box((0.002, y, z), (0.0065, y + 0.003, z + 0.002), metal) for y in (0.03, 0.036, 0.042)]
        key = [bow, slab(0.005, 0.04, z, z + 0.002, metal, y=0.028), *teeth]
        keys += [moved(moved(part, (0, 0.022, 0)), yaw=yaw) for part in key]
    return made([ring, fob, *keys])


@shape("Watch", size=(0.079, 0.055, 0.045), stands="surface", material="leather:saddlebrown", second="steel")
def watch(size: Vec3, look: Look) -> Shape:
    strap = scaled(lying(washer(0.0335, 0.037, -0.011, 0.011, look.main, 18)), (1, 1, 0.54))
    case = cylinder(0.021, 0.015, 0.024, look.second, sides=16)
    dial = cylinder(0.0175, 0.02, 0.0248, "plastic:white", sides=16)
    hands = [
        box((-0.001, 0, 0.0245), (0.001, 0.014, 0.0254), "black"),
        box((0, -0.001, 0.0245), (0.01, 0.001, 0.0254), "black"),
    ]
    crown = box((0.02, -0.002, 0.017), (0.024, 0.002, 0.022), look.second)
    return made([strap, case, dial, *hands, crown])


@shape(
    "CellPhone",
    size=(0.076, 0.149, 0.01),
    stands="surface",
    material=("black", "plastic:whitesmoke"),
    second="screen:on",
)
def cell_phone(size: Vec3, look: Look) -> Shape:
    shell = slab(0.076, 0.149, 0, 0.009, look.main)
    glass = slab(0.068, 0.128, 0.008, 0.0096, look.second)
    button = [
        slab(0.016, 0.003, 0.008, 0.01, "plastic:grey", y=-0.069),
        slab(0.012, 0.002, 0.008, 0.01, "plastic:grey", y=0.069),
    ]
    return made([shell, glass, *button])


@shape("Laptop", size=(0.37, 0.31, 0.25), stands="surface", material="metal", second="black")
def laptop(size: Vec3, look: Look) -> Shape:
    base = slab(0.37, 0.24, 0, 0.016, look.main)
    bed = slab(0.33, 0.105, 0.015, 0.017, look.second, y=0.045)
    keys = rows(
        [0.0455 * (i - 3) for i in range(7)],
        (0.01, 0.034, 0.058, 0.082),
        0.038,
        0.018,
        0.016,
        0.019,
        "plastic:dimgray",
    )
    pad = slab(0.1, 0.06, 0.015, 0.0172, "plastic:silver", y=-0.065)
    lid = [
        slab(0.37, 0.008, 0.012, 0.25, look.main, y=0.12),
        box((-0.175, 0.115, 0.03), (0.175, 0.1155, 0.238), "screen:on"),
    ]
    frame = box((-0.182, 0.1155, 0.02), (0.182, 0.1165, 0.245), look.second)
    lean = math.radians(-20)
    return made([base, bed, *keys, pad, *[tilted(p, 0, lean, (0, 0.12, 0.012)) for p in (*lid, frame)]])


@shape("Desktop", size=(0.878, 0.32, 0.5), stands="surface", material="black", second="plastic:dimgray")
def desktop(size: Vec3, look: Look) -> Shape:
    screen = [
        slab(0.6, 0.03, 0.12, 0.48, look.main, x=-0.12, y=0.06),
        box((-0.405, 0.0435, 0.14), (0.165, 0.046, 0.465), "screen:on"),
    ]
    foot = [
        slab(0.06, 0.03, 0.0, 0.2, look.main, x=-0.12, y=0.085),
        slab(0.22, 0.14, 0, 0.012, look.main, x=-0.12, y=0.07),
    ]
    tower = [slab(0.18, 0.3, 0, 0.4, look.main, x=0.33), slab(0.14, 0.004, 0.31, 0.335, look.second, x=0.33, y=-0.15)]
    power = lying(cylinder(0.012, 0.145, 0.155, "plastic:deepskyblue", sides=8), 0.26)
    tray = slab(0.44, 0.13, 0.0, 0.014, look.second, x=-0.14, y=-0.1)
    keys = [slab(0.41, 0.02, 0.013, 0.02, look.main, x=-0.14, y=-0.1 + 0.028 * i) for i in (-1.5, -0.5, 0.5, 1.5)]
    mouse = cushion((0.12, -0.14, 0), (0.18, -0.05, 0.03), look.main, round_m=0.012, steps=2)
    return made([*screen, *foot, *tower, moved(power, (0.33, 0, 0)), tray, *keys, mouse])


@shape("RemoteControl", size=(0.055, 0.2, 0.022), stands="surface", material="black", second="plastic:lightgrey")
def remote_control(size: Vec3, look: Look) -> Shape:
    shell = cushion((-0.0275, -0.1, 0), (0.0275, 0.1, 0.018), look.main, round_m=0.002, steps=2)
    power = cylinder(0.006, 0.015, 0.022, "plastic:red", -0.014, 0.082, sides=8)
    pad = washer(0.009, 0.018, 0.015, 0.0215, look.second, 10)
    keys = rows((-0.015, 0, 0.015), (-0.075, -0.055, -0.035), 0.009, 0.01, 0.015, 0.0215, look.second)
    return made([shell, power, moved(pad, (0, 0.04, 0)), *keys])


@shape(
    "AlarmClock",
    size=(0.17, 0.09, 0.181),
    stands="surface",
    material=("plastic:crimson", "plastic:petrol", "plastic:cream"),
    second="brass",
)
def alarm_clock(size: Vec3, look: Look) -> Shape:
    middle = 0.075
    drum = lying(cylinder(0.062, -0.025, 0.025, look.main, sides=18), middle)
    dial = lying(cylinder(0.054, 0.02, 0.027, "plastic:ivory", sides=18), middle)
    hour = tilted(box((-0.003, -0.0295, middle), (0.003, -0.0265, middle + 0.03), "black"), 1, 1.0, (0, 0, middle))
    minute = tilted(box((-0.002, -0.0295, middle), (0.002, -0.0265, middle + 0.045), "black"), 1, -0.6, (0, 0, middle))
    marks = [
        tilted(
            box((-0.002, -0.0285, middle + 0.043), (0.002, -0.0265, middle + 0.051), "black"),
            1,
            k * math.pi / 2,
            (0, 0, middle),
        )
        for k in range(4)
    ]
    bell = lathe([(0.03, 0), (0.027, 0.014), (0.012, 0.024), (0, 0.026)], look.second, sides=8)
    bells = [tilted(moved(bell, (0, 0, 0.064)), 1, s * 0.62) for s in (-1, 1)]
    legs = [rod([(s * 0.035, 0, 0.03), (s * 0.055, 0, 0.0)], 0.006, look.second, 5) for s in (-1, 1)]
    handle = rod([(-0.02, 0, 0.14), (-0.014, 0, 0.172), (0.014, 0, 0.172), (0.02, 0, 0.14)], 0.004, look.second, 5)
    return made([drum, dial, hour, minute, *marks, *[moved(b, (0, 0, middle)) for b in bells], *legs, handle])


@shape("CD", size=(0.12, 0.12, 0.004), stands="surface", material="metal", second="print:2")
def compact_disc(size: Vec3, look: Look) -> Shape:
    disc = washer(0.0075, 0.06, 0, 0.0025, look.main, 18)
    label = washer(0.024, 0.053, 0.002, 0.0035, look.second, 18)
    return made([disc, label, washer(0.0075, 0.02, 0.002, 0.004, "plastic:white", 10)])
