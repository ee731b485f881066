"""Shipped text encoder with two outputs: sentence vectors, and the hidden states of a text's tokens half-way up.

The learned scorer continues from the half-way states with layers of its own, so both share one set of weights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np

from cartier.models.minilm import FOLDER, WIDTH, session
from cartier.models.minilm.wordpiece import WordPiece
from cartier.types import Array

MOST_PIECES = 160  # of a request's end; the learned layers saw none longer
HALF_WAY = "LayerNormalization_78"  # the output of the second of six layers in minilm.onnx
BEGIN, END = 101, 102


def _varint(data: bytes | memoryview, at: int) -> tuple[int, int]:
    """A protobuf number and where it ends."""
    value = shift = 0
    while True:
        byte, at = data[at], at + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7


def _to_varint(value: int) -> bytes:
    return bytes([value & 127 | 128]) + _to_varint(value >> 7) if value > 127 else bytes([value])


def message_fields(message: bytes | memoryview) -> Iterator[tuple[int, memoryview, memoryview]]:
    """The fields of a protobuf message: number, content, and all its bytes; of a field that is a number no content."""
    message, at = memoryview(message), 0
    while at < len(message):
        key, start = _varint(message, at)
        length, start = _varint(message, start)
        end = start + (length if key & 7 == 2 else 0)
        yield key >> 3, message[start:end], message[at:end]
        at = end


def _field_begin(number: int, length: int) -> bytes:
    return _to_varint(number << 3 | 2) + _to_varint(length)


def message_field(number: int, content: bytes) -> bytes:
    return _field_begin(number, len(content)) + content


OUTPUT = message_field(12, message_field(1, HALF_WAY.encode()))
"""The half-way states as an output of a graph."""
GRAPH, NODE, GRAPH_OUTPUT = 7, 1, 12


def half_of(model: bytes) -> bytes:
    """The shipped ONNX model up to the half-way states: onnxruntime computes all nodes, whatever is asked of it."""
    parts = list[bytes | memoryview]()  # joined once: the weights are 24 MB
    for number, content, whole in message_fields(model):
        if number != GRAPH:
            parts.append(whole)
            continue
        kept = _half(content)
        parts += [_field_begin(GRAPH, sum(map(len, kept)) + len(OUTPUT)), *kept, OUTPUT]
    return b"".join(parts)


def _half(graph: memoryview) -> list[memoryview]:
    """A graph without outputs, and without the nodes after the one whose output the half-way states are."""
    kept, done = list[memoryview](), False
    for number, content, whole in message_fields(graph):
        if number != GRAPH_OUTPUT and not (number == NODE and done):
            kept.append(whole)
        done = done or (number == NODE and HALF_WAY.encode() in bytes(content))
    return kept


@cache
def reader() -> Reader:
    """The one reader of this process."""
    return Reader()


class Reader:
    """Texts to vectors, and tokens to states."""

    def __init__(self) -> None:
        self._pieces = WordPiece(FOLDER / "vocab.txt")
        self.vocabulary = frozenset((FOLDER / "vocab.txt").read_text(encoding="utf-8").split("\n"))
        self._known: dict[str, list[int]] = {}

    @cached_property
    def _whole(self) -> Any:
        return session((FOLDER / "minilm.onnx").read_bytes())

    @cached_property
    def _half(self) -> Any:
        return session(half_of((FOLDER / "minilm.onnx").read_bytes()))

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
        states: Array = self._half.run([HALF_WAY], {"ids": np.array(ids, np.int64)})[0]
        return states

    def vectors(self, texts: Sequence[str]) -> Array:
        """(n, 384) float32 unit vectors."""
        ids = (np.array(self._pieces(text, MOST_PIECES)[0], np.int64) for text in texts)
        rows = [self._whole.run(["vector"], {"ids": i})[0] for i in ids]
        return np.stack(rows) if rows else np.zeros((0, WIDTH), np.float32)
