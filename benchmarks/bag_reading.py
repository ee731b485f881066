"""Benchmark of bag reading: frames per second on one core, and memory, of a 640x480 RGB-D bag with poses.

python benchmarks/bag_reading.py [FRAMES ...]
    (default: 150 600, so that the memory of a short and a long bag can be compared)
Raw rgb8 and 16UC1 images with noise, CameraInfo, /tf at 50 Hz; each figure is of a fresh process, opening included.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from command_line import Parser, run_script

from cartier.types import Camera

TESTS = Path(__file__).parents[1] / "tests"

WIDTH, HEIGHT, STEP_NS = 640, 480, 33_333_333
FRAME = "camera_color_optical_frame"
KINDS = (("mcap", ""), ("mcap", "storage"), ("sqlite3", ""), ("ros1", ""), ("ros1", "lz4"))
WANTED = 100.0


def write(path: Path, kind: str, compression: str, frames: int) -> None:
    sys.path[:0] = [str(TESTS), str(TESTS / "recordings")]
    from bags import OPTICAL, START_NS, BagFile

    rng = np.random.default_rng(0)
    colours = [rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(4)]
    depths = [rng.integers(500, 5000, (HEIGHT, WIDTH), dtype=np.uint16) for _ in range(4)]
    camera = Camera(WIDTH, HEIGHT, 525.0, 525.0, 319.5, 239.5)
    with BagFile(path, kind, compression) as bag:
        m = bag.messages
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
        for i in range(frames):
            ns = START_NS + i * STEP_NS
            for part in (0, STEP_NS // 2):
                base = np.eye(4)
                base[0, 3] = (i + part / STEP_NS) * 0.01
                bag.put("/tf", ns + part, m.transforms((ns + part, "map", "base_link", base)))
            bag.put("/camera/color/camera_info", ns, m.info(ns, FRAME, camera))
            bag.put("/camera/color/image_raw", ns, m.image(ns, FRAME, colours[i % 4], "rgb8"))
            topic = "/camera/aligned_depth_to_color/image_raw"
            bag.put(topic, ns, m.image(ns + 10**6, FRAME, depths[i % 4], "16UC1"))


def read(path: Path) -> None:
    """Open and walk a bag; prints seconds to open, seconds to read, frames and the peak memory in MB."""
    from cartier_ros import rosbag

    begun = time.perf_counter()
    recording = rosbag.open(path)
    opened = time.perf_counter()
    for i in range(len(recording)):
        frame = recording[i]
        assert frame.depth_m is not None
    done = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(opened - begun, done - opened, len(recording), peak)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument(
        "frames", nargs="*", type=int, default=[150, 600], help="lengths of the bags (default: 150 600)"
    )
    parser.add_argument(
        "--read", type=Path, metavar="BAG", help="read one bag and print its figures (what it starts for each)"
    )
    options = parser.parse_args()
    if options.read:
        read(options.read)
    else:
        compare(options.frames)


def compare(counts: list[int]) -> None:
    print("bag           frames   MB on disk   open s   read s   frames/s   peak MB")
    slow = []
    with tempfile.TemporaryDirectory() as folder:
        for kind, compression in KINDS:
            for count in counts:
                path = Path(folder) / f"{kind}-{compression}-{count}"
                write(path, kind, compression, count)
                size = sum(file.stat().st_size for file in path.iterdir()) / 1e6
                command = [sys.executable, __file__, "--read", str(path)]
                out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                opened, reading, frames, peak = map(float, out.split())
                rate = frames / (opened + reading)
                name = f"{kind} {compression}"
                print(
                    f"{name:12}  {frames:6.0f}   {size:10.0f}   {opened:6.2f}   {reading:6.2f}   {rate:8.0f}   "
                    f"{peak:7.0f}"
                )
                if not compression and rate < WANTED:
                    slow.append(name)
                for file in path.iterdir():
                    file.unlink()
    if slow:
        sys.exit(f"slower than {WANTED:.0f} frames/s: {', '.join(slow)}")


if __name__ == "__main__":
    run_script(main)
