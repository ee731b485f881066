"""Training weights restored from the shipped ONNX file, where only the repository is at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import onnx
import torch
from _detector_batches import Batch
from _detector_closer import Closer, lesson
from _detector_export import SIZE, Graph, maps_of, named
from _detector_loss import paint_loss
from _detector_network import Conv, Network
from onnx import numpy_helper
from torch import Tensor, nn

SCALES = (5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)  # one of which the scale of the cells' logits will be near


class Reading(Graph):
    """Walks as the export does, and takes the weights of each convolution from a file in place of writing them
    there."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        graph = onnx.load(path).graph
        held = {one.name: torch.from_numpy(numpy_helper.to_array(one).copy()) for one in graph.initializer}
        held |= {
            node.output[0]: held[node.input[0]]
            for node in graph.node
            if node.op_type == "Cast" and node.input[0] in held
        }
        self.left = [[held[name] for name in node.input[1:]] for node in graph.node if node.op_type == "Conv"]

    def conv(self, *_: Any, **__: Any) -> str:
        self.left.pop(0)
        return ""

    def layer(self, x: str, layer: Any) -> str:
        """Batch norms were folded away: they begin as nothing but a bias."""
        weight, bias = self.left.pop(0)
        conv = layer
        if isinstance(layer, Conv):
            conv, norm = layer[0], layer[1]
            norm.running_var.fill_(1 - norm.eps)
            norm.bias.copy_(bias)
        else:
            conv.bias.copy_(bias)
        conv.weight.copy_(weight)
        return ""


@torch.no_grad()
def restore(network: Network, closer: Closer, path: Path, batches: list[Batch]) -> None:
    """The weights of an exported file into new networks, which then see the same, score_model and all.

    Batch norms get the mean and spread that these crops have there, so that training finds them as it left them; the
    scale of the cells' logits, which no file holds, is that under which the crops are explained best.
    """
    reading = Reading(path)
    maps_of(reading, network, "", SIZE)
    while len((held := reading.left.pop(0))[0]) != len(network.names):
        pass  # the second pass has the first one's weights
    network.scale.fill_(2 * held[0][0].float().norm())  # the mean of two passes halves it
    network.bias.copy_(held[1])
    reading.conv()  # the length of the features
    named(reading, closer, "", "", "", "")
    network.eval(), closer.eval()
    sums: dict[nn.Module, list[Tensor]] = {}

    def gather(norm: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        of_one = torch.stack([inputs[0].mean((0, 2, 3)), (inputs[0] ** 2).mean((0, 2, 3))])
        sums.setdefault(norm, []).append(of_one)

    norms = [part for net in (network, closer) for part in net.modules() if isinstance(part, nn.BatchNorm2d)]
    hooks = [norm.register_forward_pre_hook(gather) for norm in norms]
    costs = torch.zeros(len(SCALES))
    for true in batches:
        features = network(torch.from_numpy(true.images))[2]
        closer(*lesson(network, true)[:4])
        for k, scale in enumerate(SCALES):
            network.paint_scale.fill_(scale)
            costs[k] += paint_loss(network.painted(features), true.kinds, len(network.names))
    network.paint_scale.fill_(SCALES[int(costs.argmin())])
    for hook in hooks:
        hook.remove()
    for norm in norms:
        mean, square = torch.stack(sums[norm]).mean(0)
        norm.running_mean, norm.running_var = mean, square - mean**2
        norm.weight.copy_((norm.running_var + norm.eps).sqrt())
        norm.bias.add_(mean)
