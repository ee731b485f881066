"""Learned parser: the dialogue act of each clause of an utterance and the role of each of its words.

Three small transformer layers over the words (parser.npz) see what the shipped encoder and four layers of the parser's
own make of each word, and whether it belongs to a known name or to a table of words. The four layers are those of the
need scorer with low-rank changes (parser_layers.npz). tools/understanding trains all of them on marked requests. The
turn before goes in with the words, so that "the blue one" can be read as a reply.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cartier.labels import name_key, plain, words
from cartier.models.minilm import session
from cartier.spatial.expressions import EntityVocabulary
from cartier.types import AlarmKind, Array
from cartier.understanding.adapters import adapted
from cartier.understanding.decoding import clauses
from cartier.understanding.need_scorer import SHIPPED, half_way
from cartier.understanding.reference_words import COLOURS, GENERIC, MOST, ORDER, PLACING, SIZES
from cartier.understanding.tags import ALARMS, DIALOGUE_ACTS, TAGS, Clause
from cartier.understanding.text_encoder import BEGIN, END, MOST_PIECES, reader
from cartier.understanding.utterance import TOKEN

FITTED, CHANGES = (Path(__file__).with_name(f"{name}.npz") for name in ("parser", "parser_layers"))
MOST_CONTEXT = 20  # tokens of each side of the turn before
MOST_TOKENS, LONGEST_NAME = 110, 4
HEADS, LAYERS = 4, 3
NUMBER = re.compile(r"\s*(?:#\d+|\(room \d+\))")
NEGATIONS = frozenset(words("no not never without none nor neither t cannot dont isnt except instead rather"))
QUESTIONS = frozenset(words("what which who where when how whose why is are do does did have has can could"))
TABLES: tuple[frozenset[str], ...] = (
    frozenset(COLOURS), frozenset(MOST), frozenset(SIZES), frozenset(ORDER), frozenset(GENERIC), frozenset(PLACING),
    NEGATIONS, QUESTIONS, frozenset(".!?;"), frozenset(","),
)  # fmt: skip
TURNS = 3
"""The person's turn before, the robot's, and the words themselves."""
BITS = 4 + len(TABLES) + TURNS
TAG_OF = {tag: k for k, tag in enumerate(TAGS)}


class Words(NamedTuple):
    """What the network sees: (n, 768) states and (n, BITS) tables of all words; the utterance's own from ``own`` on,
    which is its token ``first``."""

    states: Array
    bits: Array
    own: int
    first: int


class Pieces(NamedTuple):
    """Ids of all words' pieces, the first piece of each word (n,), and the rest as in ``Words``."""

    ids: tuple[int, ...]
    at: list[int]
    bits: Array
    own: int
    first: int


def words_of(tokens: Sequence[str], before: tuple[str, str] | None, names: EntityVocabulary) -> Words:
    """The words of the turn before (person, robot) and of an utterance's end, as the network sees them."""
    read = pieces_of(tokens, before, names)
    return Words(word_states(read.ids)[read.at].astype(np.float32), read.bits, read.own, read.first)


def pieces_of(tokens: Sequence[str], before: tuple[str, str] | None, names: EntityVocabulary) -> Pieces:
    """The same before any layer has seen them."""
    turns = [TOKEN.findall(plain(NUMBER.sub("", turn)))[-MOST_CONTEXT:] for turn in before or ("", "")]
    first = max(0, len(tokens) - MOST_TOKENS)
    ids, at = [BEGIN], [[0], [], []]
    for k, said in enumerate((*turns, tokens[first:])):
        for token in said:
            at[k].append(len(ids))
            ids += reader().pieces(token)
        ids += [END] if said else []
    if len(ids) > MOST_PIECES:  # the end holds the request
        return pieces_of(tokens, None, names) if before else pieces_of(tokens[first + 10 :], None, names)
    bits = np.concatenate([
        np.hstack([_known(("", *said) if k == 0 else said, names), np.tile(np.eye(TURNS)[k], (len(at[k]), 1))])
        for k, said in enumerate((*turns, list(tokens[first:])))
    ])  # fmt: skip
    own = len(at[0]) + len(at[1])
    return Pieces(tuple(ids), [i for turn in at for i in turn], bits.astype(np.float32), own, first)


def _known(tokens: Sequence[str], names: EntityVocabulary) -> Array:
    """(n, 4 + tables) whether a word begins or goes on with an object's or a room's name, and the tables it is in."""
    bits = np.zeros((len(tokens), 4 + len(TABLES)), np.float32)
    keys = [
        [(end, name_key(" ".join(tokens[k:end])))
         for end in range(min(k + LONGEST_NAME, len(tokens)), k, -1) if tokens[end - 1].isalnum()]
        for k in range(len(tokens))
    ]  # fmt: skip
    for column, known in ((0, names.objs), (2, names.rooms)):
        k = 0
        while k < len(tokens):
            end = next((end for end, key in keys[k] if key in known), None)
            if end is not None:
                bits[k, column], bits[k + 1 : end, column + 1] = 1, 1
            k = end or k + 1
    bits[:, 4:] = [[token in table for table in TABLES] for token in tokens] or np.zeros((0, len(TABLES)))
    return bits


@cache
def _layers() -> Any:
    return session(adapted((SHIPPED / "scorer.onnx").read_bytes(), CHANGES))


@lru_cache(maxsize=16)
def word_states(ids: tuple[int, ...]) -> Array:
    """(t, 768) the half-way states of pieces beside what the parser's own layers make of them."""
    low = half_way(ids)
    return np.concatenate([low, _layers().run(None, {"states": low})[0]], 1)


@cache
def parser() -> Parser:
    """The one parser of this process."""
    return Parser(FITTED)


class Parser:
    """Tokens to clauses."""

    def __init__(self, fitted: Path) -> None:
        with np.load(fitted, allow_pickle=False) as data:
            self._w = {name: data[name].astype(np.float32) for name in data.files}

    def __call__(self, tokens: Sequence[str], before: tuple[str, str] | None, names: EntityVocabulary) -> list[Clause]:
        """The clauses of an utterance, given the (person, robot) turn before it and the names that are known."""
        if not tokens:
            return []
        tags, logits = self._read(tokens, before, names)
        acts = [
            [(DIALOGUE_ACTS[k], float(shares[k])) for k in np.argsort(-shares)[:2]]
            for shares in (_shares(row[: len(DIALOGUE_ACTS)]) for row in logits)
        ]
        return clauses(list(tokens[len(tokens) - len(tags) :]), tags, acts)

    def alarm(self, tokens: Sequence[str], names: EntityVocabulary) -> tuple[AlarmKind, float]:
        """The kind of emergency that words tell of, if any, and the probability that a clause of them tells of one."""
        _, logits = self._read(tokens, None, names)
        surest = max((_shares(row)[len(DIALOGUE_ACTS) :] for row in logits), key=lambda shares: float(shares.sum()))
        return ALARMS[int(surest.argmax())], float(surest.sum())

    def _read(
        self, tokens: Sequence[str], before: tuple[str, str] | None, names: EntityVocabulary
    ) -> tuple[list[str], list[Array]]:
        """The tags of an utterance's last words, and for each clause the logits of its acts and alarms."""
        seen = words_of(tokens, before, names)
        states = self._states(seen)
        whole, said = states[0], states[seen.own :]
        tags = _tags(self._linear(said, "tag"))
        cuts = [k for k, tag in enumerate(tags) if tag == "B-/"]
        parts = zip([0, *(k + 1 for k in cuts)], [*cuts, len(tags)], strict=True)
        return tags, [self._acts(whole, said[start:end]) for start, end in parts]

    def _linear(self, x: Array, name: str) -> Array:
        y: Array = x @ self._w[f"{name}.weight"].T + self._w[f"{name}.bias"]
        return y

    def _norm(self, x: Array, name: str) -> Array:
        x = x - x.mean(-1, keepdims=True)
        scaled: Array = x / np.sqrt((x * x).mean(-1, keepdims=True) + 1e-5)
        moved: Array = scaled * self._w[f"{name}.weight"] + self._w[f"{name}.bias"]
        return moved

    def _states(self, seen: Words) -> Array:
        """(n, width) what the layers of attention make of the words."""
        x = self._linear(np.concatenate([seen.states, seen.bits], 1), "begin")
        x = x + self._w["places"][np.minimum(np.arange(len(x))[::-1], len(self._w["places"]) - 1)]
        for k in range(LAYERS):
            y = self._norm(x, f"layers.{k}.norm1")
            q, key, value = (
                self._linear(y, f"layers.{k}.{part}").reshape(len(x), HEADS, -1).transpose(1, 0, 2) for part in "qkv"
            )
            scores = q @ key.transpose(0, 2, 1) / np.sqrt(q.shape[-1])
            shares = np.exp(scores - scores.max(-1, keepdims=True))
            mixed = (shares / shares.sum(-1, keepdims=True)) @ value
            x = x + self._linear(mixed.transpose(1, 0, 2).reshape(len(x), -1), f"layers.{k}.o")
            inner = np.maximum(self._linear(self._norm(x, f"layers.{k}.norm2"), f"layers.{k}.up"), 0)
            x = x + self._linear(inner, f"layers.{k}.down")
        states: Array = self._norm(x, "end")
        return states

    def _acts(self, whole: Array, said: Array) -> Array:
        """(acts and alarms,) logits of a clause's words; of no words, those of the whole utterance."""
        said = said if len(said) else whole[None]
        attention = np.exp(said @ self._w["pool"] - (said @ self._w["pool"]).max())
        pooled = np.concatenate([whole, attention @ said / attention.sum()])
        logits: Array = self._linear(pooled, "act") / self._w["temperature"]
        return logits


def _shares(logits: Array) -> Array:
    shares = np.exp(logits - logits.max())
    return np.asarray(shares / shares.sum())


def _tags(logits: Array) -> list[str]:
    """The best tag of each token, where "inside" follows only what it can be inside of (Viterbi)."""
    score, path = np.where(_INSIDE, -np.inf, logits[0]), list[Array]()
    for row in logits[1:]:
        ways = score[:, None] + _ALLOWED
        path.append(ways.argmax(0))
        score = ways.max(0) + row
    tags = [int(score.argmax())]
    for step in reversed(path):
        tags.append(int(step[tags[-1]]))
    return [TAGS[k] for k in reversed(tags)]


_INSIDE = np.array([tag.startswith("I-") for tag in TAGS])
_ALLOWED = np.array([
    [0.0 if not now.startswith("I-") or before[1:] == now[1:] else -np.inf for now in TAGS] for before in TAGS
])  # fmt: skip
