"""Training, calibration and export of the dollhouse detector, as train_dollhouse_detector.py starts them."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from _detector_batches import Batch, Pool, batch
from _detector_closer import Closer, optimizer_of, save_closer
from _detector_homes import names
from _detector_loss import follow, loss_of
from _detector_network import Network
from torch import Tensor

DIMENSIONS = 64  # of the features: name vectors are told apart by so many principal directions
BATCH, PEAK, DECAY, WARM_STEPS = 10, 3e-3, 0.02, 150
SAVE_S = 180
BOX_WEIGHT, PAINT_WEIGHT = 3.0, 0.5
AROUND = ("wall and floor",)  # what a cell shows where no thing is
ROOM = 4 << 30  # bytes of frames in memory


def new_network() -> Network:
    """The untrained network over the vectors of the names.

    Principal directions are scaled by the root of their spread (half whitened): else names as near as "pan lid" and
    "pot lid" could hardly be told apart by a cosine.
    """
    from cartier.models.minilm import TextEncoder

    encode = TextEncoder()
    vectors, around = (encode(list(texts)).astype(np.float64) for texts in (names(), AROUND))
    middle = vectors.mean(0)
    _, spread, directions = np.linalg.svd(vectors - middle, full_matrices=False)
    basis = directions[:DIMENSIONS] / np.sqrt(spread[:DIMENSIONS, None])
    return Network(*(torch.tensor(a, dtype=torch.float32) for a in (vectors, around, middle, basis)))


def train(data: Path, run: Path, minutes: float, seed: int) -> None:
    """Train until the time is over; the learning rate follows the clock, so that it always ends at zero."""
    torch.manual_seed(seed)
    run.mkdir(parents=True, exist_ok=True)
    network, mean = new_network().to(memory_format=torch.channels_last), new_network()
    optimizer = _optimizer(network)
    step, spent = _resumed(run, network, mean, optimizer)
    first = step
    rng = np.random.default_rng((seed, step))
    pool = Pool(data / "train", ROOM)
    pool.refresh()
    ahead, batches = ThreadPoolExecutor(1), _batches(pool, np.random.default_rng((seed, step, 1)))
    start, saved, sums = time.time() - spent, time.time(), np.zeros(3)
    made = ahead.submit(next, batches)
    while (spent := time.time() - start) < 60 * minutes:
        turn = 0.5 * (1 + math.cos(math.pi * min(1, spent / (60 * minutes))))
        rate = PEAK * min(1, (step + 1 - first) / WARM_STEPS) * turn
        for group in optimizer.param_groups:
            group["lr"] = max(rate, 1e-6)
        true, weights = made.result()
        made = ahead.submit(next, batches)  # the next one is made while this one is learnt
        images = torch.from_numpy(true.images).contiguous(memory_format=torch.channels_last)
        losses = loss_of(network, images, true, weights, rng)
        optimizer.zero_grad(set_to_none=True)
        (losses[0] + BOX_WEIGHT * losses[1] + PAINT_WEIGHT * losses[2]).backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 20.0)
        optimizer.step()
        step += 1
        follow(mean, network, min(0.999, (1 + step) / (10 + step)))
        sums += [loss.item() for loss in losses]
        if step % 25 == 0:
            print(f"{spent:.0f} s step {step} lr {rate:.5f} heat {sums[0] / 25:.3f} box {sums[1] / 25:.3f} "
                  f"paint {sums[2] / 25:.3f} scale {network.scale.item():.1f} frames {len(pool.frames)}",
                  flush=True)  # fmt: skip
            sums[:] = 0
        if time.time() - saved > SAVE_S:
            saved = time.time()
            _save(run, network, mean, optimizer, step, spent)
    _save(run, network, mean, optimizer, step, spent)


def _optimizer(network: Network) -> torch.optim.Optimizer:
    fast = [p for p in network.parameters() if p.ndim < 2]
    slow = [p for p in network.parameters() if p.ndim >= 2]
    return torch.optim.AdamW([{"params": slow, "weight_decay": DECAY}, {"params": fast, "weight_decay": 0.0}])


def _batches(pool: Pool, rng: np.random.Generator) -> Iterator[tuple[Batch, Tensor]]:
    """Batches without end, with the weights of the names; now and then new shards are looked for."""
    for count in itertools.count():
        if count % 25 == 0:
            pool.refresh(3)
            weights = _weights(pool)
        yield batch(pool, BATCH, rng), weights


def _weights(pool: Pool) -> Tensor:
    """How much a hit of each name counts: rare ones up to three times as much."""
    counts = np.maximum(pool.counts(len(names())), 1)
    return torch.tensor(np.clip((np.median(counts) / counts) ** 0.4, 0.6, 3.0), dtype=torch.float32)


def _save(run: Path, network: Network, mean: Network, optimizer: Any, step: int, spent: float) -> None:
    part = run / "checkpoint.part"
    state = {"network": network.state_dict(), "mean": mean.state_dict(), "optimizer": optimizer.state_dict()}
    torch.save(state | {"step": step, "spent": spent}, part)
    part.replace(run / "checkpoint.pt")
    print(f"saved at step {step}", flush=True)


def _resumed(run: Path, network: Network, mean: Network, optimizer: Any) -> tuple[int, float]:
    """Steps and seconds so far."""
    path = run / "checkpoint.pt"
    if not path.exists():
        return 0, 0.0
    state = torch.load(path, weights_only=True)
    network.load_state_dict(state["network"])
    mean.load_state_dict(state["mean"])
    optimizer.load_state_dict(state["optimizer"])
    return int(state["step"]), float(state["spent"])


def begin(run: Path, folder: Path, data: Path) -> None:
    """Checkpoints in RUN from an exported network; only the optimizers' memory is lost."""
    from _detector_restore import restore

    if (run / "checkpoint.pt").exists():
        raise SystemExit(f"{run} holds a checkpoint already: give another folder, or go on with `train` or `closer`")
    if not any((data / "train").glob("*.npz")):
        raise SystemExit(f"{data / 'train'} holds no frames: `render` some first")
    run.mkdir(parents=True, exist_ok=True)
    network, closer, pool, rng = (
        new_network(),
        Closer(len(names())),
        Pool(data / "train", ROOM),
        np.random.default_rng(0),
    )
    pool.refresh(40)
    restore(network, closer, folder / "detector.onnx", [batch(pool, BATCH, rng) for _ in range(40)])
    told = json.loads((folder / "names.json").read_text())["trained"]
    steps, minutes, closer_steps, closer_minutes = (int(number) for number in re.findall(r"\d+", told))
    _save(run, network, network, _optimizer(network), steps, 60.0 * minutes)
    save_closer(run, closer, closer, optimizer_of(closer), closer_steps, 60.0 * closer_minutes)


def closer_run(data: Path, run: Path, minutes: float, seed: int) -> None:
    """RUN/closer.pt: the second stage, over the network as RUN/checkpoint.pt has them."""
    from _detector_closer import train_closer

    network, pool = new_network(), Pool(data / "train", ROOM)
    network.load_state_dict(torch.load(run / "checkpoint.pt", weights_only=True)["mean"])
    pool.refresh()
    train_closer(network, pool, run, minutes, seed)


def export_run(run: Path, into: Path) -> None:
    """The averaged weights as ONNX, calibrated if there is something to calibrate them with, and what belongs beside
    it."""
    from _detector_export import SIZE, compare, export

    network, closer = new_network(), Closer(len(names()))
    state, later = (torch.load(run / file, weights_only=True) for file in ("checkpoint.pt", "closer.pt"))
    network.load_state_dict(state["mean"])
    closer.load_state_dict(later["mean"])
    if (run / "score_model.json").exists():
        told = json.loads((run / "score_model.json").read_text())
        with torch.no_grad():
            for part in (closer.name.weight, closer.name.bias, closer.trust.weight, closer.trust.bias):
                part *= told["slope"]
            closer.name.bias += told["shift"] + torch.tensor(told["offsets"])
    into.mkdir(parents=True, exist_ok=True)
    path = into / "detector.onnx"
    export(network, closer, path)
    image = np.kron(np.random.default_rng(0).integers(0, 256, (SIZE[1] // 32, SIZE[0] // 32, 3)), np.ones((32, 32, 1)))
    print(
        f"largest difference to torch: {compare(network, closer, path, image):.1e}; {path.stat().st_size / 1e6:.1f} MB"
    )
    trained = (
        f"{state['step']} steps on rendered views of generated homes, {state['spent'] / 60:.0f} minutes by the clock; "
        f"the second stage {later['step']} steps, {later['spent'] / 60:.0f} minutes"
    )
    np.save(into / "words.npy", np.vstack([network.middle[None], network.basis]).astype(np.float32))
    told = {"size": list(SIZE), "trained": trained}
    _write_names(into, told | {"names": names(), "around": list(AROUND)})


def calibrate_run(run: Path, shards: Path, max_frames: int) -> None:
    """Into RUN/score_model.json, which the next export takes in: from rendered frames and from walks.

    All are of homes with things of all types: one that never holds a plunger would only tell how often one is imagined.
    """
    from _detector_choice import CALIBRATED_TO, LOW, THERE, calibrate, on_walks, outputs_on_shards
    from dollhouse_detector import run_detector

    from cartier import plugins

    (run / "score_model.json").unlink(missing_ok=True)
    export_run(run, run / "plain")
    detector = plugins.make("detectors", "embedded", threshold=LOW, folder=run / "plain", threads=1)
    walked = on_walks(partial(run_detector, least=THERE), run / "plain", range(1, CALIBRATED_TO, 2), max_frames)
    slope, shift, offsets = calibrate([outputs_on_shards(shards, detector), *walked], detector.model.names)
    told = {"slope": slope, "shift": shift, "offsets": offsets}
    (run / "score_model.json").write_text(json.dumps(told) + "\n")
    print(f"slope {slope:.2f}, shift {shift:.2f}")


def _write_names(folder: Path, told: dict[str, Any]) -> None:
    digests = {
        file: hashlib.sha256((folder / file).read_bytes()).hexdigest() for file in ("detector.onnx", "words.npy")
    }
    (folder / "names.json").write_text(json.dumps(told | {"sha256": digests}, indent=1) + "\n")
