"""Low-rank changes of a model's weights (LoRA, Hu et al. 2021), so that two sets of layers ship as one and a little."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cartier.types import Array
from cartier.understanding.text_encoder import GRAPH, message_field, message_fields

INITIALIZER, NAME, RAW = 5, 8, 9  # of a graph; of a tensor


def adapted(model: bytes, changes: Path) -> bytes:
    """An ONNX model with other weights.

    Every matrix ``NAME.int8`` (in, out) with ``NAME.scale`` (out,) gets the product of ``NAME.down`` (in, r) and
    ``NAME.up`` (r, out), both int8 with one scale per rank, added and is rounded anew; a vector that ``changes`` (an
    .npz file) holds under its own name is replaced.
    """
    with np.load(changes, allow_pickle=False) as data:
        change = {name: data[name] for name in data.files}
    raw = _initializers(model)
    new = {name: values.astype(np.float32).tobytes() for name, values in change.items() if name in raw}
    for name in {key.removesuffix(".down") for key in change if key.endswith(".down")}:
        scale = np.frombuffer(raw[f"{name}.scale"], np.float32)
        old = np.frombuffer(raw[f"{name}.int8"], np.int8).reshape(-1, len(scale)) * scale
        weight = old + _factor(change, f"{name}.down") @ _factor(change, f"{name}.up")
        step = np.abs(weight).max(0) / 127
        new[f"{name}.int8"] = np.rint(weight / step).astype(np.int8).tobytes()
        new[f"{name}.scale"] = step.astype(np.float32).tobytes()
    return b"".join(
        message_field(GRAPH, _replaced(content, new)) if number == GRAPH else whole
        for number, content, whole in message_fields(model)
    )


def _factor(change: dict[str, Array], name: str) -> Array:
    values: Array = change[name].astype(np.float32) * change[f"{name}.scale"]
    return values


def _initializers(model: bytes) -> dict[str, memoryview]:
    """The bytes of every initial value by its name."""
    graph = next(content for number, content, _ in message_fields(model) if number == GRAPH)
    tensors = [dict(_parts(content)) for number, content, _ in message_fields(graph) if number == INITIALIZER]
    return {str(tensor[NAME], "utf-8"): tensor[RAW] for tensor in tensors}


def _parts(tensor: memoryview) -> list[tuple[int, memoryview]]:
    return [(number, content) for number, content, _ in message_fields(tensor) if number in (NAME, RAW)]


def _replaced(graph: memoryview, new: dict[str, bytes]) -> bytes:
    """A graph with other bytes for some initial values."""
    kept = list[bytes | memoryview]()
    for number, content, whole in message_fields(graph):
        name = str(dict(_parts(content))[NAME], "utf-8") if number == INITIALIZER else ""
        if name in new:
            fields = (message_field(RAW, new[name]) if n == RAW else same for n, _, same in message_fields(content))
            kept.append(message_field(INITIALIZER, b"".join(fields)))
        else:
            kept.append(whole)
    return b"".join(kept)
