"""Network of the parser in torch, its training and its report, as train_parser.py starts them."""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as fn

sys.path.append(str(Path(__file__).parent))
from check_marks import home
from samples import Sample
from torch import Tensor, nn

from cartier.spatial.expressions import EntityVocabulary
from cartier.understanding.decoding import spans_of
from cartier.understanding.entity_vocabulary import known_anywhere
from cartier.understanding.parser import BITS, HEADS, LAYERS, TAG_OF, words_of
from cartier.understanding.parser import Parser as Fitted
from cartier.understanding.tags import ACTS, TAGS

INPUT, WIDTH, INNER, PLACES = 2 * 384 + BITS, 192, 576, 64
BATCH, RATE, DECAY, WARM_UP, DROPOUT = 32, 8e-4, 0.02, 200, 0.2


class Ready(NamedTuple):
    """A sample as the network sees it: inputs (n, INPUT) in half precision, tags of its own words or None, and clauses
    (begin, end) among all words with their allowed acts."""

    inputs: Tensor
    own: int
    tags: list[int] | None
    clauses: list[tuple[int, int, Tensor]]


def ready(sample: Sample) -> Ready | None:
    """A sample with the states of its words."""
    if not sample.tokens:
        return None
    words = words_of(sample.tokens, sample.before, known(sample))
    inputs = torch.tensor(np.concatenate([words.states, words.bits], 1)).half()
    return marked(sample, inputs, words.own)


def known(sample: Sample) -> EntityVocabulary:
    """The names in a sample's home, or those known without one."""
    return home(sample.home)[1] if sample.home else known_anywhere()


def marked(sample: Sample, inputs: Tensor, own: int) -> Ready:
    """Inputs (n, anything) of a sample's words with its tags and acts."""
    count = len(inputs) - own
    first = len(sample.tokens) - count
    tags = None if sample.tags is None else [TAG_OF[tag] for tag in sample.tags[first:]]
    marks = (sample.tags or ("O",) * len(sample.tokens))[first:]
    cuts = [k for k, tag in enumerate(marks) if tag == "B-/"]
    parts = list(zip([0, *(k + 1 for k in cuts)], [*cuts, count], strict=True))
    acts = sample.acts[len(sample.acts) - len(parts) :]
    found = [
        (own + a, own + b, torch.tensor([act in allowed for act in ACTS]))
        for (a, b), allowed in zip(parts, acts, strict=True) if b > a
    ]  # fmt: skip
    return Ready(inputs, own, tags, found)


class Network(nn.Module):
    """The layers of ``understanding.parser.Parser``, with its names."""

    def __init__(self) -> None:
        super().__init__()
        self.begin, self.end = nn.Linear(INPUT, WIDTH), nn.LayerNorm(WIDTH)
        self.places = nn.Parameter(torch.randn(PLACES, WIDTH) * 0.02)
        self.layers = nn.ModuleList(
            nn.ModuleDict({
                "norm1": nn.LayerNorm(WIDTH), "norm2": nn.LayerNorm(WIDTH), "up": nn.Linear(WIDTH, INNER),
                "down": nn.Linear(INNER, WIDTH), **{part: nn.Linear(WIDTH, WIDTH) for part in "qkvo"},
            })
            for _ in range(LAYERS)
        )  # fmt: skip
        self.tag, self.act = nn.Linear(WIDTH, len(TAGS)), nn.Linear(2 * WIDTH, len(ACTS))
        self.pool = nn.Parameter(torch.zeros(WIDTH))

    def forward(self, inputs: list[Tensor]) -> Tensor:
        """(b, t, width) states; the words of shorter samples stand at the end."""
        longest = max(map(len, inputs))
        x = torch.stack([fn.pad(i.float(), (0, 0, longest - len(i), 0)) for i in inputs])
        there = torch.tensor([[False] * (longest - len(i)) + [True] * len(i) for i in inputs], device=x.device)
        x = fn.dropout(self.begin(fn.dropout(x, 0.1, self.training)), DROPOUT, self.training)
        x = x + self.places[torch.arange(longest).flip(0).clamp(max=PLACES - 1)]
        for layer in self.layers:
            y = layer["norm1"](x)
            q, k, v = (layer[p](y).view(*y.shape[:2], HEADS, -1).transpose(1, 2) for p in "qkv")
            mixed = fn.scaled_dot_product_attention(q, k, v, attn_mask=there[:, None, None])
            x = x + fn.dropout(layer["o"](mixed.transpose(1, 2).reshape(y.shape)), DROPOUT, self.training)
            inner = layer["down"](fn.dropout(fn.relu(layer["up"](layer["norm2"](x))), DROPOUT, self.training))
            x = x + fn.dropout(inner, DROPOUT, self.training)
        states: Tensor = self.end(x)
        return states

    def loss(self, samples: list[Ready]) -> Tensor:
        """The mean surprise at the tags and at the acts."""
        states = self([s.inputs for s in samples])
        said, tags, pooled, allowed = list[Tensor](), list[int](), list[Tensor](), list[Tensor]()
        for k, sample in enumerate(samples):
            own = states[k, states.shape[1] - len(sample.inputs) :]
            if sample.tags is not None:
                said.append(own[sample.own :])
                tags += sample.tags
            for begin, end, acts in sample.clauses:
                pooled.append(torch.cat([own[0], torch.softmax(own[begin:end] @ self.pool, 0) @ own[begin:end]]))
                allowed.append(acts)
        shares = self.act(torch.stack(pooled)).log_softmax(-1)
        loss = -shares.masked_fill(~torch.stack(allowed).to(shares.device), -1e9).logsumexp(-1).mean()
        if said:
            right = torch.tensor(tags, device=loss.device)
            loss = loss + 3 * fn.cross_entropy(self.tag(torch.cat(said)), right, label_smoothing=0.02)
        return loss

    def load(self, file: Path) -> None:
        """Take on weights that ``save`` wrote."""
        with np.load(file, allow_pickle=False) as kept:
            self.load_state_dict({name: torch.tensor(kept[name]).float() for name in self.state_dict()})

    def save(self, file: Path, temperature: float = 1.0) -> None:
        """Write the weights in half precision."""
        weights = {name: value.detach().cpu().numpy().astype(np.float16) for name, value in self.state_dict().items()}
        np.savez(file, **weights, temperature=np.float32(temperature))


def train(samples: list[Ready], passes: int, seed: int = 0, begin: Path | None = None) -> Network:
    """A network that learned from samples; ``begin`` are weights that it goes on from, at half the rate."""
    torch.manual_seed(seed)
    rng, network = random.Random(seed), Network().train()
    rate = RATE if begin is None else RATE / 2
    if begin is not None:
        network.load(begin)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=DECAY)
    steps, step, losses, began = passes * -(-len(samples) // BATCH), 0, list[float](), time.perf_counter()
    for _ in range(passes):
        order = sorted(samples, key=lambda s: len(s.inputs) + rng.random() * 6)
        batches = [order[k : k + BATCH] for k in range(0, len(order), BATCH)]
        rng.shuffle(batches)
        for batch in batches:
            for group in optimiser.param_groups:
                group["lr"] = rate * min((step + 1) / WARM_UP, 1) * max(1 - step / steps, 0.02)
            loss = network.loss(batch)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            step += 1
            losses.append(loss.item())
            if step % 200 == 0:
                took = time.perf_counter() - began
                print(f"step {step} of {steps}: loss {np.mean(losses[-200:]):.3f}, {took:.0f} s", flush=True)
    return network.eval()


def temperature(network: Network, samples: list[Ready]) -> float:
    """The temperature of the acts' logits at which held-out clauses surprise least."""
    logits, allowed = list[Tensor](), list[Tensor]()
    with torch.no_grad():
        for sample in samples:
            own = network([sample.inputs])[0]
            for begin, end, acts in sample.clauses:
                pooled = torch.cat([own[0], torch.softmax(own[begin:end] @ network.pool, 0) @ own[begin:end]])
                logits.append(network.act(pooled))
                allowed.append(acts)
    scores, right = torch.stack(logits), torch.stack(allowed)

    def surprise(degree: float) -> float:
        shares = (scores / degree).log_softmax(-1)
        return float(-shares.masked_fill(~right, -1e9).logsumexp(-1).mean())

    return min((float(t) for t in np.arange(0.5, 6.05, 0.05)), key=surprise)


def report(fitted: Fitted, samples: list[Sample], name: str) -> None:
    """How much of held-out lines is read as marked, and how far certainties are from shares of right acts."""
    acts, lines, hits, said, right, sure = list[bool](), 0, 0, 0, 0, list[float]()
    for sample in samples:
        found = fitted(sample.tokens, sample.before, home(sample.home)[1] if sample.home else known_anywhere())
        acts += [len(found) == len(sample.acts) and f.act in a for f, a in zip(found, sample.acts, strict=False)]
        sure += [f.certainty for f, _ in zip(found, sample.acts, strict=False)]
        got = {(s.role, s.words) for clause in found for s in clause.spans}
        true = {(s.role, s.words) for s in spans_of(sample.tokens, sample.tags or ()) if s.role != "/"}
        lines += got == true
        hits, said, right = hits + len(got & true), said + len(got), right + len(true)
    f1 = 2 * hits / max(said + right, 1)
    print(
        f"{name}: {len(samples)} lines; act {np.mean(acts):.1%}, every span {lines / len(samples):.1%}, F1 {f1:.3f}, "
        f"calibration error {calibration_error(sure, acts):.3f}"
    )


def calibration_error(certainties: list[float], right: list[bool], bins: int = 10) -> float:
    """Expected calibration error (Guo et al., 2017): the mean gap of certainty and share of right in equal bins."""
    sure, hit = np.array(certainties), np.array(right, float)
    of = np.minimum((sure * bins).astype(int), bins - 1)
    return float(sum(abs(sure[of == k].sum() - hit[of == k].sum()) for k in range(bins)) / len(sure))
