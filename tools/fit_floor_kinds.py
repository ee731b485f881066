"""Fits the network of floor kinds (mapping/floor_kinds.py), and measures how many cells of a home's floor are right.

python tools/fit_floor_kinds.py fit                     (writes models/floor_kinds/network.npz, in a minute)
python tools/fit_floor_kinds.py measure [HOME …]        (the built-in and twelve generated homes, with rugs)

Fitted are looks at empty rooms with floors of any colour and with rugs, under random light, half of them as a real
camera sees them: no home takes part. The seed is fixed. Measured are whole walks, from which the map is made
as always: once with the true kinds of floor instead of the network's, and once from pixels.
"""

from __future__ import annotations

import colorsys
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

from cartier import plugins
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.occupancy import OccupancyMapper
from cartier.navigation.planning import traversable
from cartier.types import Frame
from cartier.types.route_rules import FLOOR_KINDS
from cartier_dollhouse.floor_kinds import KNOWN, MODEL, FloorKindMapper, Patch, features, laid_out
from cartier_dollhouse.floors import RUGS, kinds_at, with_options
from cartier_dollhouse.mesh import panel
from cartier_dollhouse.model import Part, Room, Scene
from cartier_dollhouse.recording import look, pinhole
from cartier_dollhouse.render import Renderer
from cartier_dollhouse.scene import load_home
from cartier_dollhouse.sensor import Sensor

SCENES, ROOM_M, HIGH_M = 150, 2.5, 2.6
HELD_OUT = tuple(str(77101 + k) for k in range(12))
HIDDEN, ROUNDS, BATCH, RATE, DECAY = 32, 6000, 512, 2e-3, 1e-4
ROWS_A_VIEW = 120
STRANGE = 0.98  # of what was fitted lies nearer to its mean (Mahalanobis) than what counts as strange
SIZES = ((640, 480), (640, 480), (480, 360))

Rows = tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]


def random_scene(rng: random.Random) -> Scene:
    """Two empty rooms side by side with floors of any kind and colour, a rug in each."""
    rooms = tuple(
        Room(
            f"room {k}",
            "room",
            (k * (ROOM_M + 0.01), 0.0, k * (ROOM_M + 0.01) + ROOM_M, 2 * ROOM_M),
            _floor(rng),
            "paint:cream",
        )
        for k in (0, 1)
    )
    floors = [_level(room.box, room.floor) for room in rooms]
    scene = Scene("floors", "", rooms, (), (), tuple(floors), HIGH_M, (ROOM_M, ROOM_M))
    return with_options(scene, (RUGS,), rng)


def _level(area: tuple[float, float, float, float], floor: str) -> Part:
    x1, y1, x2, y2 = area
    flat = panel((x1, y1, 0), (x2, y1, 0), (x2, y2, 0), (x1, y2, 0), floor)
    return replace(flat, uv_m=flat.vertices[:, :2].copy())


def _floor(rng: random.Random) -> str:
    red, green, blue = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0, 0.55), rng.uniform(0.3, 0.98))
    tint = "#" + "".join(f"{round(255 * part):02x}" for part in (red, green, blue))
    return f"{rng.choice(FLOOR_KINDS[1:-1])}:{tint}"


def random_frame(scene: Scene, number: int) -> Frame:
    """A look down into a scene, under light that falls off to one side; every other one as a real camera sees it."""
    rng = np.random.default_rng(number)
    camera, xy = pinhole(*SIZES[number % len(SIZES)]), rng.uniform(1.0, 2 * ROOM_M - 1.0, 2)
    towards = np.array([ROOM_M, ROOM_M]) + rng.normal(0, 1.0, 2) - xy
    down = float(np.radians(rng.choice([15.0, 22.5, 22.5, 35.0, 52.5])))
    pose = look(xy, float(np.arctan2(towards[1], towards[0])), down, float(rng.uniform(1.0, 1.6)))
    view = Renderer(scene, camera, light=False).render(pose)
    v, u = np.mgrid[-1 : 1 : camera.height * 1j, -1 : 1 : camera.width * 1j]
    across, along = rng.uniform(-0.25, 0.25, 2)
    light = np.clip(rng.uniform(0.5, 1.1) * (1 + across * u + along * v), 0.1, 1.4)
    view = replace(view, rgb=np.clip(view.rgb * light[..., None], 0, 255).astype(np.uint8))
    if number % 2:
        view = Sensor(number).corrupt(view, 0)
    return Frame(number, 0.0, view.rgb, view.depth_m, pose, camera)


def rows_of(frame: Frame, scene: Scene, rng: np.random.Generator) -> Rows | None:
    """Features of cells, and their kinds (0 to KNOWN - 1); cells of two kinds are left out."""
    patch = laid_out(frame, 0.05)
    if patch is None:
        return None
    found, enough = features(patch)
    kinds = kinds_at(scene, patch.xy()).reshape(
        found.shape[0], -1, found.shape[1], patch.seen.shape[1] // found.shape[1]
    )
    low, high = kinds.min((1, 3)), kinds.max((1, 3))
    some = np.argwhere(enough & (low == high) & (low > 0))
    some = some[rng.permutation(len(some))[:ROWS_A_VIEW]]
    return found[tuple(some.T)], low[tuple(some.T)].astype(np.int64) - 1


def collect() -> Rows:
    every = list[Rows]()
    for k in range(SCENES):
        scene = random_scene(random.Random(k))
        rows = rows_of(random_frame(scene, k), scene, np.random.default_rng(k))
        if rows is not None:
            every.append(rows)
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
    values, axes = np.linalg.eigh(np.cov(((x - mean) / scale).T.astype(np.float64)))
    whiten = axes / np.sqrt(np.maximum(values, 1e-4))
    strange = np.quantile(np.mean(np.square((x - mean) / scale @ whiten), 1), STRANGE)
    names = ("w1", "b1", "w2", "b2")
    arrays = {name: part.astype(np.float32) for name, part in zip(names, net, strict=True)}
    return arrays | {
        "mean": mean,
        "scale": scale.astype(np.float32),
        "whiten": whiten.astype(np.float32),
        "strange": np.float32(strange),
    }


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


def measure(homes: Sequence[str], max_frames: int, sensor: str) -> None:
    world = plugins.make("worlds", "dollhouse")
    totals = {"true": Score(), "pixels": Score()}
    for home in homes:
        scene = load_home(f"{home}+{RUGS}")
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
        truth = np.where(traversable(grid, 0.05), kinds_at(scene, grid.centre(np.moveaxis(where, 0, -1))), 0).astype(
            np.uint8
        )
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
        wrong = (score.told - score.right) / score.cells
        print(f"{name}: {score.right / score.cells:.2%} of {score.cells} cells right, {wrong:.2%} wrong, else unknown")
        print(f"  of those told {score.right / max(score.told, 1):.2%} are right; rows true, columns told:")
        print(f"  {', '.join(FLOOR_KINDS)}\n{score.confused}")


def main() -> int:
    parser = Parser(__doc__)
    parser.add_argument(
        "what", metavar="what", choices=("fit", "measure"), help="make the network, or measure the one that ships"
    )
    parser.add_argument("homes", nargs="*", help="homes to measure in (default: the built-in and ten generated ones)")
    parser.add_argument("--rows", type=Path, help="keep the rows of the fit in this file, or take them from it")
    parser.add_argument("--max-frames", type=int, default=800, help="of a walk (default: %(default)s)")
    parser.add_argument("--sensor", default="exact", metavar="KIND", help="exact, depth-camera or phone")
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
