"""Network of the dollhouse detector: a small ResNet, a feature pyramid, CenterNet's heads over vectors of names."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

STRIDE = 4
WIDTHS = (16, 24, 48, 112, 192)
NECK = 48


class Conv(nn.Sequential):
    """Convolution, batch norm, ReLU."""

    def __init__(self, a: int, b: int, kernel: int = 3, stride: int = 1, relu: bool = True, apart: int = 1) -> None:
        layers: list[nn.Module] = [
            nn.Conv2d(a, b, kernel, stride, kernel // 2 * apart, apart, bias=False),
            nn.BatchNorm2d(b, momentum=0.03),
        ]
        super().__init__(*layers, *([nn.ReLU(inplace=True)] if relu else []))


class Block(nn.Module):
    """A residual block (He et al. 2015), its first convolution with a stride, or with its taps ``apart``."""

    def __init__(self, a: int, b: int, stride: int = 1, apart: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(Conv(a, b, 3, stride, apart=apart), Conv(b, b, 3, relu=False, apart=apart))
        self.skip = nn.Identity() if a == b and stride == 1 else Conv(a, b, 1, stride, relu=False)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.body(x) + self.skip(x))


class Network(nn.Module):
    """RGB (N, 3, H, W), 0 to 1, to name logits (N, C, H/4, W/4), boxes (N, 4, …) and unit features (N, D, …).

    Two heads speak the language of names: the first only in the middles of things, where the logits have their peaks,
    the second in every cell, walls and floors included. Boxes are the distances from a cell's centre to left, top,
    right, bottom in units of the stride, as exponents. The logits are cosines between the features and the frozen
    vectors of the names, scaled (LSeg, Li et al. 2022, in the place of the classes of CenterNet, Zhou et al. 2019):
    ``basis`` (D, 384) holds the principal directions of the name vectors, so that a D-dimensional head says the same as
    a 384-dimensional one at a fraction of the cost.
    """

    def __init__(self, vectors: Tensor, around: Tensor, middle: Tensor, basis: Tensor) -> None:
        """``vectors`` (C, 384) of the names and ``around`` (A, 384) of what is no thing, such as walls."""
        super().__init__()
        c0, c1, c2, c3, c4 = WIDTHS
        self.stem = nn.Sequential(Conv(3, c0, 3, 2), Conv(c0, c1, 3, 2))
        self.s4 = Block(c1, c1)
        self.s8 = nn.Sequential(Block(c1, c2, 2), Block(c2, c2))
        self.s16 = nn.Sequential(Block(c2, c3, 2), Block(c3, c3))
        self.s32 = nn.Sequential(Block(c3, c4, 2), Block(c4, c4))
        self.more16, self.more32 = Block(c3, c3), Block(c4, c4, apart=2)
        self.room = nn.Sequential(nn.Conv2d(c4, 64, 1), nn.ReLU(), nn.Conv2d(64, c4, 1))
        self.lateral = nn.ModuleList([nn.Conv2d(c, NECK, 1) for c in (c1, c2, c3, c4)])
        self.smooth16, self.smooth8, self.smooth4 = Conv(NECK, NECK), Conv(NECK, NECK), Conv(NECK, NECK)
        self.refine = Block(NECK, NECK)
        for later in (self.refine.body[1][1], self.more16.body[1][1], self.more32.body[1][1], self.room[2]):
            nn.init.zeros_(later.weight)  # what was added to a trained network begins as nothing
        nn.init.zeros_(self.room[2].bias)
        self.see, self.paint = nn.Conv2d(NECK, basis.shape[0], 1), nn.Conv2d(NECK, basis.shape[0], 1)
        self.box = nn.Sequential(Conv(NECK, 32), nn.Conv2d(32, 4, 1))
        self.register_buffer("names", F.normalize((vectors - middle) @ basis.T, dim=1))
        self.register_buffer("around", F.normalize((around - middle) @ basis.T, dim=1))
        self.register_buffer("middle", middle)
        self.register_buffer("basis", basis)
        self.scale = nn.Parameter(torch.tensor(10.0))
        self.paint_scale = nn.Parameter(torch.tensor(10.0))
        self.bias = nn.Parameter(torch.full((vectors.shape[0],), -4.6))
        nn.init.constant_(self.box[-1].bias, 1.0)

    def forward(self, x: Tensor, every: tuple[int, int, int] = (0, 0, 1)) -> tuple[Tensor, Tensor, Tensor]:
        """Heatmap logits, boxes (log of l, t, r, b in strides), and the D-dimensional features of all cells, unit
        length.

        ``every`` (y, x, step): of the cells from there on only each step-th gets features, which is enough to train.
        """
        up = self.neck(x)
        y, x0, step = every
        return *self.heat(up), F.normalize(self.paint(up[:, :, y::step, x0::step]), dim=1)

    def neck(self, x: Tensor) -> Tensor:
        """What all heads see: (N, 48, H/4, W/4)."""
        f4 = self.s4(self.stem((x - 0.5) * 4.0))
        f8 = self.s8(f4)
        f16 = self.more16(self.s16(f8))
        f32 = self.more32(self.s32(f16))
        f32 = f32 + self.room(f32.mean((2, 3), keepdim=True))  # what kind of room this is
        up = self.lateral[3](f32)
        up = self.smooth16(self.lateral[2](f16) + F.interpolate(up, size=f16.shape[2:], mode="nearest"))
        up = self.smooth8(self.lateral[1](f8) + F.interpolate(up, size=f8.shape[2:], mode="nearest"))
        up = self.refine(up)
        up = self.lateral[0](f4) + F.interpolate(up, size=f4.shape[2:], mode="nearest")
        return cast(Tensor, self.smooth4(up))

    def heat(self, up: Tensor) -> tuple[Tensor, Tensor]:
        """Heatmap logits and boxes."""
        seen = F.normalize(self.see(up), dim=1)
        return F.conv2d(seen, (self.names * self.scale)[..., None, None], self.bias), self.box(up)

    def painted(self, features: Tensor) -> Tensor:
        """Logits (N, C + A, h, w) of what each cell shows: the names, then what is around them."""
        vectors = torch.cat([self.names, self.around]) * self.paint_scale
        return F.conv2d(features, vectors[..., None, None])
