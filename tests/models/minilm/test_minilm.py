"""The shipped text encoder: the original's vectors, a peer's tokens, a bounded length."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier.models.minilm import FOLDER, MAX_TOKENS, TextEncoder
from cartier.models.minilm.wordpiece import WordPiece

HERE = Path(__file__).parent
TOKENS = WordPiece(FOLDER / "vocab.txt")
PEER: Any = None
TEXTS = json.loads((HERE / "texts.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def encoder() -> TextEncoder:
    return TextEncoder()


def test_the_vectors_are_the_originals(encoder: TextEncoder) -> None:
    original = np.load(HERE / "vectors.npy").astype(np.float32)
    vectors = encoder(TEXTS)
    assert vectors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert (vectors * original).sum(1).min() >= 0.99


def test_a_text_alone_and_among_others_has_one_vector(encoder: TextEncoder) -> None:
    together = TextEncoder()(TEXTS)
    np.testing.assert_array_equal(np.stack([encoder([text])[0] for text in TEXTS]), together)
    assert encoder([]).shape == (0, 384)


def test_meaning_is_nearer_than_spelling(encoder: TextEncoder) -> None:
    couch, sofa, coach = encoder(["couch", "sofa", "coach"])
    assert couch @ sofa > couch @ coach


def test_a_long_text_is_cut_and_counted() -> None:
    encoder = TextEncoder()
    begin = "tea " * (MAX_TOKENS - 2)
    same = encoder([begin + "and a very different ending", begin])
    np.testing.assert_array_equal(same[0], same[1])
    assert encoder.cut == 1


def test_what_ships_is_small() -> None:
    assert sum(f.stat().st_size for f in FOLDER.iterdir() if f.is_file()) <= 25e6


# newer characters are another matter: the library's Unicode tables are older than Python's
COMMON = st.one_of(
    st.characters(max_codepoint=0x52F, exclude_categories=("Cn",)),
    st.characters(min_codepoint=0x4E00, max_codepoint=0x9FA5),
    st.sampled_from("—…“”’‘•€™→✓☕😴\u200b\u3000\ufeff"),
)


@given(st.text(COMMON, max_size=60))
def test_tokens_equal_the_tokenizers_library(text: str) -> None:
    tokenizers = pytest.importorskip("tokenizers", reason="comes with transformers; CI installs it for the torch step")
    global PEER
    PEER = PEER or tokenizers.BertWordPieceTokenizer(str(FOLDER / "vocab.txt"), lowercase=True)
    assert TOKENS(text, MAX_TOKENS)[0] == PEER.encode(text).ids[:MAX_TOKENS]
