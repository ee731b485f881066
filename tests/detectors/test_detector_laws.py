"""What every detector owes its caller, over every layout and every form of file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_onnx import SCORE, frame, red_finder

from cartier import plugins
from cartier.detectors.layouts import LAYOUTS
from cartier.errors import BackendError
from cartier.testing import check_detector

INPUT = {"mean": [0, 0, 0], "std": [1, 1, 1], "scale": 255}
FRAMES = (frame(0), frame(1, 640, 480), frame(2, 33, 97), frame(3, 64, 48))


def from_onnx(layout: str) -> Callable[[Path], dict[str, Any]]:
    return lambda folder: {"model": red_finder(folder / "m.onnx", layout, brightest=1.0, **INPUT), "threshold": 0.3}


def from_file(folder: Path) -> dict[str, Any]:
    rows = [
        {"frame": i, "label": label, "score": score, "xyxy": [-1, 2, 9.5, 20]}
        for i in range(3)
        for label, score in (("mug", 0.4), ("CoffeeMachine", SCORE), ("mug", 0.2))
    ]
    (folder / "d.jsonl").write_text("\n".join(map(json.dumps, rows)))
    return {"path": folder / "d.jsonl", "threshold": 0.3}


MAKERS = {f"onnx-{layout}": from_onnx(layout) for layout in LAYOUTS} | {"file": from_file}


@pytest.fixture(params=MAKERS)
def made(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, dict[str, Any]]:
    return request.param.split("-")[0], MAKERS[request.param](tmp_path)


def test_every_detector_is_under_the_laws() -> None:
    # ground_truth has no threshold, transformers needs torch, embedded and photos know no red squares:
    # tests/test_testing.py and their own tests check the laws for them
    elsewhere = {"ground_truth", "transformers", "embedded", "photos"}
    assert {b.name for b in plugins.backends("detectors")} - elsewhere == {name.split("-")[0] for name in MAKERS}


def test_detections_obey(made: tuple[str, dict[str, Any]]) -> None:
    every = check_detector(lambda: plugins.make("detectors", made[0], **made[1]), FRAMES)  # type: ignore[call-overload]
    low = plugins.make("detectors", made[0], **made[1]).score_model.zero_weight_score  # type: ignore[call-overload]
    assert sum(map(len, every)) >= 3 and 0 < low < 0.3
    for found in every:
        assert (found.boxes_xyxy[:, 2:] - found.boxes_xyxy[:, :2] >= 1).all()
        assert (found.scores >= np.float32(low)).all() and (np.diff(found.scores) <= 0).all()


def test_the_name_says_the_threshold(made: tuple[str, dict[str, Any]]) -> None:
    detector = plugins.make("detectors", made[0], **made[1])
    assert "0.3" in detector.name
    assert detector.score_model.threshold == pytest.approx(0.3) and detector.score_model.measured == ""


def test_a_higher_threshold_gives_fewer_of_the_same(made: tuple[str, dict[str, Any]]) -> None:
    name, options = made
    low, high = (plugins.make("detectors", name, **options | {"threshold": t}) for t in (0.0, 0.5))
    every, some = low.detect(FRAMES[0]), high.detect(FRAMES[0])
    assert len(some) <= len(every)
    assert np.array_equal(some.scores, every.scores[every.scores >= high.score_model.zero_weight_score])


@pytest.mark.parametrize("wrong", [{"threshold": -1}, {"threshold": 2}, {"colour": "red"}])
def test_wrong_options_are_refused(made: tuple[str, dict[str, Any]], wrong: dict[str, Any]) -> None:
    with pytest.raises(BackendError, match=r"threshold must be from 0 to 1|has no option 'colour'"):
        plugins.make("detectors", made[0], **made[1] | wrong)
