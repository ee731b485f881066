"""Text encoder: half of the model gives what the whole model gives half-way, bit for bit."""

from __future__ import annotations

import numpy as np

from cartier.understanding.text_encoder import (
    BEGIN,
    END,
    FOLDER,
    GRAPH,
    HALF_WAY,
    OUTPUT,
    half_of,
    message_field,
    reader,
    session,
)


def test_half_of_the_model_gives_the_half_way_states() -> None:
    ids = [
        piece
        for word in ["so", "much", "work", "tonight", ",", "i", "am", "getting", "sleepy"]
        for piece in reader().pieces(word)
    ]
    ids = [BEGIN, *ids, END]
    # Concatenated protobuf messages are merged: this adds an output to the graph.
    whole = session((FOLDER / "minilm.onnx").read_bytes() + message_field(GRAPH, OUTPUT))
    states = whole.run([HALF_WAY], {"ids": np.array(ids, np.int64)})[0]
    np.testing.assert_array_equal(reader().states(ids), states)


def test_half_of_the_model_holds_fewer_nodes() -> None:
    import onnx

    model = (FOLDER / "minilm.onnx").read_bytes()
    whole, half = onnx.load_from_string(model), onnx.load_from_string(half_of(model))
    assert len(half.graph.node) < len(whole.graph.node) / 2
    assert [output.name for output in half.graph.output] != [output.name for output in whole.graph.output]
