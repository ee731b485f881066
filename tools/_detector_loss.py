"""Losses of the dollhouse detector: CenterNet's focal loss, the boxes' GIoU, and LSeg's cross-entropy of cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from _detector_batches import STRIDE, Batch
from _detector_network import Network
from torch import Tensor, nn

HALF = torch.cpu.get_capabilities().get("avx512_bf16", False)  # elsewhere bfloat16 takes three times as long as float32
AROUND_WEIGHT = 0.4  # of cells that show no thing: there are so many


def loss_of(
    network: Network, images: Tensor, true: Batch, weights: Tensor, rng: np.random.Generator
) -> tuple[Tensor, ...]:
    """CenterNet's focal loss with rare names weighted up, the GIoU loss of the boxes, and LSeg's cross-entropy of
    cells."""
    corner = (int(rng.integers(2)), int(rng.integers(2)))
    with torch.autocast("cpu", torch.bfloat16, enabled=HALF):
        logits, sides, features = network(images, (*corner, 2))
        painted = network.painted(features)
    count = max(1, len(true.hits))
    heat_loss = Focal.apply(logits, *(torch.from_numpy(a) for a in (true.spots, true.heat, true.hits)), weights) / count
    target, sides = torch.from_numpy(true.boxes), sides.float()
    b, y, x = (target[:, 4] > 0).nonzero(as_tuple=True)
    truth, weight = target[b, :4, y, x], target[b, 4, y, x]
    centre = torch.stack([x, y], 1).float() * STRIDE + STRIDE / 2
    reach = sides[b, :, y, x].clamp(-4, 6).exp() * STRIDE
    guess = torch.cat([centre - reach[:, :2], centre + reach[:, 2:]], 1)
    box_loss = (weight * (1 - giou(guess, truth))).sum() / count
    return heat_loss, box_loss, paint_loss(painted, true.kinds[:, corner[0] :: 2, corner[1] :: 2], len(weights))


def paint_loss(painted: Tensor, kinds: Any, classes: int) -> Tensor:
    """Softmax cross-entropy of the cells; walls and floors count less, as there are so many."""
    wanted = torch.from_numpy(np.where(kinds < 0, classes, kinds)).flatten()
    weight = torch.ones(painted.shape[1])
    weight[classes:] = AROUND_WEIGHT
    return torch.nn.functional.cross_entropy(painted.permute(0, 2, 3, 1).flatten(0, 2).float(), wanted, weight)


class Focal(torch.autograd.Function):
    """CenterNet's focal loss, summed: of logits (B, C, h, w), spots (M, 4), their heat (M,), hits (K,) and weights (C,)
    of classes, as a batch has them.

    Its derivative is worked out with it: autograd would go over the large maps three times as often. Image by image, so
    that one stays in the cache, and as if there were nothing; then what the few cells with heat have otherwise.
    """

    @staticmethod
    def forward(ctx: Any, logits: Tensor, spots: Tensor, heat: Tensor, hits: Tensor, weights: Tensor) -> Tensor:
        total, slope = torch.zeros(()), torch.empty_like(logits)
        for image, into in zip(logits, slope, strict=True):
            cost, change = _alarm(image)
            total += cost.sum()
            into.copy_(change)
        b, y, x, c = spots.unbind(1)
        cost, change = _alarm(logits[b, c, y, x])
        easier = (1 - heat) ** 4
        total -= ((1 - easier) * cost).sum()
        change *= easier
        kind = c[hits]
        sure = torch.sigmoid(logits[b[hits], kind, y[hits], x[hits]].float()).clamp(1e-6, 1 - 1e-6)
        total -= (weights[kind] * (1 - sure) ** 2 * sure.log()).sum()
        change[hits] = weights[kind] * ((1 - sure) ** 2) * (2 * sure * sure.log() - (1 - sure))
        slope[b, c, y, x] = change.to(slope.dtype)
        ctx.slope = slope
        return total

    @staticmethod
    def backward(ctx: Any, above: Tensor) -> tuple[Tensor | None, ...]:
        return ctx.slope.mul_(above.to(ctx.slope.dtype)), None, None, None, None


def _alarm(logits: Tensor) -> tuple[Tensor, Tensor]:
    """What it costs to be alarmed where nothing is, and its derivative: p² · -log(1 - p) of the sigmoids p."""
    chance = torch.sigmoid(logits.float())
    cost = torch.log1p(-chance.clamp_(max=1 - 1e-6)).neg_()
    square = chance * chance
    slope = (1 - chance).mul_(2).mul_(cost).add_(chance).mul_(square)
    return cost.mul_(square), slope


def giou(a: Tensor, b: Tensor) -> Tensor:
    """Generalised intersection over union of boxes, pair by pair (Rezatofighi et al. 2019)."""
    shared = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(1)
    union = (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - shared
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1)
    return shared / union.clamp(min=1e-3) - (hull - union) / hull.clamp(min=1e-3)


@torch.no_grad()
def follow(mean: nn.Module, net: nn.Module, decay: float) -> None:
    """The exponential moving average of the weights, which is what is kept."""
    for a, b in zip(mean.state_dict().values(), net.state_dict().values(), strict=True):
        if a.dtype.is_floating_point:
            a.lerp_(b, 1 - decay)
        else:
            a.copy_(b)
