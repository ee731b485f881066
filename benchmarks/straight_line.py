"""Benchmark of mapping without the detector: milliseconds per frame, peak memory, start-up times.

python benchmarks/straight_line.py [RECORDING]    (default: the kitchen in ../shared, else a rendered room)
One BLAS thread; medians; memory is the peak of a fresh process.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

from cartier import plugins
from cartier.contracts import Recording
from cartier.geometry import backproject, project, transform
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.occupancy import OccupancyMapper
from cartier.pipeline import map_home
from cartier.types import Camera, Detections, DetectorScoreModel, Frame

KITCHEN = Path(__file__).parents[2] / "shared" / "recordings" / "kitchen_7scenes"
BOXES = 30  # detections per frame at most


class ManyThings:
    """Boxes of things at fixed places in the home, as a busy detector gives them, at no cost: the rest of the line is
    measured."""

    name = "many things (benchmark)"

    def __init__(self, recording: Recording) -> None:
        rng, points = np.random.default_rng(0), []
        for number in range(0, len(recording), max(1, len(recording) // 25)):
            frame = recording[number]
            assert frame.depth_m is not None
            world = transform(frame.world_from_camera, backproject(frame.depth_m, frame.camera, 8).reshape(-1, 3))
            points.append(rng.choice(world[np.isfinite(world[:, 0])], 12))
        self.points = np.concatenate(points)
        self.half_m = rng.uniform(0.05, 0.4, len(self.points))
        self.labels = [f"thing {i}" for i in rng.integers(0, 120, len(self.points))]

    def detect(self, frame: Frame) -> Detections:
        uv, z = project(self.points, frame.camera, frame.world_from_camera)
        inside = (z > 0.3) & (uv > 0).all(1) & (uv < (frame.camera.width, frame.camera.height)).all(1)
        which = np.flatnonzero(inside)[:BOXES]
        half = (self.half_m[which] / z[which] * frame.camera.fx)[:, None]
        boxes = np.hstack([uv[which] - half, uv[which] + half])
        return Detections(frame.index, boxes, np.full(len(which), 0.9), tuple(self.labels[i] for i in which))


class Repeated:
    """A recording several times over: twenty times as many frames, of the same home."""

    def __init__(self, recording: Recording, times: int) -> None:
        self.recording, self.times = recording, times
        self.name, self.camera, self.truth, self.notes = recording.name, recording.camera, None, ()

    def __len__(self) -> int:
        return len(self.recording) * self.times

    def __getitem__(self, index: int) -> Frame:
        return self.recording[index % len(self.recording)]

    def fingerprint(self) -> str:
        return self.recording.fingerprint()


def rendered_room(folder: Path) -> Path:
    """A 640x480 recording of the tests' room, for those without the kitchen."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from cartier.recordings.folder import save
    from synthetic import walk

    room = walk()
    room.camera = Camera(640, 480, 480.0, 480.0, 319.5, 239.5)
    save(room, folder / "room")
    return folder / "room"


def milliseconds(action: Callable[..., Any], *args: Any) -> float:
    begin = time.perf_counter()
    action(*args)
    return (time.perf_counter() - begin) * 1e3


def per_frame(recording: Recording) -> dict[str, float]:
    """Median milliseconds of each step over the frames, three times over."""
    spent: dict[str, list[float]] = {"decode": [], "objects": [], "occupancy": []}
    detector = ManyThings(recording)
    for _ in range(3):
        objects, mapper = ObjectMap(DetectorScoreModel()), OccupancyMapper()
        for number in range(len(recording)):
            begin = time.perf_counter()
            frame = recording[number]
            spent["decode"].append((time.perf_counter() - begin) * 1e3)
            found = detector.detect(frame)
            spent["objects"].append(milliseconds(objects.add, frame, found))
            spent["occupancy"].append(milliseconds(mapper.add, frame))
    return {step: statistics.median(values) for step, values in spent.items()}


def peak_mb(path: str, times: int) -> float:
    """Peak memory (MB) of a fresh process that maps the recording so many times over."""
    done = subprocess.run(
        [sys.executable, __file__, path, "--times", str(times)], capture_output=True, text=True, check=True
    )
    return float(json.loads(done.stdout)["peak_mb"])


def seconds(*command: str, runs: int = 7) -> float:
    """Median wall seconds of a process."""
    return (
        statistics.median(
            milliseconds(lambda: subprocess.run(command, capture_output=True, check=True)) for _ in range(runs)
        )
        / 1e3
    )


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("recording", nargs="?", type=Path, help="default: the kitchen, else a rendered room")
    parser.add_argument(
        "--times", type=int, help="only map RECORDING so often in this process, and print its peak memory"
    )
    given = parser.parse_args()
    if given.times:
        recording = Repeated(plugins.open_recording(given.recording), given.times)
        map_home(recording, ManyThings(recording))
        print(json.dumps({"peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))
        return
    with tempfile.TemporaryDirectory() as scratch:
        path = given.recording or (KITCHEN if KITCHEN.is_dir() else rendered_room(Path(scratch)))
        recording = plugins.open_recording(path)
        camera = recording.camera
        print(
            f"{recording.name}: {len(recording)} frames of {camera.width}x{camera.height}, up to {BOXES} boxes a frame"
        )
        costs = per_frame(recording)
        for step, ms in costs.items():
            print(f"  {step:18} {ms:7.2f} ms a frame")
        print(f"  {'all of it':18} {sum(costs.values()):7.2f} ms a frame   (limit 15)")
        for times in (1, 20):
            print(f"  peak memory, recording x {times:<3} {peak_mb(str(path), times):7.1f} MB")
    bare, numpy, ours = (seconds(sys.executable, "-c", code) for code in ("pass", "import numpy", "import cartier"))
    print(
        f"  import numpy {numpy - bare:.3f} s, import cartier {ours - bare:.3f} s: ratio "
        f"{(ours - bare) / (numpy - bare):.2f}   (limit 2)"
    )
    print(f"  cartier --help {seconds(str(Path(sys.executable).parent / 'cartier'), '--help'):.3f} s   (limit 0.5)")


if __name__ == "__main__":
    run_script(main)
