"""Low-rank changes of the shipped layers: exact against a closed form, and none is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from cartier.models.minilm import session
from cartier.understanding.adapters import adapted
from cartier.understanding.need_scorer import SHIPPED
from cartier.understanding.parser import CHANGES, word_states
from cartier.understanding.text_encoder import WIDTH

RNG = np.random.default_rng(0)
WEIGHT, SCALE, BIAS = RNG.integers(-127, 128, (6, 5)), RNG.uniform(0.01, 0.02, 5), RNG.normal(size=5)


def model() -> bytes:
    """One linear layer with int8 weights, as the shipped models have them."""
    values = {"a.int8": WEIGHT.astype(np.int8), "a.scale": SCALE.astype(np.float32), "a.bias": BIAS.astype(np.float32)}
    nodes = [
        helper.make_node("DequantizeLinear", ["a.int8", "a.scale"], ["w"], axis=1),
        helper.make_node("MatMul", ["x", "w"], ["m"]),
        helper.make_node("Add", ["m", "a.bias"], ["y"]),
    ]
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, ["t", wide]) for n, wide in (("x", 6), ("y", 5))]
    constants = [numpy_helper.from_array(v, n) for n, v in values.items()]
    graph = helper.make_graph(nodes, "one", ends[:1], ends[1:], constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=9).SerializeToString()


def changes(folder: Path, size: int) -> tuple[Path, np.ndarray, np.ndarray]:
    """A file of changes of rank two, their matrix and the new bias."""
    down, up = RNG.integers(-size, size + 1, (6, 2)), RNG.integers(-size, size + 1, (2, 5))
    steps = (np.array([[0.01, 0.02]]), np.array([[0.03], [0.01]]))
    bias = BIAS + size
    np.savez(
        folder / "changes.npz",
        **{"a.down": down.astype(np.int8), "a.up": up.astype(np.int8), "a.bias": bias.astype(np.float32)},
        **{"a.down.scale": steps[0].astype(np.float32), "a.up.scale": steps[1].astype(np.float32)},
    )
    return folder / "changes.npz", (down * steps[0]) @ (up * steps[1]), bias


@pytest.mark.parametrize("size", [0, 90])
def test_the_product_is_added_and_vectors_are_replaced(tmp_path: Path, size: int) -> None:
    file, change, bias = changes(tmp_path, size)
    x = RNG.normal(size=(4, 6)).astype(np.float32)
    new = adapted(model(), file)
    onnx.checker.check_model(onnx.load_from_string(new))
    wanted = x @ (WEIGHT * SCALE + change) + bias
    np.testing.assert_allclose(session(new).run(None, {"x": x})[0], wanted, atol=0.06)
    if size:
        assert np.abs(session(model()).run(None, {"x": x})[0] - wanted).max() > 1  # the change is no small one


def test_the_parsers_layers_are_changed_and_the_scorers_stay() -> None:
    with np.load(CHANGES, allow_pickle=False) as kept:
        assert sum(name.endswith(".up") for name in kept.files) == 24, "four layers of six matrices"
    low, own = np.split(word_states((101, 2175, 2000, 1996, 2793, 102)), [WIDTH], axis=1)  # go to the bed
    scorers = session((SHIPPED / "scorer.onnx").read_bytes()).run(None, {"states": low})[0]
    assert own.shape == scorers.shape and np.abs(own - scorers).mean() > 0.1
