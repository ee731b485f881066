"""The text encoder that ships inside (MiniLM, int8); its image side is the detector's labels, painted through the text side."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.errors import BackendError
from cartier.minilm import MAX_TOKENS, TextEncoder
from cartier.types import Array, Frame


def make() -> Embedded:
    """Nothing to choose."""
    return Embedded()


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
