"""Calibration of a detector's scores on photographs with true boxes: the score_model of its sidecar.

python tools/calibrate_on_photographs.py [DETECTOR] [--photos ../shared/photos] [--part even|odd]     (default: photos)
Its last line goes into the sidecar. A logistic regression of "right" on the score's logit, over every detection of a
household thing but persons, who would be half of all: `spawn_threshold` and `zero_weight_score` are the score from
which one of ten is right, `threshold` one of two, `full_weight_score` seven of ten. Nothing else is fitted: how real
objects and inventions spread over standpoints cannot be had from single photographs, and stays at the defaults.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from command_line import Parser, run_script
from photographs import LOW, PARTS, SHARED, Matched, match, photographs

from cartier import specs

PERSON = "person"


def fit(scores: Any, right: Any) -> tuple[float, float]:
    """a and b of P(right) = expit(a + b logit(score)), by maximum likelihood."""
    x, sign = logit(np.clip(scores, 1e-3, 1 - 1e-3)), np.where(right, -1, 1)
    a, b = minimize(lambda p: np.logaddexp(0, sign * (p[0] + p[1] * x)).sum(), (0.0, 1.0)).x
    return float(a), float(b)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("detector", nargs="?", default="photos", help="as of cartier map (default: photos)")
    parser.add_argument("--photos", type=Path, default=SHARED / "photos", help="folder with images/ and labels/")
    parser.add_argument("--part", choices=["all", *PARTS], default="all", help="every other photograph, by name")
    options = parser.parse_args()
    photos, matched = list(photographs(options.photos, options.part)), Matched()
    detector = specs.detector(options.detector, None, threshold=LOW)  # type: ignore[arg-type]  # none of these reads it
    for photo in photos:
        match(photo, detector, matched)
    hits = np.array([hit for name, some in matched.hits.items() if name != PERSON for hit in some])
    boxes = sum(len(some) for name, some in matched.boxes.items() if name != PERSON)
    a, b = fit(hits[:, 0], hits[:, 1] > 0)
    for low in np.arange(0.1, 0.9, 0.1):
        here = hits[(hits[:, 0] >= low) & (hits[:, 0] < low + 0.1), 1]
        if len(here):
            print(
                f"score {low:.1f}-{low + 0.1:.1f}: {here.mean():4.0%} of {len(here)} right, fitted "
                f"{expit(a + b * logit(low + 0.05)):4.0%}"
            )
    at = {share: round(float(expit((logit(share) - a) / b)), 2) for share in (0.1, 0.5, 0.7)}
    about = f"{len(photos)} COCO photographs with {boxes} household things"
    score_model = {"threshold": at[0.5], "spawn_threshold": at[0.1], "zero_weight_score": at[0.1]}
    score_model |= {"full_weight_score": at[0.7], "measured": about}
    print(json.dumps({"threshold": at[0.5], "score_model": score_model}))


if __name__ == "__main__":
    run_script(main)
