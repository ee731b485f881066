"""Learned need scorer: how strongly a request calls for each kind of object (tools/train_scorer.py trains it).

Three signals count: the meaning of the request or of one of its sentences, compared with the names and uses on the
card; the card's name where the words contain it, judged by its context; and the words that the request shares with a
use. The fine-tuned upper layers of the encoder decide which sentence matters and whether a name is wanted.
"""

from __future__ import annotations

import math
from collections.abc import Container
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cartier.labels import plain, words
from cartier.models.minilm import session
from cartier.types import Array
from cartier.understanding.card_vectors import VECTORS, Knowledge
from cartier.understanding.cards import Deck
from cartier.understanding.lexical import Fit, Lexicon, turned_down
from cartier.understanding.spelling import Spelling
from cartier.understanding.text import STOP
from cartier.understanding.text_encoder import BEGIN, END, MOST_PIECES, reader
from cartier.understanding.utterance import Mention, Utterance, listen, mentions

SHIPPED = Path(__file__).parent  # with scorer.onnx, the layers, scorer.npz, the heads, and vectors.npz, the cards
MOST_TOKENS = 110
MOST_SENTENCES = 9
# logits that the only name in a one-sentence request adds, or subtracts if refused; half for several names
ALONE = 4.0


class Tokens(NamedTuple):
    """The ids of a request's end, and where its tokens (from ``first`` on) begin among them."""

    ids: list[int]
    at: list[int]
    first: int

    def span(self, start: int, end: int) -> tuple[int, int] | None:
        """Tokens start to end as a range of ids; None where they were cut off."""
        inside = start >= self.first and end - self.first < len(self.at)
        return (self.at[start - self.first], self.at[end - self.first]) if inside else None


def tokenise(heard: Utterance) -> Tokens:
    """The request's last tokens as ids."""
    first = max(0, len(heard.tokens) - MOST_TOKENS)
    ids, at = [BEGIN], [1]
    for token in heard.tokens[first:]:
        pieces = reader().pieces(token)
        if len(ids) + len(pieces) >= MOST_PIECES:
            break
        ids.extend(pieces)
        at.append(len(ids))
    return Tokens([*ids, END], at, first)


class Spoken(NamedTuple):
    """A name in the words, and how strongly it speaks for its object, or against."""

    mention: Mention
    weight: float


class Judgement(NamedTuple):
    """What a request calls for.

    ``logits`` (n,) for each card, without the names that were said; ``nothing`` is the logit that no thing is wanted.
    ``spoken`` are the names said, by their keys; ``queries`` (s, 384) the unit vectors of the request and its
    sentences, ``lean`` (s,) how much each counts; ``sentences`` the words of each, and ``fits`` what each card's uses
    share with them.
    """

    logits: Array
    nothing: float
    spoken: dict[str, Spoken]
    queries: Array
    lean: Array
    sentences: list[str]
    fits: dict[int, Fit]


def soft_max(values: Array, sharpness: float, axis: int = -1) -> Array:
    """The smooth maximum log(sum(exp(s·v)))/s."""
    top = values.max(axis, keepdims=True)
    smooth: Array = np.log(np.exp(sharpness * (values - top)).sum(axis)) / sharpness + np.squeeze(top, axis)
    return smooth


@cache
def upper_layers() -> Any:
    """The trained layers that ship: half-way states (t, 384) to states (t, 384)."""
    return session((SHIPPED / "scorer.onnx").read_bytes())


@lru_cache(maxsize=16)
def half_way(ids: tuple[int, ...]) -> Array:
    """(t, 384) the half-way states of pieces; the parse and the need of one request mostly have the same."""
    return reader().states(ids)


class Scorer:
    """Judges requests over the cards of a deck."""

    def __init__(self, deck: Deck, folder: Path = SHIPPED) -> None:
        self.deck = deck
        self._folder = folder
        names = [w for card in deck.cards for n in card.names for w in words(plain(n))]
        likely = [w for w, n in deck.used.most_common() if n > 1]
        self._spelling = Spelling(reader().vocabulary | deck.used.keys(), [*sorted(STOP), *names], likely)

    @cached_property
    def lexicon(self) -> Lexicon:
        """The words of the cards' uses; only needs ask for it."""
        return Lexicon(self.deck)

    @cached_property
    def knowledge(self) -> Knowledge:
        """The vectors of the cards' texts; only needs ask for them."""
        return Knowledge(self.deck, self._folder / VECTORS.name)

    @cached_property
    def _layers(self) -> Any:
        return session((self._folder / "scorer.onnx").read_bytes())

    def _states(self, ids: list[int]) -> Array:
        """(t, 384) states of the upper layers."""
        if self._folder == SHIPPED:
            return upper_layers().run(None, {"states": half_way(tuple(ids))})[0]  # type: ignore[no-any-return]
        states: Array = self._layers.run(None, {"states": reader().states(ids)})[0]
        return states

    @cached_property
    def _heads(self) -> dict[str, Array]:
        with np.load(self._folder / "scorer.npz", allow_pickle=False) as data:
            return {name: data[name].astype(np.float32) for name in data.files}

    def hear(self, text: str) -> Utterance:
        """A request's tokens and sentences, slips of the keyboard mended."""
        return listen(text, self._spelling)

    def judge(self, heard: Utterance, known: Container[str]) -> Judgement:
        """What a request calls for; ``known`` are the keys of all names to listen for."""
        heads = self._heads
        tokens = tokenise(heard)
        states = self._states(tokens.ids)
        said = list(mentions(heard, known))
        alone = 0.0 if len(heard.sentences) > 1 else ALONE if len({m.key for m in said}) == 1 else ALONE / 2
        spoken: dict[str, Spoken] = {}
        for mention in said:
            span = tokens.span(mention.start, mention.end)
            if span is not None:
                weight = _wanted(states[slice(*span)].mean(0), heads)
                weight += -alone if mention.unwanted else alone
                if mention.key not in spoken or weight > spoken[mention.key].weight:
                    spoken[mention.key] = Spoken(mention, weight)
        attention = np.exp(states @ heads["pool"] - (states @ heads["pool"]).max())
        whole = attention @ states / attention.sum()
        queries, lean, sentences = [whole], [0.0], [" ".join(heard.tokens)]
        for sentence in heard.sentences[-MOST_SENTENCES:] if len(heard.sentences) > 1 else ():
            span = tokens.span(sentence.at[0], sentence.at[-1] + 1)
            if span is not None:
                queries.append(states[slice(*span)].mean(0))
                lean.append(float(queries[-1] @ heads["lean.weight"] + heads["lean.bias"]))
                sentences.append(" ".join(sentence.words))
        vectors = np.stack(queries)
        vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True) @ heads["turn"]
        fits = self.lexicon.fits(heard.sentences, turned_down(said))
        logits = self._meaning(vectors, np.array(lean), heads)
        for card, fit in fits.items():
            logits[card] += heads["lexical"] * fit.score
        nothing = float(whole @ heads["nothing.weight"] + heads["nothing.bias"])
        return Judgement(logits, nothing, spoken, vectors, np.array(lean), sentences, fits)

    def _meaning(self, queries: Array, lean: Array, heads: dict[str, Array]) -> Array:
        sharp = float(heads["sharpness"])
        uses = _by_card(queries @ self.knowledge.uses.T, self.knowledge.use_starts, sharp)
        names = _by_card(queries @ self.knowledge.names.T, self.knowledge.name_starts, sharp)
        met = uses + heads["name"] * names + lean[:, None]
        logits: Array = heads["scale"] * soft_max(met, sharp, axis=0)
        return logits

    def strange(self, judged: Judgement, name: Array) -> float:
        """The logit of an object without a card, by its name's vector."""
        heads = self._heads
        sharp = float(heads["sharpness"])
        named = judged.queries @ name
        met = heads["guess.name"] * named + heads["guess.bias"] + judged.lean
        return float(heads["scale"] * soft_max(met, sharp))

    def why(self, judged: Judgement, card: int) -> str:
        """The sentence that called for a card's object."""
        start = int(self.knowledge.use_starts[card])
        uses = self.knowledge.uses[start : start + len(self.deck.cards[card].uses)]
        met = (judged.queries @ uses.T).max(1) + judged.lean
        return judged.sentences[int(met.argmax())]


def _by_card(cosines: Array, starts: Array, sharp: float) -> Array:
    """The smooth maximum over the texts of each card: (s, texts) to (s, cards)."""
    return np.log(np.add.reduceat(np.exp(sharp * cosines), starts, axis=1)) / sharp


def _wanted(state: Array, heads: dict[str, Array]) -> float:
    """How strongly a name is asked for, by the states of its tokens."""
    inner = state @ heads["wanted1.weight"] + heads["wanted1.bias"]
    gelu = 0.5 * inner * (1 + np.vectorize(math.erf)(inner / math.sqrt(2)))
    return float(gelu @ heads["wanted2.weight"] + heads["wanted2.bias"])
