"""Networks of a few nodes that really look: each finds the bright rectangle of one channel, in any output layout."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from cartier.types import Camera, Frame

SIDE = 32
"""The networks' input is 32x32: one cell at stride 32, and two by two at FastestDet's 16."""
RED_BOX = (8, 8, 24, 16)
BLUE_BOX = (4, 28, 16, 40)
SCORE = 0.8
LABELS = ["mug", "CoffeeMachine"]
CHANNELS = {"fastestdet": "bgr", "yolov8": "rgb", "yolox": "bgr", "nanodet": "bgr", "detr": "rgb", "exported": "rgb"}
CHANNELS |= {"end_to_end": "rgb"}


def frame(index: int = 3, width: int = 64, height: int = 48) -> Frame:
    """A black image with a red rectangle, and a blue one that only a detector with swapped channels sees."""
    rgb = np.zeros((height, width, 3), np.uint8)
    for channel, (x1, y1, x2, y2) in ((0, RED_BOX), (2, BLUE_BOX)):
        rgb[y1:y2, x1:x2, channel] = round(SCORE * 255)
    return Frame(index, 0.0, rgb, None, np.eye(4), Camera(width, height, 60.0, 60.0, width / 2, height / 2))


class Net:
    """Adds nodes by name; every method returns the name of the tensor that it makes."""

    def __init__(self, size: Sequence[Any] = (1, 3, SIDE, SIDE)) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self.inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, size)]

    def __call__(self, op: str, *inputs: Any, **attributes: Any) -> str:
        names = [i if isinstance(i, str) else self.constant(i) for i in inputs]
        out = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, names, [out], **attributes))
        return out

    def constant(self, value: Any) -> str:
        array = np.asarray(value)
        array = array.astype(np.float32) if array.dtype == np.float64 else array
        self.constants.append(numpy_helper.from_array(array, f"c{len(self.constants)}"))
        return self.constants[-1].name

    def save(
        self,
        path: Path,
        outputs: dict[str, str],
        types: Mapping[str, int] | None = None,
        props: Mapping[str, str] | None = None,
    ) -> Path:
        """``outputs``: the name that each tensor gets outside; ``props``: what the file says about itself."""
        for tensor, name in outputs.items():
            self.nodes.append(helper.make_node("Identity", [tensor], [name]))
        infos = [
            helper.make_tensor_value_info(n, (types or {}).get(n, TensorProto.FLOAT), None) for n in outputs.values()
        ]
        graph = helper.make_graph(self.nodes, "tiny", self.inputs, infos, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        helper.set_model_props(model, dict(props or {}))
        path.write_bytes(model.SerializeToString())
        return path


def constant_net(
    path: Path,
    outputs: dict[str, Any],
    size: Sequence[Any] = (1, 3, SIDE, SIDE),
    props: Mapping[str, str] | None = None,
) -> Path:
    """Gives the same arrays for every image."""
    net = Net(size)
    arrays = {name: np.asarray(value) for name, value in outputs.items()}
    types = {n: TensorProto.INT64 if a.dtype == np.int64 else TensorProto.FLOAT for n, a in arrays.items()}
    return net.save(path, {net.constant(a): n for n, a in arrays.items()}, types, props)


def describe(model: Path, **keys: Any) -> Path:
    """Write the sidecar of a model."""
    sidecar = model.with_suffix(".json")
    sidecar.write_text(json.dumps(keys), encoding="utf-8")
    return sidecar


def red_finder(path: Path, layout: str, brightest: float = 255.0, zero: float = 0.0, **keys: Any) -> Path:
    """A network of a layout, and its sidecar with ``keys`` added, that boxes the red rectangle as class 1.

    It scores the brightest value of its red channel, where ``zero`` stands for black and ``brightest`` for 255.
    """
    net = Net()
    channel = {"rgb": 0, "bgr": 2}[keys.get("channels", CHANNELS[layout])]
    image = net("Gather", "image", np.array([channel]), axis=1)
    red = net("Div", net("Sub", image, zero), brightest - zero)  # 0 to 1
    mask = net("Cast", net("Greater", red, 0.6), to=TensorProto.FLOAT)
    x1, x2 = _extent(net, net("ReduceMax", mask, axes=[0, 1, 2], keepdims=0))
    y1, y2 = _extent(net, net("ReduceMax", mask, axes=[0, 1, 3], keepdims=0))
    score = net("Reshape", net("ReduceMax", red, keepdims=0), np.array([1]))
    outputs, types = ENCODERS[layout](net, (x1, y1, x2, y2), score, keys)
    describe(net.save(path, outputs, types), **({"layout": layout, "labels": LABELS} | keys))
    return path


def _extent(net: Net, line: str) -> tuple[str, str]:
    """First and last + 1 of the pixels that are set, each of shape (1,)."""
    at = np.arange(SIDE, dtype=np.float64)
    first = net("Sub", float(SIDE), net("ReduceMax", net("Mul", line, SIDE - at), keepdims=1))
    return first, net("ReduceMax", net("Mul", line, at + 1), keepdims=1)


def _centre(net: Net, box: Sequence[str], unit: float) -> list[str]:
    x1, y1, x2, y2 = box
    halves = [net("Mul", net("Add", a, b), 0.5 / unit) for a, b in ((x1, x2), (y1, y2))]
    sides = [net("Mul", net("Sub", b, a), 1 / unit) for a, b in ((x1, x2), (y1, y2))]
    return halves + [net("Max", side, 1e-3) for side in sides]  # where nothing was found, no logarithm of 0


def _logit(net: Net, p: str) -> str:
    return net("Log", net("Div", p, net("Sub", 1.0, p)))


def _shaped(net: Net, parts: Sequence[Any], shape: Sequence[int]) -> str:
    whole = net("Concat", *(p if isinstance(p, str) else np.array([p]) for p in parts), axis=0)
    return net("Reshape", whole, np.array(shape))


Encoded = tuple[dict[str, str], dict[str, int]]


def _fastestdet(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    cx, cy, w, h = _centre(net, box, SIDE)
    dx, dy = (net("Atanh", net("Min", net("Mul", c, 2.0), 0.999)) for c in (cx, cy))  # from cell 0 of 2
    cell = _shaped(net, [score, dx, dy, _logit(net, w), _logit(net, h), 0.0, 1.0], (1, 7, 1, 1))
    return {net("Pad", cell, np.array([0, 0, 0, 0, 0, 0, 1, 1])): "out"}, {}


def _yolov8(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    return {_shaped(net, [*_centre(net, box, 1), 0.0, score], (1, 6, 1)): "out"}, {}


def _yolox(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    cx, cy, w, h = _centre(net, box, 32)
    row = _shaped(net, [cx, cy, net("Log", w), net("Log", h), score, 0.0, 1.0], (1, 1, 7))
    return {net("Concat", np.zeros((1, 20, 7)), row, axis=1): "out"}, {}


def _nanodet(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    """Of the 16 cells at stride 8 the one whose corner is at (8, 8); a side lies between 0 and 7 strides from there."""
    x1, y1, x2, y2 = (net("Div", side, 8.0) for side in box)
    away = [net("Sub", 1.0, x1), net("Sub", 1.0, y1), net("Sub", x2, 1.0), net("Sub", y2, 1.0)]
    shares = [net("Min", net("Max", net("Div", side, 7.0), 1e-6), 1 - 1e-6) for side in away]
    parts = [part for share in shares for part in (0.0, *[-1e4] * 6, _logit(net, share))]
    row = _shaped(net, [0.0, score, *parts], (1, 1, 34))
    return {net("Concat", np.zeros((1, 5, 34)), row, np.zeros((1, 16, 34)), axis=1): "out"}, {}


def _detr(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    if keys.get("activation") == "sigmoid":
        logits = _shaped(net, [-30.0, _logit(net, score)], (1, 1, 2))
    else:
        logits = _shaped(net, [-30.0, net("Log", score), net("Log", net("Sub", 1.0, score))], (1, 1, 3))
    return {logits: "logits", _shaped(net, _centre(net, box, SIDE), (1, 1, 4)): "pred_boxes"}, {}


def _end_to_end(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    row = _shaped(net, [*box, score, 1.0], (1, 1, 6))
    return {net("Concat", row, np.zeros((1, 299, 6)), axis=1): "output0"}, {}


def _exported(net: Net, box: Sequence[str], score: str, keys: dict[str, Any]) -> Encoded:
    unit = SIDE if keys.get("box_units") == "normalised" else 1
    boxes = _shaped(net, [net("Mul", side, 1 / unit) for side in box], (1, 1, 4))
    outputs = {
        net.constant(np.array([[1]])): "labels",
        boxes: "boxes",
        net("Reshape", score, np.array([1, 1])): "scores",
    }
    return outputs, {"labels": TensorProto.INT64}


ENCODERS: dict[str, Callable[[Net, Sequence[str], str, dict[str, Any]], Encoded]] = {
    "fastestdet": _fastestdet, "yolov8": _yolov8, "yolox": _yolox, "nanodet": _nanodet, "detr": _detr,
    "exported": _exported, "end_to_end": _end_to_end,
}  # fmt: skip
