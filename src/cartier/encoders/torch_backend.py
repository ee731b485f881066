"""Encoders on torch: a frame as a tensor, a model from a folder or the hub, and texts through a text tower."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image

from cartier.errors import BackendError, InputError
from cartier.models import hub

Loaded = TypeVar("Loaded")
BATCH = 256  # texts in one forward


def pick_device(asked: str | None) -> tuple[torch.device, torch.dtype]:
    """The device asked for, else the GPU, else the CPU; and the precision to compute in there: half on a GPU."""
    device = torch.device(hub.best_device(asked))
    return device, torch.float32 if device.type == "cpu" else torch.float16


def to_pixels(
    rgb: npt.NDArray[np.uint8],
    size_wh: tuple[int, int],
    mean: Sequence[float],
    std: Sequence[float],
    like: tuple[torch.device, torch.dtype],
) -> torch.Tensor:
    """The whole image (H, W, 3) at another size, never cropped, as (1, 3, h, w): (value / 255 - mean) / std."""
    image = Image.fromarray(rgb).resize(size_wh, Image.Resampling.BICUBIC)
    values = (np.asarray(image, np.float32) / 255 - np.asarray(mean, np.float32)) / np.asarray(std, np.float32)
    return torch.from_numpy(np.ascontiguousarray(values.transpose(2, 0, 1)[None])).to(*like)


def to_array(values: torch.Tensor) -> npt.NDArray[np.float32]:
    """A tensor of any device and precision as a C-contiguous float32 array."""
    return np.ascontiguousarray(values.to("cpu", torch.float32).numpy())


def from_hub(load: Callable[..., Loaded], model: str, what: str, **options: Any) -> Loaded:
    """What ``load`` (a ``from_pretrained``) makes of a folder or a hub id, which may end in ``@revision``.

    Raises InputError, one line, if there is no such model or it does not load.
    """
    where = hub.located(model)
    try:
        with hub.quiet():
            return load(**where, **options)
    except ImportError as error:
        raise BackendError(f"the {what} of {model!r} needs another package: {hub.line_of(error)}") from error
    except Exception as error:  # transformers, huggingface_hub and safetensors share no base class
        if "local_files_only" in where:
            gone = "it is neither a folder here nor downloaded already, and there is no way to the hub"
            raise InputError(f"the {what} of {model!r} cannot be loaded: {gone}: {hub.FETCH}") from error
        folder = Path(model).is_dir()
        place = "this folder" if folder else "neither a folder here nor the hub has it, or it is damaged"
        raise InputError(f"the {what} of {model!r} cannot be loaded ({place}): {hub.line_of(error)}") from error


@dataclass
class TextTower:
    """``embed`` takes the tokens like a transformers model and gives (n, D); ``limit``, ``vocabulary`` count tokens."""

    embed: Callable[..., torch.Tensor]
    tokenizer: Any
    limit: int
    vocabulary: int
    width: int
    padding: str
    """'longest', or 'max_length' for a model that was trained on padded texts (SigLIP)."""
    device: torch.device
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if len(self.tokenizer) <= self.vocabulary / 2:  # transformers makes an empty one where files are missing
            raise InputError(
                f"the tokenizer has {len(self.tokenizer)} tokens, but the text tower {self.vocabulary}: "
                "is a file of the tokenizer missing?"
            )

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        """(n, D) float32, one row per text, as the tower gives them: not normalised."""
        if not texts:
            return np.empty((0, self.width), np.float32)
        return np.concatenate([self._batch(list(texts[i : i + BATCH])) for i in range(0, len(texts), BATCH)])

    def _batch(self, texts: list[str]) -> npt.NDArray[np.float32]:
        self._say_cuts(texts)
        tokens = self.tokenizer(
            texts, padding=self.padding, truncation=True, max_length=self.limit, return_tensors="pt"
        )
        highest = int(tokens["input_ids"].max())
        if highest >= self.vocabulary:  # on a GPU an index fault would kill the process's context
            raise InputError(
                f"the tokenizer gives token {highest}, but the text tower knows {self.vocabulary}: they do not belong "
                "together"
            )
        with torch.inference_mode():
            return to_array(self.embed(**tokens.to(self.device)))

    def _say_cuts(self, texts: list[str]) -> None:
        if self.notes:
            return
        for text, tokens in zip(texts, self.tokenizer(texts, verbose=False)["input_ids"], strict=True):
            if len(tokens) > self.limit:
                self.notes.append(
                    f"texts longer than {self.limit} tokens are cut there: {text[:40]!r}… has {len(tokens)}"
                )
                return
