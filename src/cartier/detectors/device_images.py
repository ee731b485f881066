"""Image preprocessing on the model's own device: an image processor's CPU work as a few operations of torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cartier.types import Array

FILTERS = {2: "bilinear", 3: "bicubic"}  # Pillow's numbers of the filters that torch has too
SAME = 0.002  # of the range of values, on average: half a grey level; another filter differs by much more
GAUSS_REACH = 4  # standard deviations, as scipy cuts its Gaussians off

Size = tuple[int, int]


class DeviceImages:
    """Turns images of one size into a model's input.

    For each new size of image, noise is prepared by the model's own processor and here. If the two agree, the work is
    done here from then on; where not, the processor goes on doing it, and ``notes`` say so.

    ``square`` is for OWLv2, whose processor pads images to a square and resizes with scipy; others resize with Pillow.
    """

    def __init__(self, processor: Any, device: Any, square: bool) -> None:
        self._processor, self._device, self._square = processor, device, square
        self._sizes: dict[Size, Size | None] = {}
        self.notes: list[str] = []

    def __call__(self, images: Sequence[Array]) -> dict[str, Any]:
        """``pixel_values`` (B, 3, h, w) float32 on the device, of images (H, W, 3) uint8 that are all of one size.

        There is a ``pixel_mask`` beside it only where the processor did the work and gives one.
        """
        shape = images[0].shape[:2]
        if shape not in self._sizes:
            self._sizes[shape] = self._agreed(shape)
        size = self._sizes[shape]
        return self._theirs(images) if size is None else {"pixel_values": self._ours(images, size)}

    def _agreed(self, shape: Size) -> Size | None:
        """The size of the input for images of a shape, None if it is not the same when it is made here."""
        noise = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
        given = self._theirs([noise])
        theirs, mask = given["pixel_values"], given.get("pixel_mask")
        height, width = (int(side) for side in theirs.shape[-2:])
        known = self._square or getattr(self._processor, "resample", None) in FILTERS
        if known and (mask is None or bool(mask.all())):
            try:
                differ = (self._ours([noise], (height, width)) - theirs).abs().mean()
            except (AttributeError, TypeError, ValueError):  # of a processor with settings of its own
                differ = theirs.new_tensor(float("inf"))
            if float(differ) <= SAME * float(theirs.max() - theirs.min()):
                return height, width
        self.notes.append(
            f"images of {shape[1]}x{shape[0]} px are prepared on the CPU, which is slow: "
            f"{type(self._processor).__name__} does not do here what cartier knows of it"
        )
        return None

    def _theirs(self, images: Sequence[Array]) -> dict[str, Any]:
        given = self._processor(images=list(images), return_tensors="pt", input_data_format="channels_last")
        return {key: given[key].to(self._device) for key in ("pixel_values", "pixel_mask") if key in given}

    def _ours(self, images: Sequence[Array], size: Size) -> Any:
        import torch

        batch = torch.from_numpy(np.stack(images)).to(self._device)  # bytes travel, floats are made there
        pixels = (_padded_and_zoomed if self._square else self._resized)(batch.permute(0, 3, 1, 2).float(), size)
        given = self._processor
        scale = given.rescale_factor if given.do_rescale else 1.0
        if not given.do_normalize:
            return pixels.mul_(scale)
        mean, std = (torch.tensor(of, device=self._device).view(3, 1, 1) for of in (given.image_mean, given.image_std))
        return pixels.mul_(scale / std).sub_(mean / std)

    def _resized(self, pixels: Any, size: Size) -> Any:
        """As Pillow resizes: first the rows, then the columns, each to whole grey levels."""
        from torch.nn.functional import interpolate

        mode = FILTERS[int(self._processor.resample)]
        for stage in ((pixels.shape[2], size[1]), size):
            if pixels.shape[2:] != stage:
                pixels = interpolate(pixels, stage, mode=mode, antialias=True).round_().clamp_(0, 255)
        return pixels


def _padded_and_zoomed(pixels: Any, size: Size) -> Any:
    """As OWLv2's processor does: zeros below and to the right make a square, blurred before it is made smaller."""
    from torch.nn.functional import interpolate, pad

    height, width = pixels.shape[-2:]
    side = max(height, width)
    square = pad(pixels, (0, side - width, 0, side - height))
    for axis, wanted in zip((2, 3), size, strict=True):
        square = _blurred(square, axis, max(0.0, (side / wanted - 1) / 2))
    return interpolate(square, size, mode="bilinear", align_corners=False)


def _blurred(pixels: Any, axis: int, sigma_px: float) -> Any:
    """A Gaussian along one axis, mirrored at the edges."""
    from torch.nn.functional import pad

    reach = int(GAUSS_REACH * sigma_px + 0.5)
    if not reach:
        return pixels
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    around = pad(pixels, (0, 0, reach, reach) if axis == 2 else (reach, reach, 0, 0), mode="reflect")
    length, out = pixels.shape[axis], None
    for number, weight in enumerate((weights / weights.sum()).tolist()):
        part = around.narrow(axis, number, length)
        out = part * weight if out is None else out.add_(part, alpha=weight)
    return out
