"""Precomputed vectors of the card texts, each under the hash of its text (tools/train_scorer.py makes them)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from cartier.models.minilm import WIDTH
from cartier.types import Array
from cartier.understanding.cards import Deck
from cartier.understanding.text_encoder import reader

VECTORS = Path(__file__).with_name("vectors.npz")
UNLIKE = 0.7  # cosine of two cards up to which their objects have different uses
ALIKE = 0.8  # cosine of two cards from which their objects serve the same needs
MUCH_ALIKE = 0.83  # cosine from which one may replace the other, if their names are similar too
CALLED_ALIKE = 0.6  # cosine of two names from which they count as similar


def text_key(text: str) -> int:
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little", signed=True)


@cache
def shipped(file: Path = VECTORS) -> tuple[dict[int, int], Array, Array]:
    """Row of each text's key, int8 rows (n, 384), their scales (n,). Without the file all texts are encoded anew."""
    if not file.exists():
        return {}, np.zeros((1, WIDTH), np.int8), np.ones(1, np.float32)
    with np.load(file, allow_pickle=False) as data:
        return {int(k): i for i, k in enumerate(data["keys"])}, data["rows"], data["scales"]


class Knowledge:
    """Names and uses of all cards as unit vectors, the texts of each card side by side.

    ``uses`` and ``names`` are (n, 384); those of card i begin at ``use_starts[i]`` and ``name_starts[i]``. Texts
    without a shipped vector are encoded here, so edited and new cards work, but load more slowly.
    """

    def __init__(self, deck: Deck, file: Path = VECTORS) -> None:
        self._file = file
        self.use_texts = [t for card in deck.cards for t in card.uses]
        self.use_starts = _starts(len(card.uses) for card in deck.cards)
        self.name_starts = _starts(len(card.names) for card in deck.cards)
        self.uses = self.vectors(self.use_texts)
        self.names = self.vectors([t for card in deck.cards for t in card.names])

    def likeness(self, card: int) -> Array:
        """(n,) the cosines of what a card and each card are good for."""
        likeness: Array = self._means @ self._means[card]
        return likeness

    def near_synonyms(self, one: int, other: int) -> bool:
        """Whether two cards are much the same: called alike and good for the same, such as a pan and a frying pan."""
        if self._means[one] @ self._means[other] <= MUCH_ALIKE:
            return False
        mine, others = (self.names[start:end] for start, end in (self._span(one), self._span(other)))
        return float((mine @ others.T).max()) > CALLED_ALIKE

    def _span(self, card: int) -> tuple[int, int]:
        ends = [*self.name_starts[1:], len(self.names)]
        return int(self.name_starts[card]), int(ends[card])

    @cached_property
    def _means(self) -> Array:
        means = np.add.reduceat(self.uses, self.use_starts)
        unit: Array = means / np.linalg.norm(means, axis=1, keepdims=True)
        return unit

    def vectors(self, texts: list[str]) -> Array:
        """(n, 384) float32, shipped where they are, else encoded now."""
        place, rows, scales = shipped(self._file)
        found = [place.get(text_key(t), -1) for t in texts]
        vectors = rows[found].astype(np.float32) * scales[found, None]
        missing = [i for i, p in enumerate(found) if p < 0]
        if missing:
            vectors[missing] = reader().vectors([texts[i] for i in missing])
        return vectors


def pack(texts: Iterable[str], vectors: Array) -> dict[str, Array]:
    """The arrays of the shipped file."""
    scales = np.abs(vectors).max(1) / 127
    keys = np.array([text_key(t) for t in texts], np.int64)
    return {
        "keys": keys,
        "rows": np.rint(vectors / scales[:, None]).astype(np.int8),
        "scales": scales.astype(np.float32),
    }


def _starts(counts: Iterable[int]) -> Array:
    return np.cumsum([0, *counts])[:-1]
