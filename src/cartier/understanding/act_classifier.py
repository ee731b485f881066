"""Learned classifier of speech acts: whether words tell of an emergency, and of which kind.

A few small networks of one hidden layer (acts.npz, fitted by tools/fit_acts.py) stand on the shipped encoder: on a
text's sentence vector, on the mean and the greatest of its tokens' half-way states, and on the wordings of
``act_patterns.py``. Their probabilities are averaged.
"""

from __future__ import annotations

import re
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from cartier.types import AlarmKind, Array
from cartier.understanding.act_patterns import heard
from cartier.understanding.text_encoder import reader

FITTED = Path(__file__).with_name("acts.npz")
KINDS: tuple[AlarmKind, ...] = get_args(AlarmKind)
SENTENCE = re.compile(r"(?<=[.!?;\n])\s+")
MOST_SENTENCES = 24  # of a request's end


def features(text: str) -> Array:
    """(1152 + patterns,) what the networks see of a text."""
    vector, states = reader().vector_and_states(text)
    return np.concatenate([vector, states.mean(0), states.max(0), heard(text)]).astype(np.float32)


class Networks(NamedTuple):
    """(n, features, hidden) and (n, hidden, kinds + 1) weights, their offsets, and from which probability on words are
    an alarm.
    """

    inner: Array
    inner_offsets: Array
    outer: Array
    outer_offsets: Array
    threshold: Array

    def shares(self, x: Array) -> Array:
        """(m, kinds + 1) probabilities of each kind of alarm, and last of none, for (m, features)."""
        hidden = np.maximum(x @ self.inner + self.inner_offsets[:, None], 0)
        logits = hidden @ self.outer + self.outer_offsets[:, None]
        shares = np.exp(logits - logits.max(-1, keepdims=True))
        return np.asarray((shares / shares.sum(-1, keepdims=True)).mean(0))


@cache
def _fitted() -> Networks:
    with np.load(FITTED, allow_pickle=False) as data:
        return Networks(*(data[name].astype(np.float32) for name in Networks._fields))


def parts_of(words: str) -> list[str]:
    """The last sentences of the words, and each two in a row: what is judged one by one."""
    sentences = SENTENCE.split(words.strip())[-MOST_SENTENCES:]
    return [*sentences, *(f"{one} {two}" for one, two in pairwise(sentences))]


def alarm_kind(words: str) -> AlarmKind | None:
    """The kind of emergency that a sentence of the words, or two in a row, tell of; the surest one."""
    networks = _fitted()
    judged = networks.shares(np.stack([features(text) for text in parts_of(words)]))
    surest = judged[judged[:, -1].argmin()]
    return KINDS[int(surest[:-1].argmax())] if 1 - surest[-1] >= networks.threshold else None
