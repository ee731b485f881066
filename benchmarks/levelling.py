"""Benchmark of recordings that lie as they should not: a floor that is not at 0, another up, images on their side.

python benchmarks/levelling.py [RECORDING] [--things bed]
Each variant is the same recording, turned, shifted and with its world tipped over; ../shared/recordings/bedroom_iphone
by default. The table says what `map` lists, how sure it is of THINGS, what it says of the corrections, and which faults
`doctor` finds; the first line is the sound one.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

from cartier import plugins, specs
from cartier.contracts import Recording
from cartier.doctor import examine
from cartier.mapping.upright import Levelled, Upright, upright
from cartier.pipeline import map_home
from cartier.types import Frame

BEDROOM = Path(__file__).resolve().parents[2] / "shared/recordings/bedroom_iphone"
TURNS = {"upright": 0, "sideways": 1, "turned 180°": 2}
FLOORS_M = (-2.0, -0.9, 0.0, 2.0)
Z_FROM_Y = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
UPS = {"z up": np.eye(4), "y up": Z_FROM_Y.T}


class Variant:
    """A recording that lies otherwise, and does not say so."""

    def __init__(self, recording: Recording, levelled: Levelled) -> None:
        self._moved = Upright(recording, levelled)
        self.name, self.camera, self.truth = recording.name, self._moved.camera, None
        self.notes: Sequence[str] = ()

    def __len__(self) -> int:
        return len(self._moved)

    def __getitem__(self, index: int) -> Frame:
        return self._moved[index]

    def fingerprint(self) -> str:
        return str(self._moved.fingerprint())


def row(recording: Recording, things: str) -> dict[str, Any]:
    """What map and doctor make of a recording."""
    begin = time.process_time()
    lying = upright(recording, specs.detector(specs.PHOTOS, recording))
    home = map_home(lying, specs.detector(specs.PHOTOS, recording))
    took_s = time.process_time() - begin
    sure = [obj for obj in home.objects if obj.confirmed]
    return {
        "objects": len(sure),
        "labels": sorted(obj.label for obj in sure),
        things: max((obj.probability for obj in home.objects if obj.label == things), default=0.0),
        "said": [note for note in lying.levelled.notes if note in home.notes],
        "doctor": [fault.fault for fault in examine(recording).faults],
        "map_s": took_s,
    }


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("recording", nargs="?", type=Path, default=BEDROOM, help="a recording that lies as it should")
    parser.add_argument("--things", default="bed", help="the object whose certainty is shown")
    arguments = parser.parse_args()
    if not arguments.recording.exists():
        raise SystemExit(f"{arguments.recording} is missing: name a recording of a real room")
    detector = specs.detector(specs.PHOTOS, plugins.open_recording(arguments.recording))
    sound = upright(plugins.open_recording(arguments.recording), detector)
    print(f"{'':34} objects  {arguments.things:>5}  map s  said  doctor")
    for (held, turns), (axis, matrix), floor_m in itertools.product(TURNS.items(), UPS.items(), FLOORS_M):
        shift = np.eye(4)
        shift[2, 3] = floor_m
        found = row(Variant(sound, Levelled(matrix @ shift, turns)), arguments.things)
        name = f"{held}, {axis}, floor at {floor_m:g} m"
        print(
            f"{name:34} {found['objects']:7}  {found[arguments.things]:5.0%}  {found['map_s']:5.1f}  "
            f"{len(found['said']):4}  {' '.join(found['doctor']) or 'sound'}",
            flush=True,
        )


if __name__ == "__main__":
    run_script(main)
