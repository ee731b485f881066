"""The text encoder that ships inside (MiniLM, int8); its images are labels painted, or with embedded:pixels what the eyes see."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cartier.errors import BackendError
from cartier.eyes import FOLDER
from cartier.minilm import MAX_TOKENS, TextEncoder
from cartier.types import Array, Frame

if TYPE_CHECKING:
    from cartier.eyes.sight import Sight


def make(
    model: str = "words", folder: str | Path = FOLDER, provider: str = "cpu", threads: int | None = None
) -> Embedded:
    """``model`` is "words", which paints what a detector found, or "pixels": the dense features of the eyes that ship inside.

    ``folder``, ``provider`` and ``threads`` are those of the detector ``embedded``; eyes that both use look once at a frame.
    """
    if model == "words":
        return Embedded()
    if model != "pixels":
        raise BackendError(
            f"the embedded encoder works from words or from pixels (embedded:pixels), not from {model!r}"
        )
    from cartier.eyes.sight import open_sight

    return FromPixels(open_sight(Path(folder), provider, threads))


class Embedded:
    """Words only: ``sees`` is False, so an index paints what a detector found with the vectors of the names."""

    name = "embedded (all-MiniLM-L6-v2, int8)"
    sees = False

    def __init__(self) -> None:
        self._encode = TextEncoder()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out of the texts so far."""
        cut = self._encode.cut
        return (f"{cut} texts were longer than {MAX_TOKENS} tokens: only their beginning was read",) if cut else ()

    def image(self, frame: Frame) -> Array:
        raise BackendError("the embedded encoder has no eyes: paint the labels of a detector through its text side")

    def text(self, texts: Sequence[str]) -> Array:
        """(n, 384) float32 unit vectors."""
        return self._encode(texts)


class FromPixels(Embedded):
    """Dense features after LSeg (Li et al. 2022): the text side stayed frozen, and the eyes learnt to match the names' vectors.

    Of the 384 dimensions only those directions are kept in which the names of the dollhouse's types differ.
    """

    sees = True

    def __init__(self, sight: Sight) -> None:
        super().__init__()
        self._sight = sight
        self.name = "embedded eyes' features, from pixels"

    def image(self, frame: Frame) -> Array:
        """(h, w, D) float32 unit vectors. Raises BackendError if the network gives what it must not."""
        return self._sight.features(frame)

    def text(self, texts: Sequence[str]) -> Array:
        """(n, D) float32 unit vectors."""
        return self._sight.eyes.project(super().text(texts))
