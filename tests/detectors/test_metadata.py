"""ONNX files that say what they are: their own names, input size and task, and which of them are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_onnx import SIDE, constant_net, describe, frame

from cartier import plugins
from cartier.detectors.layouts import cells
from cartier.errors import InputError

EIGHTY = {i: f"part {i}" for i in range(80)}
TWO = "{0: 'mug', 1: \"driver's seat\"}"


def made(path: Path, table: np.ndarray, more: dict[str, Any] | None = None, **props: str) -> Any:
    """The detector of a file that always gives ``table``, and ``more`` outputs."""
    size = (1, 3, "h", "w") if "imgsz" in props else (1, 3, SIDE, SIDE)
    constant_net(path / "m.onnx", {"output0": table} | (more or {}), size, props)
    return plugins.make("detectors", "onnx", model=path / "m.onnx")


def anchors(classes: int, more: int = 0, at: int = 1, count: int = cells((SIDE, SIDE))) -> np.ndarray:
    """One box of class ``at``, the middle of the input, as YOLOv8 has it, with columns of masks that are no scores."""
    table = np.zeros((1, 4 + classes + more, count))
    table[0, :4, 0], table[0, 4 + at, 0] = (16, 16, 8, 8), 0.9
    table[0, 4 + classes :] = 5.0
    return table


def rows(at: int = 1, more: int = 0) -> np.ndarray:
    """The same as an end-to-end model has it."""
    table = np.zeros((1, 300, 6 + more))
    table[0, 0, :6] = 12, 12, 20, 20, 0.9, at
    return table


@pytest.mark.parametrize("form", [str, json.dumps, lambda names: str(list(names.values()))])
def test_eighty_names_of_ones_own(tmp_path: Path, form: Any) -> None:
    detector = made(tmp_path, anchors(80, at=56), names=form(EIGHTY), task="detect")
    assert detector.detect(frame()).labels == ("part 56",)
    assert "with its own names (part 0, part 1, part 2, part 3, …)" in detector.notes[0]


MASKS = {"output1": np.zeros((1, 32, 8, 8))}


@pytest.mark.parametrize(
    ("table", "more", "task"),
    [
        (anchors(2), None, "detect"),
        (anchors(2), None, ""),
        (anchors(2, 32), MASKS, "segment"),
        (anchors(2, 51), None, "pose"),
        (anchors(2, count=5000), None, "detect"),
        (rows(), None, "detect"),
        (rows(more=32), MASKS, "segment"),
    ],
)
def test_boxes_of_every_task_that_has_them(tmp_path: Path, table: np.ndarray, more: Any, task: str) -> None:
    found = made(tmp_path, table, more, names=TWO, task=task).detect(frame(width=32, height=32))
    assert found.labels == ("driver's seat",)
    assert found.scores == pytest.approx([0.9]) and found.boxes_xyxy[0] == pytest.approx([12, 12, 20, 20])


def test_open_input_takes_the_files_size(tmp_path: Path) -> None:
    detector = made(tmp_path, anchors(2, count=cells((64, 32))), names=TWO, task="detect", imgsz="[32, 64]")
    assert detector.detect(frame(width=64, height=32)).boxes_xyxy[0] == pytest.approx([12, 12, 20, 20])


def test_numbers_without_a_name_are_dropped(tmp_path: Path) -> None:
    assert not made(tmp_path, anchors(3), names="{0: 'mug', 2: 'bed'}").detect(frame()).labels


@pytest.mark.parametrize(
    ("table", "props", "fault"),
    [
        (
            anchors(3),
            {"names": TWO, "task": "detect"},
            r"detect model of 2 classes \(mug, driver's seat\), but its outputs",
        ),
        (anchors(2, 1), {"names": TWO, "task": "obb"}, "of task obb, which gives turned boxes: export a model of task"),
        (np.zeros((1, 2)), {"names": TWO, "task": "classify"}, "of task classify, which gives no boxes"),
        (anchors(2), {"names": "{0: 'mug', 1: 'bed'"}, "no names by class number, but .* write a sidecar"),
        (anchors(2), {"names": "__import__('os').getcwd()"}, "no names by class number"),
        (anchors(2), {"names": "{" * 100_000}, "no names by class number"),
        (anchors(2), {"names": "{0: 'mug', 9999999: 'bed'}"}, "no names by class number"),
        (anchors(2), {"names": "{0: 'mug', 1: ' '}"}, "its metadata: labels: .*label 1 is empty"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path: Path, table: np.ndarray, props: dict[str, str], fault: str) -> None:
    with pytest.raises(InputError, match=fault) as caught:
        made(tmp_path, table, **props)
    assert "\n" not in str(caught.value)


def test_a_sidecar_outdoes_the_metadata(tmp_path: Path) -> None:
    describe(tmp_path / "m.onnx", layout="yolov8", labels=["cup", "sofa"])
    assert made(tmp_path, anchors(2), names=TWO).detect(frame()).labels == ("sofa",)
