"""What can be wrong with a model, its sidecar, or what the model says: one clear line each."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from tiny_onnx import LABELS, SIDE, Net, constant_net, describe, frame, red_finder

from cartier import plugins
from cartier.detectors import sidecar
from cartier.errors import BackendError, CartierError, InputError
from cartier.models import onnx_session


def make(model: Path, **options: Any) -> Any:
    return plugins.make("detectors", "onnx", model=model, **options)


def refused(error: type[CartierError], match: str, model: Path, **options: Any) -> None:
    with pytest.raises(error, match=match) as caught:
        make(model, **options)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700


@pytest.fixture
def yolo(tmp_path: Path) -> Path:
    return red_finder(tmp_path / "m.onnx", "yolov8")


BAD_SIDECARS = {
    "": "Invalid JSON",
    '{"layout": "yolov8",': "Invalid JSON.* line 1 column 20",
    "[" * 10_000: "Invalid JSON",
    "[1]": "should be an object",
    '{"labels": ["a"]}': "'layout' is missing",
    '{"layout": "yolov9000", "labels": ["a"]}': "layout: .*'fastestdet', 'yolov8'",
    '{"layout": ["yolov8"], "labels": ["a"]}': "layout: ",
    '{"layout": "yolov8"}': "'labels' is missing",
    '{"layout": "yolov8", "labels": "voc"}': 'labels: must be a list of names, or "coco"',
    '{"layout": "yolov8", "labels": []}': "labels: ",
    '{"layout": "yolov8", "labels": ["a", 3]}': r"labels\.1: .*string",
    '{"layout": "yolov8", "labels": ["a", " "]}': "label 1 is empty",
    '{"layout": "yolov8", "labels": ["a"], "lables": []}': "no key 'lables'; the keys are layout, labels",
    '{"layout": "yolov8", "labels": ["a"], "channels": "hsv"}': "channels: .*'rgb' or 'bgr'",
    '{"layout": "yolov8", "labels": ["a"], "scale": "255"}': "scale: .*number",
    '{"layout": "yolov8", "labels": ["a"], "scale": 0}': "scale: .*greater than 0",
    '{"layout": "yolov8", "labels": ["a"], "scale": NaN}': "scale: .*finite",
    '{"layout": "yolov8", "labels": ["a"], "mean": [1, 2]}': "mean",
    '{"layout": "yolov8", "labels": ["a"], "std": [1, 0, 1]}': "std: must be positive",
    '{"layout": "yolov8", "labels": ["a"], "threshold": 50}': "threshold: .*less than or equal to 1",
    '{"layout": "yolov8", "labels": ["a"], "score_model": {"zero_weight_score": 2}}': "score_model: scores lie between",
    '{"layout": "yolov8", "labels": ["a"], "score_model": {"colour": 2}}': "score_model: must hold the fields",
    '{"layout": "yolov8", "labels": ["a"], "input_size": [0, 32]}': r"input_size\.0",
    '{"layout": "yolov8", "labels": ["a"], "input_size": [32.5, 32]}': r"input_size\.0: .*integer",
    '{"layout": "yolov8", "labels": ["a"], "activation": "sigmoid"}': "'activation' belongs to the layout 'detr'",
    '{"layout": "detr", "labels": ["a"], "box_units": "pixels"}': "'box_units' belongs to the layout 'exported'",
}


@pytest.mark.parametrize("text", BAD_SIDECARS, ids=range(len(BAD_SIDECARS)))
def test_a_bad_sidecar(text: str, yolo: Path) -> None:
    yolo.with_suffix(".json").write_text(text)
    refused(InputError, f"m.json: .*{BAD_SIDECARS[text]}", yolo)


def test_a_sidecar_that_is_missing_or_huge(yolo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused(InputError, "nowhere.json is missing", yolo, sidecar=yolo.with_name("nowhere.json"))
    monkeypatch.setattr(sidecar, "MAX_BYTES", 10)
    refused(InputError, "m.json is larger than 10 bytes", yolo)


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        (
            {"labels": ["a"]},
            "layout yolov8 with 1 labels and a 32x32 input needs the output out to be 1x5xN, but it is 1x6x1",
        ),
        ({"labels": "coco"}, "needs the output out to be 1x84xN"),
        ({"layout": "fastestdet"}, "to be 1x7x2x2, but it is 1x6x1"),
        ({"layout": "yolox"}, "to be 1x21x7, but it is 1x6x1"),
        ({"layout": "detr"}, '"outputs" must name, for layout detr, logits, boxes; the model has out'),
        ({"layout": "exported"}, '"outputs" must name, for layout exported, labels, boxes, scores; the model has out'),
        ({"outputs": ["boxes"]}, '"outputs" must name'),
        ({"outputs": ["out", "out"]}, '"outputs" must name'),
        ({"input_size": [64, 32]}, r"input_size is \(64, 32\), but the model takes \(32, 32\)"),
    ],
)
def test_a_sidecar_that_does_not_fit(keys: dict[str, Any], match: str, yolo: Path) -> None:
    describe(yolo, **({"layout": "yolov8", "labels": LABELS} | keys))
    refused(InputError, match, yolo)


def test_detr_with_softmax_has_one_more_class_than_labels(tmp_path: Path) -> None:
    model = red_finder(tmp_path / "m.onnx", "detr")
    describe(model, layout="detr", labels=LABELS, activation="sigmoid")
    refused(InputError, "logits to be 1xNx2, but it is 1x1x3", model)


def test_an_open_input_needs_a_size(tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {"out": np.zeros((1, 6, 3))}, (1, 3, "h", "w"))
    refused(InputError, "no sidecar, and leaves its input size open .*outputs out.*write m.json", model)
    describe(model, layout="yolov8", labels=LABELS)
    refused(InputError, r'add "input_size": \[width, height\] to .*m.json', model)


@pytest.mark.parametrize(
    ("outputs", "size"),
    [
        ({"out": (1, 8400, 85)}, (640, 640)),  # YOLOX or YOLOv6: the same shape, decoded differently
        ({"out": (1, 84, 8399)}, (640, 640)),
        ({"out": (1, 85, 2, 3)}, (48, 32)),
        ({"out": (1, 85, 2, 2), "more": (1, 85, 1, 1)}, (32, 32)),
        ({"labels": (1, 3), "boxes": (1, 3, 4), "scores": (1, 3)}, (32, 32)),
    ],
)
def test_without_a_sidecar_nothing_is_guessed(outputs: dict[str, Any], size: tuple[int, int], tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {n: np.zeros(s) for n, s in outputs.items()}, (1, 3, *size))
    shown = ", ".join(f"{name} {'x'.join(map(str, shape))}" for name, shape in outputs.items())
    refused(
        InputError, re.escape(f"outputs {shown}") + '.*write m.json beside it.*"layout".*"labels".*input_size', model
    )


def test_files_that_are_no_models(tmp_path: Path) -> None:
    whole = red_finder(tmp_path / "m.onnx", "yolov8").read_bytes()
    model = tmp_path / "broken.onnx"
    for content in (
        b"",
        b"PK\3\4 a zip",
        b"version https://git-lfs.github.com/spec/v1\n",
        whole[: len(whole) // 2],
        whole[:-1],
    ):
        model.write_bytes(content)
        refused(InputError, "broken.onnx cannot be loaded: it is no ONNX model, or it is truncated", model)
    refused(InputError, "nowhere.onnx does not exist", tmp_path / "nowhere.onnx")
    refused(InputError, "is a folder", tmp_path)


def test_a_model_too_large_to_be_one(yolo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_session, "MAX_BYTES", 100)
    refused(InputError, "is larger than", yolo)


def test_an_operator_that_onnxruntime_does_not_have(tmp_path: Path) -> None:
    net = Net()
    model = net.save(tmp_path / "m.onnx", {net("Clairvoyance", "image"): "out"})
    refused(InputError, "cannot be loaded: .*Clairvoyance", model)


@pytest.mark.parametrize("place", ["../weights.bin", "{absolute}", "link.bin"])
def test_weights_outside_of_the_models_folder_are_refused(place: str, tmp_path: Path) -> None:
    """onnxruntime does it from 1.24 on; this test fails with an older one."""
    (tmp_path / "weights.bin").write_bytes(np.zeros((1, 6, 1), np.float32).tobytes())
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "weights.bin")
    model = constant_net(folder / "m.onnx", {"out": np.zeros((1, 6, 1))})
    proto = onnx.load(model)
    weights = proto.graph.initializer[0]
    weights.ClearField("raw_data")
    weights.data_location = TensorProto.EXTERNAL
    entry = weights.external_data.add()
    entry.key, entry.value = "location", place.format(absolute=tmp_path / "weights.bin")
    model.write_bytes(proto.SerializeToString())
    describe(model, layout="yolov8", labels=LABELS)
    refused(InputError, "cannot be loaded: .*[Ee]xternal data", model)


def test_weights_beside_the_model_are_read(tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {"out": np.array([[[9.0], [9], [9], [9], [0.9], [0]]])})
    onnx.save(onnx.load(model), model, save_as_external_data=True, location="m.bin", size_threshold=0)
    describe(model, layout="yolov8", labels=LABELS)
    assert (tmp_path / "m.bin").is_file()
    assert len(make(model).detect(frame())) == 1


@pytest.mark.parametrize("size", [(1, 4, SIDE, SIDE), (2, 3, SIDE, SIDE), (1, SIDE, SIDE, 3), (1, 3, SIDE)])
def test_inputs_that_are_no_image(size: tuple[int, ...], tmp_path: Path) -> None:
    model = constant_net(tmp_path / "m.onnx", {"out": np.zeros((1, 6, 3))}, size)
    refused(
        InputError, f"one input of float images 1x3xHxW, but its inputs are image {'x'.join(map(str, size))}", model
    )


def test_a_second_input_that_nobody_knows(tmp_path: Path) -> None:
    net = Net()
    net.inputs.append(helper.make_tensor_value_info("im_shape", TensorProto.FLOAT, (1, 2)))
    model = net.save(tmp_path / "m.onnx", {net.constant(np.zeros((1, 6, 3))): "out"})
    refused(InputError, "one input of .*im_shape 1x2", model)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"threshold": 1.5}, "threshold must be from 0 to 1, got 1.5"),
        ({"threshold": float("nan")}, "threshold must be from 0 to 1"),
        ({"iou": -0.1}, "iou must be from 0 to 1"),
        ({"threads": 0}, "threads must be at least 1"),
        ({"provider": "abacus"}, "no provider 'abacus' here; there are .*CPUExecutionProvider"),
        ({"labels": "coco"}, "has no option 'labels'"),
    ],
)
def test_bad_options(options: dict[str, Any], match: str, yolo: Path) -> None:
    refused(BackendError, match, yolo, **options)


def bright_fault(path: Path, value: float) -> Path:
    """A YOLOv8 that says 0 for a black image (which the trial is) and ``value`` for a bright one."""
    net = Net()
    bright = net("ReduceMax", "image", keepdims=0)
    table = net("Where", net("Greater", bright, 0.5), np.full((1, 6, 1), value), np.zeros((1, 6, 1)))
    model = net.save(path, {table: "out"})
    describe(model, layout="yolov8", labels=LABELS)
    return model


@pytest.mark.parametrize(
    ("value", "match"),
    [
        (np.nan, "output out holds NaN or infinity for frame 7"),
        (np.inf, "output out holds NaN or infinity for frame 7"),
        (7.25, "a score of 7.25 for frame 7, where layout yolov8 has 0 to 1"),
    ],
)
def test_rubbish_from_the_model_names_the_frame(value: float, match: str, tmp_path: Path) -> None:
    detector = make(bright_fault(tmp_path / "m.onnx", value))
    with pytest.raises(BackendError, match=match):
        detector.detect(frame(7))


def test_a_class_without_a_label(tmp_path: Path) -> None:
    outputs = {
        "labels": np.array([[1, 2]]),
        "boxes": np.full((1, 2, 4), [1.0, 1, 9, 9]),
        "scores": np.array([[0.9, 0.6]]),
    }
    model = constant_net(tmp_path / "m.onnx", outputs)
    describe(model, layout="exported", labels=LABELS)
    with pytest.raises(BackendError, match="class 2 for frame 7, but its sidecar has labels for 0 to 1"):
        make(model).detect(frame(7))
    unsure = constant_net(tmp_path / "n.onnx", outputs | {"scores": np.array([[0.9, 0.1]])})
    describe(unsure, layout="exported", labels=LABELS)
    assert len(make(unsure).detect(frame(7))) == 1


def test_outputs_of_different_lengths(tmp_path: Path) -> None:
    outputs = {"labels": np.array([[1]]), "boxes": np.ones((1, 2, 4)), "scores": np.array([[0.9, 0.6]])}
    model = constant_net(tmp_path / "m.onnx", outputs)
    describe(model, layout="exported", labels=LABELS)
    with pytest.raises(BackendError, match="2 boxes, 2 scores and 1 classes for frame 7"):
        make(model).detect(frame(7))


def test_a_model_that_fails_while_it_runs(tmp_path: Path) -> None:
    net = Net()
    model = net.save(tmp_path / "m.onnx", {net("Reshape", "image", np.array([1, 6, 7])): "out"})
    describe(model, layout="yolov8", labels=LABELS)
    refused(CartierError, "m.onnx (failed on a black 32x32 image|cannot be loaded): ", model)


def test_an_output_that_changes_its_shape(tmp_path: Path) -> None:
    net = Net()
    bright = net(
        "NonZero", net("Reshape", net("ReduceMax", "image", keepdims=0), np.array([1]))
    )  # 1x0 if black, else 1x1
    more = net("Unsqueeze", net("Cast", bright, to=TensorProto.FLOAT), np.array([2]))
    model = net.save(tmp_path / "m.onnx", {net("Concat", np.zeros((1, 6, 1)), more, axis=1): "out"})
    describe(model, layout="yolov8", labels=LABELS)
    with pytest.raises(InputError, match=r"frame 7: .* needs the output out to be 1x6xN, but it is 1x7x1"):
        make(model).detect(frame(7))


def test_the_sidecar_is_strict_json(yolo: Path) -> None:
    sidecar = yolo.with_suffix(".json")
    sidecar.write_text(json.dumps({"layout": "yolov8", "labels": LABELS, "input_size": ["32", 32]}))
    refused(InputError, r"input_size\.0: .*integer", yolo)
