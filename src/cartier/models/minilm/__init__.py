"""Embedded text encoder: all-MiniLM-L6-v2, int8, on onnxruntime (built by tools/build_text_encoder.py)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cartier.models.minilm.wordpiece import WordPiece
from cartier.types import Array

FOLDER = Path(__file__).parent
WIDTH = 384
MAX_TOKENS = 256  # the original's own limit


class TextEncoder:
    """Sentence vectors of length 1 (Sentence-BERT, Reimers and Gurevych 2019), encoded one by one and remembered.

    ``cut`` counts the texts that were longer than 256 tokens, of which only the beginning was read.
    """

    def __init__(self, model: bytes | None = None) -> None:
        self._session = _shipped() if model is None else session(model)
        self._tokens = _words()
        self._known: dict[str, Array] = {}
        self.cut = 0

    def __call__(self, texts: Sequence[str]) -> Array:
        """(n, 384) float32 unit vectors."""
        vectors = [self._vector(text) for text in texts]
        return np.stack(vectors) if vectors else np.zeros((0, WIDTH), np.float32)

    def _vector(self, text: str) -> Array:
        known = self._known.get(text)
        if known is None:
            ids, cut = self._tokens(text, MAX_TOKENS)
            self.cut += cut
            known = self._session.run(None, {"ids": np.array(ids, np.int64)})[0]
            if len(self._known) < 10_000:  # a server's lifetime of requests must not fill the memory
                self._known[text] = known
        return known


def session(source: str | bytes) -> Any:
    """An onnxruntime session on one thread: a sentence is too small to share, and busy cores make sharing slow."""
    import onnxruntime  # not before the first text

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # no warnings of weights that half a model does not use
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


@cache  # every encoder of a process reads the same network and words, and changes neither
def _shipped() -> Any:
    return session(str(FOLDER / "minilm.onnx"))


@cache
def _words() -> WordPiece:
    return WordPiece(FOLDER / "vocab.txt")
