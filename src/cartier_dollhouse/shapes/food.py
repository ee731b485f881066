"""Shapes of food, whole and sliced."""

from __future__ import annotations

import math

from cartier_dollhouse.mesh import box, cushion, cylinder, lathe, moved, prism, sphere, tilted, tube
from cartier_dollhouse.model import Part, Shape, Vec3
from cartier_dollhouse.shapes import Look, shape
from cartier_dollhouse.shapes.small import Profile, made, rows, scaled, strip, wavy

ARCH = [(-0.05, 0.0), (0.05, 0.0), (0.058, 0.045), (0.06, 0.08), (0.054, 0.106), (0.032, 0.122), (0.0, 0.126)]
LOAF = [*ARCH, *[(-x, y) for x, y in reversed(ARCH[2:-1])]]
"""The outline of a slice of bread, upright in x and y."""


@shape("Apple", size=(0.09, 0.09, 0.1), stands="surface", material=("food:crimson", "food:yellowgreen"))
def apple(size: Vec3, look: Look) -> Shape:
    body: Profile = [
        (0, 0.008),
        (0.014, 0),
        (0.034, 0.014),
        (0.044, 0.04),
        (0.043, 0.058),
        (0.03, 0.078),
        (0.014, 0.08),
    ]
    leaf = strip([(0, 0, 0.001), (0.012, 0.006, 0.007), (0.028, 0.006, 0.001)], 0.001, "food:green")
    return made(
        [
            lathe([*body, (0, 0.07)], look.main),
            tube([(0, 0, 0.07), (0.003, 0, 0.085), (0.008, 0, 0.098)], 0.0022, "food:saddlebrown", 5),
            moved(leaf, (0.003, 0, 0.082), -1.0),
        ],
    )


@shape("Tomato", size=(0.09, 0.09, 0.075), stands="surface", material="food:red")
def tomato(size: Vec3, look: Look) -> Shape:
    body: Profile = [(0, 0.003), (0.018, 0), (0.038, 0.014), (0.045, 0.034), (0.038, 0.055), (0.018, 0.066), (0, 0.061)]
    sepal = strip([(0.0, 0.064, 0.003), (0.012, 0.067, 0.005), (0.03, 0.062, 0.001)], 0.002, "food:green")
    stars = [moved(sepal, yaw=math.tau * i / 5) for i in range(5)]
    stem = tube([(0, 0, 0.062), (0.002, 0, 0.075)], 0.0025, "food:darkgreen", 5)
    return made([lathe(body, look.main, sides=16), *stars, stem])


@shape("Potato", size=(0.077, 0.117, 0.076), stands="surface", material="food:peru")
def potato(size: Vec3, look: Look) -> Shape:
    body = scaled(sphere(0.04, (0, 0, 0), look.main, sides=14), (0.95, 1.4, 0.85))
    lump = scaled(sphere(0.033, (0, 0, 0), look.main, sides=10), (1, 1.1, 0.9))
    eyes = [sphere(0.004, at, "food:saddlebrown", sides=6) for at in ((0.01, -0.02, 0.032), (-0.016, 0.015, 0.028))]
    return made([body, moved(lump, (0.008, 0.024, 0.006)), *eyes])


@shape("Egg", size=(0.054, 0.054, 0.079), stands="surface", material=("food:antiquewhite", "food:burlywood"))
def egg(size: Vec3, look: Look) -> Shape:
    profile: Profile = [
        (0, 0),
        (0.012, 0.003),
        (0.022, 0.014),
        (0.0265, 0.03),
        (0.024, 0.048),
        (0.016, 0.064),
        (0.007, 0.071),
    ]
    return made([lathe([*profile, (0, 0.073)], look.main, sides=16)])


@shape("EggCracked", size=(0.12, 0.12, 0.025), stands="surface", material="food:white", second="food:orange")
def egg_cracked(size: Vec3, look: Look) -> Shape:
    white = wavy(lathe([(0, 0), (0.055, 0), (0.057, 0.003), (0.046, 0.006), (0, 0.006)], look.main, sides=18), 3, 0.12)
    yolk = lathe([(0.02, 0.005), (0.018, 0.014), (0.01, 0.02), (0, 0.022)], look.second, sides=12)
    return made([white, moved(yolk, (0.006, -0.004, 0))])


@shape("Lettuce", size=(0.16, 0.2, 0.15), stands="surface", material="food:limegreen", second="food:forestgreen")
def lettuce(size: Vec3, look: Look) -> Shape:
    heart = scaled(sphere(0.05, (0, 0, 0.058), "food:yellowgreen", sides=10), (1, 1.2, 1.1), (0, 0, 0.058))
    leaves = []
    for i in range(8):
        colour = look.main if i % 2 else look.second
        leaf = scaled(sphere(0.045, (0, 0, 0), colour, sides=6), (0.95, 0.22, 1.25))
        leaf = tilted(leaf, 0, -0.35 if i % 2 else -0.15)
        out = 0.062 if i % 2 else 0.045
        leaves.append(moved(moved(leaf, (0, out, 0.06)), yaw=math.tau * i / 8))
    stalk = cylinder(0.02, 0.0, 0.03, "food:honeydew", sides=8)
    return made([heart, stalk, *leaves])


@shape("LettuceSliced", size=(0.2, 0.16, 0.06), stands="surface", material="food:limegreen", second="food:forestgreen")
def lettuce_sliced(size: Vec3, look: Look) -> Shape:
    leaves = []
    for i in range(9):
        colour = (look.main, look.second, "food:greenyellow")[i % 3]
        leaf = strip(
            [(-0.05, 0.012, 0.012), (-0.02, 0.0, 0.03), (0.02, 0.008, 0.034), (0.05, 0.022, 0.014)], 0.003, colour
        )
        leaves.append(
            moved(leaf, (0.04 * (i % 3 - 1), 0.02 * (i // 3 - 1), 0.008 * (i // 3) + 0.004 * (i % 3)), 0.9 * i)
        )
    return made(leaves)


@shape("Bread", size=(0.158, 0.291, 0.136), stands="surface", material="food:peru")
def bread(size: Vec3, look: Look) -> Shape:
    base = cushion((-0.062, -0.135, 0), (0.062, 0.135, 0.1), look.main, round_m=0.008, steps=2)
    crown = cushion((-0.075, -0.143, 0.035), (0.075, 0.143, 0.136), look.main, round_m=0.02, steps=3)
    cuts = []
    for y in (-0.08, 0.0, 0.08):
        cut = strip(
            [(-0.05, 0, 0.002), (-0.025, 0.012, 0.009), (0.025, 0.012, 0.009), (0.05, 0, 0.002)], 0.006, "food:wheat"
        )
        cuts.append(moved(moved(cut, yaw=1.0), (0, y, 0.118)))
    return made([base, crown, *cuts])


@shape("BreadSliced", size=(0.158, 0.3, 0.136), stands="surface", material="food:peru")
def bread_sliced(size: Vec3, look: Look) -> Shape:
    parts = _slice(0.14, look.main, 0.0, 0.08)
    for i in range(4):
        parts += _slice(0.016, look.main, -0.2 - 0.16 * i, -0.024 - 0.035 * i)
    return made(parts)


def _slice(thick: float, crust: str, lean: float, y: float) -> list[Part]:
    """An upright piece of a loaf whose foot stands at ``y``: the crust, and the crumb of the two faces."""
    crumb = [(x * 0.88, 0.006 + z * 0.9) for x, z in LOAF]
    parts = [prism(LOAF, 0, thick, crust), prism(crumb, -0.001, thick + 0.001, "food:wheat")]
    return [moved(tilted(tilted(part, 0, math.pi / 2), 0, lean), (0, y + thick / 2, 0.0)) for part in parts]


@shape("AppleSliced", size=(0.15, 0.1, 0.05), stands="surface", material="food:crimson")
def apple_sliced(size: Vec3, look: Look) -> Shape:
    return made(_fan([0.034, 0.04, 0.038, 0.028], 0.014, look.main, "food:lemonchiffon", "food:saddlebrown"))


@shape("TomatoSliced", size=(0.16, 0.1, 0.045), stands="surface", material="food:red")
def tomato_sliced(size: Vec3, look: Look) -> Shape:
    return made(_fan([0.036, 0.042, 0.042, 0.034], 0.012, look.main, "food:tomato", "food:gold"))


@shape("PotatoSliced", size=(0.16, 0.1, 0.045), stands="surface", material="food:peru")
def potato_sliced(size: Vec3, look: Look) -> Shape:
    return made(_fan([0.03, 0.04, 0.04, 0.032], 0.012, look.main, "food:khaki", "food:khaki"))


def _fan(radii: list[float], thick: float, skin: str, flesh: str, seed: str) -> list[Part]:
    """Round slices that lean on each other in a row: skin outside, flesh on the cut, seeds in the middle."""
    parts = []
    for i, radius in enumerate(radii):
        cut = radius * 0.92
        piece = [
            cylinder(radius, 0, thick, skin, sides=10),
            lathe([(cut, thick / 2), (cut, thick + 0.001), (0, thick + 0.001)], flesh, sides=10),
            *rows((-0.009, 0.009), (0.002,), 0.005, 0.006, thick / 2, thick + 0.002, seed),
        ]
        lean = 0.0 if i == 0 else 0.35
        foot = 0.0 if i == 0 else radius * math.sin(lean)
        parts += [moved(tilted(part, 1, lean), (-0.036 * i, 0.004 * (-1) ** i, foot)) for part in piece]
    return parts


@shape("Sandwich", size=(0.13, 0.13, 0.06), stands="surface", material="food:peru")
def sandwich(size: Vec3, look: Look) -> Shape:
    outline = [(x, y - 0.06) for x, y in LOAF]
    leaf = cushion((-0.064, -0.066, 0.016), (0.064, 0.07, 0.024), "food:limegreen", round_m=0.002, steps=2)
    return made(
        [
            prism(outline, 0, 0.016, look.main),
            leaf,
            cylinder(0.05, 0.024, 0.03, "food:tomato", sides=12),
            moved(box((-0.048, -0.048, 0.03), (0.048, 0.048, 0.035), "food:gold"), yaw=0.5),
            prism(outline, 0.035, 0.052, look.main),
        ],
    )
