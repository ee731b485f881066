"""Shapes of bathroom and sink supplies: soap, paper, cloths, towels, brushes."""

from __future__ import annotations

import math

import numpy as np

from cartier_dollhouse.mesh import box, cushion, cylinder, lathe, moved, slab, tilted, tube
from cartier_dollhouse.model import Part, Shape, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.small import Profile, bent, hollow, made, rod, scaled, strip, washer, wavy


@shape(
    "SoapBottle",
    size=(0.1, 0.095, 0.22),
    stands="surface",
    material=("plastic:mediumseagreen", "plastic:cornflowerblue", "plastic:orange"),
    second="plastic:white",
)
def soap_bottle(size: Vec3, look: Look) -> Shape:
    body = lathe(
        [(0, 0), (0.037, 0), (0.04, 0.006), (0.04, 0.12), (0.032, 0.142), (0.014, 0.15), (0, 0.15)], look.main, sides=16
    )
    label = lathe([(0.0395, 0.035), (0.0405, 0.035), (0.0405, 0.1), (0.0395, 0.1)], "paper", sides=16)
    collar = cylinder(0.016, 0.148, 0.168, look.second, sides=10)
    stem = cylinder(0.005, 0.165, 0.2, look.second, sides=6)
    nozzle = [(0, 0.012, 0.203), (0, -0.03, 0.203), (0, -0.048, 0.194)]
    return made([body, label, collar, stem, tube(nozzle, 0.008, look.second, 6)])


@shape(
    "SoapBar", size=(0.06, 0.095, 0.03), stands="surface", material=("ceramic:pink", "ceramic:cream", "ceramic:sage")
)
def soap_bar(size: Vec3, look: Look) -> Shape:
    stamp = slab(0.028, 0.045, 0.027, 0.0305, look.main)
    return made([cushion((-0.03, -0.047, 0), (0.03, 0.047, 0.03), look.main, round_m=0.005, steps=3), stamp])


@shape(
    "SprayBottle",
    size=(0.07, 0.113, 0.245),
    stands="surface",
    material=("plastic:dodgerblue", "plastic:limegreen"),
    second="plastic:white",
)
def spray_bottle(size: Vec3, look: Look) -> Shape:
    body = lathe(
        [(0, 0), (0.032, 0), (0.035, 0.006), (0.035, 0.1), (0.014, 0.16), (0.012, 0.19), (0, 0.19)], look.main, sides=14
    )
    label = lathe([(0.0345, 0.025), (0.0355, 0.025), (0.0355, 0.085), (0.0345, 0.085)], "paper", sides=14)
    collar = cylinder(0.017, 0.178, 0.198, look.second, sides=10)
    head = strip(
        [(-0.055, 0.222, 0.008), (-0.03, 0.205, 0.012), (0.03, 0.205, 0.013), (0.045, 0.215, 0.01)], 0.028, look.second
    )
    nozzle = slab(0.02, 0.014, 0.223, 0.245, "plastic:crimson", y=-0.06)
    trigger = tube(bent([(-0.03, 0.21), (-0.042, 0.188), (-0.04, 0.16)]), 0.006, "plastic:crimson", 5)
    return made([body, label, collar, head, nozzle, trigger])


@shape("DishSponge", size=(0.074, 0.125, 0.03), stands="surface", material="fabric:gold", second="fabric:darkgreen")
def dish_sponge(size: Vec3, look: Look) -> Shape:
    foam = slab(0.074, 0.125, 0, 0.022, look.main)
    return made([foam, slab(0.072, 0.122, 0.021, 0.03, look.second)])


@shape("PaperTowelRoll", size=(0.11, 0.115, 0.23), stands="surface", material="fabric:white", second="cardboard")
def paper_towel_roll(size: Vec3, look: Look) -> Shape:
    sheet = box((0.05, -0.005, 0.003), (0.056, 0.06, 0.227), look.main)
    return made([*_roll(look, 0.055, 0.02, 0.23), sheet])


@shape("ToiletPaper", size=(0.11, 0.11, 0.1), stands="surface", material="fabric:white", second="cardboard")
def toilet_paper(size: Vec3, look: Look) -> Shape:
    sheet = box((0.05, -0.002, 0.001), (0.055, 0.05, 0.099), look.main)
    return made([*_roll(look, 0.055, 0.022, 0.1), sheet])


def _roll(look: Look, radius: float, core: float, height: float) -> list[Part]:
    paper = washer(core + 0.001, radius, 0, height, look.main, 18)
    return [paper, washer(core - 0.002, core + 0.002, -0.001, height + 0.001, look.second, 12)]


@shape(
    "TissueBox",
    size=(0.22, 0.12, 0.15),
    stands="surface",
    material=("fabric:skyblue", "fabric:pink", "fabric:sage"),
    second="plastic:white",
)
def tissue_box(size: Vec3, look: Look) -> Shape:
    slot = scaled(cylinder(0.05, 0.08, 0.0915, "black", sides=12), (1, 0.4, 1))
    crumple = scaled(
        lathe(
            [(0.03, 0.088), (0.018, 0.105), (0.03, 0.12), (0.055, 0.15), (0.012, 0.12), (0, 0.12)], look.second, sides=7
        ),
        (1, 0.5, 1),
    )
    bands = [slab(0.221, 0.121, z, z + 0.008, look.second) for z in (0.012, 0.07)]
    return made([slab(0.22, 0.12, 0, 0.09, look.main), *bands, slot, crumple, tilted(crumple, 1, 0.3, (0, 0, 0.09))])


@shape(
    "Cloth",
    size=(0.208, 0.184, 0.03),
    stands="surface",
    material=("fabric:steelblue", "fabric:terracotta", "fabric:mustard"),
    second="fabric:white",
)
def cloth(size: Vec3, look: Look) -> Shape:
    wave = [
        (-0.09, 0.002, 0.1),
        (-0.06, 0.0, 0.095),
        (-0.025, 0.004, 0.1),
        (0.02, 0.001, 0.094),
        (0.055, 0.004, 0.1),
        (0.09, 0.0, 0.096),
    ]
    fold = [(y * 0.9 + 0.012, z + 0.008, half * 0.7) for y, z, half in wave]
    top = [(y * 0.7 - 0.01, z + 0.016, half * 0.62) for y, z, half in wave]
    hems = [
        moved(strip([(y, z + 0.0085, 0.006) for y, z, _ in top], 0.0012, look.second), (x, 0, 0))
        for x in (-0.035, 0.035)
    ]
    parts = [
        strip(wave, 0.007, look.main),
        moved(strip(fold, 0.007, look.main), yaw=0.12),
        strip(top, 0.008, look.main),
        *hems,
    ]
    return made(parts)


@shape("Plunger", size=(0.148, 0.148, 0.539), stands="floor", material="rubber", second="pine")
def plunger(size: Vec3, look: Look) -> Shape:
    cup: Profile = [(0.05, 0), (0.074, 0.004), (0.072, 0.03), (0.06, 0.055), (0.03, 0.075), (0.022, 0.11), (0.0, 0.112)]
    stick = lathe([(0, 0.1), (0.012, 0.1), (0.012, 0.52), (0.008, 0.536), (0, 0.539)], look.second, sides=10)
    return made([lathe([(0, 0.03), *cup], look.main), stick])


@shape("ScrubBrush", size=(0.132, 0.134, 0.476), stands="floor", material="plastic:white", second="steel")
def scrub_brush(size: Vec3, look: Look) -> Shape:
    holder = hollow([(0.062, 0), (0.066, 0.006), (0.056, 0.13), (0.06, 0.15)], 0.004, 0.006, look.main, sides=16)
    bristles = lathe([(0, 0.03), (0.036, 0.04), (0.04, 0.12), (0.03, 0.165), (0, 0.17)], "fabric:whitesmoke", sides=10)
    stick = lathe(
        [(0, 0.165), (0.007, 0.165), (0.007, 0.37), (0.014, 0.39), (0.014, 0.46), (0.008, 0.474), (0, 0.476)],
        look.second,
        sides=10,
    )
    return made([holder, bristles, stick])


@shape(
    "Towel",
    size=(0.5, 0.06, 0.65),
    stands="wall",
    material=("fabric:steelblue", "fabric:terracotta", "fabric:sage", "fabric:sand"),
    second="fabric:white",
)
def towel(size: Vec3, look: Look) -> Shape:
    if size[2] < 0.6 * size[0]:
        return made(_pile(look))
    return made(_hanging(look, 0.5, 0.65))


@shape(
    "HandTowel",
    size=(0.24, 0.05, 0.405),
    stands="wall",
    material=("fabric:darkseagreen", "fabric:mustard", "fabric:petrol"),
    second="fabric:white",
)
def hand_towel(size: Vec3, look: Look) -> Shape:
    if size[2] < 0.6 * size[0]:
        return made(_pile(look))
    return made(_hanging(look, 0.24, 0.4))


def _pile(look: Look) -> list[Part]:
    """Folded cloth, layer on layer, with the fold to the front."""
    layers = [cushion((-0.2, -0.13, 0.028 * i), (0.2, 0.13, 0.029 + 0.028 * i), look.main, 0.0015, 2) for i in range(3)]
    return [
        *layers,
        slab(0.03, 0.25, 0.0835, 0.0875, look.second, x=0.12),
        slab(0.03, 0.25, 0.0835, 0.0875, look.second, x=0.07),
    ]


def _hanging(look: Look, width: float, height: float) -> list[Part]:
    """A cloth over a rail that two brackets hold to the wall at y = 0.06."""
    rail = rod([(-width / 2 - 0.02, 0.02, height - 0.015), (width / 2 + 0.02, 0.02, height - 0.015)], 0.008, "steel", 8)
    brackets = [
        box((x - 0.006, 0.014, height - 0.022), (x + 0.006, 0.06, height - 0.008), "steel")
        for x in (-width / 2 - 0.014, width / 2 + 0.014)
    ]
    folds = [(width * (i / 12 - 0.5), 0.004 * math.sin(1.9 * i)) for i in range(13)]
    front = _drape(folds, 0.0, height - 0.006, 0.01, look.main)
    back = slab(width * 0.98, 0.01, 0.2 * height, height - 0.008, look.main, y=0.036)
    ridge = slab(width, 0.042, height - 0.012, height, look.main, y=0.02)
    proud = [(x, y - 0.001) for x, y in folds]
    hems = [_drape(proud, z * height, (z + 0.035) * height, 0.012, look.second) for z in (0.08, 0.14)]
    return [rail, *brackets, front, back, ridge, *hems]


def _drape(folds: list[tuple[float, float]], z1: float, z2: float, thick: float, material: str) -> Part:
    """Cloth that hangs from z2 to z1 along folds (x, y)."""
    lain = strip([(x, y, (z2 - z1) / 2) for x, y in folds], thick, material)
    upright = lain.vertices[:, [1, 2, 0]] + (0, 0, (z1 + z2) / 2)
    return Part(upright.astype(np.float32), lain.faces, lain.vertices[:, [1, 0]], material)


@shape("GarbageBag", size=(0.5, 0.5, 0.558), stands="floor", material="plastic:charcoal", second="plastic:red")
def garbage_bag(size: Vec3, look: Look) -> Shape:
    sack = lathe(
        [(0, 0.01), (0.17, 0), (0.24, 0.1), (0.245, 0.2), (0.19, 0.32), (0.09, 0.4), (0.035, 0.43), (0.045, 0.46)],
        look.main,
        sides=16,
    )
    tie = lathe([(0.036, 0.42), (0.046, 0.425), (0.046, 0.442), (0.036, 0.447)], look.second, sides=10)
    frill = lathe([(0.03, 0.44), (0.04, 0.47), (0.1, 0.54), (0.02, 0.47), (0, 0.46)], look.main, sides=9)
    ears = [tilted(frill, 1, s * 0.35, (0, 0, 0.44)) for s in (-1, 1)]
    return made([wavy(wavy(sack, 9, 0.06), 2, 0.03), tie, *ears])
