"""Cache of mapped homes: each is mapped once and kept in a folder that is named after what made it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins, specs
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.photos import photo_of
from cartier.pipeline import map_home
from cartier_dollhouse import network as dollhouse_detector

INDEXES = ("object_depth", "object_depth_paper", "object_viewpoint", "vlmaps")
PIXELS = "embedded:pixels"
VERSION = 6  # of what a map holds; a change in mapping that older maps must not survive raises it


@dataclass(frozen=True)
class MapSettings:
    """All that a map depends on, besides the home."""

    world: str = "dollhouse"
    detector: str = "ground_truth"
    encoder: str = "embedded"
    seed: int = 0


def encoder_for(detector: str) -> str:
    """The encoder that goes with a detector: one that has dense features gives them, for others label features are
    used."""
    return PIXELS if detector.partition(":")[0] == "embedded" else "embedded"


def file_name(text: str) -> str:
    """A text as the name of a file or folder."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in text)[:80]


class Maps:
    """Mapped homes of one world, in ``folder``; a home is explored and mapped when it is first asked for."""

    def __init__(self, folder: Path, settings: MapSettings, indexes: Sequence[str] = INDEXES) -> None:
        self.folder, self.settings, self._indexes = folder, settings, tuple(indexes)
        self.world = plugins.make("worlds", settings.world)

    def get(self, home: str, progress: Callable[[str, int, int], None] | None = None) -> Home:
        """``progress`` is told (home, frames done, frames in all). Raises InputError for an unknown home."""
        folder = self._folder_of(home)
        if folder.exists():
            try:
                return Home.load(folder)
            except InputError:  # of an older cartier, or damaged: make it anew
                pass
        options: dict[str, Any] = {"seed": self.settings.seed}
        recording = self.world.explore(home, **options)
        detector = specs.detector(self.settings.detector, recording)
        step = (lambda done, total: progress(home, done, total)) if progress else None
        map_home(recording, detector, self._indexes, encoder=self.settings.encoder, every=1, progress=step).save(folder)
        return Home.load(folder)

    def photo(self, home: str, frame: int) -> npt.NDArray[np.uint8] | None:
        """The evidence photo (H, W, 3) of a frame, if the home's map keeps it."""
        return photo_of(Home.load(self._folder_of(home)), frame)

    def _folder_of(self, home: str) -> Path:
        made_of = asdict(self.settings) | {"home": home, "version": VERSION}
        if self._indexes != INDEXES:
            made_of["indexes"] = self._indexes
        if encoder_for(self.settings.detector) == PIXELS or self.settings.encoder == PIXELS:
            ours = dollhouse_detector.load()
            made_of["model"] = [ours.sha256, asdict(ours.score_model)]
        key = json.dumps(made_of, sort_keys=True)
        return self.folder / f"{file_name(home)}-{hashlib.sha256(key.encode()).hexdigest()[:10]}"
