"""Homes as text, for the writers of requests: ``python tools/understanding/home_text.py 76001 76002``."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from cartier import plugins
from cartier.evaluation.statements import gap
from cartier.evaluation.true_home import true_objects
from cartier.labels import display_name
from cartier.types import Inventory, MapObject, Room, View
from cartier.worlds.dollhouse import Dollhouse
from cartier.worlds.dollhouse.contacts import Contacts
from cartier.worlds.dollhouse.model import Scene

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

CLOSE_M, MOST_CLOSE = 0.6, 3


@cache
def scene(name: str) -> Scene:
    """A generated home."""
    world = plugins.make("worlds", "dollhouse")
    assert isinstance(world, Dollhouse)
    return world.scene(name)


@cache
def inventory(name: str) -> Inventory:
    """A home as a perfect map would have it; each object was seen from the middle of its room."""
    of = scene(name)
    middles = [np.add(room.box[:2], room.box[2:]) / 2 for room in of.rooms]
    objects = tuple(_seen(obj, middles[obj.room or 0]) for obj in true_objects(of))
    kinds = [display_name(room.kind) for room in of.rooms]
    rooms = tuple(
        Room(i, kind if kinds.count(kind) == 1 else f"{kind} {kinds[:i].count(kind) + 1}", kind,
             np.zeros((0, 2), np.int32))
        for i, kind in enumerate(kinds)
    )  # fmt: skip
    return Inventory(objects, rooms, from_xy=of.start_xy)


def _seen(obj: MapObject, camera_xy: np.ndarray) -> MapObject:
    x, y = map(float, camera_xy)
    basic = {"light wood": "brown", "cream": "white", "dark grey": "grey", "rust": "red", "beige": "brown"}
    colours = dict[str, float]()
    for colour, share in obj.colours:
        colours[basic.get(colour, colour)] = colours.get(basic.get(colour, colour), 0.0) + share
    view = View(0, (0.0, 0.0, 9.0, 9.0), 0.9, obj.label, 81.0, (x, y, 1.5), 0.0, obj.position)
    return replace(obj, views=(view,), colours=tuple(colours.items()))


def text(name: str) -> str:
    """Rooms and objects: id, label, colours, what it stands on or in, size, distance from the robot, neighbours."""
    held, known = Contacts(scene(name)).holder, inventory(name)
    by_id = {obj.id: obj for obj in known.objects}
    at = np.array(known.from_xy)
    lines = [f"HOME {name}"]
    for room in known.rooms:
        lines.append(f" room: {room.name}")
        told = {obj.id: obj.colours for obj in true_objects(scene(name))}
        for obj in sorted((o for o in known.objects if o.room == room.id), key=lambda o: o.label):
            size = [round(100 * float(s)) for s in np.subtract(obj.box_max, obj.box_min)]
            parts = ["/".join(c for c, share in told[obj.id][:2] if share >= 0.2)]
            if obj.id in held and held[obj.id][0] in by_id:
                holder, how = held[obj.id]
                parts.append(f"{how} {by_id[holder].label} #{holder}")
            parts.append(f"{size[0]}x{size[1]}x{size[2]}cm")
            parts.append(f"{float(np.hypot(*(np.array(obj.position)[:2] - at))):.1f}m from robot")
            near = sorted((gap(obj, o), o.label, o.id) for o in known.objects if o is not obj and o.room == obj.room)
            near = [n for n in near if n[0] < CLOSE_M and held.get(obj.id, (0,))[0] != n[2]][:MOST_CLOSE]
            if near:
                parts.append("beside " + ", ".join(f"{label} #{i}" for _, label, i in near))
            lines.append(f"  #{obj.id} {obj.label}: {'; '.join(p for p in parts if p)}")
    return "\n".join(lines)


def main() -> None:
    """Print the homes."""
    parser = Parser(__doc__)
    parser.add_argument("homes", nargs="+", help="numbers of generated homes")
    for name in parser.parse_args().homes:
        print(text(name), end="\n\n")


if __name__ == "__main__":
    run_script(main)
