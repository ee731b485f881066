"""Calibration of existence probabilities: the DetectorScoreModel, fitted on generated homes that no training saw.

python tools/calibrate_existence.py FOLDER [--first 60] [--homes 40]
    FOLDER holds an exported dollhouse detector; into its names.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from _detector_choice import on_walks
from scipy.optimize import minimize

from cartier.contracts import Recording
from cartier.mapping.existence import posterior
from cartier.mapping.object_map import ObjectMap
from cartier.types import Array, DetectorScoreModel

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script
from objects import one_to_one

STEPS = (1, 2, 4)  # every frame, every second, every fourth: a walk's density must not matter
STIFF = 0.02  # of a Gaussian prior on the logarithms of the Beta distributions' numbers
FOLDS = 5
MAX_FRAMES = 400
LOG_ODDS = ("prior_log_odds", "best_view_log_odds", "log_odds_per_log_width")
Evidence = tuple[Array, Array, Array, Array]
"""Of N objects: n_observable and reports per standpoint (N, 36), how wide each was seen (N,), whether it is there
(N,)."""


def evidence(recording: Recording, detector: Any) -> list[Evidence]:
    """What maps of a walk hold for and against each object, and the truth."""
    maps = {step: ObjectMap(detector.score_model) for step in STEPS}
    shown: set[int] = set()
    for number in range(len(recording)):
        frame = recording[number]
        found = detector.detect(frame)
        shown |= set(np.unique(frame.instances).tolist())
        for step, made in maps.items():
            if number % step == 0:
                made.add(frame, found)
    objs = [obj for obj in recording.truth or () if obj.id in shown]
    rows = []
    for made in maps.values():
        made.merge_and_prune()
        objects = made.objects()
        real = one_to_one(objects, objs)
        rows.append((*made.evidence(), np.array([i in real for i in range(len(objects))])))
    return rows


def fit(homes: Sequence[Sequence[Evidence]], before: DetectorScoreModel) -> DetectorScoreModel:
    """The likeliest numbers; prints the error of the probabilities in homes that did not choose them (five folds)."""

    def told(numbers: Array) -> DetectorScoreModel:
        there, not_there = (tuple(np.exp(pair).tolist()) for pair in (numbers[:2], numbers[2:4]))
        log_odds = dict(zip(LOG_ODDS, numbers[4:].tolist(), strict=True))
        return replace(before, beta_true=there, beta_false=not_there, **log_odds)

    def fitted(chosen: Sequence[Sequence[Evidence]]) -> DetectorScoreModel:
        rows = [row for home in chosen for row in home]

        def loss(numbers: Array) -> float:
            made, total = told(numbers), STIFF * float(np.sum(numbers[:4] ** 2))
            for tried, hits, widest, right in rows:
                chance = np.clip(posterior(tried, hits, widest, made), 1e-9, 1 - 1e-9)
                total -= float(np.log(np.where(right, chance, 1 - chance)).sum())
            return total

        betas = np.log([*before.beta_true, *before.beta_false])
        start = np.array([*betas, *(getattr(before, name) for name in LOG_ODDS)])
        return told(minimize(loss, start, method="L-BFGS-B").x)

    guessed, true = [], []
    for fold in range(FOLDS):
        made = fitted([home for k, home in enumerate(homes) if k % FOLDS != fold])
        for tried, hits, widest, right in (row for home in homes[fold::FOLDS] for row in home):
            guessed.append(posterior(tried, hits, widest, made))
            true.append(right)
    chance, right = np.concatenate(guessed), np.concatenate(true).astype(float)
    tenth = np.minimum((chance * 10).astype(int), 9)
    for k in range(10):
        mine = tenth == k
        print(
            f"told {k / 10:.1f} to {(k + 1) / 10:.1f}: {right[mine].mean() if mine.any() else np.nan:.2f} of "
            f"{mine.sum()} are there"
        )
    off = sum(abs(float((chance - right)[tenth == k].sum())) for k in range(10)) / len(chance)
    print(f"calibration error {off:.3f} over {len(chance)} objects of {len(homes)} homes", flush=True)
    return fitted(homes)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("folder", type=Path, help="of an exported dollhouse detector")
    parser.add_argument("--first", type=int, default=60, help="number of the first home (default: %(default)s)")
    parser.add_argument("--homes", type=int, default=40, help="how many generated homes (default: %(default)s)")
    asked = parser.parse_args()
    file = asked.folder / "names.json"
    told = json.loads(file.read_text())
    walks = range(asked.first, asked.first + asked.homes)
    seen = on_walks(evidence, asked.folder, walks, MAX_FRAMES, threshold=None)
    made = asdict(fit(seen, DetectorScoreModel.from_dict(told.get("score_model", {}))))
    made["measured"] = f"{asked.homes} generated homes that no training saw, half of them with things of all types"
    told["score_model"] = {
        name: np.round(value, 3).tolist() if name != "measured" else value for name, value in made.items()
    }
    file.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    run_script(main)
