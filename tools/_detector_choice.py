"""Calibration of the detector's scores, per name, on walks through generated homes that no training saw."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from _detector_homes import ROBOT_M, varied

from cartier import plugins
from cartier.contracts import Recording
from cartier.types import Camera, Detections, Frame
from cartier_dollhouse.explore import explore
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import DollhouseRecording, pinhole

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from dollhouse_detector import LOW, Outputs, match

T = TypeVar("T")
FIRST = 90_000
CALIBRATED_TO = 20  # walks with odd numbers up to here calibrate the scores
THERE = 0.3  # overlap from which on a box tells where its thing is; a list asks no more of it


def walk(number: int, max_frames: int) -> Recording:
    """An exploration of a generated home at 640 x 480, without the sensor's faults; every other home holds things of
    all types."""
    world: Any = plugins.make("worlds", "dollhouse")
    seed = FIRST + number
    if number % 2 == 0:
        recording: Recording = world.explore(str(seed), seed=0, max_frames=max_frames)
        return recording
    rng, camera = np.random.default_rng((seed, 9)), pinhole()
    scene = varied(world.scene(str(seed)), rng)
    plan, corners = Plan(scene, ROBOT_M), np.array([room.box for room in scene.rooms])
    spots = rng.uniform(corners[:, :2].min(0), corners[:, 2:].max(0), (400, 2))
    scene = replace(scene, start_xy=tuple(max(spots.tolist(), key=plan.clearance)))
    poses = explore(scene, camera, ROBOT_M, seed=0, max_frames=max_frames).poses
    return DollhouseRecording(replace(scene, name=f"{scene.name} varied"), camera, poses)


def on_walks(
    work: Callable[[Recording, Any], T],
    folder: Path,
    homes: Sequence[int],
    max_frames: int,
    threshold: float | None = LOW,
) -> list[T]:
    """What ``work`` makes of walks of those numbers and of the detector in a folder; two at a time."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        return list(pool.map(_on_walk, *(repeat(v) for v in (work, folder, threshold)), homes, repeat(max_frames)))


def _on_walk(
    work: Callable[[Recording, Any], T], folder: Path, threshold: float | None, number: int, max_frames: int
) -> T:
    detector = plugins.make("detectors", "embedded", threshold=threshold, folder=folder, threads=1)
    return work(walk(number, max_frames), detector)


def outputs_on_shards(shards: Path, detector: Any) -> Outputs:
    """Every other frame of rendered homes, with things of all types in them, through a detector made with a low
    threshold."""
    outputs = Outputs(str(shards))
    for path in sorted(shards.glob("*.npz")):
        with np.load(path, allow_pickle=False) as shard:
            images, boxes, labels, of, pixels = (shard[key] for key in ("images", "boxes", "labels", "frame", "pixels"))
        height, width = images.shape[1:3]
        camera = Camera(width, height, width, width, width / 2, height / 2)
        for i in range(0, len(images), 2):
            mine, names = of == i, detector.model.names
            found = detector.detect(Frame(i, 0.0, images[i], None, np.eye(4), camera))
            true = Detections(i, boxes[mine], np.ones(mine.sum()), tuple(names[k] for k in labels[mine]))
            match(found, true, pixels[mine] * (640 / width) ** 2, outputs, THERE)
    return outputs


def calibrate(all_outputs: Sequence[Outputs], names: Sequence[str]) -> tuple[float, float, list[float]]:
    """How to make a score the chance that its thing is there: a slope and a shift of all logits, and an offset per
    name.

    A logistic regression by Newton's method, its offsets held near zero where little was seen (a Gaussian prior).
    Without it, names that are often seen where they are not pass the same threshold as names that never are.
    """
    number = {name: k for k, name in enumerate(names)}
    rows = [(score, right, number[name]) for s in all_outputs for name, hits in s.hits.items() for score, right in hits]
    score, right, which = (np.array(column, float) for column in zip(*rows, strict=True))
    logit, which = np.log(score / (1 - score).clip(1e-9)), which.astype(int)
    slope, shift, offset = 1.0, 0.0, np.zeros(len(names))
    for _ in range(80):
        chance = 1 / (1 + np.exp(-(slope * logit + shift + offset[which])))
        left, spread = right - chance, chance * (1 - chance) + 1e-6
        gain = np.bincount(which, left, len(names)) - offset
        offset += (gain / (np.bincount(which, spread, len(names)) + 1)).clip(-1, 1)
        chance = 1 / (1 + np.exp(-(slope * logit + shift + offset[which])))
        left, spread = right - chance, chance * (1 - chance) + 1e-6
        pull = np.array([(left * logit).sum(), left.sum()])
        stiff = np.array(
            [[(spread * logit**2).sum() + 1, (spread * logit).sum()], [(spread * logit).sum(), spread.sum() + 1]]
        )
        change = np.linalg.solve(stiff, pull).clip(-0.3, 0.3)
        slope, shift = slope + change[0], shift + change[1]
    return float(slope), float(shift), offset.tolist()
