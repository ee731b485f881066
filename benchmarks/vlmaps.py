"""Benchmark of VLMaps: fusing a frame against reading its features once, finding words, and the map's size on disk.

python benchmarks/vlmaps.py [RECORDING]
    (default: a rendered 6 × 5 m room; a dollhouse home is explored for the map's size)
One thread; medians of frames interleaved with reads of the same features. Limits: fusion 6 × the read of the touched
rows; locate 1 ms in 10,000 cells and 15 ms in 100,000; the stored map 50 × smaller than a dense 1000 × 1000 × 512
float32 grid.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

from cartier import plugins
from cartier.types import Camera, Detections, Frame
from cartier_bench.baselines.fusion import CELL, FeatureGrid

CAMERA = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
SHAPE = (195, 260, 512)  # half of LSeg's output for a 640 × 480 image
DENSE = 1000 * 1000 * 512 * 4


def frames(recording: str | None) -> list[Frame]:
    if recording:
        opened = plugins.open_recording(recording)
        return [opened[i] for i in range(0, len(opened), max(1, len(opened) // 20))][:20]
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from synthetic import look, render

    rng = np.random.default_rng(0)
    poses = [look((rng.uniform(1, 4), rng.uniform(1, 3), 1.2), (*rng.uniform((0, 0), (5, 4)), 0.6)) for _ in range(20)]
    return [
        Frame(i, 0.0, np.zeros((480, 640, 3), np.uint8), render(pose, CAMERA, ())[0], pose, CAMERA)
        for i, pose in enumerate(poses)
    ]


def timed(call: Callable[[], object]) -> float:
    begin = time.perf_counter()
    call()
    return (time.perf_counter() - begin) * 1e3


def fusion(recording: str | None) -> None:
    features = np.random.default_rng(0).standard_normal(SHAPE, dtype=np.float32)
    grid, rows = FeatureGrid(), []
    for frame in frames(recording):
        assert frame.depth_m is not None
        touched = touched_rows(features, frame)
        some = np.ascontiguousarray(features.reshape(-1, SHAPE[2])[: len(touched)])
        grid.add(features, frame.depth_m, frame.camera, frame.world_from_camera)  # new cells are paid once
        again = partial(grid.add, features, frame.depth_m, frame.camera, frame.world_from_camera)
        pairs = [(timed(again), timed(some.sum)) for _ in range(5)]
        fuse, read = (statistics.median(column) for column in zip(*pairs, strict=True))
        rows.append((fuse, read, some.nbytes, fuse / read))
    fuse, read, size, ratio = (statistics.median(column) for column in zip(*rows, strict=True))
    print(f"read bandwidth         {size / read / 1e6:6.1f} GB/s, one thread")
    print(f"touched features       {size / 1e6:6.1f} MB a frame, read once in {read:.1f} ms")
    print(
        f"fusion of every pixel  {fuse:6.1f} ms a frame = {ratio:.1f} × the read (limit 6; worst "
        f"{max(r[3] for r in rows):.1f})"
    )


def touched_rows(features: np.ndarray, frame: Frame) -> np.ndarray:
    """Which feature vectors have a share in any cell."""
    from cartier_bench.baselines import fusion

    assert frame.depth_m is not None
    tables = fusion._Tables(frame.depth_m.shape, features.shape[:2], frame.camera)
    window = fusion._window(frame.depth_m, frame.world_from_camera, tables, 0.05, 0)
    assert window is not None
    starts, lengths = tables.pieces(window.cells)
    used = window.cells[starts] > 0
    shares = tables.shares(starts[used], lengths[used], np.zeros(int(used.sum()), np.int32), 1)
    return np.flatnonzero(np.diff(shares.indptr))


def find() -> None:
    class Words:
        name, sees = "benchmark", True

        def text(self, texts: list[str]) -> np.ndarray:
            return np.random.default_rng(1).standard_normal((len(texts), SHAPE[2]), dtype=np.float32)

    for count, limit in ((10_000, 1), (100_000, 15)):
        index: Any = plugins.make("indexes", "vlmaps", encoder=Words())
        cells = np.zeros(count, CELL)
        cells["xy"] = np.stack(np.divmod(np.arange(count), 400), 1)
        cells["pixels"] = 1
        index._grid.restore(cells, np.random.default_rng(0).standard_normal((count, SHAPE[2]), dtype=np.float32))
        index.locate("words")
        taken = statistics.median(timed(partial(index.locate, "words")) for _ in range(25))
        print(f"locate in {count:7,} cells {taken:8.2f} ms (limit {limit})")


def size() -> None:
    recording = plugins.make("worlds", "dollhouse").explore("family_flat")
    detector = plugins.make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
    index: Any = plugins.make("indexes", "vlmaps")
    for number in range(len(recording)):
        frame = recording[number]
        detections: Detections = detector.detect(frame)
        index.add(frame, detections)
    stored = sum(map(len, index.state().values()))
    print(
        f"family_flat's map      {stored / 1e6:6.1f} MB for {len(index._grid.cells):,} cells, {DENSE / stored:.0f} × "
        "smaller than dense (limit 50)"
    )


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("recording", nargs="?", help="default: a rendered room")
    fusion(parser.parse_args().recording)
    find()
    size()


if __name__ == "__main__":
    run_script(main)
