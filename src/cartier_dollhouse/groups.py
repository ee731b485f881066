"""Furnishing rules of generated homes: furniture in groups (a bed with its night tables), and what lies on what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

Size = tuple[float, float, float]
Item = dict[str, Any]

WOODS = ("oak", "walnut", "pine", "whitewood")
FABRICS = ("petrol", "mustard", "terracotta", "sage", "charcoal", "sand", "olive", "steelblue", "darkred")
FRONTS = ("white", "whitewood", "sage", "petrol", "cream", "oak")


@dataclass(frozen=True)
class Group:
    """Furniture that stands together, its back to a wall unless it is ``free``.

    Frame: the origin in the middle of its back at the wall, x to the right of who looks at it, the front towards -y;
    ``front_m`` is the floor before it that stays empty. ``hung`` are furnishings on the wall above: type, x, size,
    bottom.
    """

    width: float
    depth: float
    height: float
    items: tuple[Item, ...]
    front_m: float = 0.6
    free: bool = False
    hung: tuple[tuple[str, float, Size, float], ...] = ()
    is_seat: bool = False
    faces_seat: bool = False


def _one(kind: str, size: Size, front_m: float = 0.6, stock: float = 0.0, **more: Any) -> Group:
    item = {"type": kind, "at": (0.0, -size[1] / 2), "size": size, "stock": stock, **more}
    return Group(size[0], size[1], size[2], (item,), front_m)


def _bed(rng: Random) -> Group:
    wide = rng.choice((0.95, 1.25, 1.65))
    pillows = 1 if wide < 1.5 else 2
    held: list[Item] = [
        {
            "type": "Pillow",
            "at": [(k - (pillows - 1) / 2) * wide / 2, 0.72],
            "size": (0.55, 0.38, 0.14),
            "colour": "white",
        }
        for k in range(pillows)
    ]
    if rng.random() < 0.25:
        held.append({"type": "TeddyBear", "at": [wide / 4, 0.25], "size": (0.26, 0.24, 0.32), "face": 20})
    if rng.random() < 0.4:
        held.append({"type": "Book", "at": [-wide / 5, -0.2], "face": 15, "variant": rng.randrange(8)})
    bed = {"type": "Bed", "at": (0.0, -1.03), "size": (wide, 2.05, 0.85), "colour": rng.choice(FABRICS), "things": held}
    sides = (-1, 1) if pillows == 2 and rng.random() < 0.6 else (rng.choice((-1, 1)),)
    wood = rng.choice(WOODS)
    tables = tuple(
        {
            "type": "SideTable",
            "at": (k * (wide / 2 + 0.26), -0.22),
            "size": (0.44, 0.42, 0.55),
            "colour": wood,
            "stock": 1.0,
        }
        for k in sides
    )
    both = wide + 2 * 0.48
    # A group's footprint is symmetric; the floor where a second night table would stand is simply left empty.
    return Group(both, 2.06, 0.85, (bed, *tables), 0.6)


def _sofa(rng: Random) -> Group:
    wide, colour = rng.choice((1.7, 2.0, 2.2)), rng.choice(FABRICS)
    held = [{"type": "Pillow", "at": [-wide / 4, 0.1], "colour": rng.choice(FABRICS)}] if rng.random() < 0.7 else []
    sofa = {"type": "Sofa", "at": (0.0, -0.46), "size": (wide, 0.92, 0.85), "colour": colour, "things": held}
    size = (rng.choice((0.9, 1.1)), 0.55, 0.42)
    table = {"type": "CoffeeTable", "at": (0.0, -1.66), "size": size, "colour": rng.choice(WOODS), "stock": 1.0}
    return Group(wide, 1.94, 0.85, (sofa, table), 0.6, is_seat=True)


def _television(rng: Random) -> Group:
    wide = rng.choice((1.3, 1.6))
    screen = {"type": "Television", "at": [0.0, 0.04], "size": (wide - 0.5, 0.2, 0.62)}
    stand = {"type": "TVStand", "at": (0.0, -0.23), "size": (wide, 0.45, 0.5), "colour": rng.choice(WOODS)}
    return Group(wide, 0.46, 1.12, (stand | {"things": [screen], "stock": 0.6},), 0.9, faces_seat=True)


def _desk(rng: Random) -> Group:
    wide = rng.choice((1.2, 1.4, 1.6))
    desk = {"type": "Desk", "at": (0.0, -0.31), "size": (wide, 0.6, 0.75), "colour": rng.choice(WOODS), "stock": 1.0}
    chair = {"type": "Chair", "at": (0.05, -0.94), "size": (0.46, 0.5, 0.88), "face": 180 + rng.randrange(-12, 13)}
    return Group(wide, 1.25, 0.88, (desk, chair), 0.5)


def _dining(rng: Random) -> Group:
    wide, rows = rng.choice(((0.8, 1), (1.2, 2), (1.5, 2)))
    wood = rng.choice(WOODS)
    size = (wide, 0.8, 0.75)
    table = {"type": "DiningTable", "at": (0.0, -0.97), "size": size, "colour": wood, "stock": 1.0}
    xs = (0.0,) if rows == 1 else (-wide / 4, wide / 4)
    chair = {"type": "Chair", "size": (0.46, 0.5, 0.88), "colour": wood}
    turned = [(x, -0.27, 0) for x in xs] + [(x, -1.67, 180) for x in xs]
    chairs = tuple(chair | {"at": (x, y), "face": face + rng.randrange(-4, 5)} for x, y, face in turned)
    return Group(wide, 1.96, 0.88, (table, *chairs), 0.0, free=True)


def _kitchen(rng: Random) -> Group:
    wide = rng.choice((2.0, 2.2, 2.4))
    half = wide / 2
    held: list[Item] = [
        {"type": "Sink", "at": [half - 0.5, -0.03], "size": (0.55, 0.42, 0.17)},
        {"type": "Faucet", "at": [half - 0.5, 0.18], "size": (0.2, 0.2, 0.3)},
    ]
    for x in (0.2, 0.48):
        for y in (-0.14, 0.14):
            held.append({"type": "StoveBurner", "at": [x - half, y]})
    on = rng.choice((None, "Pot", "Pan", "Kettle"))
    if on:
        # A pan's handle points to the side: its middle is not that of its bottom.
        held[-1]["things"] = [
            {"type": on, "at": [-0.09, 0.0] if on == "Pan" else [0.0, 0.0], "face": 270 if on == "Pan" else 0}
        ]
    counter = {"type": "CounterTop", "size": (wide, 0.62, 0.9), "colour": rng.choice(FRONTS), "stock": 0.7}
    fridge = {"type": "Fridge", "size": (0.66, 0.66, 1.75), "colour": rng.choice(("white", "steel", "mustard", "sage"))}
    turn = rng.choice((-1, 1))
    items = (
        counter | {"at": (turn * 0.35, -0.32), "things": held},
        fridge | {"at": (-turn * (half + 0.01), -0.34), "stock": 1.0, "variant": rng.choice((0, 1))},
    )
    return Group(wide + 0.7, 0.68, 1.75, items, 0.8)


def _vanity(rng: Random) -> Group:
    wide = rng.choice((0.8, 1.0))
    held: list[Item] = [
        {"type": "Sink", "at": [0.0, -0.03], "size": (0.46, 0.36, 0.15)},
        {"type": "Faucet", "at": [0.0, 0.13], "size": (0.18, 0.18, 0.26)},
        {"type": rng.choice(("SoapBottle", "SoapBar")), "at": [wide / 2 - 0.1, 0.12]},
    ]
    counter = {"type": "CounterTop", "at": (0.0, -0.26), "size": (wide, 0.5, 0.85), "colour": rng.choice(FRONTS)}
    mirror = ("Mirror", 0.0, (wide - 0.2, 0.04, 0.8), 1.15)
    return Group(wide, 0.52, 0.85, (counter | {"things": held},), 0.6, hung=(mirror,))


def _toilet(_: Random) -> Group:
    toilet = {"type": "Toilet", "at": (0.0, -0.37), "size": (0.42, 0.72, 0.8)}
    roll = {"type": "ToiletPaper", "at": (0.3, -0.12), "height": 0.0}
    return Group(0.8, 0.74, 0.8, (toilet, roll), 0.6)


def _tub(_: Random) -> Group:
    head = ("ShowerHead", 0.6, (0.22, 0.25, 1.1), 1.0)
    return Group(
        1.7, 0.8, 0.58, ({"type": "Bathtub", "at": (0.0, -0.4), "size": (1.7, 0.78, 0.58)},), 0.5, hung=(head,)
    )


def _shelf(rng: Random) -> Group:
    size = (rng.choice((0.8, 1.0, 1.2)), 0.34, rng.choice((1.4, 1.8)))
    return _one("ShelvingUnit", size, 0.6, 6.0, colour=rng.choice(WOODS))


def _dresser(rng: Random) -> Group:
    return _one("Dresser", (rng.choice((1.0, 1.3)), 0.48, 0.9), 0.7, 1.0, colour=rng.choice(WOODS))


def _small(
    kind: str, size: Size, colours: tuple[str, ...] | None = None, stock: float = 0.0, front: float = 0.0
) -> Any:
    def build(rng: Random) -> Group:
        more: Item = {"colour": rng.choice(colours)} if colours else {}
        if kind in ("Box", "WateringCan"):
            more["height"] = 0.0  # usually on furniture, here on the floor
        return _one(kind, size, front, stock, variant=rng.randrange(8), **more)

    return build


GROUPS: dict[str, Callable[[Random], Group]] = {
    "bed": _bed, "sofa": _sofa, "television": _television, "desk": _desk, "dining": _dining, "kitchen": _kitchen,
    "vanity": _vanity, "toilet": _toilet, "tub": _tub, "shelf": _shelf, "dresser": _dresser,
    "armchair": _small("ArmChair", (0.82, 0.82, 0.88), FABRICS, 1.0, 0.5),
    "side table": _small("SideTable", (0.5, 0.4, 0.6), WOODS, 1.0, 0.5),
    "console": _small("SideTable", (0.8, 0.32, 0.8), WOODS, 1.0, 0.5),
    "floor lamp": _small("FloorLamp", (0.4, 0.4, 1.65)),
    "plant": _small("HousePlant", (0.45, 0.45, 1.0)),
    "bin": _small("GarbageCan", (0.34, 0.32, 0.55)),
    "stool": _small("Stool", (0.38, 0.34, 0.62), WOODS),
    "hamper": _small("LaundryHamper", (0.5, 0.43, 0.65)),
    "box": _small("Box", (0.42, 0.38, 0.3)),
    "safe": _small("Safe", (0.42, 0.43, 0.4), None, 0.0, 0.5),
    "ball": _small("BasketBall", (0.24, 0.24, 0.24)),
    "watering can": _small("WateringCan", (0.16, 0.28, 0.2)),
    "dog bed": _small("DogBed", (0.8, 0.65, 0.18), FABRICS),
    "boots": _small("Boots", (0.28, 0.24, 0.4)),
}  # fmt: skip

# Groups of each kind of room with their chance, in the order in which they find their place.
PLANS: dict[str, tuple[tuple[str, float], ...]] = {
    "kitchen": (("kitchen", 1), ("dining", 0.9), ("side table", 0.5), ("bin", 0.9), ("stool", 0.3), ("plant", 0.4)),
    "living room": (
        ("sofa", 1), ("television", 0.8), ("shelf", 0.7), ("desk", 0.4), ("armchair", 0.6), ("floor lamp", 0.7),
        ("plant", 0.8), ("side table", 0.3), ("plant", 0.4), ("box", 0.3), ("watering can", 0.3), ("dog bed", 0.2),
    ),
    "studio": (
        ("kitchen", 1), ("bed", 1), ("desk", 0.9), ("dining", 0.5), ("armchair", 0.5), ("shelf", 0.6),
        ("floor lamp", 0.6), ("plant", 0.7), ("bin", 0.8), ("box", 0.3), ("ball", 0.2),
    ),
    "bedroom": (
        ("bed", 1), ("dresser", 0.8), ("desk", 0.5), ("shelf", 0.4), ("armchair", 0.4), ("floor lamp", 0.3),
        ("plant", 0.4), ("hamper", 0.4), ("safe", 0.2), ("box", 0.4), ("ball", 0.3),
    ),
    "bathroom": (("tub", 0.7), ("toilet", 1), ("vanity", 1), ("hamper", 0.6)),
    "hall": (("console", 0.8), ("boots", 0.6)),
}  # fmt: skip

HUNG: dict[str, tuple[tuple[str, float, Size, float], ...]] = {
    "living room": (("Painting", 1, (0.9, 0.03, 0.65), 1.4), ("Painting", 0.4, (0.5, 0.03, 0.6), 1.4)),
    "bedroom": (("Painting", 0.7, (0.8, 0.03, 0.6), 1.4), ("Mirror", 0.5, (0.5, 0.04, 1.2), 0.7)),
    "bathroom": (("ToiletPaperHanger", 0.6, (0.2, 0.1, 0.09), 0.65), ("Towel", 0.9, (0.42, 0.05, 0.6), 0.9)),
    "kitchen": (("Painting", 0.4, (0.5, 0.03, 0.4), 1.5),),
    "hall": (("Mirror", 0.5, (0.5, 0.04, 1.2), 0.7),),
}

# How often a furnishing lies on another one in AI2-THOR's rooms (procthor's receptacle figures, Apache-2.0).
COMMON: dict[str, dict[str, float]] = {
    "CoffeeTable": {
        "Book": 0.24, "RemoteControl": 0.22, "Bowl": 0.19, "Laptop": 0.19, "Vase": 0.17, "Statue": 0.17, "Mug": 0.13,
        "CreditCard": 0.13, "Plate": 0.11, "CellPhone": 0.1, "KeyChain": 0.09, "Cup": 0.08, "Candle": 0.05,
    },
    "CounterTop": {
        "CoffeeMachine": 0.27, "Toaster": 0.27, "Bread": 0.21, "Microwave": 0.17, "SoapBottle": 0.5,
        "PepperShaker": 0.27, "SaltShaker": 0.27, "Spatula": 0.27, "ButterKnife": 0.25, "Bowl": 0.19, "Fork": 0.18,
        "Knife": 0.18, "Potato": 0.18, "Spoon": 0.18, "Apple": 0.16, "Cup": 0.16, "DishSponge": 0.16, "Plate": 0.15,
        "Mug": 0.13,
    },
    "Desk": {
        "Laptop": 0.43, "DeskLamp": 0.29, "Book": 0.47, "Pencil": 0.34, "Pen": 0.32, "Mug": 0.25, "CreditCard": 0.25,
        "CellPhone": 0.24, "KeyChain": 0.22, "CD": 0.21, "Apple": 0.16, "Bottle": 0.16, "AlarmClock": 0.08,
    },
    "DiningTable": {
        "Plate": 0.39, "Bowl": 0.36, "Apple": 0.24, "Laptop": 0.24, "Mug": 0.24, "Book": 0.18, "HousePlant": 0.18,
        "Bottle": 0.17, "Vase": 0.15, "Cup": 0.14, "Fork": 0.12, "Bread": 0.11, "Tomato": 0.07, "Candle": 0.06,
    },
    "Dresser": {
        "Book": 0.25, "DeskLamp": 0.15, "Vase": 0.15, "CellPhone": 0.13, "HousePlant": 0.13, "AlarmClock": 0.12,
        "RemoteControl": 0.11, "SprayBottle": 0.11, "Statue": 0.11, "Candle": 0.08, "Newspaper": 0.04,
    },
    "Fridge": {"Egg": 0.57, "Lettuce": 0.27, "Tomato": 0.2, "Apple": 0.17, "Potato": 0.07, "WineBottle": 0.03},
    "ShelvingUnit": {
        "Vase": 0.13, "Box": 0.08, "AlarmClock": 0.05, "BasketBall": 0.05, "Book": 0.05, "DeskLamp": 0.05,
        "HousePlant": 0.05, "Pot": 0.05, "SprayBottle": 0.05, "Statue": 0.05,
    },
    "SideTable": {
        "AlarmClock": 0.23, "DeskLamp": 0.21, "HousePlant": 0.15, "Mug": 0.12, "Bottle": 0.11, "Vase": 0.09,
        "Apple": 0.08, "Book": 0.08, "KeyChain": 0.07, "RemoteControl": 0.06, "CellPhone": 0.05, "Candle": 0.04,
    },
    "TVStand": {
        "RemoteControl": 0.18, "Bottle": 0.18, "HousePlant": 0.13, "Candle": 0.11, "CreditCard": 0.11, "Vase": 0.11,
        "KeyChain": 0.08, "Statue": 0.08, "Watch": 0.08,
    },
    "ArmChair": {"Book": 0.09, "RemoteControl": 0.08, "Laptop": 0.08, "Newspaper": 0.01},
}  # fmt: skip
