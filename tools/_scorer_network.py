"""Network of the embedded reasoner's scorer in torch, for training, and its way into the files that ship."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnx
import torch
import torch.nn.functional as fn
from build_text_encoder import HEADS, LAYERS, WIDTH, Graph
from onnx import TensorProto, helper
from scorer_requests import Sample
from torch import Tensor, nn

from cartier.understanding.card_vectors import pack
from cartier.understanding.lexical import turned_down
from cartier.understanding.need_scorer import MOST_SENTENCES, Scorer, tokenise
from cartier.understanding.utterance import mentions

FROZEN = 2  # layers of the shipped encoder that stay as they are; _reading.HALF_WAY is the last one's output
DROPOUT = 0.1
NOWHERE = -1e9


class Read(NamedTuple):
    """A text as the network sees it: ids, names said (card, begin, end), sentences (begin, end), lexical fits."""

    ids: list[int]
    names: list[tuple[int, int, int]]
    sentences: list[tuple[int, int]]
    fits: dict[int, float]


class Texts:
    """Texts read with the very functions that the reasoner uses, each once."""

    def __init__(self, scorer: Scorer) -> None:
        self.scorer = scorer
        self.read = cache(self._read)

    def _read(self, text: str) -> Read:
        deck = self.scorer.deck
        heard = self.scorer.hear(text)
        tokens = tokenise(heard)
        said = {m: tokens.span(m.start, m.end) for m in mentions(heard, deck.by_key)}
        names = [(deck.by_key[m.key], *span) for m, span in said.items() if span]
        last = heard.sentences[-MOST_SENTENCES:] if len(heard.sentences) > 1 else []
        spans = [tokens.span(s.at[0], s.at[-1] + 1) for s in last]
        fits = self.scorer.lexicon.fits(heard.sentences, turned_down(said))
        return Read(tokens.ids, names, [s for s in spans if s], {card: fit.score for card, fit in fits.items()})


class Network(nn.Module):
    """all-MiniLM-L6-v2 with its upper layers to be trained, and the heads on top (see cartier/reasoners/_scorer.py)."""

    def __init__(self, weights: dict[str, np.ndarray], scorer: Scorer) -> None:
        super().__init__()
        kept = {k: torch.tensor(v) for k, v in weights.items() if k.startswith(("encoder.layer.", "embeddings."))}
        self.weights = nn.ParameterDict(
            {k.replace(".", "/"): nn.Parameter(v, requires_grad=_layer(k) >= FROZEN) for k, v in kept.items()}
        )
        self.texts = Texts(scorer)
        knowledge = scorer.knowledge
        uses, self.has_use = _padded(knowledge.uses, knowledge.use_starts)
        names, self.has_name = _padded(knowledge.names, knowledge.name_starts)
        self.cards = nn.ParameterDict({"uses": nn.Parameter(uses), "names": nn.Parameter(names)})
        self.pool = nn.Parameter(torch.zeros(WIDTH))
        self.turn = nn.Parameter(torch.eye(WIDTH))
        self.lean, self.nothing = nn.Linear(WIDTH, 1), nn.Linear(WIDTH, 1)
        self.wanted1, self.wanted2 = nn.Linear(WIDTH, 32), nn.Linear(32, 1)
        self.sharpness, self.scale = nn.Parameter(torch.tensor(3.0)), nn.Parameter(torch.tensor(3.0))  # logarithms
        self.name, self.lexical = nn.Parameter(torch.tensor(0.5)), nn.Parameter(torch.tensor(2.0))
        for linear, bias in ((self.lean, -0.1), (self.nothing, 8.0), (self.wanted2, 6.0)):
            nn.init.zeros_(linear.weight)
            nn.init.constant_(linear.bias, bias)

    def forward(self, samples: list[Sample]) -> tuple[Tensor, Tensor]:
        """Logits (b, cards) of all cards, and (b,) of nothing."""
        reads = [self.texts.read(s.text) for s in samples]
        states, mask = self._states([r.ids for r in reads])
        attention = torch.softmax((states @ self.pool).masked_fill(~mask, NOWHERE), 1)
        whole = (states * attention[..., None]).sum(1)
        spans = [(i, *span) for i, r in enumerate(reads) for span in r.sentences]
        sentences = [states[i, begin:end].mean(0) for i, begin, end in spans]
        queries = torch.cat([whole, torch.stack(sentences)]) if sentences else whole
        lean = torch.cat([torch.zeros(len(whole)), self.lean(queries[len(whole) :])[:, 0]])
        owner = [*range(len(whole)), *(i for i, _, _ in spans)]
        logits = self._meaning(queries, lean, owner, [s.use for s in samples])
        fits = torch.zeros_like(logits)
        for i, (read, sample) in enumerate(zip(reads, samples, strict=True)):
            if read.fits and sample.use is None:  # a use would meet itself
                fits[i, list(read.fits)] = torch.tensor(list(read.fits.values()))
        logits = logits + self.lexical * fits
        called = [(i, *name) for i, r in enumerate(reads) for name in r.names]
        if called:
            logits = self._called(logits, states, called)
        return logits, self.nothing(whole)[:, 0]

    def _states(self, ids: list[list[int]]) -> tuple[Tensor, Tensor]:
        longest = max(map(len, ids))
        padded = torch.tensor([i + [0] * (longest - len(i)) for i in ids])
        mask = torch.tensor([[True] * len(i) + [False] * (longest - len(i)) for i in ids])
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.training):
            with torch.no_grad():
                x = self._w("embeddings.word_embeddings.weight")[padded]
                x = x + self._w("embeddings.position_embeddings.weight")[:longest]
                x = self._norm(x + self._w("embeddings.token_type_embeddings.weight")[0], "embeddings.LayerNorm")
                for i in range(FROZEN):
                    x = self._layer(x, mask, i, 0.0)
            for i in range(FROZEN, LAYERS):
                x = self._layer(x, mask, i, DROPOUT if self.training else 0.0)
        return x.float(), mask

    def _w(self, name: str) -> Tensor:
        return self.weights[name.replace(".", "/")]

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return fn.linear(x, self._w(f"{name}.weight"), self._w(f"{name}.bias"))

    def _norm(self, x: Tensor, name: str) -> Tensor:
        return fn.layer_norm(x, (WIDTH,), self._w(f"{name}.weight"), self._w(f"{name}.bias"), 1e-12)

    def _layer(self, x: Tensor, mask: Tensor, number: int, dropout: float) -> Tensor:
        name, (b, t, _) = f"encoder.layer.{number}.", x.shape
        query, key, value = (
            self._linear(x, f"{name}attention.self.{part}").view(b, t, HEADS, WIDTH // HEADS).transpose(1, 2)
            for part in ("query", "key", "value")
        )
        mixed = fn.scaled_dot_product_attention(query, key, value, attn_mask=mask[:, None, None])
        attended = self._linear(mixed.transpose(1, 2).reshape(b, t, WIDTH), f"{name}attention.output.dense")
        x = self._norm(x + fn.dropout(attended, dropout), f"{name}attention.output.LayerNorm")
        inner = self._linear(fn.gelu(self._linear(x, f"{name}intermediate.dense")), f"{name}output.dense")
        return self._norm(x + fn.dropout(inner, dropout), f"{name}output.LayerNorm")

    def _meaning(self, queries: Tensor, lean: Tensor, owner: list[int], uses: list[tuple[int, int] | None]) -> Tensor:
        """Logits (b, cards) by what the words mean; ``owner`` tells which sample each query belongs to."""
        sharp, n = self.sharpness.exp(), len(queries)
        turned = fn.normalize(queries, dim=-1) @ self.turn
        met_uses = (
            (turned @ self.cards["uses"].view(-1, WIDTH).T)
            .view(n, *self.has_use.shape)
            .masked_fill(~self.has_use, -9.0)
        )
        own = [(q, *use) for q, i in enumerate(owner) if (use := uses[i]) is not None]
        if own:
            met_uses[tuple(torch.tensor(column) for column in zip(*own, strict=True))] = -9.0
        met_names = (turned @ self.cards["names"].view(-1, WIDTH).T).view(n, *self.has_name.shape)
        met_names = met_names.masked_fill(~self.has_name, -9.0)
        met = (torch.logsumexp(met_uses * sharp, -1) + self.name * torch.logsumexp(met_names * sharp, -1)) / sharp
        met = torch.cat([met + lean[:, None], torch.full((1, met.shape[1]), -9.0)])
        of_sample = [[q for q, i in enumerate(owner) if i == sample] for sample in range(len(uses))]
        most = max(map(len, of_sample))
        table = torch.tensor([rows + [n] * (most - len(rows)) for rows in of_sample])
        return self.scale.exp() * torch.logsumexp(met[table] * sharp, 1) / sharp

    def _called(self, logits: Tensor, states: Tensor, called: list[tuple[int, int, int, int]]) -> Tensor:
        """The logits with the names that were said; of several that mean one card, the strongest."""
        seen = torch.stack([states[i, begin:end].mean(0) for i, _, begin, end in called])
        weights = self.wanted2(fn.gelu(self.wanted1(seen)))[:, 0]
        best: dict[tuple[int, int], int] = {}
        for k, (i, card, *_) in enumerate(called):
            if (i, card) not in best or weights[k] > weights[best[i, card]]:
                best[i, card] = k
        where = tuple(torch.tensor(column) for column in zip(*best, strict=True))
        return logits.index_put(where, weights[list(best.values())], accumulate=True)


def _layer(name: str) -> int:
    parts = name.split(".")
    return int(parts[2]) if parts[0] == "encoder" else -1


def _padded(rows: np.ndarray, starts: np.ndarray) -> tuple[Tensor, Tensor]:
    """Rows of each card side by side (cards, most, 384), and which of them there are."""
    counts = np.diff([*starts, len(rows)])
    padded = np.zeros((len(starts), counts.max(), WIDTH), np.float32)
    there = np.arange(counts.max()) < counts[:, None]
    padded[there] = rows
    return torch.tensor(padded), torch.tensor(there)


def save(network: Network, folder: Path) -> None:
    """scorer.onnx (the trained layers, int8), scorer.npz (the heads) and vectors.npz (the cards)."""
    weights = {name.replace("/", "."): value.detach().numpy() for name, value in network.weights.items()}
    graph, x = Graph(weights, exact=False), "states"
    for i in range(FROZEN, LAYERS):
        layer = f"encoder.layer.{i}."
        attended = graph.linear(graph.attention(x, layer), layer + "attention.output.dense")
        x = graph.norm(graph.op("Add", x, attended), layer + "attention.output.LayerNorm")
        inner = graph.op("Gelu", graph.linear(x, layer + "intermediate.dense"))
        x = graph.norm(graph.op("Add", x, graph.linear(inner, layer + "output.dense")), layer + "output.LayerNorm")
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["t", WIDTH]) for name in ("states", x)]
    whole = helper.make_graph(graph.nodes, "scorer", ends[:1], ends[1:], list(graph.constants.values()))
    model = helper.make_model(whole, opset_imports=[helper.make_opsetid("", 20)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, folder / "scorer.onnx")
    heads = {"pool": network.pool, "turn": network.turn, "name": network.name, "lexical": network.lexical}
    heads |= {"sharpness": network.sharpness.exp(), "scale": network.scale.exp()}
    for name in ("lean", "nothing", "wanted1", "wanted2"):
        linear = getattr(network, name)
        heads[f"{name}.weight"], heads[f"{name}.bias"] = linear.weight.T.squeeze(-1), linear.bias.squeeze()
    arrays = {name: tensor.detach().numpy().astype(np.float32) for name, tensor in heads.items()}
    np.savez(folder / "scorer.npz", **arrays, **_guess(network))
    _save_vectors(network, folder / "vectors.npz")


def _save_vectors(network: Network, file: Path) -> None:
    """Every text of the cards and its vector, which training has moved."""
    scorer = network.texts.scorer
    texts = [*scorer.knowledge.use_texts, *(name for card in scorer.deck.cards for name in card.names)]
    uses, names = network.cards["uses"][network.has_use], network.cards["names"][network.has_name]
    rows = dict(zip(texts, torch.cat([uses, names]).detach().numpy(), strict=True))
    np.savez(file, **pack(rows, np.stack(list(rows.values()))))


def _guess(network: Network) -> dict[str, np.ndarray]:
    """How well a thing without a card is met, from how its name is: a line through what holds for things with cards."""
    with torch.no_grad():
        rng = np.random.default_rng(0)
        cards = rng.choice(len(network.has_name), 200, replace=False)
        texts = [Sample(card.uses[0], ()) for card in (network.texts.scorer.deck.cards[c] for c in cards)]
        states, mask = network._states([network.texts.read(t.text).ids for t in texts])
        attention = torch.softmax((states @ network.pool).masked_fill(~mask, NOWHERE), 1)
        queries = fn.normalize((states * attention[..., None]).sum(1), dim=-1) @ network.turn
        sharp = network.sharpness.exp()
        met_uses = torch.einsum("qd,cud->qcu", queries, network.cards["uses"][cards]).masked_fill(
            ~network.has_use[cards], -9.0
        )
        met_names = torch.einsum("qd,cud->qcu", queries, network.cards["names"][cards]).masked_fill(
            ~network.has_name[cards], -9.0
        )
        met_uses[range(len(cards)), range(len(cards)), 0] = -9.0
        met = (torch.logsumexp(met_uses * sharp, -1) + network.name * torch.logsumexp(met_names * sharp, -1)) / sharp
        named = met_names[..., 0]
        others = rng.random(met.shape) < 5 / len(cards)
        pick = torch.tensor(others | np.eye(len(cards), dtype=bool))
        slope, offset = np.polyfit(named[pick].numpy(), met[pick].numpy(), 1)
    return {"guess.name": np.float32(slope), "guess.bias": np.float32(offset)}
