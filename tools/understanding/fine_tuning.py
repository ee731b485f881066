"""Layers of the parser's own in torch, their training and their way into the file that ships, for fine_tune.py."""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))
import onnx
import torch
import torch.nn.functional as fn
from onnx import numpy_helper
from parser_training import Network, Ready, known, marked
from samples import Sample, act_only, hidden_alarms, joined, needs, routed, templated, varied, written
from torch import Tensor, nn
from train_parser import ROUTE_TAGS, WRITTEN

from cartier.understanding.adapters import adapted
from cartier.understanding.need_scorer import SHIPPED
from cartier.understanding.parser import CHANGES, FITTED, Pieces, pieces_of
from cartier.understanding.text_encoder import WIDTH, reader

BATCH, RATE, TOP_RATE, DROPOUT, UNREAD, RANK, HEADS = 128, 1e-4, 4e-4, 0.1, 0.02, 64, 12
UNKNOWN, SPECIAL = 100, 103  # id of a word that cannot be read; up to this are ids of no words
LAYERS = range(2, 6)
JOINED, NEEDS = 3000, 7000  # pairs of requests in one breath, and requests that name nothing, of each pass


def floats(model: bytes) -> dict[str, np.ndarray]:
    """The weights of the layers in ``model``, matrices as (in, out)."""
    raw = {i.name: numpy_helper.to_array(i) for i in onnx.load_from_string(model).graph.initializer}
    found = {name: v for name, v in raw.items() if name.startswith("encoder.") and not name.endswith(("int8", "scale"))}
    matrices = [name.removesuffix(".int8") for name in raw if name.endswith(".int8")]
    return found | {name: raw[f"{name}.int8"] * raw[f"{name}.scale"] for name in matrices}


class Layers(nn.Module):
    """Four layers of the encoder, from half-way states (b, t, 384) to states."""

    def __init__(self, weights: dict[str, np.ndarray]) -> None:
        super().__init__()
        kept = {name.replace(".", "/"): nn.Parameter(torch.tensor(v)) for name, v in weights.items()}
        self.weights = nn.ParameterDict(kept)

    def forward(self, x: Tensor, there: Tensor) -> Tensor:
        b, t, _ = x.shape
        for number in LAYERS:
            layer = f"encoder.layer.{number}."
            query, key, value = (
                self._linear(x, f"{layer}attention.self.{part}").view(b, t, HEADS, -1).transpose(1, 2)
                for part in ("query", "key", "value")
            )
            mixed = fn.scaled_dot_product_attention(query, key, value, attn_mask=there[:, None, None])
            attended = self._linear(mixed.transpose(1, 2).reshape(x.shape), f"{layer}attention.output.dense")
            x = self._norm(x + fn.dropout(attended, DROPOUT, self.training), f"{layer}attention.output.LayerNorm")
            inner = fn.gelu(self._linear(x, f"{layer}intermediate.dense"))
            inner = fn.dropout(self._linear(inner, f"{layer}output.dense"), DROPOUT, self.training)
            x = self._norm(x + inner, f"{layer}output.LayerNorm")
        return x

    def _w(self, name: str) -> Tensor:
        return self.weights[name.replace(".", "/")]

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return x @ self._w(name) + self._w(f"{name}.bias")

    def _norm(self, x: Tensor, name: str) -> Tensor:
        return fn.layer_norm(x, (WIDTH,), self._w(f"{name}.weight"), self._w(f"{name}.bias"), 1e-12)


def changes(old: dict[str, np.ndarray], new: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of parser_layers.npz: for each matrix two int8 factors of the difference, and the vectors."""
    found = dict[str, np.ndarray]()
    for name, weight in new.items():
        if weight.ndim == 1:
            found[name] = weight.astype(np.float32)
            continue
        left, values, right = np.linalg.svd(weight.astype(np.float64) - old[name], full_matrices=False)
        root = np.sqrt(values[:RANK])
        for part, factor, axis in (("down", left[:, :RANK] * root, 0), ("up", root[:, None] * right[:RANK], 1)):
            step = np.maximum(np.abs(factor).max(axis, keepdims=True), 1e-12) / 127
            found[f"{name}.{part}"] = np.rint(factor / step).astype(np.int8)
            found[f"{name}.{part}.scale"] = step.astype(np.float32)
    return found


def batch(layers: Layers, some: list[tuple[Pieces, Sample]], device: str, rng: random.Random) -> list[Ready]:
    """Samples with what the layers make of their words, some of which cannot be read."""
    ids = [[UNKNOWN if i > SPECIAL and rng.random() < UNREAD else i for i in read.ids] for read, _ in some]
    longest = max(map(len, ids))
    low = [fn.pad(torch.tensor(reader().states(i)), (0, 0, 0, longest - len(i))) for i in ids]
    there = torch.tensor([[True] * len(i) + [False] * (longest - len(i)) for i in ids], device=device)
    half_way = torch.stack(low).to(device)
    states = torch.cat([half_way, layers(half_way, there)], 2)
    return [
        marked(sample, torch.cat([states[k, read.at], torch.tensor(read.bits, device=device)], 1), read.own)
        for k, (read, sample) in enumerate(some)
    ]


def lines(learnt: list[Sample], templates: int, rng: random.Random) -> list[Sample]:
    """The lines of one pass: as written, and varied beside templates, needs and lines with an act alone."""
    about_routes = [s for s in learnt if s.tags is not None and ROUTE_TAGS & set(s.tags)]
    made = [*templated(templates, rng.randrange(10**6)), *routed(templates, rng.randrange(10**6))]
    others = [*made, *act_only(), *hidden_alarms(rng), *rng.sample(needs(), NEEDS), *joined(learnt, JOINED, rng)]
    return [*learnt, *(varied(s, rng) for s in [*learnt, *about_routes * 2, *others])]


def train(passes: int, templates: int, most: int | None, held: set[Path], out: Path) -> None:
    """Go on from what ships, and write the weights to a folder; ``most`` lines alone where it is given."""
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    rng, device = random.Random(0), "cuda" if torch.cuda.is_available() else "cpu"
    learnt = written(sorted(file for file in WRITTEN.glob("*.txt") if file.resolve() not in held))
    scorers = (SHIPPED / "scorer.onnx").read_bytes()
    layers, network = Layers(floats(adapted(scorers, CHANGES))).to(device), Network().to(device)
    network.load(FITTED)
    parts = [{"params": layers.parameters(), "rate": RATE}, {"params": network.parameters(), "rate": TOP_RATE}]
    optimiser, began, step = torch.optim.AdamW(parts, weight_decay=0.01), time.perf_counter(), 0
    for number in range(passes):
        some = lines(learnt, templates, rng)
        some = rng.sample(some, most) if most else some
        read = [(pieces_of(s.tokens, s.before, known(s)), s) for s in some if s.tokens]
        read.sort(key=lambda one: len(one[0].ids) + rng.random() * 8)
        batches = [read[k : k + BATCH] for k in range(0, len(read), BATCH)]
        for done, one in enumerate(rng.sample(batches, len(batches))):
            slope = max(1 - (number + done / len(batches)) / passes, 0.02) * min((step + 1) / 150, 1)
            for group in optimiser.param_groups:
                group["lr"] = group["rate"] * slope
            loss = network.loss(batch(layers, one, device, rng))
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_([*layers.parameters(), *network.parameters()], 1.0)
            optimiser.step()
            step += 1
            if step % 100 == 0:
                took = time.perf_counter() - began
                print(f"pass {number + 1}, step {step}: {loss.item():.3f}, {took:.0f} s", flush=True)
    new = {name.replace("/", "."): value.detach().cpu().numpy() for name, value in layers.weights.items()}
    np.savez(out / CHANGES.name, **changes(floats(scorers), new))
    with np.load(FITTED, allow_pickle=False) as kept:
        network.save(out / FITTED.name, float(kept["temperature"]))
