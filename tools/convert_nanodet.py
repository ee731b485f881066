"""Converter from NanoDet-Plus's public ncnn files to the ONNX file that ships: float16 weights, decoded boxes.

python tools/convert_nanodet.py nanodet-plus-m_416.param nanodet-plus-m_416.bin OUT.onnx [--size 416]     (needs onnx)
The .bin's sha256 begins with f7555ca6. The output is 1 x (4 + names) x cells: cx, cy, w, h in input pixels, then
scores; that is layout yolov8 of the `onnx` detector. Only the layers that NanoDet-Plus has are known; anything else
stops with an error.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

FLOAT16_TAG = 0x01306B47  # before weights that ncnn stores as float16
REST = -233  # ncnn for "all that is left"
STRIDES, DISTANCES = (8, 16, 32, 64), 8
HALVED = 64  # arrays of more numbers than this are stored as float16


class Weights:
    """ncnn's .bin, read from its beginning to its end."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def floats(self, count: int, kind: str = "<f4") -> Any:
        values = np.frombuffer(self._data, kind, count, self._at)
        self._at += -(-values.nbytes // 4) * 4
        return values.astype(np.float32)

    def tagged(self, count: int) -> Any:
        tag = int(np.frombuffer(self._data, "<u4", 1, self._at)[0])
        self._at += 4
        if tag not in (0, FLOAT16_TAG):
            raise SystemExit(f"weights with the tag {tag:#x} are neither float32 nor float16")
        return self.floats(count, "<f2" if tag else "<f4")

    def done(self) -> bool:
        return self._at == len(self._data)


class Graph:
    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any) -> str:
        name = f"cartier_c{len(self.constants)}"
        array = np.ascontiguousarray(value)
        half = array.dtype == np.float32 and array.size > HALVED
        self.constants.append(numpy_helper.from_array(array.astype(np.float16) if half else array, name))
        return self.op("Cast", name, to=TensorProto.FLOAT) if half else name

    def op(self, kind: str, *inputs: Any, out: str | None = None, **attributes: Any) -> str:
        names = [i if isinstance(i, str) else self.constant(i) for i in inputs]
        out = out or f"cartier_t{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, names, [out], **attributes))
        return out

    def layer(self, kind: str, ins: list[str], outs: list[str], p: dict[int, Any]) -> None:
        """One ncnn layer with its parameters ``p`` by number."""
        if kind == "Split":
            for out in outs:
                self.op("Identity", ins[0], out=out)
        elif kind in ("Convolution", "ConvolutionDepthWise"):
            self._convolution(ins[0], outs[0], p)
        elif kind == "Pooling" and p.get(0, 0) == 0 and not p.get(4):
            pads, rounding = [p.get(3, 0)] * 4, int(p.get(5, 0) == 0)
            self.op(
                "MaxPool",
                ins[0],
                out=outs[0],
                kernel_shape=[p[1]] * 2,
                strides=[p.get(2, 1)] * 2,
                pads=pads,
                ceil_mode=rounding,
            )
        elif kind == "Concat":
            self.op("Concat", *ins, out=outs[0], axis=p.get(0, 0) + 1)
        elif kind == "ShuffleChannel":
            sides = self.op("Slice", self.op("Shape", ins[0]), np.array([2]), np.array([4]))
            grouped = self.op("Reshape", ins[0], self.op("Concat", np.array([1, p[0], -1]), sides, axis=0))
            turned = self.op("Transpose", grouped, perm=[0, 2, 1, 3, 4])
            self.op("Reshape", turned, self.op("Concat", np.array([1, -1]), sides, axis=0), out=outs[0])
        elif kind == "Slice":
            self._slice(ins[0], outs, p)
        elif kind == "Crop":
            ends = [2**31 if end == REST else end for end in p[10]]
            axes = [axis + 1 for axis in p.get(11, range(len(ends)))]
            self.op("Slice", ins[0], np.array(p[9]), np.array(ends), np.array(axes), out=outs[0])
        elif kind == "Interp" and p[0] == 2 and not p.get(3):
            scales = np.array([1, 1, p[1], p[2]], np.float32)
            self.op(
                "Resize", ins[0], "", scales, out=outs[0], mode="linear", coordinate_transformation_mode="half_pixel"
            )
        elif kind == "BinaryOp" and p.get(0, 0) == 0 and not p.get(1):
            self.op("Add", *ins, out=outs[0])
        elif kind == "Sigmoid":
            self.op("Sigmoid", ins[0], out=outs[0])
        elif kind == "ReLU":
            self.op("LeakyRelu", ins[0], out=outs[0], alpha=float(p.get(0, 0)))
        elif kind == "Reshape":
            self.op("Reshape", ins[0], np.array([1] + [p[k] for k in (2, 1, 0) if k in p]), out=outs[0])
        elif kind == "Permute" and p[0] == 1:
            self.op("Transpose", ins[0], out=outs[0], perm=[0, 2, 1])
        else:
            raise SystemExit(f"no way is known to write ncnn's layer {kind} {p} in ONNX")

    def _convolution(self, source: str, out: str, p: dict[int, Any]) -> None:
        across, stride, dilation, left = p[1], p.get(3, 1), p.get(2, 1), p.get(4, 0)
        down, top = p.get(11, across), p.get(14, left)
        inputs = [source, self.weights.tagged(p[6]).reshape(p[0], -1, down, across)]
        if p.get(5):
            inputs.append(self.weights.floats(p[0]))
        made = self.op(
            "Conv", *inputs, out=out if not p.get(9) else None, kernel_shape=[down, across],
            strides=[p.get(13, stride), stride], pads=[top, left, p.get(16, top), p.get(15, left)],
            dilations=[p.get(12, dilation), dilation], group=p.get(7, 1),
        )  # fmt: skip
        if p.get(9) in (1, 2):
            self.op("LeakyRelu", made, out=out, alpha=float(p[10][0]) if p[9] == 2 else 0.0)
        elif p.get(9) == 4:
            self.op("Sigmoid", made, out=out)
        elif p.get(9):
            raise SystemExit(f"no way is known to write ncnn's activation {p[9]} in ONNX")

    def _slice(self, source: str, outs: list[str], p: dict[int, Any]) -> None:
        begin, axis = 0, np.array([p.get(1, 0) + 1])
        for out, size in zip(outs, p[0], strict=True):
            if size == REST and out != outs[-1]:
                raise SystemExit("a slice leaves a size open that is not its last")
            end = 2**31 if size == REST else begin + size
            self.op("Slice", source, np.array([begin]), np.array([end]), axis, out=out)
            begin = end

    def decode(self, table: str, names: int, size: int) -> str:
        """The head of NanoDet-Plus: scores, and per side a distribution over 0 to 7 strides from its cell's corner."""
        grids = [np.mgrid[: math.ceil(size / s), : math.ceil(size / s)].reshape(2, -1) * s for s in STRIDES]
        corners = np.concatenate(grids, axis=1)[::-1].T
        stride = np.repeat(STRIDES, [grid.shape[1] for grid in grids]).astype(np.float32)
        count, axis = len(stride), np.array([2])
        scores = self.op("Slice", table, np.array([0]), np.array([names]), axis)
        sides = self.op("Slice", table, np.array([names]), np.array([names + 4 * DISTANCES]), axis)
        shares = self.op("Softmax", self.op("Reshape", sides, np.array([1, count, 4, DISTANCES])), axis=3)
        mean = self.op("MatMul", shares, np.arange(DISTANCES, dtype=np.float32)[:, None])
        ltrb = self.op("Mul", self.op("Reshape", mean, np.array([1, count, 4])), stride.reshape(1, -1, 1))
        to_box = np.array([[-0.5, 0, 1, 0], [0, -0.5, 0, 1], [0.5, 0, 1, 0], [0, 0.5, 0, 1]], np.float32)
        cells = np.hstack([corners, np.zeros_like(corners)])[None].astype(np.float32)
        boxes = self.op("Add", self.op("MatMul", ltrb, to_box), cells)
        return self.op("Transpose", self.op("Concat", boxes, scores, axis=2), out="output0", perm=[0, 2, 1])


def convert(param: str, weights: bytes, names: int, size: int) -> Any:
    """The ONNX model of a network's description and its weights; ``size`` is the side of its input in pixels."""
    graph = Graph(Weights(weights))
    made: dict[str, None] = {}
    taken, source = set[str](), ""
    for fields in filter(None, (line.split() for line in param.splitlines()[2:])):
        kind, ins, outs = fields[0], int(fields[2]), int(fields[3])
        inputs, outputs, told = fields[4 : 4 + ins], fields[4 + ins : 4 + ins + outs], fields[4 + ins + outs :]
        if kind == "Input":
            source = outputs[0]
            continue
        graph.layer(kind, inputs, outputs, dict(_parameter(*pair.split("=")) for pair in told))
        made |= dict.fromkeys(outputs)
        taken |= set(inputs)
    if not graph.weights.done():
        raise SystemExit("the weights hold more than the layers take: these two files do not belong together")
    (table,) = made.keys() - taken
    cells = sum(math.ceil(size / stride) ** 2 for stride in STRIDES)
    graph.decode(table, names, size)
    image = helper.make_tensor_value_info(source, TensorProto.FLOAT, [1, 3, size, size])
    out = helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 4 + names, cells])
    model = helper.make_model(
        helper.make_graph(graph.nodes, "nanodet", [image], [out], graph.constants),
        opset_imports=[helper.make_opsetid("", 13)],
        ir_version=8,
    )
    onnx.checker.check_model(model)
    return model


def _parameter(key: str, value: str) -> tuple[int, Any]:
    """One ``key=value`` of ncnn; a key below -23300 holds a list, which begins with its length."""
    number = int(key)
    if number <= -23300:
        return -number - 23300, [_number(v) for v in value.split(",")[1:]]
    return number, _number(value)


def _number(text: str) -> int | float:
    return int(text) if text.lstrip("-").isdigit() else float(text)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("param", type=Path, help="ncnn's file of layers")
    parser.add_argument("bin", type=Path, help="ncnn's file of weights")
    parser.add_argument("out", type=Path, help="the ONNX file to write")
    parser.add_argument("--size", type=int, default=416, help="of the input, in pixels (default: %(default)s)")
    parser.add_argument("--names", type=int, default=80, help="how many classes it has (default: %(default)s)")
    options = parser.parse_args()
    onnx.save(
        convert(options.param.read_text(encoding="utf-8"), options.bin.read_bytes(), options.names, options.size),
        options.out,
    )


if __name__ == "__main__":
    run_script(main)
