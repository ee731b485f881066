"""Training homes of the dollhouse detector: generated ones with more clutter, laid tables and other colours."""

from __future__ import annotations

import colorsys
import math
from dataclasses import replace
from typing import Any

import numpy as np

from cartier.labels import display_name
from cartier_dollhouse import shapes
from cartier_dollhouse.model import Scene, Thing
from cartier_dollhouse.place import Plan

ROBOT_M = 0.2
SELDOM = (  # what generated homes hold in none or hardly any: scattered as often as four others
    "BaseballBat", "Cabinet", "Cart", "Cloth", "Desktop", "DishSponge", "Dumbbell", "Footstool", "HandTowel",
    "KeyChain", "Ladle", "LightSwitch", "Microwave", "Newspaper", "Ottoman", "PaperTowelRoll", "Plunger", "Poster",
    "ScrubBrush", "Shelf", "ShowerDoor", "TennisRacket", "TissueBox", "VacuumCleaner", "WashingMachine", "Watch",
    "WineBottle",
)  # fmt: skip
TINY_M = 0.24  # what is smaller is mostly hidden or too far away to be learnt, so that there must be more of it
TABLES = {
    "DiningTable": 0.6,
    "CounterTop": 0.2,
    "CoffeeTable": 0.2,
    "Desk": 0.15,
    "SideTable": 0.15,
}  # chance of being laid
SETTING = (  # kind, chance, metres to the right of the plate and away from who sits there
    ("Plate", 0.9, 0.0, 0.0), ("Fork", 0.8, -0.17, 0.0), ("Knife", 0.5, 0.17, 0.0), ("ButterKnife", 0.5, 0.2, 0.02),
    ("Spoon", 0.7, 0.22, 0.0), ("Cup", 0.4, 0.16, 0.22), ("Mug", 0.3, -0.16, 0.2), ("Bowl", 0.4, 0.0, 0.26),
)  # fmt: skip
ALSO_ON_SHELVES = ("Boots", "BasketBall", "Dumbbell", "HousePlant")
HELD = {  # what lies in or on small things
    "Bowl": ("Apple", "Tomato", "Potato", "Egg", "Spoon"),
    "Plate": ("Bread", "BreadSliced", "Sandwich", "Apple", "AppleSliced", "TomatoSliced", "Fork", "Knife", "Egg"),
    "Pan": ("Egg", "EggCracked", "Potato", "Spatula"),
    "Box": ("Book", "TeddyBear", "BasketBall", "Bottle", "Cloth"),
    "Sink": ("DishSponge", "Plate", "Mug", "Bowl", "Pan", "Pot", "Cup"),
    "StoveBurner": ("Pan", "Pot", "Kettle"),
}
OVER_M = {"Pan": 0.1}  # its handle sticks out
WOODS = ("oak", "walnut", "pine", "whitewood", "birch", "cherry", "beech", "ash", "teak")
FAMILIES = ("paint", "fabric", "plastic", "ceramic", "leather", "carpet", "tiles", "planks", "stripes", "wood")
COLOURS = (
    "white", "cream", "ivory", "wheat", "sand", "grey", "lightgrey", "charcoal", "black", "petrol", "mustard",
    "terracotta", "sage", "olive", "steelblue", "darkred", "lightsteelblue", "mistyrose", "honeydew", "lightblue",
    "navy", "firebrick", "seagreen", "slategrey", "tan", "peru", "khaki", "lavender",
)  # fmt: skip
APPLES = ("red", "crimson", "darkred", "firebrick", "green", "limegreen", "yellowgreen", "olivedrab", "gold")
METALS = {"metal": "#9a9da1", "steel": "#b9bcc0", "black": "#242526"}
LEFT_OUT = ("Window", "Blinds", "Curtains", "ShowerHead", "Sink", "Faucet", "StoveBurner", "CounterTop", "Bathtub")


def names() -> list[str]:
    """The display names of all types of the dollhouse: the classes of the detector, in the order of the types."""
    return [display_name(kind) for kind in shapes.types()]


def varied(scene: Scene, rng: np.random.Generator, crowd: float = 1.0) -> Scene:
    """The home with other colours and with extra things of all types: on surfaces, on the floor and on walls.

    ``crowd``: how many more than usual there are on surfaces.

    Generated homes never hold about twenty types; here each has its chance, tables are laid, and bowls and pans hold
    something. Extra things may touch others: this is no home file, only something to look at.
    """
    scene = _with(scene, _on_floor(scene, rng) + _on_walls(scene, rng))
    scene = _with(scene, _on_surfaces(scene, rng, crowd))
    scene = _with(scene, _held(scene, rng))
    objs = [_recoloured(obj, rng) for obj in scene.things]
    structure = scene.structure
    if rng.random() < 0.6:
        swap: dict[str, str] = {}
        structure = tuple(replace(part, material=_other(part.material, rng, swap, 0.5)) for part in structure)
    return replace(scene, things=tuple(objs), structure=structure)


def _with(scene: Scene, extra: list[Thing]) -> Scene:
    """The home with more things, numbered on: ids count from 1 in the order of the things."""
    first = len(scene.things) + 1
    return replace(scene, things=(*scene.things, *(replace(obj, id=first + k) for k, obj in enumerate(extra))))


def _recoloured(obj: Thing, rng: np.random.Generator) -> Thing:
    swap: dict[str, str] = {}
    if obj.type == "Apple":  # home files give them any colour; by theirs alone they are no tomatoes
        swap = dict.fromkeys(("food:crimson", "food:yellowgreen"), f"food:{rng.choice(APPLES)}")
    elif rng.random() < 0.4:
        return obj
    parts = tuple(replace(part, material=_other(part.material, rng, swap, 0.6)) for part in obj.shape.parts)
    return replace(obj, shape=replace(obj.shape, parts=parts))


def _other(material: str, rng: np.random.Generator, swap: dict[str, str], chance: float) -> str:
    """Another wood for a wood, another colour for what is coloured; the same for all parts of one thing."""
    if material not in swap:
        family, _, colour = material.partition(":")
        swap[material] = material
        if rng.random() < chance:
            if material in WOODS:
                swap[material] = str(rng.choice(WOODS)) if rng.random() < 0.7 else f"paint:{_colour(rng)}"
            elif material in METALS:
                swap[material] = f"metal:{_colour(rng) if rng.random() < 0.3 else METALS[str(rng.choice([*METALS]))]}"
            elif family in FAMILIES and colour:
                wooden = family in ("planks", "wood")
                swap[material] = f"{family}:{rng.choice(WOODS) if wooden else _colour(rng)}"
    return swap[material]


def _colour(rng: np.random.Generator) -> str:
    """One of those that homes are full of, or any."""
    if rng.random() < 0.6:
        return str(rng.choice(COLOURS))
    red, green, blue = (
        255 * np.array(colorsys.hsv_to_rgb(rng.random(), rng.random() ** 1.5, rng.uniform(0.1, 1)))
    ).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _kinds(stands: str) -> tuple[list[str], Any]:
    """The types that stand so, and how likely each is to be taken."""
    kinds = [kind for kind in shapes.types() if shapes.info(kind).stands == stands and kind not in LEFT_OUT]
    weight = np.array([4.0 if kind in SELDOM or max(shapes.info(kind).size) < TINY_M else 1.0 for kind in kinds])
    return kinds, weight / weight.sum()


def _made(kind: str, rng: np.random.Generator) -> Any:
    usual = np.array(shapes.info(kind).size)
    size = np.maximum(usual * math.exp(rng.uniform(-0.25, 0.25)) * rng.uniform(0.85, 1.18, 3), 0.003)
    return shapes.build(kind, tuple(size.tolist()), None, int(rng.integers(20)))


def _on_surfaces(scene: Scene, rng: np.random.Generator, crowd: float) -> list[Thing]:
    """Small things where the tops and shelves of furniture are still free; some tables are laid first."""
    (kinds, odds), found = _kinds("surface"), []
    kinds, odds = [*kinds, *ALSO_ON_SHELVES], np.append(odds, [odds.min()] * len(ALSO_ON_SHELVES))
    odds /= odds.sum()
    boxes = {t.id: t.truth() for t in scene.things}
    for obj in scene.things:
        if obj.on:
            continue
        taken = [(b.box_min, b.box_max) for i, b in boxes.items() if _carrier(scene, i) == obj.id]
        if rng.random() < TABLES.get(obj.type, 0):
            found += _laid(obj, rng, taken)
        for surface in obj.shape.surfaces:
            span = np.array(surface.high_xy) - np.array(surface.low_xy)
            for _ in range(int(rng.poisson(crowd * min(9.0, 12.0 * float(np.prod(span)))))):
                made_of = str(rng.choice(kinds, p=odds))
                found += _put(obj, surface, made_of, None, rng, taken)
    return found


def _laid(table: Thing, rng: np.random.Generator, taken: list[Any]) -> list[Thing]:
    """Up to four places at the long sides of a table, as for a meal."""
    found: list[Thing] = []
    top = table.shape.surfaces[0]
    low, high = np.array(top.low_xy), np.array(top.high_xy)
    for _ in range(int(rng.integers(1, 5))):
        side = float(rng.choice((-1.0, 1.0)))  # of the table: whoever sits there looks the other way
        plate = np.array([rng.uniform(low[0] + 0.2, max(low[0] + 0.21, high[0] - 0.2)), 0.0])
        plate[1] = (high[1] - 0.17) if side > 0 else (low[1] + 0.17)
        for kind, chance, right, ahead in SETTING:
            if rng.random() < chance:
                at = plate + side * np.array([-right, -ahead]) + rng.normal(0, 0.012, 2)
                found += _put(table, top, kind, at, rng, taken)
    return found


def _held(scene: Scene, rng: np.random.Generator) -> list[Thing]:
    """What lies in bowls, on plates, in sinks and on stoves, half the time."""
    found: list[Thing] = []
    for obj in scene.things:
        if obj.type in HELD and rng.random() < 0.5:
            taken: list[Any] = []
            for _ in range(int(rng.integers(1, 4))):
                kind = str(rng.choice(HELD[obj.type]))
                found += _put(obj, obj.shape.surfaces[0], kind, None, rng, taken, OVER_M.get(kind, 0.04))
    return found


def _put(
    carrier: Thing, surface: Any, kind: str, at: Any, rng: np.random.Generator, taken: list[Any], over: float = 0.0
) -> list[Thing]:
    """A new thing on a surface, anywhere or ``at`` a point of it, in a list: empty where it does not fit or meets
    ``taken``.

    ``over``: metres by which it may stick out.
    """
    low, high, made = np.array(surface.low_xy), np.array(surface.high_xy), _made(kind, rng)
    half = min(made.size[:2]) / 2 - over
    if made.size[2] > surface.clear_m - 0.01 or max(made.size[:2]) > 1.2 * float((high - low).max()) + 2 * over:
        return []
    if (high - low < 2 * half).any():
        return []
    half = max(half, 0.0)
    anywhere = at is None
    spot = rng.uniform(low + half, high - half) if anywhere else np.clip(at, low + half, high - half)
    turn = rng.normal(0, 0.06)
    if anywhere:
        turn = rng.uniform(-0.6, 0.6) if rng.random() < 0.7 else rng.uniform(0, math.tau)
    x, y, z = carrier.to_world(np.array([*spot, surface.z])).tolist()
    new = Thing(0, kind, made, (x, y, z + 0.001), carrier.yaw + turn, 0)
    box = new.truth()
    if any(_meet((box.box_min, box.box_max), other) for other in taken):
        return []
    taken.append((box.box_min, box.box_max))
    return [new]


def _carrier(scene: Scene, number: int) -> int:
    """The id of what a thing stands on, by ids, which count from 1 in the order of the things."""
    return scene.things[number - 1].on


def _meet(a: Any, b: Any) -> bool:
    return all(a[0][k] < b[1][k] - 0.005 and b[0][k] < a[1][k] - 0.005 for k in range(3))


def _on_floor(scene: Scene, rng: np.random.Generator) -> list[Thing]:
    """Two to four pieces per room, of any type that stands on floors; some small things lie on the floor too."""
    plan, (floor, floor_odds), (small, small_odds) = Plan(scene, ROBOT_M), _kinds("floor"), _kinds("surface")
    found: list[Thing] = []
    for room in scene.rooms:
        low, high = np.array(room.box[:2]), np.array(room.box[2:])
        for _ in range(int(rng.integers(2, 5))):
            lies = rng.random() < 0.15
            kind = str(rng.choice(small, p=small_odds) if lies else rng.choice(floor, p=floor_odds))
            made = _made(kind, rng)
            reach = float(np.hypot(*made.size[:2])) / 2 * 0.9
            for _ in range(15):
                xy = rng.uniform(low, high)
                if plan.clearance(xy) > reach and all(math.dist(xy, t.at[:2]) > reach + 0.4 for t in found):
                    wall = int(np.argmin(np.abs(np.array(room.box) - np.tile(xy, 2))))
                    yaw = (math.pi / 2, math.pi, -math.pi / 2, 0.0)[wall] + rng.normal(0, 0.4)
                    found.append(Thing(0, kind, made, (float(xy[0]), float(xy[1]), 0.0), float(yaw)))
                    break
    return found


def _on_walls(scene: Scene, rng: np.random.Generator) -> list[Thing]:
    """Two to five things per room on its walls; one that hides behind furniture is simply not seen."""
    (kinds, odds), found = _kinds("wall"), list[Any]()
    holes = [(np.array(o.start), np.array(o.end)) for o in scene.openings]
    for room in scene.rooms:
        x1, y1, x2, y2 = room.box
        for _ in range(int(rng.integers(2, 6))):
            kind = str(rng.choice(kinds, p=odds))
            made = _made(kind, rng)
            width, depth, height = made.size
            side = int(rng.integers(4))
            low, high = (y1, y2) if side in (0, 2) else (x1, x2)
            if high - low < width + 0.2:
                continue
            along = float(rng.uniform(low + width / 2 + 0.05, high - width / 2 - 0.05))
            face = (x1 + depth / 2, y1 + depth / 2, x2 - depth / 2, y2 - depth / 2)[side]
            x, y = (face, along) if side in (0, 2) else (along, face)
            yaw = (math.pi / 2, math.pi, -math.pi / 2, 0.0)[side]
            near = any(_gap(np.array([x, y]), a, b) < width / 2 + 0.1 for a, b in holes)
            if near or any(math.dist((x, y), t.at[:2]) < (width + t.shape.size[0]) / 2 for t in found):
                continue
            bottom = max(0.1, float(rng.uniform(0.8, 1.9)) - height / 2)
            if bottom + height < scene.height_m - 0.05:
                found.append(Thing(0, kind, made, (x, y, bottom), yaw))
    return found


def _gap(point: Any, a: Any, b: Any) -> float:
    t = float(np.clip(np.dot(point - a, b - a) / max(1e-9, float(np.dot(b - a, b - a))), 0, 1))
    return float(np.linalg.norm(point - a - t * (b - a)))
