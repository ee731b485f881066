"""The onnx detector on networks that really look: pixels in, boxes out, in every layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto, helper
from tiny_onnx import LABELS, RED_BOX, SCORE, SIDE, Net, constant_net, describe, frame, red_finder

from cartier import plugins
from cartier.detectors.layouts import LAYOUTS
from cartier.detectors.sidecar import DEFAULTS, coco80, coco91

INPUT = {"mean": [0, 0, 0], "std": [1, 1, 1], "scale": 255, "threshold": 0.5}
"""Makes every layout see 0 to 1; yolox and detr have other defaults."""


def detect(model: Path, **options: Any) -> Any:
    return plugins.make("detectors", "onnx", model=model, **options).detect(frame())


@pytest.mark.parametrize("resize", ["stretch", "letterbox", "letterbox_top_left"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_red_rectangle_comes_back_in_frame_pixels(layout: str, resize: str, tmp_path: Path) -> None:
    keys = INPUT | {"resize": resize}
    found = detect(red_finder(tmp_path / "m.onnx", layout, brightest=1.0, **keys))
    assert found.labels == ("coffee machine",)
    assert found.scores[0] == pytest.approx(SCORE, abs=1e-4)
    # stretching 48 rows to 32 moves a row's edge by up to the height of one input row
    assert found.boxes_xyxy[0] == pytest.approx(RED_BOX, abs=1.51 if resize == "stretch" else 1e-3)


@pytest.mark.parametrize("channels", ["rgb", "bgr"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_channels_come_in_the_order_of_the_sidecar(layout: str, channels: str, tmp_path: Path) -> None:
    found = detect(red_finder(tmp_path / "m.onnx", layout, brightest=1.0, **INPUT, channels=channels))
    assert found.boxes_xyxy[0] == pytest.approx(RED_BOX, abs=1.51)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_layouts_defaults_feed_what_its_authors_feed(layout: str, tmp_path: Path) -> None:
    red = 2 if DEFAULTS[layout]["channels"] == "bgr" else 0
    mean, std = DEFAULTS[layout]["mean"][red], DEFAULTS[layout]["std"][red]
    brightest = 255 / DEFAULTS[layout]["scale"]
    model = red_finder(tmp_path / "m.onnx", layout, brightest=(brightest - mean) / std, zero=-mean / std)
    found = detect(model)
    assert found.scores == pytest.approx([SCORE], abs=1e-4)
    expected = {"yolox": (255.0, 0.0, 1.0), "nanodet": (255.0, 123.675, 58.395), "detr": (1.0, 0.485, 0.229)}.get(
        layout, (1.0, 0.0, 1.0)
    )
    assert (brightest, mean, std) == expected


def test_mean_and_std_belong_to_their_channels(tmp_path: Path) -> None:
    keys: dict[str, Any] = {"scale": 255, "mean": [0.5, 9, 9], "std": [0.25, 9, 9]}
    found = detect(red_finder(tmp_path / "m.onnx", "yolov8", brightest=2.0, zero=-2.0, **keys))
    assert found.scores == pytest.approx([SCORE], abs=1e-4)


def test_letterbox_pads_with_grey(tmp_path: Path) -> None:
    net = Net()
    corner = net("Slice", "image", np.array([0, 0]), np.array([1, 1]), np.array([2, 3]))
    score = net("ReduceMean", corner, keepdims=0)
    parts = [np.array([v]) for v in (16.0, 16.0, 8.0, 8.0)] + [net("Reshape", score, np.array([1]))]
    model = net.save(tmp_path / "m.onnx", {net("Reshape", net("Concat", *parts, axis=0), np.array([1, 5, 1])): "out"})
    describe(model, layout="yolov8", labels=["x"], threshold=0)
    assert detect(model).scores == pytest.approx([114 / 255])
    describe(model, layout="yolov8", labels=["x"], threshold=0, resize="stretch")
    assert detect(model).scores == pytest.approx([0])


def test_detr_with_sigmoid(tmp_path: Path) -> None:
    found = detect(red_finder(tmp_path / "m.onnx", "detr", brightest=1.0, **INPUT, activation="sigmoid"))
    assert (found.labels, found.scores) == (("coffee machine",), pytest.approx([SCORE], abs=1e-4))


def test_a_detr_query_without_an_object_is_no_detection(tmp_path: Path) -> None:
    model = tmp_path / "m.onnx"
    logits = np.array([[[0.0, 1.0, 9.0], [0.0, 5.0, 0.0]]])
    constant_net(model, {"logits": logits, "boxes": np.full((1, 2, 4), 0.5)})
    describe(model, layout="detr", labels=LABELS, threshold=0)
    found = detect(model)
    assert found.labels == ("coffee machine", "coffee machine")
    assert found.scores == pytest.approx([0.98670, 0.00034], abs=1e-5)


def test_exported_with_normalised_boxes(tmp_path: Path) -> None:
    keys = {"box_units": "normalised", "resize": "letterbox"}
    found = detect(red_finder(tmp_path / "m.onnx", "exported", brightest=1.0, **keys))
    assert found.boxes_xyxy[0] == pytest.approx(RED_BOX, abs=1e-3)


@pytest.mark.parametrize("kind", [TensorProto.INT64, TensorProto.INT32, TensorProto.FLOAT])
def test_exported_with_target_sizes_is_told_width_then_height(kind: int, tmp_path: Path) -> None:
    net = Net((1, 3, SIDE, 2 * SIDE))
    net.inputs.append(helper.make_tensor_value_info("orig_target_sizes", kind, (1, 2)))
    sizes = net("Cast", "orig_target_sizes", to=TensorProto.FLOAT)
    corners = net("Mul", net("Concat", sizes, sizes, axis=1), np.array([0.25, 0.25, 0.5, 0.5]))
    outputs = {net.constant(np.array([[1]])): "labels", net("Reshape", corners, np.array([1, 1, 4])): "boxes"}
    outputs[net.constant(np.array([[0.9]]))] = "scores"
    model = net.save(tmp_path / "m.onnx", outputs, {"labels": TensorProto.INT64})
    describe(model, layout="exported", labels=LABELS)
    assert detect(model).boxes_xyxy.tolist() == [[16, 12, 32, 24]]


def test_fastestdet_cells_count_from_their_own_corner(tmp_path: Path) -> None:
    grid = np.full((1, 7, 2, 4), 0.0)
    grid[0, :, 1, 2] = [0.9, np.arctanh(0.5), np.arctanh(-0.5), np.log(0.25 / 0.75), 0.0, 1.0, 0.0]
    model = constant_net(tmp_path / "m.onnx", {"out": grid}, (1, 3, 32, 64))
    describe(model, layout="fastestdet", labels=LABELS)
    found = detect(model)  # centre ((2 + 0.5) / 4, (1 - 0.5) / 2), size (1/4, 1/2) of 64x48
    assert found.labels == ("mug",)
    assert found.boxes_xyxy[0] == pytest.approx((32, 0, 48, 24), abs=1e-4)


@pytest.mark.parametrize(
    ("row", "stride", "column", "line"), [(0, 8, 0, 0), (9, 8, 1, 1), (33, 16, 1, 0), (41, 32, 1, 0)]
)
def test_yolox_decodes_each_stride(row: int, stride: int, column: int, line: int, tmp_path: Path) -> None:
    table = np.zeros((1, 42, 6))  # 64x32: 8x4 + 4x2 + 2x1 cells
    table[0, row] = [0.5, 0.25, np.log(0.5), 0.0, 0.9, 1.0]
    model = constant_net(tmp_path / "m.onnx", {"out": table}, (1, 3, 32, 64))
    describe(model, layout="yolox", labels=["x"], resize="stretch")
    cx, cy, w, h = (column + 0.5) * stride, (line + 0.25) * stride * 1.5, 0.5 * stride, stride * 1.5
    expected = np.clip([cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2], 0, [64, 48, 64, 48])
    assert detect(model).boxes_xyxy[0] == pytest.approx(expected, abs=1e-3)


def test_a_wild_yolox_side_is_clipped(tmp_path: Path) -> None:
    table = np.zeros((1, 21, 6))
    table[0, -1] = [0.5, 0.5, 500.0, 88.0, 0.9, 1.0]
    model = constant_net(tmp_path / "m.onnx", {"out": table})
    describe(model, layout="yolox", labels=["x"])
    assert detect(model).boxes_xyxy.tolist() == [[0, 0, 64, 48]]


def boxes_net(path: Path, boxes: list[list[float]], scores: list[list[float]]) -> Path:
    """YOLOv8 with fixed (cx, cy, w, h) and class scores, over frames of 64x48 stretched to 64x48."""
    table = np.concatenate([np.array(boxes).T, np.array(scores).T])[None]
    model = constant_net(path, {"out": table}, (1, 3, 48, 64))
    describe(model, layout="yolov8", labels=["cup", "book"])
    return model


def test_duplicates_go_within_a_class_only(tmp_path: Path) -> None:
    boxes: list[list[float]] = [[20, 20, 10, 10], [21, 20, 10, 10], [20, 21, 10, 10], [40, 20, 10, 10]]
    model = boxes_net(tmp_path / "m.onnx", boxes, [[0.7, 0], [0.9, 0], [0, 0.8], [0.6, 0]])
    found = detect(model)
    assert list(zip(found.labels, found.scores.round(2).tolist(), strict=True)) == [
        ("cup", pytest.approx(0.9)), ("book", pytest.approx(0.8)), ("cup", pytest.approx(0.6)),
    ]  # fmt: skip
    assert len(detect(model, iou=0.95)) == 4
    assert len(detect(model, threshold=0.9)) == 3 and len(detect(model, threshold=0.75, iou=0.95)) == 4


def test_boxes_are_clipped_and_slivers_dropped(tmp_path: Path) -> None:
    boxes: list[list[float]] = [[0, 0, 20, 20], [63.8, 20, 1, 10], [100, 20, 10, 10], [30, 30, -5, 5], [50, 40, 0.5, 5]]
    found = detect(boxes_net(tmp_path / "m.onnx", boxes, [[0.9, 0]] * 5))
    assert found.boxes_xyxy.tolist() == [[0, 0, 10, 10]]


def test_a_null_label_is_dropped(tmp_path: Path) -> None:
    model = boxes_net(tmp_path / "m.onnx", [[20, 20, 10, 10], [40, 20, 10, 10]], [[0.9, 0], [0, 0.9]])
    describe(model, layout="yolov8", labels=[None, "book"])
    assert detect(model).labels == ("book",)


def test_a_sidecar_sets_the_threshold_or_the_whole_calibration(tmp_path: Path) -> None:
    model = boxes_net(tmp_path / "m.onnx", [[20, 20, 10, 10], [40, 20, 10, 10]], [[0.9, 0], [0, 0.2]])
    assert len(detect(model)) == 1 and plugins.make("detectors", "onnx", model=model).score_model.threshold == 0.5
    describe(model, layout="yolov8", labels=["cup", "book"], threshold=0.3)
    assert len(detect(model)) == 2 and plugins.make("detectors", "onnx", model=model).score_model.threshold == 0.3
    describe(
        model,
        layout="yolov8",
        labels=["cup", "book"],
        score_model={"zero_weight_score": 0.7, "full_weight_score": 0.9, "prior_log_odds": -1, "measured": "here"},
    )
    known = plugins.make("detectors", "onnx", model=model).score_model
    assert len(detect(model)) == 1 and (known.zero_weight_score, known.prior_log_odds, known.measured) == (
        0.7,
        -1,
        "here",
    )


def test_outputs_by_name(tmp_path: Path) -> None:
    model = tmp_path / "m.onnx"
    constant_net(model, {"a": np.array([[[8.0, 8, 16, 16]]]), "b": np.array([[0.9]]), "c": np.array([[0]])})
    describe(model, layout="exported", labels=["x"], outputs=["c", "a", "b"])
    assert detect(model).boxes_xyxy[0] == pytest.approx((16, 12, 32, 24))


def test_an_open_input_takes_the_sidecars_size(tmp_path: Path) -> None:
    table = np.array([[[10.0], [10], [20], [20], [0.9]]])
    model = constant_net(tmp_path / "m.onnx", {"out": table}, ("batch", 3, "h", "w"))
    describe(model, layout="yolov8", labels=["x"], input_size=[64, 96], resize="stretch")
    assert detect(model).boxes_xyxy.tolist() == [[0, 0, 20, 10]]


@pytest.mark.parametrize(
    ("layout", "shape", "size"), [("fastestdet", (1, 85, 2, 3), (32, 48)), ("yolov8", (1, 84, 8400), (640, 640))]
)
def test_without_a_sidecar_proven_shapes_are_taken_and_said(
    layout: str, shape: tuple[int, ...], size: tuple[int, int], tmp_path: Path
) -> None:
    model = constant_net(tmp_path / "m.onnx", {"out": np.zeros(shape)}, (1, 3, *size))
    detector = plugins.make("detectors", "onnx", model=model)
    assert len(detector.detect(frame())) == 0
    assert "no sidecar" in detector.notes[0]
    assert layout in detector.notes[0]
    describe(model, layout=layout, labels="coco")
    assert plugins.make("detectors", "onnx", model=model).notes == ()


def test_the_name_says_file_threshold_and_an_unusual_iou(tmp_path: Path) -> None:
    model = red_finder(tmp_path / "eyes.onnx", "yolov8")
    assert plugins.make("detectors", "onnx", model=model).name == "onnx eyes.onnx (counts from 0.5)"
    named = plugins.make("detectors", "onnx", model=str(model), threshold=0.25, iou=0.7, threads=1, provider="CPU")
    assert named.name == "onnx eyes.onnx (counts from 0.25, iou 0.7)"


def test_coco_names() -> None:
    assert len(coco80()) == len(set(coco80())) == 80
    assert (coco80()[0], coco80()[56], coco80()[79]) == ("person", "chair", "toothbrush")
    assert (coco91()[1], coco91()[62], coco91()[90], coco91()[12]) == ("person", "chair", "toothbrush", None)
    assert [name for name in coco91() if name] == list(coco80())
