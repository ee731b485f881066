"""Shipped text encoder with two outputs: sentence vectors, and the hidden states of a text's tokens half-way up.

The learned scorer continues from the half-way states with layers of its own, so both share one set of weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from cartier.models.minilm import FOLDER, WIDTH
from cartier.models.minilm.wordpiece import WordPiece
from cartier.types import Array

MOST_PIECES = 160  # of a request's end; the learned layers saw none longer
HALF_WAY = "LayerNormalization_78"  # the output of the second of six layers in minilm.onnx
BEGIN, END = 101, 102


def session(model: bytes) -> Any:
    """An onnxruntime session on one thread: a sentence is too small to share."""
    import onnxruntime  # not before the first text

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def _field(number: int, content: bytes) -> bytes:
    return bytes([number << 3 | 2, len(content)]) + content


@cache
def reader() -> Reader:
    """The one reader of this process."""
    return Reader()


class Reader:
    """Texts to vectors, and tokens to states."""

    def __init__(self) -> None:
        # Concatenated protobuf messages are merged: this adds an output to the graph (7) and its name (12, 1).
        half_way = _field(7, _field(12, _field(1, HALF_WAY.encode())))
        self._session = session((FOLDER / "minilm.onnx").read_bytes() + half_way)
        self._pieces = WordPiece(FOLDER / "vocab.txt")
        self.vocabulary = frozenset((FOLDER / "vocab.txt").read_text(encoding="utf-8").split("\n"))
        self._known: dict[str, list[int]] = {}

    def pieces(self, token: str) -> list[int]:
        """The ids of one word or punctuation mark."""
        known = self._known.get(token)
        if known is None:
            known = self._pieces(token, MOST_PIECES)[0][1:-1]
            if len(self._known) < 50_000:  # a server's lifetime of requests must not fill the memory
                self._known[token] = known
        return known

    def states(self, ids: Sequence[int]) -> Array:
        """(t, 384) float32, half-way up."""
        states: Array = self._session.run([HALF_WAY], {"ids": np.array(ids, np.int64)})[0]
        return states

    def vectors(self, texts: Sequence[str]) -> Array:
        """(n, 384) float32 unit vectors."""
        ids = (np.array(self._pieces(text, MOST_PIECES)[0], np.int64) for text in texts)
        rows = [self._session.run(["vector"], {"ids": i})[0] for i in ids]
        return np.stack(rows) if rows else np.zeros((0, WIDTH), np.float32)

    def vector_and_states(self, text: str) -> tuple[Array, Array]:
        """(384,) the unit vector of a text and (t, 384) its half-way states, of one pass."""
        ids = np.array(self._pieces(text, MOST_PIECES)[0], np.int64)
        vector, states = self._session.run(["vector", HALF_WAY], {"ids": ids})
        return vector, states
