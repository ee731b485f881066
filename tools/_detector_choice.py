"""What is chosen on generated homes that no training saw: how far to trust each name, the least score, the agreeing frames."""

from __future__ import annotations

import sys
from collections import defaultdict
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
from cartier.detectors.embedded import GLIMPSED
from cartier.geometry import box_distance
from cartier.language.names import display_name
from cartier.types import Camera, Detections, Frame, Place
from cartier.worlds.dollhouse.explore import explore
from cartier.worlds.dollhouse.place import Plan
from cartier.worlds.dollhouse.recording import DollhouseRecording, pinhole

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from dollhouse_detector import LOW, Kept, Sight, ap50, index_of, listed, look, match

T = TypeVar("T")
FIRST = 90_000
CHOSEN_FROM = 20  # the first of the walks that choose threshold and views: odd ones before it calibrate the scores
THRESHOLDS = (0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55)
VIEWS = (2, 3, 4, 5)
THERE = 0.3  # overlap from which on a box tells where its thing is; a list asks no more of it
HOLDS_M = 1.0  # from such a thing at which a glimpse is as good as right
Counts = tuple[float, float, int, float, int]
"""Recall and precision of a list, how many names were only glimpsed, the sum of their scores, and how many of them are there."""


def walk(number: int, max_frames: int) -> Recording:
    """An exploration of a generated home at 640 x 480, without the sensor's faults; every other home holds things of all types."""
    world, seed = plugins.make("worlds", "dollhouse"), FIRST + number
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


def on_walks(work: Callable[[Recording, Any], T], folder: Path, homes: Sequence[int], max_frames: int) -> list[T]:
    """What ``work`` makes of walks of those numbers and of the eyes in a folder, with a threshold of ``LOW``; two at a time."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        return list(pool.map(_on_walk, *(repeat(v) for v in (work, folder)), homes, repeat(max_frames)))


def _on_walk(work: Callable[[Recording, Any], T], folder: Path, number: int, max_frames: int) -> T:
    eyes = plugins.make("detectors", "embedded", threshold=LOW, folder=folder, threads=1)
    return work(walk(number, max_frames), eyes)


def looks_at_shards(shards: Path, eyes: Any) -> Sight:
    """Every other frame of rendered homes, with things of all types in them, through eyes made with a low threshold."""
    sight = Sight(str(shards))
    for path in sorted(shards.glob("*.npz")):
        with np.load(path, allow_pickle=False) as shard:
            images, boxes, labels, of, pixels = (shard[key] for key in ("images", "boxes", "labels", "frame", "pixels"))
        height, width = images.shape[1:3]
        camera = Camera(width, height, width, width, width / 2, height / 2)
        for i in range(0, len(images), 2):
            mine, names = of == i, eyes.model.names
            found = eyes.detect(Frame(i, 0.0, images[i], None, np.eye(4), camera))
            true = Detections(i, boxes[mine], np.ones(mine.sum()), tuple(names[k] for k in labels[mine]))
            match(found, true, pixels[mine] * (640 / width) ** 2, sight, THERE)
    return sight


def calibrate(sights: Sequence[Sight], names: Sequence[str]) -> tuple[float, float, list[float]]:
    """How to make a score the chance that its thing is there: a slope and a shift of all logits, and an offset per name.

    A logistic regression by Newton's method, its offsets held near zero where little was seen (a Gaussian prior). Without
    it, names that are often seen where they are not pass the same threshold as names that never are.
    """
    number = {name: k for k, name in enumerate(names)}
    rows = [(score, right, number[name]) for s in sights for name, hits in s.hits.items() for score, right in hits]
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


def choose(folder: Path, homes: int, max_frames: int) -> tuple[float, int]:
    """Threshold and views: of those at which the mean of F1 over the homes' lists is as good as the best, the most precise.

    As good as: within one standard error of it (Breiman et al. 1984), since few homes cannot tell such settings apart, and a
    thing that is not there costs a robot a way in vain. Prints all.
    """
    sights, lists = [], defaultdict[tuple[float, int], list[Counts]](list)
    for sight, of_home in on_walks(_lists, folder, range(CHOSEN_FROM, CHOSEN_FROM + homes), max_frames):
        sights.append(sight)
        for setting, counts in of_home.items():
            lists[setting].append(counts)
    print(f"held-back generated homes: AP50 {np.mean(list(ap50(sights).values())):.3f}", flush=True)
    f1 = {s: np.array([2 * r * p / max(1e-9, r + p) for r, p, *_ in of_homes]) for s, of_homes in lists.items()}
    for (threshold, views), of_homes in lists.items():
        recall, precision = np.mean(of_homes, axis=0)[:2].tolist()
        mean = f1[threshold, views].mean()
        print(f"score {threshold:.2f}, {views} views: recall {recall:.3f} precision {precision:.3f} F1 {mean:.3f}")
    best = max(f1, key=lambda setting: float(f1[setting].mean()))
    error = float(f1[best].std(ddof=1)) / homes**0.5
    print(f"best F1 {f1[best].mean():.3f} ± {error:.3f} at {best}")
    as_good = [setting for setting in f1 if f1[setting].mean() >= f1[best].mean() - error]
    chosen = max(as_good, key=lambda setting: float(np.mean([precision for _, precision, *_ in lists[setting]])))
    glimpsed, scores, right = np.sum(lists[chosen], axis=0)[2:].tolist()
    print(f"only glimpsed: {glimpsed:.0f} names, of which {right:.0f} are there within {HOLDS_M} m: "
          f"{right / max(1e-9, scores):.2f} of their scores")  # fmt: skip
    return chosen


def _lists(walked: Recording, eyes: Any) -> tuple[Sight, dict[tuple[float, int], Counts]]:
    """What is seen on a walk, and what the list is worth at all thresholds and views."""
    recording, lists = Kept(walked), {}
    sight = look(recording, eyes)
    for threshold in THRESHOLDS:
        index = index_of(recording, [_as_seen(found, threshold) for found in sight.found], VIEWS[0])
        for views in VIEWS:
            index.min_views = views  # it counts them all, and leaves names out only when it is asked
            hints = [index.glimpse(name) for name in index.glimpsed()]
            scores, right = sum(hint.score for hint in hints), sum(_holds(recording, hint) for hint in hints)
            lists[threshold, views] = (*listed(sight, index.names()), len(hints), scores, right)
    return sight, lists


def _as_seen(found: Detections, threshold: float) -> Detections:
    """What eyes of that threshold would have told."""
    hints = (found.scores < threshold) & (found.scores >= GLIMPSED)
    return replace(found.keep(found.scores >= threshold), glimpsed=found.keep(hints))


def _holds(recording: Kept, place: Place) -> bool:
    things = [t for t in recording.truth or () if display_name(t.label) == place.label]
    return any(box_distance(np.array(place.position), t.box_min, t.box_max) <= HOLDS_M for t in things)
