"""Embedded text encoder (MiniLM, int8): label features, or with embedded:pixels the detector's dense features."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cartier.errors import BackendError
from cartier.models.minilm import MAX_TOKENS, TextEncoder
from cartier.types import Array, Frame
from cartier_dollhouse.network import FOLDER

if TYPE_CHECKING:
    from cartier_dollhouse.network.inference import Inference


def make(
    model: str = "words", folder: str | Path = FOLDER, provider: str = "cpu", threads: int | None = None
) -> Embedded:
    """``model`` is "words", which encodes labels only, or "pixels": the dense features of the embedded detector.

    ``folder``, ``provider`` and ``threads`` are those of the detector ``embedded``; both share one inference per frame.
    """
    if model == "words":
        return Embedded()
    if model != "pixels":
        raise BackendError(
            f"the embedded encoder works from words or from pixels (embedded:pixels), not from {model!r}"
        )
    from cartier_dollhouse.network.inference import open_inference

    return FromPixels(open_inference(Path(folder), provider, threads))


class Embedded:
    """Words only: an index fills the boxes of a detector with the features of their labels."""

    name = "embedded (all-MiniLM-L6-v2, int8)"
    text_only = True

    def __init__(self) -> None:
        self._encode = TextEncoder()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out of the texts so far."""
        cut = self._encode.cut
        return (f"{cut} texts were longer than {MAX_TOKENS} tokens: only their beginning was read",) if cut else ()

    def image(self, frame: Frame) -> Array:
        raise BackendError("the embedded encoder encodes no images: use the features of a detector's labels")

    def text(self, texts: Sequence[str]) -> Array:
        """(n, 384) float32 unit vectors."""
        return self._encode(texts)


class FromPixels(Embedded):
    """Dense features after LSeg (Li et al. 2022): trained to match the names' vectors of a frozen text encoder.

    Of the 384 dimensions only those directions are kept in which the names of the dollhouse's types differ.
    """

    text_only = False

    def __init__(self, inference: Inference) -> None:
        super().__init__()
        self._inference = inference
        self.name = "embedded dollhouse detector's features, from pixels"

    def image(self, frame: Frame) -> Array:
        """(h, w, D) float32 unit vectors. Raises BackendError if the network gives what it must not."""
        return self._inference.features(frame)

    def text(self, texts: Sequence[str]) -> Array:
        """(n, D) float32 unit vectors."""
        return self._inference.model.project(super().text(texts))
