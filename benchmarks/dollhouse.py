"""Benchmark of the renderer: frames per second of a built-in home, with the shares of tracing and of shading.

python benchmarks/dollhouse.py [HOME]    (default: studio)
One thread, medians over views from the middle of every room. For one core: taskset -c 0 python benchmarks/dollhouse.py
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import json
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from command_line import Parser, run_script

from cartier.types import Camera
from cartier_dollhouse.model import Scene
from cartier_dollhouse.render import Renderer
from cartier_dollhouse.scene import load_home

TURNS = 6
ROUNDS = 3


def poses(scene: Scene) -> list[npt.NDArray[np.float64]]:
    """Standing in the middle of each room, looking round, a little down."""
    result = []
    for room in scene.rooms:
        x1, y1, x2, y2 = room.box
        for yaw in np.arange(TURNS) * math.tau / TURNS + 0.3:
            forward = np.array([math.cos(yaw) * 0.97, math.sin(yaw) * 0.97, -0.243])
            forward /= np.linalg.norm(forward)
            right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
            pose = np.eye(4)
            pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
            pose[:3, 3] = ((x1 + x2) / 2, (y1 + y2) / 2, 1.5)
            result.append(pose)
    return result


def median_ms(look: Callable[[npt.NDArray[np.float64]], Any], where: list[npt.NDArray[np.float64]]) -> float:
    times = []
    for pose in where * ROUNDS:
        start = time.perf_counter()
        look(pose)
        times.append(1000 * (time.perf_counter() - start))
    return statistics.median(times)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("home", nargs="?", default="studio", help="a built-in home, or a number (default: %(default)s)")
    scene = load_home(parser.parse_args().home)
    where = poses(scene)
    for width, height in ((640, 480), (320, 240)):
        camera = Camera(width, height, width * 0.6, width * 0.6, width / 2 - 0.5, height / 2 - 0.5)
        renderer = Renderer(scene, camera)
        start = time.perf_counter()
        renderer.render(where[0])
        first_s = time.perf_counter() - start
        whole, trace = median_ms(renderer.render, where), median_ms(renderer.depth, where)
        figures = {
            "home": scene.name, "triangles": len(renderer.mesh.faces), "size": f"{width}x{height}",
            "engine": renderer.engine, "first_frame_with_light_s": round(first_s, 2),
            "frames_per_s": round(1000 / whole, 1), "ms": round(whole, 1), "tracing_ms": round(trace, 1),
            "shading_ms": round(whole - trace, 1),
        }  # fmt: skip
        print(json.dumps(figures))


if __name__ == "__main__":
    run_script(main)
