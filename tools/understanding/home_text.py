"""Homes as text, for the writers of requests: ``python tools/understanding/home_text.py 76001 76002``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cartier_bench.predicates import gap
from cartier_bench.true_home import perfect_map, scene_of, true_objects
from cartier_dollhouse.contacts import Contacts

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

CLOSE_M, MOST_CLOSE = 0.6, 3


def text(name: str) -> str:
    """Rooms and objects: id, label, colours, what it stands on or in, size, distance from the robot, neighbours."""
    held, known = Contacts(scene_of(name)).holder, perfect_map(name)
    by_id = {obj.id: obj for obj in known.objects}
    at = np.array(known.from_xy)
    lines = [f"HOME {name}"]
    for room in known.rooms:
        lines.append(f" room: {room.name}")
        told = {obj.id: obj.colours for obj in true_objects(scene_of(name))}
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
