"""How much a request by name says that its object is there: the likelihood ratio of ``understanding/tentative.py``.

python tools/request_evidence.py [--homes 8] [--first 75001]
Walks through generated homes from pixels and takes each name that the detector knows as asked for once. A name that is
nowhere in the home must not be driven to. Prints, for each ratio, what share of names that are there gains a goal from
a tentative object (and how many of these goals are right), and what share of names that are not there is driven to.
Three requests in four are taken to be for what is there.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

from cartier import plugins
from cartier.geometry import box_distance
from cartier.labels import display_name
from cartier.mapping.object_map import ObjectMap
from cartier.types import MapObject, TrueObject
from cartier.understanding.tentative import CONFIRMED_PROBABILITY

FIRST_HOME = 75_001  # on none of these was the detector trained
SAME_M = 0.5
ASKED_FOR_WHAT_IS_THERE = 0.75
Row = tuple[bool, float, bool]
"""Of a name: whether it is in the home, the probability of its likeliest object, and whether that one is right."""


def is_true(obj: MapObject, truth: list[TrueObject]) -> bool:
    same = [true for true in truth if display_name(true.label) == obj.label]
    far = [box_distance(np.array(obj.position), np.array(true.box_min), np.array(true.box_max)) for true in same]
    return bool(min(map(float, far), default=np.inf) <= SAME_M)


def names_of(home: str) -> list[Row]:
    world: Any = plugins.make("worlds", "dollhouse")
    recording, truth = world.explore(home), list(world.scene(home).truth())
    detector = plugins.make("detectors", "embedded", threads=1)
    objects = ObjectMap(detector.score_model)
    for number in range(len(recording)):
        frame = recording[number]
        objects.add(frame, detector.detect(frame))
    objects.consolidate()
    there, rows = {display_name(true.label) for true in truth}, []
    for name in detector.knows:
        best = max((o for o in objects.objects() if o.label == name), key=lambda o: o.probability, default=None)
        rows.append((name in there, best.probability if best else 0.0, best is not None and is_true(best, truth)))
    return rows


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("--homes", type=int, default=8, help="how many generated homes (default: %(default)s)")
    parser.add_argument("--first", type=int, default=FIRST_HOME, help="the first of them (default: %(default)s)")
    asked = parser.parse_args()
    homes = [str(asked.first + k) for k in range(asked.homes)]
    rows = [row for home in homes for row in names_of(home)]
    here, gone = [row for row in rows if row[0]], [row for row in rows if not row[0]]
    odds = ASKED_FOR_WHAT_IS_THERE / (1 - ASKED_FOR_WHAT_IS_THERE)
    print(f"{len(here)} names in {len(homes)} homes, {len(gone)} that are not there")
    print(f"likelihood ratio by these counts: {odds * len(gone) / len(here):.1f}")
    bound = CONFIRMED_PROBABILITY / (1 - CONFIRMED_PROBABILITY)
    for ratio in (1, 3, 6, 9, 12, 20, 30):
        least = bound / ratio / (1 + bound / ratio)
        more = [row for row in here if least <= row[1] < CONFIRMED_PROBABILITY]
        false = np.mean([row[1] >= least for row in gone])
        print(
            f"ratio {ratio:2}, from {least:.2f}: {len(more)} more of {len(here)} served, "
            f"{sum(row[2] for row in more)} of them right; driven to though not there: {false:.1%}"
        )


if __name__ == "__main__":
    run_script(main)
