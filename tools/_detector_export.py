"""ONNX export of the detector, node by node: batch norms folded in, peaks and boxes picked inside the graph."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from _detector_closer import (
    AROUND,
    CELLS,
    KINDS_OF_CELL,
    LEAST,
    MOST_CHANGE,
    PLACES,
    SIDE,
    Closer,
    mended,
    places,
    two_passes,
)
from _detector_closer import patches as cut_out
from _detector_closer import sizes as sizes_of
from _detector_network import NECK, STRIDE, Conv, Network
from onnx import TensorProto, helper, numpy_helper
from torch.nn.functional import interpolate

SIZE = (640, 480)
FAR_SIZE = (384, 288)  # of the second pass, in which large things are as small as training showed them
MOST = 100  # boxes per image


class Graph:
    """Nodes and constants under construction; methods return the name of their output."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self._constants: dict[tuple[Any, ...], Any] = {}
        self._whole: dict[str, str] = {}

    @property
    def constants(self) -> list[Any]:
        return list(self._constants.values())

    def constant(self, values: Any, kind: Any = np.float32) -> str:
        """Equal ones are kept once: both passes share their weights."""
        array = np.asarray(values, kind)
        key = (array.dtype, array.shape, array.tobytes())
        if key not in self._constants:
            self._constants[key] = numpy_helper.from_array(array, f"c{len(self._constants)}")
        return str(self._constants[key].name)

    def weight(self, values: Any) -> str:
        """Half a float each in the file; onnxruntime makes them whole when it opens it."""
        name = self.constant(values, np.float16)
        if name not in self._whole:
            self._whole[name] = self.add("Cast", name, to=TensorProto.FLOAT)
        return self._whole[name]

    def add(self, kind: str, *inputs: str, outputs: int = 1, **settings: Any) -> Any:
        names = [f"{kind}{len(self.nodes)}_{k}" for k in range(outputs)]
        self.nodes.append(helper.make_node(kind, list(inputs), names, **settings))
        return names[0] if outputs == 1 else names

    def conv(self, x: str, weight: Any, bias: Any, stride: int = 1, apart: int = 1, groups: int = 1) -> str:
        pad = weight.shape[-1] // 2 * apart
        shape = {"strides": [stride] * 2, "pads": [pad] * 4, "dilations": [apart] * 2, "group": groups}
        return str(self.add("Conv", x, self.weight(weight), self.constant(bias), **shape))

    def layer(self, x: str, layer: Any) -> str:
        """A Conv of ours, its batch norm folded into it, or a bare convolution."""
        if not isinstance(layer, Conv):
            return self.conv(x, layer.weight.numpy(), layer.bias.numpy(), layer.stride[0], groups=layer.groups)
        conv, norm = layer[0], layer[1]
        scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        bias = norm.bias - norm.running_mean * scale
        weight = (conv.weight * scale[:, None, None, None]).numpy()
        y = self.conv(x, weight, bias.numpy(), conv.stride[0], conv.dilation[0])
        return str(self.add("Relu", y)) if len(layer) == 3 else y

    def block(self, x: str, block: Any) -> str:
        body = self.layer(self.layer(x, block.body[0]), block.body[1])
        skip = x if isinstance(block.skip, torch.nn.Identity) else self.layer(x, block.skip)
        return str(self.add("Relu", self.add("Add", body, skip)))

    def enlarged(self, x: str, before: tuple[int, int], after: tuple[int, int]) -> str:
        """Nearest neighbours, as torch takes them: cell i of ``after`` (rows, columns) is floor(i * before / after)."""
        if after == (2 * before[0], 2 * before[1]):
            settings = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
            return str(self.add("Resize", x, "", self.constant([1, 1, 2, 2]), **settings))
        for axis, (a, b) in enumerate(zip(before, after, strict=True), start=2):
            x = self.add("Gather", x, self.constant([i * a // b for i in range(b)], np.int64), axis=axis)
        return x

    def mirrored(self, x: str) -> str:
        """Left and right changed places."""
        width = [self.constant(value, np.int64) for value in ([-1], [-(2**31)], [3], [-1])]
        return str(self.add("Slice", x, *width))

    def resized(self, x: str, channels: int, size: tuple[int, int]) -> str:
        """Linear interpolation to ``size`` (w, h)."""
        shape = self.constant([1, channels, size[1], size[0]], np.int64)
        settings = {"mode": "linear", "coordinate_transformation_mode": "half_pixel"}
        return str(self.add("Resize", x, "", "", shape, **settings))

    def unit(self, x: str, depth: int) -> str:
        """Vectors (1, D, h, w) of length one. A convolution adds up over the channels faster than ReduceSum."""
        ones, nothing = np.ones((1, depth, 1, 1), np.float32), np.zeros(1, np.float32)
        length = self.add("Sqrt", self.conv(self.add("Mul", x, x), ones, nothing))
        return str(self.add("Div", x, self.add("Max", length, self.constant(1e-12))))


def export(network: Network, closer: Closer, path: Path) -> None:
    """Input ``image`` (1, 3, h, w) float32, 0 to 1, of ``SIZE`` (w, h); outputs ``boxes`` (100, 4) xyxy in its pixels,
    ``scores`` and ``classes`` (100), best first, and ``features`` (1, D, h/4, w/4), unit vectors for every cell.

    The maps are the mean over two passes: over the image, and over its mirror image made smaller, for large things.
    That takes 1.5 times as long as the first alone, and finds more than two passes at one size do. ``closer`` then
    names each place.
    """
    network, closer = network.eval(), closer.eval()
    graph = Graph()
    cells = (SIZE[0] // STRIDE, SIZE[1] // STRIDE)
    depth = len(network.basis)
    with torch.no_grad():
        up, *near = maps_of(graph, network, "image", SIZE)
        small = graph.mirrored(graph.resized("image", 3, FAR_SIZE))
        far = [
            graph.resized(graph.mirrored(values), channels, cells)  # in this order, as mirroring is slow
            for values, channels in zip(maps_of(graph, network, small, FAR_SIZE)[1:], (depth, 4, depth), strict=True)
        ]
        far[1] = graph.add("Gather", far[1], graph.constant([2, 1, 0, 3], np.int64), axis=1)  # left and right
        far[1] = graph.add("Add", far[1], graph.constant(math.log(SIZE[0] / FAR_SIZE[0])))
        seen, sides, painted = (graph.add("Add", a, b) for a, b in zip(near, far, strict=True))
        # the mean of the passes' logits: the names' convolution is linear, so that once for both will do
        names = (network.names * network.scale / 2)[..., None, None]
        logits = graph.conv(seen, names.numpy(), network.bias.numpy())
        sides, features = graph.add("Mul", sides, graph.constant(0.5)), graph.unit(painted, depth)
        boxes, around, own = _places(graph, logits, sides, up, len(network.names))
        told, changes = named(graph, closer, _patches(graph, boxes), _sizes(graph, boxes), around, own)
    _best(graph, told, changes, boxes, len(network.names))
    graph.nodes.append(helper.make_node("Identity", [features], ["features"]))
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, SIZE[1], SIZE[0]])
    outputs = [
        helper.make_tensor_value_info(name, kind, shape)
        for name, kind, shape in (
            ("boxes", TensorProto.FLOAT, [MOST, 4]),
            ("scores", TensorProto.FLOAT, [MOST]),
            ("classes", TensorProto.INT64, [MOST]),
            ("features", TensorProto.FLOAT, [1, len(network.basis), *cells[::-1]]),
        )
    ]
    made = helper.make_graph(graph.nodes, "detector", [image], outputs, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model, full_check=True)
    path.write_bytes(model.SerializeToString())


def maps_of(graph: Graph, network: Network, image: str, size: tuple[int, int]) -> tuple[str, str, str, str]:
    """What all heads see, what the heatmap's logits are made of, the boxes and the features of all cells of an image of
    a size (w, h)."""
    x = graph.add("Mul", graph.add("Sub", image, graph.constant(0.5)), graph.constant(4.0))
    for layer in network.stem:
        x = graph.layer(x, layer)
    steps = [graph.block(x, network.s4)]
    for stage in ([*network.s8], [*network.s16, network.more16], [*network.s32, network.more32]):
        x = steps[-1]
        for block in stage:
            x = graph.block(x, block)
        steps.append(x)
    room = graph.add("Relu", graph.layer(graph.add("GlobalAveragePool", x), network.room[0]))
    steps[-1] = graph.add("Add", x, graph.layer(room, network.room[2]))
    sides = [graph.layer(x, lateral) for x, lateral in zip(steps, network.lateral, strict=True)]
    shapes = [(-(-size[1] // stride), -(-size[0] // stride)) for stride in (4, 8, 16, 32)]
    up = sides[3]
    for level, smooth in ((2, network.smooth16), (1, network.smooth8), (0, network.smooth4)):
        up = graph.layer(graph.add("Add", sides[level], graph.enlarged(up, shapes[level + 1], shapes[level])), smooth)
        if level == 1:
            up = graph.block(up, network.refine)
    depth = len(network.basis)
    box = graph.layer(graph.layer(up, network.box[0]), network.box[1])
    return up, graph.unit(graph.layer(up, network.see), depth), box, graph.unit(graph.layer(up, network.paint), depth)


def _places(graph: Graph, logits: str, sides: str, up: str, classes: int) -> tuple[str, str, str]:
    """`_detector_closer.places`: boxes (K, 4), what the neck saw there (K, 48) and the logits (K, C)."""
    rows, columns = SIZE[1] // STRIDE, SIZE[0] // STRIDE
    cells = rows * columns
    top = graph.add("ReduceMax", logits, axes=[1], keepdims=1)
    high = graph.add("MaxPool", top, kernel_shape=[3, 3], strides=[1, 1], pads=[1, 1, 1, 1])
    peaks = graph.add("Where", graph.add("Equal", top, high), top, graph.constant(-30.0))
    flat = graph.add("Reshape", peaks, graph.constant([cells], np.int64))
    _, cell = graph.add("TopK", flat, graph.constant([PLACES], np.int64), outputs=2)
    reach, around, own = (
        graph.add(
            "Transpose",
            graph.add("Gather", graph.add("Reshape", maps, graph.constant([depth, cells], np.int64)), cell, axis=1),
            perm=[1, 0],
        )
        for maps, depth in ((sides, 4), (up, NECK), (logits, classes))
    )
    across, one = graph.constant(columns, np.int64), graph.constant([1], np.int64)
    x, y = (graph.add("Cast", graph.add(kind, cell, across), to=TensorProto.FLOAT) for kind in ("Mod", "Div"))
    x, y = (
        graph.add("Add", graph.add("Mul", value, graph.constant(float(STRIDE))), graph.constant(STRIDE / 2))
        for value in (x, y)
    )
    centre = graph.add("Concat", graph.add("Unsqueeze", x, one), graph.add("Unsqueeze", y, one), axis=1)
    reach = graph.add("Exp", graph.add("Clip", reach, graph.constant(-4.0), graph.constant(6.0)))
    reach = graph.add("Mul", reach, graph.constant(float(STRIDE)))
    before, after = graph.add("Split", reach, graph.constant([2, 2], np.int64), outputs=2, axis=1)
    low, high = graph.add("Sub", centre, before), graph.add("Add", centre, after)
    return graph.add("Concat", low, high, axis=1), around, own


def _sizes(graph: Graph, boxes: str) -> str:
    """Widths and heights (K, 2)."""
    low, high = graph.add("Split", boxes, graph.constant([2, 2], np.int64), outputs=2, axis=1)
    return str(graph.add("Max", graph.add("Sub", high, low), graph.constant(1.0)))


def _patches(graph: Graph, boxes: str) -> str:
    """`_detector_closer.patches`: (K, 3, 40, 40)."""
    low, high = graph.add("Split", boxes, graph.constant([2, 2], np.int64), outputs=2, axis=1)
    middle = graph.add("Mul", graph.add("Add", low, high), graph.constant(0.5))
    half = graph.add("ReduceMax", graph.add("Sub", high, low), axes=[1], keepdims=1)
    half = graph.add("Max", graph.add("Mul", half, graph.constant(AROUND / 2)), graph.constant(LEAST / 2))
    squares = graph.add("Concat", graph.add("Sub", middle, half), graph.add("Add", middle, half), axis=1)
    image = graph.constant(np.zeros(PLACES), np.int64)
    shape = {"output_height": SIDE, "output_width": SIDE, "sampling_ratio": 2, "mode": "avg"}
    return str(graph.add("RoiAlign", "image", squares, image, coordinate_transformation_mode="half_pixel", **shape))


def named(graph: Graph, closer: Closer, patches: str, sizes: str, around: str, own: str) -> tuple[str, str]:
    """The second stage, at each place: logits (K, C, 1, 1) and changes of the boxes (K, 4 C, 1, 1)."""
    x = graph.add("Mul", graph.add("Sub", patches, graph.constant(0.5)), graph.constant(4.0))
    for layer in closer.body:
        x = graph.layer(x, layer)
    layout = graph.add(
        "Reshape", graph.layer(x, closer.layout), graph.constant([PLACES, CELLS * KINDS_OF_CELL], np.int64)
    )
    ends = graph.constant([2, 3], np.int64)
    known = [graph.add("Sub", graph.add("Log", sizes), graph.constant(4.0)), around, graph.add("Sigmoid", own), layout]
    known = [graph.add("Unsqueeze", values, ends) for values in known]
    x = graph.layer(graph.add("Concat", graph.add("GlobalAveragePool", x), *known, axis=1), closer.mix)
    first = graph.layer(graph.add("Unsqueeze", own, ends), closer.trust)
    return graph.add("Add", graph.layer(x, closer.name), first), graph.layer(x, closer.mend)


def _best(graph: Graph, told: str, changes: str, boxes: str, classes: int) -> None:
    """Of all names of all places the likeliest, each with its box."""
    flat = graph.add("Reshape", told, graph.constant([PLACES * classes], np.int64))
    best, where = graph.add("TopK", flat, graph.constant([MOST], np.int64), outputs=2)
    count = graph.constant(classes, np.int64)
    graph.nodes.append(helper.make_node("Sigmoid", [best], ["scores"]))
    graph.nodes.append(helper.make_node("Mod", [where, count], ["classes"]))
    boxes = graph.add("Gather", boxes, graph.add("Div", where, count), axis=0)
    changes = graph.add("Reshape", changes, graph.constant([PLACES * classes, 4], np.int64))
    halves = graph.constant([2, 2], np.int64)
    move, grow = graph.add("Split", graph.add("Gather", changes, where, axis=0), halves, outputs=2, axis=1)
    low, high = graph.add("Split", boxes, halves, outputs=2, axis=1)
    sides, half = graph.add("Sub", high, low), graph.constant(0.5)
    middle = graph.add("Add", graph.add("Mul", graph.add("Add", low, high), half), graph.add("Mul", move, sides))
    grow = graph.add("Exp", graph.add("Clip", grow, graph.constant(-MOST_CHANGE), graph.constant(MOST_CHANGE)))
    reach = graph.add("Mul", graph.add("Mul", sides, half), grow)
    ends = graph.add("Sub", middle, reach), graph.add("Add", middle, reach)
    graph.nodes.append(helper.make_node("Concat", [*ends], ["boxes"], axis=1))


@torch.no_grad()
def compare(network: Network, closer: Closer, path: Path, image: Any) -> float:
    """The largest difference of a score, a feature or a box (in image widths) to torch's, for an image (h, w, 3)
    uint8."""
    import onnxruntime

    tensor = torch.from_numpy((np.asarray(image, np.float32) / 255).transpose(2, 0, 1)[None].copy())
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    wanted = ["scores", "features", "boxes", "classes"]
    scores, features, boxes, classes = session.run(wanted, {"image": tensor.numpy()})
    network, closer = network.eval(), closer.eval()
    near = network(tensor)[2]
    far = interpolate(
        network(interpolate(tensor, FAR_SIZE[::-1], mode="bilinear").flip(3))[2], near.shape[2:], mode="bilinear"
    )
    painted = torch.nn.functional.normalize(near + far.flip(3), dim=1)
    found, around, own = places(*two_passes(network, tensor), PLACES)
    told, changes = closer(cut_out(tensor, found), sizes_of(found), around[0], own[0])
    best, where = told.flatten().topk(MOST)
    kinds = (where % told.shape[1]).numpy()
    true = mended(found[0, where // told.shape[1]], changes.flatten(0, 1)[where]).numpy()
    # of nearly equal scores the order is anybody's guess
    away = np.abs(boxes[:, None] - true).max(2) + np.where(classes[:, None] == kinds, 0, np.inf)
    apart = np.quantile(away.min(1), 0.9) / SIZE[0]
    return float(max(np.abs(scores - best.sigmoid().numpy()).max(), np.abs(features - painted.numpy()).max(), apart))
