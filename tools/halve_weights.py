"""Converter of an ONNX file's float32 weights to float16: half the bytes, and a graph that still reckons in float32.

python tools/halve_weights.py SOURCE.onnx TARGET.onnx     (needs onnx)
Arrays of more than 64 numbers are stored as float16, and a Cast gives them back; onnxruntime folds it when it loads the
file. The networks in `models/photos` were made in this way.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

FEW = 64  # numbers of an array that stays as it is: biases and constants
LARGEST = float(np.finfo(np.float16).max)


def halve(model: onnx.ModelProto) -> int:
    """Store large weights as float16, in place; returns how many arrays were."""
    graph, casts = model.graph, []
    for array in graph.initializer:
        values = numpy_helper.to_array(array)
        if array.data_type != TensorProto.FLOAT or values.size <= FEW or np.abs(values).max() > LARGEST:
            continue
        name = array.name
        array.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
        casts.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:], graph.value_info[:]
    graph.node.extend(nodes)
    return len(casts)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("source", type=Path, help="file to read")
    parser.add_argument("target", type=Path, help="file to write")
    options = parser.parse_args()
    model = onnx.load(options.source)
    count = halve(model)
    onnx.checker.check_model(model)
    options.target.write_bytes(model.SerializeToString(deterministic=True))
    print(f"{options.target}: {count} arrays halved, {options.target.stat().st_size:,} bytes")


if __name__ == "__main__":
    run_script(main)
