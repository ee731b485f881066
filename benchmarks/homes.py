"""Benchmark of the seven homes: coverage of exploration, depth against boxes, and the error of ObjectDepth.

python benchmarks/homes.py [HOME …]      one BLAS thread; detections are ground truth (dollhouse), said so in each row
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import time
from dataclasses import replace

import numpy as np
from command_line import Parser, run_script

from cartier import plugins
from cartier.contracts import Detector, Recording, SpatialIndex
from cartier.geometry import backproject, box_distance, transform
from cartier.labels import display_name
from cartier.pipeline import map_home
from cartier.types import Detections, Frame

ENOUGH_PX = 200
OUTSIDE_M = 0.02


def inside_their_boxes(recording: Recording) -> tuple[int, int, set[int]]:
    """Depth pixels of things that lie in their true boxes (2 cm), all of them, and the ids seen with 200 pixels or
    more."""
    boxes = {obj.id: (np.array(obj.box_min), np.array(obj.box_max)) for obj in recording.truth or ()}
    good = total = 0
    seen: set[int] = set()
    for number in range(0, len(recording), 3):
        frame = recording[number]
        assert frame.depth_m is not None and frame.instances is not None
        world = transform(frame.world_from_camera, backproject(frame.depth_m, frame.camera).astype(np.float64))
        for i in np.flatnonzero(np.bincount(frame.instances.ravel())):
            if i == 0:
                continue
            points = world[frame.instances == i]
            if len(points) >= ENOUGH_PX:
                seen.add(int(i))
            good += int((box_distance(points, *boxes[int(i)]) <= OUTSIDE_M).sum())
            total += len(points)
    return good, total, seen


def distances(index: SpatialIndex, recording: Recording) -> list[tuple[float, str, int]]:
    """(metres from ObjectDepth's position to the nearest true box of that name, name, evidence frame), worst first."""
    rows = []
    for name in index.names():
        place = index.locate(name)
        assert place is not None
        same = [obj for obj in recording.truth or () if display_name(obj.label) == name]
        nearest = min(
            float(box_distance(np.array(place.position), np.array(t.box_min), np.array(t.box_max))) for t in same
        )
        rows.append((nearest, name, place.frame))
    return sorted(rows, reverse=True)


class WithoutMasks:
    """Ground truth as boxes only: what a detector of boxes gives at best."""

    def __init__(self, truth: Detector) -> None:
        self.truth, self.name, self.score_model = truth, f"{truth.name}, boxes only", truth.score_model

    def detect(self, frame: Frame) -> Detections:
        return replace(self.truth.detect(frame), masks=None)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("homes", nargs="*", help="built-in homes, or numbers (default: the seven built-in ones)")
    world = plugins.make("worlds", "dollhouse")
    for name in parser.parse_args().homes or world.homes():
        begin = time.perf_counter()
        recording = world.explore(name)
        explored_s = time.perf_counter() - begin
        truth = plugins.make("detectors", "ground_truth", truth=recording.truth, source="dollhouse")
        begin = time.perf_counter()
        home = map_home(recording, truth)
        mapped_s = time.perf_counter() - begin
        good, total, seen = inside_their_boxes(recording)
        print(
            f"{name}: {len(recording)} frames, explored in {explored_s:.1f} s, mapped in {mapped_s:.1f} s, by "
            f"{truth.name}"
        )
        print(f"  {recording.notes[-1]}")
        print(
            f"  {len(seen)} of {len(recording.truth)} things seen with {ENOUGH_PX} px or more; {good / total:.4%} of "
            "their depth in their true boxes"
        )
        for what, made in (("masks", home), ("boxes only", map_home(recording, WithoutMasks(truth)))):
            rows = distances(made.index("object_depth")[1], recording)
            metres = [row[0] for row in rows]
            mean, median = statistics.mean(metres), statistics.median(metres)
            print(
                f"  ObjectDepth from {what}: mean {mean:.3f} m, median {median:.3f} m to the nearest true box, "
                f"{len(rows)} names"
            )
            print(
                "    worst: " + ", ".join(f"{label} {m:.2f} m (frame {frame})" for m, label, frame in rows[:5]),
                flush=True,
            )


if __name__ == "__main__":
    run_script(main)
