"""LSeg's network up to its pixel features, with the public checkpoint's parameter names.

Li et al. 2022, "Language-driven Semantic Segmentation": a ViT-L/16 whose blocks 6, 12, 18 and 24 are reassembled to
maps at 1/4, 1/8, 1/16 and 1/32 of the image and fused from coarse to fine (DPT: Ranftl et al. 2021, "Vision
Transformers for Dense Prediction"); head1 takes the result, at half the image's resolution, to CLIP's space. The last
step of the published network, an enlargement x2, is left out: it adds no information.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import nn
from torch.nn import functional


@dataclass(frozen=True)
class Shape:
    """The sizes of the published network; tests make smaller ones."""

    width: int = 1024
    heads: int = 16
    mlp: int = 4096
    depth: int = 24
    taps: tuple[int, int, int, int] = (5, 11, 17, 23)
    patch: int = 16
    grid: int = 24
    """Position embeddings are stored for grid x grid patches (384 px)."""
    maps: tuple[int, int, int, int] = (256, 512, 1024, 1024)
    fused: int = 256
    out: int = 512


class LSegNetwork(nn.Module):
    """Images (1, 3, H, W), scaled to [-1, 1], H and W multiples of two patches, to features (H/2, W/2, ``out``)."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.pretrained = _Backbone(shape)
        self.scratch = _Decoder(shape)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        features: torch.Tensor = self.scratch(self.pretrained(images))[0].permute(1, 2, 0)
        return features


class _Backbone(nn.Module):
    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.model = _ViT(shape)
        scalings: tuple[nn.Module | None, ...] = (
            nn.ConvTranspose2d(shape.maps[0], shape.maps[0], 4, stride=4),
            nn.ConvTranspose2d(shape.maps[1], shape.maps[1], 2, stride=2),
            None,
            nn.Conv2d(shape.maps[3], shape.maps[3], 3, stride=2, padding=1),
        )
        self.act_postprocess1, self.act_postprocess2, self.act_postprocess3, self.act_postprocess4 = (
            _Reassemble(shape.width, channels, scaling) for channels, scaling in zip(shape.maps, scalings, strict=True)
        )

    def forward(self, images: torch.Tensor) -> list[torch.Tensor]:
        rows, columns = (side // self.model.shape.patch for side in images.shape[2:])
        steps = (self.act_postprocess1, self.act_postprocess2, self.act_postprocess3, self.act_postprocess4)
        return [step(tokens, rows, columns) for step, tokens in zip(steps, self.model(images), strict=True)]


class _ViT(nn.Module):
    """timm's parameter names; the last norm and the classifier are not needed and not there."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.cls_token = nn.Parameter(torch.zeros(1, 1, shape.width))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + shape.grid**2, shape.width))
        self.patch_embed = nn.ModuleDict({"proj": nn.Conv2d(3, shape.width, shape.patch, stride=shape.patch)})
        self.blocks = nn.ModuleList(_Block(shape) for _ in range(shape.depth))

    def forward(self, images: torch.Tensor) -> list[torch.Tensor]:
        patches = self.patch_embed["proj"](images)
        positions = self._positions(*patches.shape[2:])
        tokens = torch.cat((self.cls_token, patches.flatten(2).transpose(1, 2)), dim=1) + positions
        seen = []
        for number, block in enumerate(self.blocks):
            tokens = block(tokens)
            if number in self.shape.taps:
                seen.append(tokens)
        return seen

    def _positions(self, rows: int, columns: int) -> torch.Tensor:
        whole, grid = self.pos_embed[:, :1], self.pos_embed[:, 1:]
        square = grid.transpose(1, 2).reshape(1, -1, self.shape.grid, self.shape.grid)
        fitted = functional.interpolate(square, size=(rows, columns), mode="bilinear")
        return torch.cat((whole, fitted.flatten(2).transpose(1, 2)), dim=1)


class _Block(nn.Module):
    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(shape.width, eps=1e-6), nn.LayerNorm(shape.width, eps=1e-6)
        self.attn = _Attention(shape)
        self.mlp = nn.ModuleDict({"fc1": nn.Linear(shape.width, shape.mlp), "fc2": nn.Linear(shape.mlp, shape.width)})

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        tokens = tokens + self.attn(self.norm1(tokens))
        inner = functional.gelu(self.mlp["fc1"](self.norm2(tokens)))
        out: torch.Tensor = tokens + self.mlp["fc2"](inner)
        return out


class _Attention(nn.Module):
    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.heads = shape.heads
        self.qkv, self.proj = nn.Linear(shape.width, 3 * shape.width), nn.Linear(shape.width, shape.width)

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        query, key, value = self.qkv(tokens).reshape(*tokens.shape[:2], 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        mixed = functional.scaled_dot_product_attention(query, key, value)
        out: torch.Tensor = self.proj(mixed.transpose(1, 2).flatten(2))
        return out


class _Reassemble(nn.ModuleDict):
    """Tokens to a map: the class token mixed into each patch, a 1x1 convolution, a rescaling."""

    def __init__(self, width: int, channels: int, scaling: nn.Module | None) -> None:
        readout = nn.ModuleDict({"project": nn.Sequential(nn.Linear(2 * width, width), nn.GELU())})
        steps: dict[str, nn.Module] = {"0": readout, "3": nn.Conv2d(width, channels, 1)}  # 1 and 2 only reshape
        super().__init__(steps if scaling is None else steps | {"4": scaling})

    def forward(self, tokens: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
        whole, patches = tokens[:, :1], tokens[:, 1:]
        readout: Any = self["0"]
        mixed = readout["project"](torch.cat((patches, whole.expand_as(patches)), dim=2))
        out: torch.Tensor = self["3"](mixed.transpose(1, 2).reshape(len(mixed), -1, rows, columns))
        return self["4"](out) if "4" in self else out


class _Decoder(nn.Module):
    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.layer1_rn, self.layer2_rn, self.layer3_rn, self.layer4_rn = (
            nn.Conv2d(channels, shape.fused, 3, padding=1, bias=False) for channels in shape.maps
        )
        self.refinenet1, self.refinenet2, self.refinenet3 = (_Fusion(shape.fused, skip=True) for _ in range(3))
        self.refinenet4 = _Fusion(shape.fused, skip=False)
        self.head1 = nn.Conv2d(shape.fused, shape.out, 1)

    def forward(self, maps: list[torch.Tensor]) -> torch.Tensor:
        path = self.refinenet4(self.layer4_rn(maps[3]))
        path = self.refinenet3(path, self.layer3_rn(maps[2]))
        path = self.refinenet2(path, self.layer2_rn(maps[1]))
        path = self.refinenet1(path, self.layer1_rn(maps[0]))
        out: torch.Tensor = self.head1(path)
        return out


class _Fusion(nn.Module):
    """Adds the finer map, if any, refines, and doubles the resolution."""

    def __init__(self, channels: int, skip: bool) -> None:
        super().__init__()
        if skip:
            self.resConfUnit1 = _Residual(channels)
        self.resConfUnit2 = _Residual(channels)
        self.out_conv = nn.Conv2d(channels, channels, 1)

    def forward(self, path: torch.Tensor, finer: torch.Tensor | None = None) -> torch.Tensor:
        if finer is not None:
            path = path + self.resConfUnit1(finer)
        larger = functional.interpolate(self.resConfUnit2(path), scale_factor=2, mode="bilinear", align_corners=True)
        out: torch.Tensor = self.out_conv(larger)
        return out


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1, self.conv2 = (nn.Conv2d(channels, channels, 3, padding=1, bias=False) for _ in range(2))
        self.bn1, self.bn2 = nn.BatchNorm2d(channels), nn.BatchNorm2d(channels)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        inner = self.bn1(self.conv1(functional.relu(values)))
        out: torch.Tensor = values + self.bn2(self.conv2(functional.relu(inner)))
        return out
