"""Texts to vectors through a transformers text tower: cut at its token limit, which is said once, and in batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from cartier.encoders.torch_backend import to_array
from cartier.errors import InputError

BATCH = 256


@dataclass
class TextTower:
    """``embed`` takes the tokens as a transformers model does and gives (n, D); ``limit`` and ``vocabulary`` count tokens."""

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
        if (
            int(tokens["input_ids"].max()) >= self.vocabulary
        ):  # on a GPU an index fault would kill the process's context
            raise InputError(
                f"the tokenizer gives token {int(tokens['input_ids'].max())}, but the text tower knows "
                f"{self.vocabulary}: they do not belong together"
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
