"""Ten frames of a walk through the built-in studio, rendered once in each process that runs tests."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from cartier.recordings.folder import save
from cartier.testing import sample_frames
from cartier.types import Frame, TrueObject


class Studio:
    """A recording of them, with the name of one of the dollhouse: the detector that maps it is the dollhouse's own."""

    name, notes = "dollhouse studio", ("a simulation: the dollhouse",)
    truth: Sequence[TrueObject] | None = None

    def __init__(self) -> None:
        self.frames = sample_frames()
        self.camera = self.frames[0].camera

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return self.frames[index]

    def fingerprint(self) -> str:
        return "ten frames of the studio"


@cache
def studio() -> Studio:
    return Studio()


def saved_studio(folder: Path) -> Path:
    """A folder that records the walk."""
    save(studio(), folder)
    return folder
