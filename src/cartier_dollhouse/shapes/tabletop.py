"""Shapes of crockery, cutlery, bottles and cooking utensils."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import cushion, cylinder, lathe, moved, prism, slab, sphere, tube
from cartier_dollhouse.model import Part, Shape, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.small import Profile, bent, hollow, inside, lying, made, rod, rows, scaled, strip


@shape(
    "Mug",
    size=(0.126, 0.091, 0.104),
    stands="surface",
    material=("ceramic:white", "ceramic:terracotta", "ceramic:petrol", "ceramic:mustard"),
)
def mug(size: Vec3, look: Look) -> Shape:
    body = hollow([(0.04, 0), (0.045, 0.008), (0.045, 0.104)], 0.004, 0.006, look.main)
    handle = [
        (0.043, 0, 0.085),
        (0.066, 0, 0.088),
        (0.077, 0, 0.066),
        (0.074, 0, 0.038),
        (0.06, 0, 0.022),
        (0.043, 0, 0.02),
    ]
    return made([body, rod(handle, 0.006, look.main)], inside(0.035, 0.006))


@shape(
    "Cup",
    size=(0.1, 0.1, 0.13),
    stands="surface",
    material=("ceramic:skyblue", "ceramic:cream", "ceramic:sage"),
    second="ceramic:white",
)
def cup(size: Vec3, look: Look) -> Shape:
    body = hollow([(0.032, 0), (0.034, 0.005), (0.05, 0.13)], 0.003, 0.006, look.main)
    band = lathe([(0.0445, 0.088), (0.0465, 0.088), (0.0495, 0.112), (0.047, 0.112)], look.second, sides=16)
    return made([body, band], inside(0.028, 0.006))


@shape(
    "Bowl",
    size=(0.197, 0.197, 0.086),
    stands="surface",
    material=("ceramic:white", "ceramic:petrol", "ceramic:terracotta"),
    second="ceramic:steelblue",
)
def bowl(size: Vec3, look: Look) -> Shape:
    outer: Profile = [(0.05, 0), (0.052, 0.008), (0.08, 0.018), (0.093, 0.045), (0.0985, 0.086)]
    lining: Profile = [(0.0945, 0.086), (0.089, 0.046), (0.075, 0.02), (0, 0.02)]
    body = lathe([(0, 0), *outer, *lining], look.main, sides=18)
    band = lathe([(0.0955, 0.062), (0.0965, 0.062), (0.0988, 0.078), (0.0968, 0.078)], look.second, sides=18)
    return made([body, band], inside(0.075, 0.02))


@shape(
    "Plate",
    size=(0.237, 0.237, 0.023),
    stands="surface",
    material=("ceramic:white", "ceramic:cream", "ceramic:skyblue"),
    second="ceramic:steelblue",
)
def plate(size: Vec3, look: Look) -> Shape:
    outer: Profile = [(0.07, 0), (0.074, 0.004), (0.118, 0.02), (0.118, 0.023)]
    body = lathe([(0, 0), *outer, (0.11, 0.0225), (0.08, 0.0085), (0, 0.008)], look.main)
    rim = lathe([(0.1182, 0.0205), (0.1182, 0.0234), (0.112, 0.0232)], look.second)
    return made([body, rim], inside(0.078, 0.0085, "top"))


@shape("Pot", size=(0.314, 0.25, 0.16), stands="surface", material=("steel", "paint:crimson"), second="black")
def pot(size: Vec3, look: Look) -> Shape:
    body = hollow([(0.117, 0), (0.124, 0.01), (0.124, 0.15), (0.127, 0.16)], 0.004, 0.008, look.main, sides=18)
    loop = [(0.12, -0.04, 0.128), (0.15, -0.035, 0.134), (0.15, 0.035, 0.134), (0.12, 0.04, 0.128)]
    handle = rod(loop, 0.008, look.second)
    return made([body, handle, moved(handle, yaw=math.pi)], inside(0.1, 0.008))


@shape("Pan", size=(0.279, 0.43, 0.06), stands="surface", material="black", second="black")
def pan(size: Vec3, look: Look) -> Shape:
    body = hollow([(0.115, 0), (0.139, 0.042), (0.141, 0.045)], 0.005, 0.005, look.main, sides=24)
    grip = strip(
        [(-0.36, 0.052, 0.013), (-0.34, 0.052, 0.016), (-0.22, 0.042, 0.013), (-0.19, 0.038, 0.011)], 0.014, look.second
    )
    neck = strip([(-0.2, 0.041, 0.009), (-0.13, 0.03, 0.012)], 0.006, "steel")
    return made([body, grip, neck], inside(0.105, 0.005))


@shape("PotLid", size=(0.25, 0.25, 0.075), stands="surface", material="steel", second="black")
def pot_lid(size: Vec3, look: Look) -> Shape:
    return made(_lid(look))


@shape("PanLid", size=(0.28, 0.28, 0.07), stands="surface", material="steel", second="black")
def pan_lid(size: Vec3, look: Look) -> Shape:
    return made(_lid(look))


def _lid(look: Look) -> list[Part]:
    dome = lathe([(0, 0), (0.125, 0), (0.127, 0.006), (0.1, 0.024), (0.05, 0.036), (0, 0.04)], look.main)
    knob = lathe([(0.008, 0.036), (0.008, 0.05), (0.02, 0.056), (0.022, 0.068), (0, 0.072)], look.second, sides=12)
    return [dome, knob]


@shape("Knife", size=(0.036, 0.333, 0.016), stands="surface", material="black", second="steel")
def knife(size: Vec3, look: Look) -> Shape:
    return made([_handle(look.main, 0.13), _blade(look.second, 0.2, 0.034)])


@shape("ButterKnife", size=(0.024, 0.23, 0.01), stands="surface", material="steel", second="steel")
def butter_knife(size: Vec3, look: Look) -> Shape:
    grip = strip([(-0.11, 0, 0.007), (-0.1, 0, 0.009), (0, 0.002, 0.006)], 0.007, look.main)
    edge = [(0.005, 0), (0.009, 0.05), (0.009, 0.085), (0.004, 0.1), (-0.002, 0.104), (-0.006, 0.1), (-0.005, 0)]
    return made([grip, prism(edge, 0.003, 0.005, look.second)])


def _handle(material: str, length: float) -> Part:
    return cushion((-0.013, -length, 0), (0.011, 0.004, 0.015), material, round_m=0.004, steps=2)


def _blade(material: str, length: float, wide: float) -> Part:
    """A pointed blade along +y, lying flat; its back is at -x."""
    back = -0.012
    outline = [(back, 0), (back + wide * 0.8, 0.005), (back + wide, 0.03), (back + wide, 0.5 * length)]
    return prism(
        [*outline, (back + wide * 0.7, 0.8 * length), (back + 0.003, length), (back, length)], 0.006, 0.0085, material
    )


@shape("Fork", size=(0.032, 0.229, 0.024), stands="surface", material="steel")
def fork(size: Vec3, look: Look) -> Shape:
    shaft = [(-0.11, 0.004, 0.008), (-0.09, 0.003, 0.009), (-0.02, 0.008, 0.004), (0.03, 0.014, 0.004)]
    root = [(0.042, 0.01, 0.013), (0.058, 0.003, 0.014)]
    tines = [
        strip([(0.056, 0.004, 0.0022), (0.085, 0, 0.002), (0.117, 0.01, 0.0012)], 0.003, look.main, x)
        for x in (-0.0115, -0.004, 0.004, 0.0115)
    ]
    return made([strip([*shaft, *root], 0.003, look.main), *tines])


@shape("Spoon", size=(0.041, 0.207, 0.022), stands="surface", material="steel")
def spoon(size: Vec3, look: Look) -> Shape:
    return made([*_scoop(look.main, 0.02, 0.032, 0.012, 0.15)])


@shape("Ladle", size=(0.085, 0.3, 0.07), stands="surface", material="steel", second="black")
def ladle(size: Vec3, look: Look) -> Shape:
    grip = tube(bent([(-0.25, 0.056), (-0.16, 0.058)]), 0.009, look.second, 6)
    return made([*_scoop(look.main, 0.042, 0.042, 0.035, 0.2), grip])


def _scoop(material: str, half: float, deep: float, tall: float, shaft: float) -> list[Part]:
    """The bowl of a spoon at the far end of a shaft."""
    lip: Profile = [(0, 0), (0.6, 0.1), (0.9, 0.5), (1, 1), (0.93, 1), (0.83, 0.55), (0.55, 0.2), (0, 0.12)]
    basin = scaled(lathe(lip, material, sides=14), (half, deep, tall))
    wide = min(half * 0.35, 0.009)
    sections = [
        (-shaft - deep, 1.1 * tall, wide),
        (-shaft, tall, wide),
        (-deep * 1.5, 1.3 * tall, wide / 2),
        (-deep * 0.95, tall - 0.003, wide),
    ]
    return [basin, strip(sections, 0.003, material)]


@shape("Spatula", size=(0.075, 0.3, 0.03), stands="surface", material="black", second="steel")
def spatula(size: Vec3, look: Look) -> Shape:
    grip = cushion((-0.012, -0.2, 0.014), (0.012, -0.09, 0.03), look.main, round_m=0.004, steps=2)
    neck = strip([(-0.1, 0.02, 0.005), (-0.02, 0.018, 0.004), (0.01, 0.002, 0.008)], 0.003, look.second)
    bars = [
        strip([(0.005, 0, 0.005), (0.095, 0, 0.006)], 0.003, look.main, x) for x in (-0.028, -0.0095, 0.0095, 0.028)
    ]
    ends = [slab(0.07, 0.02, 0, 0.003, look.main, y=y) for y in (0.005, 0.098)]
    return made([grip, neck, *bars, *ends])


@shape("SaltShaker", size=(0.058, 0.058, 0.111), stands="surface", material="ceramic:white", second="steel")
def salt_shaker(size: Vec3, look: Look) -> Shape:
    body = lathe([(0, 0), (0.028, 0), (0.029, 0.006), (0.02, 0.08), (0, 0.08)], look.main, sides=12)
    cap = lathe([(0.0215, 0.076), (0.0215, 0.092), (0.016, 0.104), (0, 0.11)], look.second, sides=12)
    holes = rows((-0.006, 0.006), (-0.006, 0.006), 0.003, 0.003, 0.104, 0.1095, "black")
    return made([body, cap, *holes])


@shape("PepperShaker", size=(0.058, 0.058, 0.125), stands="surface", material="walnut", second="steel")
def pepper_shaker(size: Vec3, look: Look) -> Shape:
    body: Profile = [
        (0, 0),
        (0.029, 0),
        (0.029, 0.02),
        (0.02, 0.04),
        (0.017, 0.058),
        (0.024, 0.08),
        (0.024, 0.084),
        (0, 0.084),
    ]
    head: Profile = [(0, 0.086), (0.024, 0.086), (0.027, 0.1), (0.018, 0.115), (0, 0.118)]
    knob = sphere(0.007, (0, 0, 0.12), look.second, sides=8)
    return made([lathe(body, look.main, sides=14), lathe(head, look.main, sides=14), knob])


@shape(
    "Bottle",
    size=(0.085, 0.085, 0.254),
    stands="surface",
    material=("plastic:cornflowerblue", "plastic:seagreen", "plastic:orange"),
    second="plastic:white",
)
def bottle(size: Vec3, look: Look) -> Shape:
    body: Profile = [
        (0, 0.004),
        (0.034, 0),
        (0.042, 0.01),
        (0.042, 0.08),
        (0.038, 0.09),
        (0.042, 0.1),
        (0.042, 0.155),
        (0.03, 0.19),
        (0.015, 0.212),
    ]
    label = lathe([(0.0415, 0.106), (0.0427, 0.106), (0.0427, 0.15), (0.0415, 0.15)], look.second, sides=14)
    cap = cylinder(0.017, 0.225, 0.254, look.second, sides=12)
    return made([lathe([*body, (0.014, 0.23), (0, 0.23)], look.main, sides=14), label, cap])


@shape("WineBottle", size=(0.08, 0.08, 0.31), stands="surface", material="ceramic:darkgreen", second="plastic:darkred")
def wine_bottle(size: Vec3, look: Look) -> Shape:
    body: Profile = [
        (0, 0.006),
        (0.036, 0),
        (0.04, 0.006),
        (0.04, 0.18),
        (0.034, 0.2),
        (0.018, 0.222),
        (0.014, 0.25),
        (0.014, 0.3),
        (0, 0.3),
    ]
    label = lathe([(0.0395, 0.06), (0.0405, 0.06), (0.0405, 0.15), (0.0395, 0.15)], "paper", sides=13)
    crest = lathe([(0.04, 0.1), (0.0408, 0.1), (0.0408, 0.125), (0.04, 0.125)], look.second, sides=13)
    foil = lathe([(0.0148, 0.255), (0.0155, 0.29), (0.0165, 0.292), (0.0165, 0.308), (0, 0.31)], look.second, sides=12)
    return made([lathe(body, look.main, sides=13), label, crest, foil])


@shape("AluminumFoil", size=(0.3, 0.1, 0.05), stands="surface", material="print:5", second="metal")
def aluminum_foil(size: Vec3, look: Look) -> Shape:
    sheet = strip(
        [(-0.072, 0.0, 0.14), (-0.06, 0.006, 0.14), (-0.045, 0.002, 0.14), (-0.02, 0.03, 0.14)], 0.003, look.second
    )
    roll = lying(cylinder(0.019, -0.148, 0.148, look.second, sides=12), 0.024)
    carton = slab(0.3, 0.05, 0, 0.05, look.main)
    return made([carton, moved(scaled(roll, (1, 1, 0.9)), (0, 0, 0), math.pi / 2), sheet])
