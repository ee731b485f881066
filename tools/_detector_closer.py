"""Second stage of the detector: it classifies a patch of the image at each place where the first stage sees something.

A heatmap of all names at once learns thin and small things badly: knives were not told from the table in any frame of
the training, though their places stood out. As in Faster R-CNN (Ren et al. 2015), naming is left to a second network,
which sees such a place and what the first one thought of it, and mends its box for each name: a pan on a stove has the
burner's middle, and one box for the two fits neither.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from _detector_batches import SMALL, Batch, batch
from _detector_loss import follow, giou
from _detector_network import NECK, STRIDE, Conv, Network
from torch import Tensor, nn
from torch.nn import functional as F

FAR = 0.6  # of the size of the first pass is the second
PLACES_OF_CROP = 16
BATCH, PEAK, DECAY, SAVE_S = 10, 2e-3, 0.02, 120
PLACES = 32  # of a frame that are looked at closely
SIDE = 40  # pixels of a patch
AROUND = 1.3  # a patch is a square so many times the longer side of its box,
LEAST = 28.0  # and at least so many pixels wide
RIGHT, WRONG = 0.3, 0.2  # overlap from which on a place is of a thing, and up to which it is not
CELLS, KINDS_OF_CELL = 25, 24  # of the layout: what a patch shows where
MOST_CHANGE = 1.5  # of the logarithm of a box's sides
MEND = 2.0  # weight of the boxes' loss


class Closer(nn.Module):
    """Patches (N, 3, 40, 40), their boxes' widths and heights (N, 2), what the first stage's heads saw there (N, 48)
    and its logits (N, C), to logits (N, C) and changes (N, C, 4) of the box for each name: of its middle, in sides, and
    of their logarithms."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            Conv(3, 24, 3, 2), Conv(24, 40, 3, 2), Conv(40, 80), Conv(80, 128, 3, 2), Conv(128, 128)
        )
        self.layout = nn.Conv2d(128, KINDS_OF_CELL, 1)
        self.mix = Conv(128 + 2 + NECK + classes + CELLS * KINDS_OF_CELL, 128, 1)
        self.name = nn.Conv2d(128, classes, 1)
        self.mend = nn.Conv2d(128, 4 * classes, 1)
        self.trust = nn.Conv2d(classes, classes, 1, groups=classes)
        for fresh in (self.name.weight, self.name.bias, self.mend.weight, self.mend.bias, self.trust.bias):
            nn.init.zeros_(fresh)  # at first all stays as the first stage has it
        nn.init.ones_(self.trust.weight)

    def forward(self, patches: Tensor, sizes: Tensor, around: Tensor, first: Tensor) -> tuple[Tensor, Tensor]:
        seen = self.body((patches - 0.5) * 4.0)
        layout = self.layout(seen).flatten(1)
        known = torch.cat([seen.mean((2, 3)), sizes.log() - 4.0, around, first.sigmoid(), layout], 1)
        mixed = self.mix(known[..., None, None])
        names = self.name(mixed) + self.trust(first[..., None, None])
        return names[..., 0, 0], self.mend(mixed).unflatten(1, (-1, 4))[..., 0, 0]


def mended(boxes: Tensor, changes: Tensor) -> Tensor:
    """Boxes (N, 4) xyxy with changes (N, 4) as ``Closer`` gives them."""
    sides = boxes[:, 2:] - boxes[:, :2]
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 + changes[:, :2] * sides
    half = sides / 2 * changes[:, 2:].clamp(-MOST_CHANGE, MOST_CHANGE).exp()
    return torch.cat([middle - half, middle + half], 1)


def places(logits: Tensor, sides: Tensor, up: Tensor, most: int) -> tuple[Tensor, Tensor, Tensor]:
    """Boxes (B, most, 4) xyxy where any name has a peak, the highest first, and what the neck (B, most, 48) and the
    logits (B, most, C) are there."""
    top = logits.amax(1)
    peaks = torch.where(F.max_pool2d(top, 3, 1, 1) == top, top, torch.tensor(-30.0)).flatten(1)
    where = peaks.topk(most, 1).indices
    columns = logits.shape[3]
    centre = torch.stack([where % columns, where // columns], 2) * STRIDE + STRIDE / 2
    reach, around, own = (
        maps.flatten(2).gather(2, where[:, None].expand(-1, maps.shape[1], -1)).transpose(1, 2)
        for maps in (sides, up, logits)
    )
    reach = reach.clamp(-4, 6).exp() * STRIDE
    boxes = torch.cat([centre - reach[..., :2], centre + reach[..., 2:]], 2)
    return boxes, around, own


def patches(images: Tensor, boxes: Tensor) -> Tensor:
    """(B * K, 3, 40, 40) of images (B, 3, H, W) around boxes (B, K, 4): RoIAlign (He et al. 2017), black beyond the
    image, each pixel the mean of four points."""
    count, high, wide = boxes.shape[1], *images.shape[2:]
    middle, half = (boxes[..., :2] + boxes[..., 2:]) / 2, AROUND / 2 * (boxes[..., 2:] - boxes[..., :2]).amax(2)
    steps = (torch.arange(2 * SIDE) + 0.5) / SIDE - 1
    at = middle[:, :, None] + half.clamp(min=LEAST / 2)[..., None, None] * steps[:, None]  # (B, K, 80, 2) of x and y
    shape = torch.tensor([wide, high])
    inside = ((at - 0.5 >= -1) & (at - 0.5 <= shape)).to(images.dtype)
    at = 2 * at / shape - 1
    across = at[:, :, None, :, 0].expand(-1, -1, 2 * SIDE, -1)
    grid = torch.stack([across, at[..., 1, None].expand(-1, -1, -1, 2 * SIDE)], 4).flatten(1, 2)
    found = F.grid_sample(images, grid, padding_mode="border", align_corners=False)
    found = found * (inside[..., 1, None] * inside[:, :, None, :, 0]).flatten(1, 2)[:, None]
    found = F.avg_pool2d(found, 2).unflatten(2, (count, SIDE))
    return found.transpose(1, 2).flatten(0, 1)


def sizes(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).flatten(0, 1).clamp(min=1)


@torch.no_grad()
def two_passes(network: Network, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Logits and boxes as the exported network has them, the mean over the images and over them made smaller; and
    what the heads of the former see."""
    up = network.neck(images)
    logits, sides = network.heat(up)
    small = F.interpolate(images, scale_factor=FAR, mode="bilinear").flip(3)
    turned, far_sides = network.heat(network.neck(small))
    turned, far_sides = (F.interpolate(m, logits.shape[2:], mode="bilinear").flip(3) for m in (turned, far_sides))
    return (logits + turned) / 2, (sides + far_sides[:, [2, 1, 0, 3]] - math.log(FAR)) / 2, up


def wanted(boxes: Tensor, true: Batch, classes: int) -> tuple[Tensor, Tensor, Tensor]:
    """Which names each place has (B, K, C), and where that is to be learnt: not of boxes that are half right or too
    small; and (P, 6) the places, numbered through, the names and the true boxes of those that are right."""
    names, counts = torch.zeros(*boxes.shape[:2], classes), torch.ones(*boxes.shape[:2], classes)
    right_ones = [torch.zeros(0, 6)]
    for image in range(len(boxes)):
        objs = torch.from_numpy(true.objects[true.objects[:, 0] == image]).float()
        if not len(objs):
            continue
        box, kind = objs[:, 1:5], objs[:, 5].long()
        sides = (
            torch.minimum(boxes[image][:, None, 2:], box[:, 2:]) - torch.maximum(boxes[image][:, None, :2], box[:, :2])
        ).clamp(min=0)
        shared, size = sides.prod(2), (box[:, 2:] - box[:, :2]).prod(1)
        overlap = shared / ((boxes[image][:, 2:] - boxes[image][:, :2]).prod(1)[:, None] + size - shared).clamp(min=1)
        unsure = (overlap >= WRONG) & ((overlap < RIGHT) | (size < SMALL))
        right = (overlap >= RIGHT) & (size >= SMALL)
        for flags, into, value in ((unsure, counts, 0.0), (right, counts, 1.0), (right, names, 1.0)):
            place, obj = flags.nonzero(as_tuple=True)
            into[image, place, kind[obj]] = value
        # of several things of a name that with which it overlaps most
        best = (kind[:, None] == kind) & (overlap[:, None, :] > overlap[:, :, None])
        place, obj = (right & ~best.any(2)).nonzero(as_tuple=True)
        number = (image * boxes.shape[1] + place).float()
        right_ones.append(torch.cat([number[:, None], kind[obj, None].float(), box[obj]], 1))
    return names, counts, torch.cat(right_ones)


@torch.no_grad()
def lesson(network: Network, true: Batch) -> tuple[Tensor, ...]:
    """What a closer network is shown of a batch, its boxes (N, 4), which names (N, C) those have, which of them count,
    and the true boxes as ``wanted`` has them."""
    images = torch.from_numpy(true.images)
    boxes, around, own = places(*two_passes(network, images), PLACES_OF_CROP)
    shown = patches(images, boxes), sizes(boxes), around.flatten(0, 1), own.flatten(0, 1)
    names, counts, right = wanted(boxes, true, own.shape[2])
    return *shown, boxes.flatten(0, 1), names.flatten(0, 1), counts.flatten(0, 1), right


def cost_of(
    closer: Closer, shown: Sequence[Tensor], boxes: Tensor, names: Tensor, counts: Tensor, right: Tensor
) -> Tensor:
    """Of each place, summed over the names, and of the boxes of those that it has."""
    told, changes = closer(*shown)
    naming = F.binary_cross_entropy_with_logits(told, names, counts, reduction="sum")
    place, name = right[:, 0].long(), right[:, 1].long()
    boxing = (1 - giou(mended(boxes[place], changes[place, name]), right[:, 2:])).sum()
    return (naming + MEND * boxing) / len(told)


def optimizer_of(closer: Closer) -> torch.optim.Optimizer:
    return torch.optim.AdamW(closer.parameters(), weight_decay=DECAY)


def save_closer(run: Path, closer: Closer, mean: Closer, optimizer: Any, step: int, spent: float) -> None:
    state = {"closer": closer.state_dict(), "mean": mean.state_dict(), "optimizer": optimizer.state_dict()}
    part = run / "closer.part"
    torch.save(state | {"step": step, "spent": spent}, part)
    part.replace(run / "closer.pt")


def train_closer(network: Network, pool: Any, run: Path, minutes: float, seed: int) -> None:
    """Learn to name places, the first stage being left as it is; RUN/closer.pt keeps the averaged weights, and can be
    gone on from."""
    torch.manual_seed(seed)
    network.eval()
    closer, mean = Closer(len(network.names)), Closer(len(network.names))
    optimizer = optimizer_of(closer)
    path, step, spent = run / "closer.pt", 0, 0.0
    if path.exists():
        state = torch.load(path, weights_only=True)
        closer.load_state_dict(state["closer"])
        optimizer.load_state_dict(state["optimizer"])
        step, spent = state["step"], state["spent"]
    mean.load_state_dict(state["mean"] if step else closer.state_dict())

    def prepared(number: int) -> tuple[Tensor, ...]:
        return lesson(network, batch(pool, BATCH, np.random.default_rng((seed, number, 2))))

    ahead = ThreadPoolExecutor(2)  # the first stage runs on the next ones while the latest is learnt
    made = deque(ahead.submit(prepared, step + k) for k in range(3))
    start, saved, costs = time.time() - spent, time.time(), []
    while True:
        spent = time.time() - start
        over = spent >= 60 * minutes
        if over or time.time() - saved > SAVE_S:
            saved = time.time()
            save_closer(run, closer, mean, optimizer, step, spent)
            pool.refresh(20)
        if over:
            return ahead.shutdown(cancel_futures=True)
        for group in optimizer.param_groups:
            group["lr"] = max(PEAK * 0.5 * (1 + math.cos(math.pi * spent / (60 * minutes))), 1e-6)
        *shown, boxes, names, counts, right = made.popleft().result()
        made.append(ahead.submit(prepared, step + 3))
        loss = cost_of(closer, shown, boxes, names, counts, right)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        step += 1
        follow(mean, closer, min(0.999, (1 + step) / (10 + step)))
        costs.append(loss.item())
        if step % 50 == 0:
            print(f"{spent:.0f} s step {step} cost {np.mean(costs[-50:]):.3f} frames {len(pool.frames)}", flush=True)
