"""Builder of the stored inventories of ``tests/data/inventories``, and of requests made from the truth of homes.

python benchmarks/inventories.py [HOME …]      (default: every home that something stored is about; 20 minutes)

The built-in homes are mapped from ground truth and from pixels (detector ``embedded``), and requests about particular
objects are made for each as ``cartier bench things`` makes them (``tests/data/made.jsonl``). The generated
homes of the labelled sentences are mapped from ground truth, in small pictures. Each home is rendered once. What is
there is not made again.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from command_line import Parser, run_script

import stored
from cartier import specs
from cartier.pipeline import map_home
from cartier.types import Frame
from cartier_bench.maps import encoder_for
from cartier_bench.things import WRITTEN, load_items
from cartier_bench.things_made import make_items
from cartier_bench.true_home import true_home
from cartier_dollhouse import Dollhouse, make

DEVELOPMENT = Path(__file__).resolve().parents[1] / "tools" / "things" / "development.jsonl"
BUILT_IN, GENERATED = (640, 480, 62.0, 0.2), (320, 240, 62.0, 0.2)
"""The pictures' size, their field of view and the robot's radius: the bench's, and for quick maps a quarter of the
pixels."""
DETECTORS = {"truth": "ground_truth", "pixels": "embedded"}
LEAST_PX = {640: 64, 320: 16}  # visible pixels from which ground truth sees something, by the pictures' width
MADE = stored.DATA / "made.jsonl"


class Rendered:
    """A recording whose frames are rendered once and kept, for two maps of a home and for the truth about it."""

    def __init__(self, recording: Any) -> None:
        self.name, self.camera, self.truth, self.notes = (
            recording.name,
            recording.camera,
            recording.truth,
            recording.notes,
        )
        self.fingerprint = recording.fingerprint
        self._frames: list[Frame] = [recording[i] for i in range(len(recording))]

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Frame:
        return self._frames[index]


class RenderedWorld(Dollhouse):
    """The dollhouse, of which the latest walk is kept."""

    _latest: tuple[str, Any] = ("", None)

    def explore(self, home: str, seed: int = 0, *args: Any, **options: Any) -> Any:
        if self._latest[0] != home:
            self._latest = (home, None)  # one walk at a time is a gigabyte
            self._latest = (home, Rendered(super().explore(home, seed, *args, **options)))
        return self._latest[1]


def store(world: RenderedWorld, home: str, kind: str) -> None:
    if (stored.FOLDER / f"{home}.{kind}.json.gz").exists():
        return
    begin, recording, name = time.monotonic(), world.explore(home), DETECTORS[kind]
    least = {"min_pixels": LEAST_PX[recording.camera.width]} if kind == "truth" else {}
    detector = specs.detector(name, recording, **least)
    mapped = map_home(recording, detector, ("object_depth",), encoder=encoder_for(name), every=1)
    file = stored.store(home, kind, mapped.objects, mapped.rooms, mapped.start_xy)
    sure = sum(obj.confirmed for obj in mapped.objects)
    print(
        f"{home} {kind}: {len(recording)} frames, {sure} of {len(mapped.objects)} objects confirmed, "
        f"{file.stat().st_size} bytes, {time.monotonic() - begin:.0f} s",
        flush=True,
    )


def store_requests(world: RenderedWorld, home: str, keep: Path) -> None:
    """Add the requests that are made for a home to those of others."""
    items = load_items(MADE) if MADE.exists() else []
    if any(item.home == home for item in items):
        return
    items = sorted([*items, *make_items(true_home(world, home, 0, keep))], key=lambda item: item.home)
    MADE.write_text("".join(json.dumps(item.to_dict(), ensure_ascii=False) + "\n" for item in items), "utf-8")


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("homes", nargs="*", help="homes (default: every home that something stored is about)")
    chosen = parser.parse_args().homes
    built_in = make().homes()
    generated = list(dict.fromkeys(item.home for file in (DEVELOPMENT, WRITTEN) for item in load_items(file)))
    stored.FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as keep:
        for home in chosen or [*built_in, *generated]:
            world = RenderedWorld(*(BUILT_IN if home in built_in else GENERATED))
            store(world, home, "truth")
            if home in built_in:
                store(world, home, "pixels")
                store_requests(world, home, Path(keep))


if __name__ == "__main__":
    run_script(main)
