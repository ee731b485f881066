"""Shapes of decoration, toys, sports gear and other loose furnishings."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cushion, cylinder, lathe, moved, prism, slab, sphere, tilted, tube
from cartier_dollhouse.model import Shape, Surface, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.small import Profile, bent, hollow, hoop, lying, made, plump, rod, scaled


@shape(
    "Candle",
    size=(0.075, 0.075, 0.15),
    stands="surface",
    material=("plastic:ivory", "plastic:crimson", "plastic:sage"),
    second="brass",
)
def candle(size: Vec3, look: Look) -> Shape:
    dish = lathe(
        [(0, 0), (0.03, 0), (0.0375, 0.012), (0.036, 0.013), (0.026, 0.005), (0, 0.005)], look.second, sides=16
    )
    wax = lathe(
        [(0, 0.005), (0.022, 0.005), (0.022, 0.14), (0.019, 0.142), (0.008, 0.136), (0, 0.136)], look.main, sides=14
    )
    drip = cushion((0.014, -0.006, 0.09), (0.026, 0.006, 0.139), look.main, round_m=0.006, steps=2)
    wick = tube([(0, 0, 0.134), (0.001, 0, 0.147)], 0.0015, "black", 5)
    return made([dish, wax, drip, wick])


@shape(
    "Pillow",
    size=(0.43, 0.35, 0.136),
    stands="surface",
    material=("fabric:cream", "fabric:mustard", "fabric:petrol", "fabric:terracotta"),
    second="fabric:white",
)
def pillow(size: Vec3, look: Look) -> Shape:
    return made([plump(0.43, 0.35, 0.136, look.main)])


@shape(
    "Vase",
    size=(0.175, 0.175, 0.23),
    stands="surface",
    material=("ceramic:petrol", "ceramic:terracotta", "ceramic:cream", "ceramic:mustard"),
    second="ceramic:white",
)
def vase(size: Vec3, look: Look) -> Shape:
    if look.variant % 2:
        flared: Profile = [(0.05, 0), (0.055, 0.01), (0.045, 0.06), (0.05, 0.14), (0.085, 0.23)]
        ring = lathe([(0.047, 0.09), (0.05, 0.09), (0.053, 0.11), (0.05, 0.11)], look.second, sides=14)
        return made([hollow(flared, 0.006, 0.01, look.main, 14), ring])
    belly: Profile = [
        (0.045, 0),
        (0.05, 0.008),
        (0.084, 0.07),
        (0.084, 0.11),
        (0.05, 0.165),
        (0.034, 0.195),
        (0.05, 0.23),
    ]
    ring = lathe([(0.084, 0.082), (0.0868, 0.082), (0.0868, 0.098), (0.084, 0.098)], look.second, sides=14)
    return made([hollow(belly, 0.006, 0.01, look.main, 14), ring])


@shape("Statue", size=(0.186, 0.149, 0.35), stands="surface", material=("stone:white", "brass"), second="stone:dark")
def statue(size: Vec3, look: Look) -> Shape:
    plinth = [slab(0.15, 0.13, 0, 0.03, look.second), slab(0.12, 0.1, 0.03, 0.05, look.second)]
    if look.variant % 2:
        rings = [
            hoop(0.09, 0.02, (0, 0, 0.155), look.main, 1, 6, 12),
            hoop(0.045, 0.014, (0, 0, 0.16), look.main, 0, 5, 10),
        ]
        return made([*plinth, *rings, sphere(0.03, (0, 0, 0.275), look.main, sides=10)])
    robe = scaled(
        lathe(
            [(0, 0.05), (0.045, 0.05), (0.03, 0.12), (0.022, 0.17), (0.036, 0.225), (0.012, 0.245), (0, 0.25)],
            look.main,
            sides=10,
        ),
        (1, 0.75, 1),
    )
    arms = [
        rod(
            [(s * 0.03, 0, 0.225), (s * 0.07, -0.02, 0.25), (s * 0.05, -0.03, 0.305), (s * 0.012, -0.03, 0.335)],
            0.008,
            look.main,
            5,
        )
        for s in (-1, 1)
    ]
    head = scaled(sphere(0.02, (0, -0.002, 0.27), look.main, sides=10), (1, 1, 1.3), (0, 0, 0.27))
    ball = sphere(0.022, (0, -0.03, 0.345), "brass", sides=8)
    return made([*plinth, robe, *arms, head, ball])


@shape("TableTopDecor", size=(0.38, 0.25, 0.12), stands="surface", material="walnut", second="wicker")
def table_top_decor(size: Vec3, look: Look) -> Shape:
    tray = scaled(
        lathe([(0, 0), (0.09, 0), (0.19, 0.03), (0.186, 0.034), (0.09, 0.008), (0, 0.008)], look.main, sides=16),
        (1, 0.65, 1),
    )
    balls = [
        sphere(0.05, (-0.065, 0.0, 0.06), look.second, sides=10),
        sphere(0.042, (0.03, 0.018, 0.052), "ceramic:white", sides=10),
        sphere(0.032, (0.095, -0.012, 0.046), "brass", sides=10),
    ]
    return made([tray, *balls])


@shape("Box", size=(0.398, 0.415, 0.276), stands="surface", material="cardboard", second="paper")
def carton(size: Vec3, look: Look) -> Shape:
    w, d, h, t, flap = 0.165, 0.172, 0.2, 0.006, 0.085
    walls = [
        box((-w, -d, 0), (w, -d + t, h), look.main),
        box((-w, d - t, 0), (w, d, h), look.main),
        box((-w, -d + t, 0), (-w + t, d - t, h), look.main),
        box((w - t, -d + t, 0), (w, d - t, h), look.main),
        box((-w + t, -d + t, 0), (w - t, d - t, t), look.main),
    ]
    lid_y = tilted(box((-w, d - t, h), (w, d, h + flap), look.main), 0, -0.42, (0, d, h))
    lid_x = tilted(box((w - t, -d, h), (w, d, h + flap), look.main), 1, 0.42, (w, 0, h))
    flaps = [lid_y, moved(lid_y, yaw=math.pi), lid_x, moved(lid_x, yaw=math.pi)]
    label = slab(0.11, 0.004, 0.07, 0.15, look.second, x=0.07, y=-d)
    tape = slab(0.045, 0.003, 0.0, 0.1, "plastic:tan", x=-0.05, y=-d)
    return made([*walls, *flaps, label, tape], Surface("inside", t, (t - w, t - d), (w - t, d - t)))


@shape(
    "TeddyBear",
    size=(0.4, 0.32, 0.45),
    stands="surface",
    material=("fabric:peru", "fabric:sienna"),
    second="fabric:wheat",
)
def teddy_bear(size: Vec3, look: Look) -> Shape:
    body = sphere(0.12, (0, 0, 0.14), look.main, squash=1.15, sides=10)
    belly = sphere(0.075, (0, -0.064, 0.135), look.second, squash=1.15, sides=8)
    head = sphere(0.1, (0, -0.01, 0.34), look.main, squash=0.92, sides=10)
    snout = sphere(0.042, (0, -0.095, 0.32), look.second, squash=0.8, sides=6)
    face = [slab(0.03, 0.02, 0.328, 0.348, "black", y=-0.132)]
    face += [slab(0.02, 0.02, 0.36, 0.38, "black", x=s * 0.04, y=-0.094) for s in (-1, 1)]
    ears = [sphere(0.038, (s * 0.08, 0, 0.42), look.main, sides=6) for s in (-1, 1)]
    arms = [
        rod([(s * 0.09, -0.02, 0.22), (s * 0.15, -0.08, 0.16), (s * 0.165, -0.11, 0.12)], 0.038, look.main, 5)
        for s in (-1, 1)
    ]
    legs = [rod([(s * 0.07, -0.03, 0.05), (s * 0.12, -0.19, 0.05)], 0.048, look.main, 6) for s in (-1, 1)]
    soles = [sphere(0.04, (s * 0.12, -0.185, 0.05), look.second, sides=5) for s in (-1, 1)]
    return made([body, belly, head, snout, *face, *ears, *arms, *legs, *soles])


@shape("BasketBall", size=(0.24, 0.24, 0.24), stands="floor", material="rubber:chocolate", second="black")
def basket_ball(size: Vec3, look: Look) -> Shape:
    seam = lathe([(0.1195, -0.004), (0.1215, 0), (0.1195, 0.004)], look.second, sides=16)
    seams = [seam, tilted(seam, 0, math.pi / 2), tilted(seam, 1, math.pi / 2)]
    ball = sphere(0.12, (0, 0, 0), look.main, sides=16)
    return made([tilted(tilted(part, 0, 0.5), 1, 0.4) for part in (ball, *seams)])


@shape("BaseballBat", size=(0.081, 0.081, 0.9), stands="floor", material="pine", second="leather:black")
def baseball_bat(size: Vec3, look: Look) -> Shape:
    wood = lathe([(0, 0.002), (0.028, 0), (0.034, 0.02), (0.034, 0.28), (0.016, 0.6), (0, 0.6)], look.main, sides=14)
    grip = lathe([(0.0155, 0.6), (0.0145, 0.87), (0.026, 0.885), (0.026, 0.895), (0, 0.9)], look.second, sides=14)
    return made([wood, grip])


@shape("TennisRacket", size=(0.256, 0.653, 0.03), stands="surface", material="plastic:crimson", second="leather:black")
def tennis_racket(size: Vec3, look: Look) -> Shape:
    frame = scaled(hoop(0.12, 0.01, (0, 0, 0), look.main, 2, 5, 16), (1, 1.35, 1))
    z = 0.0015
    strings = [
        slab(0.003, 2 * 1.35 * math.sqrt(0.12**2 - x * x), -z, z, "plastic:ivory", x=x)
        for x in (-0.08, -0.04, 0.0, 0.04, 0.08)
    ]
    strings += [
        slab(2 * math.sqrt(0.12**2 - (y / 1.35) ** 2), 0.003, -z, z, "plastic:ivory", y=y)
        for y in (-0.12, -0.072, -0.024, 0.024, 0.072, 0.12)
    ]
    throat = [rod([(s * 0.06, -0.14, 0), (s * 0.01, -0.27, 0)], 0.009, look.main, 5) for s in (-1, 1)]
    grip = rod([(0, -0.25, 0), (0, -0.29, 0), (0, -0.48, 0)], 0.015, look.second, 6)
    return made([frame, *strings, *throat, grip])


@shape("Dumbbell", size=(0.132, 0.331, 0.132), stands="floor", material="rubber", second="steel")
def dumbbell(size: Vec3, look: Look) -> Shape:
    bar = cylinder(0.016, -0.1, 0.1, look.second, sides=10)
    weights = [
        lathe(
            [(0, s), (0.052, s), (0.066, s + 0.012), (0.066, s + 0.078), (0.052, s + 0.09), (0, s + 0.09)],
            look.main,
            sides=8,
        )
        for s in (-0.165, 0.075)
    ]
    return made([tilted(lying(part), 1, math.pi / 8) for part in (bar, *weights)])


@shape(
    "Boots",
    size=(0.277, 0.27, 0.4),
    stands="floor",
    material=("leather:saddlebrown", "leather:charcoal"),
    second="black",
)
def boots(size: Vec3, look: Look) -> Shape:
    parts = []
    for x in (-0.072, 0.072):
        shaft = hollow([(0.045, 0.03), (0.048, 0.15), (0.058, 0.4)], 0.006, 0.2, look.main, sides=9)
        cuff = lathe([(0.055, 0.355), (0.061, 0.36), (0.062, 0.385)], look.second, sides=9)
        foot = cushion((-0.046, -0.19, 0.015), (0.046, 0.045, 0.115), look.main, round_m=0.034, steps=2)
        sole = [(-0.036, 0.045), (-0.046, -0.13), (-0.03, -0.188), (0.03, -0.188), (0.046, -0.13), (0.036, 0.045)]
        heel = slab(0.078, 0.065, 0, 0.02, look.second, y=0.012)
        parts += [moved(p, (x, 0, 0)) for p in (shaft, cuff, foot, prism(sole, 0.012, 0.032, look.second), heel)]
    return made(parts)


@shape(
    "WateringCan",
    size=(0.16, 0.36, 0.24),
    stands="surface",
    material=("plastic:mediumseagreen", "metal"),
    second="brass",
)
def watering_can(size: Vec3, look: Look) -> Shape:
    body = hollow([(0.078, 0), (0.08, 0.01), (0.066, 0.15), (0.05, 0.16)], 0.004, 0.01, look.main, sides=16)
    spout = rod(bent([(-0.06, 0.03), (-0.12, 0.09), (-0.2, 0.2)]), 0.013, look.main, 7)
    rose = tilted(lathe([(0, 0), (0.014, 0), (0.027, 0.026), (0, 0.03)], look.second, 0, 0, 10), 0, 0.7)
    handle = rod(
        bent([(-0.045, 0.16), (-0.03, 0.225), (0.06, 0.235), (0.12, 0.18), (0.125, 0.11), (0.07, 0.05)]),
        0.009,
        look.main,
        6,
    )
    return made([body, spout, moved(rose, (0, -0.19, 0.19)), handle])
