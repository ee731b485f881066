"""Fits the network of floor kinds (mapping/floor_kinds.py), and measures how many cells of a home's floor are right.

python tools/fit_floor_kinds.py fit                     (24 generated homes; writes models/floor_kinds/network.npz)
python tools/fit_floor_kinds.py measure [HOME …]        (the built-in and twelve generated homes, with rugs)

Fitted are views from random places in homes 77001 and on, which no benchmark uses, with rugs, and with floors of any
colour; half of them as a real camera sees them. The seed is fixed. Measured are whole walks, from which the map is made
as always: once with the true kinds of floor instead of the network's, and once from pixels.
"""

from __future__ import annotations

import random
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

from cartier import plugins
from cartier.mapping.floor_kinds import KNOWN, MODEL, FloorKindMapper, Patch, features, laid_out
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.occupancy import OccupancyMapper
from cartier.navigation.planning import traversable
from cartier.route_rules import FLOOR_KINDS
from cartier.types import Frame
from cartier.worlds.dollhouse.floors import RUGS, kinds_at, with_options
from cartier.worlds.dollhouse.generate import generate
from cartier.worlds.dollhouse.model import Scene
from cartier.worlds.dollhouse.place import Plan
from cartier.worlds.dollhouse.recording import DollhouseRecording, look, pinhole
from cartier.worlds.dollhouse.scene import load_scene
from cartier.worlds.dollhouse.sensor import Sensor

FIRST, HOMES, VIEWS = 77001, 24, 16
HELD_OUT = tuple(str(77101 + k) for k in range(12))
HIDDEN, ROUNDS, BATCH, RATE, DECAY = 32, 6000, 512, 2e-3, 1e-4
ROWS_A_VIEW = 160
COLOURS = "white beige lightgrey terracotta lightblue sage slategrey oak walnut pine whitewood cherry ash sand grey "
COLOURS += "charcoal navy tan olive ivory rosybrown"

Rows = tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]


def recoloured(seed: int) -> Scene:
    """A generated home with rugs, whose floors are of any kind and colour."""
    rng = random.Random(seed)

    def floor(_: re.Match[str]) -> str:
        return f'"floor": "{rng.choice(FLOOR_KINDS[1:-1])}:{rng.choice(COLOURS.split())}"'

    return with_options(load_scene(re.sub(r'"floor": "[^"]*"', floor, generate(seed))), (RUGS,))


def views(scene: Scene, seed: int) -> Iterator[Frame]:
    """Frames from random places of a home, that look as the robot does."""
    rng, plan = np.random.default_rng(seed), Plan(scene, 0.2)
    grid = plan.grid()
    places = grid.centre(np.argwhere(plan.reachable(scene.start_xy)))
    downs = np.radians(rng.choice([0.0, 22.5, 22.5, 35.0, 52.5], VIEWS))
    at = places[rng.integers(len(places), size=VIEWS)]
    poses = [look(xy, float(rng.uniform(0, 6.28)), float(d), float(rng.uniform(1.0, 1.6))) for xy, d in zip(at, downs, strict=True)]
    camera = pinhole(*((640, 480) if seed % 3 else (480, 360)))
    yield from DollhouseRecording(scene, camera, np.array(poses), Sensor(seed) if seed % 2 else None)  # type: ignore[misc]


def rows_of(frame: Frame, scene: Scene, rng: np.random.Generator) -> Rows | None:
    """Features of cells, and their kinds (0 to KNOWN - 1); cells of two kinds are left out."""
    patch = laid_out(frame, 0.05)
    if patch is None:
        return None
    found, enough = features(patch)
    kinds = kinds_at(scene, patch.xy()).reshape(found.shape[0], -1, found.shape[1], patch.seen.shape[1] // found.shape[1])
    low, high = kinds.min((1, 3)), kinds.max((1, 3))
    some = np.argwhere(enough & (low == high) & (low > 0))
    some = some[rng.permutation(len(some))[:ROWS_A_VIEW]]
    return found[tuple(some.T)], low[tuple(some.T)].astype(np.int64) - 1


def collect() -> Rows:
    rng, every = np.random.default_rng(0), list[Rows]()
    for k in range(HOMES):
        scene = recoloured(FIRST + k)
        for frame in views(scene, FIRST + k):
            rows = rows_of(frame, scene, rng)
            if rows is not None and len(rows[0]):
                every.append(rows)
        print(f"home {FIRST + k}: {sum(len(x) for x, _ in every)} rows", file=sys.stderr, flush=True)
    return np.concatenate([x for x, _ in every]), np.concatenate([y for _, y in every])


def fit(x: npt.NDArray[np.float32], y: npt.NDArray[np.int64]) -> dict[str, npt.NDArray[Any]]:
    """A network of one hidden layer (Adam, balanced classes)."""
    rng = np.random.default_rng(0)
    mean, scale = x.mean(0), x.std(0) + 1e-6
    inputs = np.clip((x - mean) / scale, -5, 5)
    weight = len(y) / (KNOWN * np.bincount(y, minlength=KNOWN))
    net = [
        rng.normal(0, (2 / x.shape[1]) ** 0.5, (x.shape[1], HIDDEN)), np.zeros(HIDDEN),
        rng.normal(0, (1 / HIDDEN) ** 0.5, (HIDDEN, KNOWN)), np.zeros(KNOWN),
    ]  # fmt: skip
    first, second = [np.zeros_like(p) for p in net], [np.zeros_like(p) for p in net]
    for step in range(1, ROUNDS + 1):
        some = rng.integers(len(y), size=BATCH)
        a, target, w = inputs[some], y[some], weight[y[some]]
        hidden = np.maximum(a @ net[0] + net[1], 0)
        scores = hidden @ net[2] + net[3]
        scores = np.exp(scores - scores.max(1, keepdims=True))
        scores /= scores.sum(1, keepdims=True)
        scores[np.arange(BATCH), target] -= 1
        scores *= w[:, None] / BATCH
        back = (scores @ net[2].T) * (hidden > 0)
        grads = [a.T @ back, back.sum(0), hidden.T @ scores, scores.sum(0)]
        rate = RATE * (1 - step / (ROUNDS + 1))
        for k, grad in enumerate(grads):
            grad = grad + DECAY * net[k]
            first[k] = 0.9 * first[k] + 0.1 * grad
            second[k] = 0.999 * second[k] + 0.001 * grad * grad
            net[k] = net[k] - rate * (first[k] / (1 - 0.9**step)) / (np.sqrt(second[k] / (1 - 0.999**step)) + 1e-8)
    strange = np.quantile(np.mean(np.square(np.clip((x - mean) / scale, -9, 9)), 1), 0.998)
    names = ("w1", "b1", "w2", "b2")
    arrays = {name: part.astype(np.float32) for name, part in zip(names, net, strict=True)}
    return arrays | {"mean": mean, "scale": scale.astype(np.float32), "strange": np.array(strange, np.float32)}


@dataclass
class Score:
    """Cells of free floor where the truth is known: all, told (not unknown), and right of these."""

    cells: int = 0
    told: int = 0
    right: int = 0
    confused: npt.NDArray[np.int64] | None = None

    def add(self, truth: npt.NDArray[np.uint8], found: npt.NDArray[np.uint8]) -> None:
        known = truth > 0
        counts = np.zeros((KNOWN + 1, KNOWN + 1), np.int64)
        np.add.at(counts, (truth[known], found[known]), 1)
        self.confused = counts if self.confused is None else self.confused + counts
        self.cells += int(known.sum())
        self.told += int((found[known] > 0).sum())
        self.right += int((found[known] == truth[known]).sum())


def true_classifier(scene: Scene) -> Any:
    """The true kinds, pixel by pixel, where the network would say them."""

    def classify(frame: Frame, patch: Patch) -> npt.NDArray[np.float32]:
        kinds = np.where(patch.seen, kinds_at(scene, patch.xy()), 0)
        side = kinds.shape[0] // 64
        counts = np.stack([(kinds == k).reshape(64, side, 64, side).sum((1, 3)) for k in range(1, KNOWN + 1)], -1)
        logs = np.log((counts + 0.01) / (counts.sum(-1, keepdims=True) + 0.04))
        logs[counts.sum(-1) == 0] = np.nan
        return np.asarray(logs, np.float32)

    return classify


def measure(homes: Sequence[str], max_frames: int, sensor: bool) -> None:
    world = plugins.make("worlds", "dollhouse")
    totals = {"true": Score(), "pixels": Score()}
    for home in homes:
        scene = world.scene(f"{home}+{RUGS}")
        walk = world.explore(f"{home}+{RUGS}", max_frames=max_frames, sensor=sensor)
        floor = OccupancyMapper()
        kinds = {"true": FloorKindMapper(0.05, true_classifier(scene)), "pixels": FloorKindMapper(0.05)}
        keyframes = Keyframes()
        frames = []
        for number in range(len(walk)):
            frame = walk[number]
            floor.add(frame)
            frames = keyframes.push(frame) + (keyframes.flush() if number + 1 == len(walk) else [])
            for each in frames:
                for mapper in kinds.values():
                    mapper.add(each)
        grid = floor.grid()
        assert grid is not None
        where = np.indices(grid.cells.shape)
        truth = np.where(traversable(grid, 0.05), kinds_at(scene, grid.centre(np.moveaxis(where, 0, -1))), 0).astype(np.uint8)
        told = []
        for name, mapper in kinds.items():
            found = mapper.kinds(grid)
            assert found is not None
            one = Score()
            one.add(truth, found)
            totals[name].add(truth, found)
            told.append(f"{name} {one.right / one.cells:.1%} right, {1 - one.told / one.cells:.1%} unknown")
        print(f"{home:16} {one.cells:6} cells: {'; '.join(told)}", flush=True)
    for name, score in totals.items():
        wrong = score.told - score.right
        print(f"{name}: {score.right / score.cells:.2%} of {score.cells} cells right, {wrong / score.cells:.2%} wrong, the rest unknown")
        print(f"  of those told {score.right / max(score.told, 1):.2%} right; rows true, columns told ({', '.join(FLOOR_KINDS)}):")
        print(score.confused)


def main() -> int:
    parser = Parser(__doc__)
    parser.add_argument("what", choices=("fit", "measure"))
    parser.add_argument("homes", nargs="*")
    parser.add_argument("--rows", type=Path, help="keep the rows of the fit in this file, or take them from it")
    parser.add_argument("--max-frames", type=int, default=800)
    parser.add_argument("--sensor", action="store_true", help="frames as a real camera has them")
    asked = parser.parse_args()
    if asked.what == "measure":
        built_in = plugins.make("worlds", "dollhouse").homes()
        measure(asked.homes or [*built_in, *HELD_OUT], asked.max_frames, asked.sensor)
        return 0
    if asked.rows is not None and asked.rows.exists():
        kept = np.load(asked.rows, allow_pickle=False)
        x, y = kept["x"], kept["y"]
    else:
        x, y = collect()
        if asked.rows is not None:
            np.savez(asked.rows, x=x, y=y)
    net = fit(x, y)
    MODEL.parent.mkdir(exist_ok=True)
    np.savez(MODEL, **net)  # type: ignore[arg-type]
    hidden = np.maximum(np.clip((x - net["mean"]) / net["scale"], -5, 5) @ net["w1"] + net["b1"], 0)
    right = (hidden @ net["w2"] + net["b2"]).argmax(1) == y
    print(f"{len(y)} cells of single views, {right.mean():.1%} right on those fitted; {MODEL.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(run_script(main))
