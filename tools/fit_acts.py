"""Fit the speech-act networks (understanding/acts.npz) on tools/alarms and on the requests of tools/requests.

    python tools/fit_acts.py [--write]

A quarter of the lines, by the checksums of their texts, is reported on by networks that were fitted on the others. With
``--write``, networks that were fitted on all lines are saved.
"""

from __future__ import annotations

import json
import sys
import zlib
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

from cartier.types import Array
from cartier.understanding.act_classifier import FITTED, KINDS, Networks, features, parts_of
from cartier.understanding.act_patterns import WIDTH as PATTERNS

TOOLS = Path(__file__).parent
HELD_BACK = ("grumpy", "hosts", "newcomer", "others_past", "transcript", "wheels")
NETWORKS, HIDDEN, EPOCHS, BATCH, DROP = 4, 64, 20, 256, 0.3
RATE, DECAY, SMOOTH = 2e-3, 1e-2, 0.05
DENSE_SCALE = 0.5  # of the encoder's features beside the patterns'
PARTS, WHOLE = 16000, 1500  # of requests
THRESHOLD = 0.55  # at which of 590 requests in tools/things/development.jsonl one is taken for an alarm


def held_out(text: str) -> bool:
    return zlib.crc32(("h" + text).encode()) % 4 == 0


def written() -> dict[str, list[str]]:
    """The lines of tools/alarms by their file."""
    return {p.stem: p.read_text(encoding="utf-8").splitlines() for p in sorted((TOOLS / "alarms").glob("*.txt"))}


def requests() -> list[str]:
    """Ordinary requests to learn from, whole and in parts, none of the styles that are held back."""
    learnt: list[str] = []
    for file in sorted((TOOLS / "requests").glob("*.jsonl")):
        texts = [json.loads(line)["text"] for line in file.read_text(encoding="utf-8").splitlines()]
        learnt.extend(texts if file.stem not in HELD_BACK else [])
    rng = np.random.default_rng(0)
    parts = [part for text in learnt for part in parts_of(text) if len(part.split()) > 2]
    whole = [learnt[i] for i in rng.permutation(len(learnt))[:WHOLE]]
    return [*whole, *(parts[i] for i in rng.permutation(len(parts))[:PARTS])]


def network(z: Array, y: Array, seed: int) -> list[Array]:
    """Weights and offsets of one network, by Adam with dropout and smoothed targets."""
    rng, classes = np.random.default_rng(seed), len(KINDS) + 1
    values = [rng.normal(0, z.shape[1] ** -0.5, (z.shape[1], HIDDEN)), np.zeros(HIDDEN),
              rng.normal(0, 0.1, (HIDDEN, classes)), np.zeros(classes)]  # fmt: skip
    values = [v.astype(np.float32) for v in values]
    moments = [(np.zeros_like(v), np.zeros_like(v)) for v in values]
    targets, step = np.eye(classes, dtype=np.float32)[y] * (1 - SMOOTH) + SMOOTH / classes, 0
    for _ in range(EPOCHS):
        order = rng.permutation(len(z))
        for batch in (order[i : i + BATCH] for i in range(0, len(order), BATCH)):
            x = z[batch] * (rng.random((len(batch), z.shape[1]), dtype=np.float32) > DROP) / (1 - DROP)
            kept = (rng.random((len(batch), HIDDEN), dtype=np.float32) > DROP) / (1 - DROP)
            hidden = np.maximum(x @ values[0] + values[1], 0) * kept
            logits = hidden @ values[2] + values[3]
            shares = np.exp(logits - logits.max(1, keepdims=True))
            error = (shares / shares.sum(1, keepdims=True) - targets[batch]) / len(batch)
            back = (error @ values[2].T) * (hidden > 0) * kept
            step += 1
            for value, slope, (first, second) in zip(
                values, (x.T @ back, back.sum(0), hidden.T @ error, error.sum(0)), moments, strict=True
            ):
                first[:] = 0.9 * first + 0.1 * slope
                second[:] = 0.999 * second + 0.001 * slope**2
                move = (first / (1 - 0.9**step)) / (np.sqrt(second / (1 - 0.999**step)) + 1e-8)
                value -= (RATE * (move + DECAY * value)).astype(np.float32)
    return values


def fit(x: Array, y: Array) -> Networks:
    """The networks, each from another seed, with the scaling of the features in their first layer."""
    mean, scale = x.mean(0), DENSE_SCALE / np.maximum(x.std(0), 1e-3)
    mean[-PATTERNS:], scale[-PATTERNS:] = 0.0, 1.0
    fitted = [network(((x - mean) * scale).astype(np.float32), y, seed) for seed in range(NETWORKS)]
    inner, offsets, outer, last = (np.stack(parts) for parts in zip(*fitted, strict=True))
    inner = inner * scale[:, None]
    rounded = [v.astype(np.float16) for v in (inner, offsets - mean @ inner, outer, last)]
    one, two, three, four = (v.astype(np.float32) for v in rounded)
    return Networks(one, two, three, four, np.asarray(THRESHOLD, np.float32))


def main() -> None:
    arguments = Parser(__doc__)
    arguments.add_argument("--write", action="store_true", help="save networks that were fitted on all lines")
    given = arguments.parse_args()
    lines = [(text, name) for name, texts in written().items() for text in texts]
    lines += [(part, name) for text, name in lines if name not in KINDS for part in parts_of(text) if part != text]
    lines += [(text, "requests") for text in requests()]
    x = np.stack([features(text) for text, _ in lines])
    y = np.array([KINDS.index(name) if name in KINDS else len(KINDS) for _, name in lines])
    source, held = np.array([name for _, name in lines]), np.array([held_out(text) for text, _ in lines])
    alarmed = 1 - fit(x[~held], y[~held]).shares(x)[:, -1] >= THRESHOLD
    for name in dict.fromkeys(source):
        for label, part in (("fitted", ~held), ("held out", held)):
            of = part & (source == name)
            print(f"{name:12} {label:8} {int(alarmed[of].sum()):5} of {int(of.sum()):5} are alarms")
    if given.write:
        fitted = fit(x, y)
        stored = {name: v.astype(np.float16) for name, v in zip(fitted._fields, fitted, strict=True)}
        np.savez_compressed(FITTED, **stored)
        print(f"wrote {FITTED.name}, fitted on all {len(lines)} lines")


if __name__ == "__main__":
    run_script(main)
