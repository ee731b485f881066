"""Table of the rooms of ``cartier bench --suite look``: what stands at each place, what is asked, and the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cartier_bench.look_items import CANNOT_TELL, Placed

P = Placed
ROOMS: Mapping[str, tuple[tuple[Any, ...], ...]] = {
    "aster": (
        ("state", "television", "on", "on", [P("Television", variant=0, state="on")], "TVStand", 1.6),
        ("state", "box", "open", "open", [P("Box")], "CoffeeTable", 4.5),
        ("attribute", "arm chair", "colour", "red", [P("ArmChair", "red")], "", 2.2),
        ("state", "plate", "clean", "dirty", [P("Plate", state="dirty", size=(0.34, 0.34, 0.03))], "CoffeeTable", 0.9),
    ),
    "birch": (
        ("state", "television", "on", "off", [P("Television", variant=1, state="off")], "TVStand", 2.2),
        ("which", "box", "open", "open", [P("Box", state="closed", right_m=-0.35), P("Box", right_m=0.35)],
         "CoffeeTable", 1.5, "", 1),
        ("state", "garbage can", "full", "full", [P("GarbageCan", state="full")], "", 1.0),
        ("attribute", "pillow", "colour", "green", [P("Pillow", "fabric:forestgreen", size=(0.5, 0.4, 0.16))],
         "CoffeeTable", 1.0),
    ),
    "cedar": (
        ("state", "fridge", "open", "open", [P("Fridge", variant=1)], "", 2.0),
        ("state", "television", "on", "on", [P("Television", variant=1)], "TVStand", 4.6),
        ("exists on", "teddy bear", "look", "yes", [P("TeddyBear", right_m=0.1)], "Desk", 1.3, "", None,
         "is there a teddy bear on the desk?"),
        ("state", "pillow", "clean", "clean", [P("Pillow", "fabric:white", size=(0.5, 0.4, 0.16))], "CoffeeTable", 1.1),
    ),
    "dahlia": (
        ("state", "fridge", "open", "closed", [P("Fridge", variant=0)], "", 2.2),
        ("which", "pillow", "clean", "dirty",
         [P("Pillow", "fabric:white", state="dirty", right_m=-0.32, size=(0.45, 0.4, 0.16)),
          P("Pillow", "fabric:white", right_m=0.32, size=(0.45, 0.4, 0.16))], "DiningTable", 1.2, "", 0),
        ("state", "garbage can", "full", "empty", [P("GarbageCan")], "", 1.0),
        ("attribute", "vase", "colour", "blue", [P("Vase", "ceramic:royalblue", size=(0.2, 0.2, 0.4))], "SideTable",
         1.1),
    ),
    "elm": (
        ("hidden side", "television", "on", CANNOT_TELL, [P("Television", variant=0, state="on")], "TVStand", 1.4,
         "behind"),
        ("state", "bathtub", "full", "full", [P("Bathtub", state="full")], "", 1.5),
        ("exists on", "teddy bear", "look", "no", [P("Book", "red"), P("Bowl", right_m=0.3)], "Desk", 1.2, "", None,
         "is there a teddy bear on the desk?"),
        ("state", "box", "clean", "dirty", [P("Box", state="dirty")], "CoffeeTable", 1.4),
    ),
    "fern": (
        ("hidden side", "television", "on", CANNOT_TELL, [P("Television", variant=1, state="off")], "TVStand", 1.4,
         "behind"),
        ("state", "bathtub", "full", "empty", [P("Bathtub")], "", 1.6),
        ("which", "garbage can", "full", "full",
         [P("GarbageCan", right_m=-0.35), P("GarbageCan", state="full", right_m=0.35)], "", 1.2, "", 1),
        ("attribute", "stool", "colour", "yellow", [P("Stool", "paint:gold")], "", 1.4),
    ),
    "hazel": (
        ("hidden side", "fridge", "open", CANNOT_TELL, [P("Fridge", variant=0)], "", 1.5, "behind"),
        ("state", "floor lamp", "on", "on", [P("FloorLamp")], "", 2.0),
        ("state", "box", "full", "full", [P("Box", state="full")], "CoffeeTable", 1.0),
        ("attribute", "garbage can", "colour", "black", [P("GarbageCan", "plastic:black")], "", 1.3),
    ),
    "iris": (
        ("hidden side", "box", "full", CANNOT_TELL, [P("Box", state="full", size=(0.5, 0.5, 0.6))],
         "CoffeeTable", 1.3, "low"),
        ("which", "floor lamp", "on", "on", [P("FloorLamp", right_m=-0.4), P("FloorLamp", state="off", right_m=0.4)],
         "", 2.0, "", 0),
        ("state", "plate", "clean", "clean", [P("Plate", size=(0.34, 0.34, 0.03))], "CoffeeTable", 0.9),
        ("attribute", "teddy bear", "colour", "pink", [P("TeddyBear", "fabric:pink")], "SideTable", 1.3),
    ),
    "jasmine": (
        ("hidden side", "garbage can", "full", CANNOT_TELL, [P("GarbageCan", state="full")], "", 1.2, "low"),
        ("state", "floor lamp", "on", "off", [P("FloorLamp", state="off")], "", 1.8),
        ("state", "box", "full", "empty", [P("Box")], "CoffeeTable", 1.0),
        ("attribute", "ottoman", "colour", "purple", [P("Ottoman", "fabric:purple")], "", 1.5),
    ),
    "laurel": (
        ("hidden side", "bathtub", "full", CANNOT_TELL, [P("Bathtub", state="full")], "", 1.8, "low"),
        ("state", "box", "open", "closed", [P("Box", state="closed")], "CoffeeTable", 1.3),
        ("which", "chair", "colour", "red", [P("Chair", "paint:blue", right_m=-0.45), P("Chair", "paint:red",
         right_m=0.45)], "", 1.9, "", 1),
        ("attribute", "pillow", "colour", "orange", [P("Pillow", "fabric:orange", size=(0.5, 0.4, 0.16))],
         "CoffeeTable", 3.4),
    ),
}  # fmt: skip
