"""What ObjectDepth and ObjectViewpoint share: per name, the view whose corrected box is the largest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict
from pathlib import Path

from cartier.errors import InputError
from cartier.files import read_json, write_json
from cartier.geometry import weak_perspective_size
from cartier.types import Detections, Frame, Place


class LargestView(ABC):
    """Keeps one place per name: of the frame with the largest box, corrected for perspective distortion.

    Source: CARTIER (arXiv 2307.11865), object detection and spatial language index.
    """

    def __init__(self) -> None:
        self._best: dict[str, tuple[float, Place]] = {}

    @abstractmethod
    def place(self, frame: Frame, detections: Detections, which: int) -> Place | None:
        """The place that one detection gives, or None if it gives none (no depth, say)."""

    def add(self, frame: Frame, detections: Detections) -> None:
        sizes = weak_perspective_size(detections.boxes_xyxy, frame.camera)
        for which in reversed(sizes.argsort()):  # largest first: the rest of a name's boxes then cost nothing
            label, size = detections.labels[which], float(sizes[which])
            if size > 0 and (label not in self._best or size > self._best[label][0]):
                place = self.place(frame, detections, int(which))
                if place is not None:
                    self._best[label] = (size, place)

    def names(self) -> list[str]:
        return sorted(self._best)

    def locate(self, name: str) -> Place | None:
        entry = self._best.get(name)
        return entry[1] if entry else None

    def save(self, folder: Path) -> None:
        write_json(folder / "places.json", [{"size_px2": size, **asdict(place)} for size, place in self._best.values()])

    def load(self, folder: Path) -> None:
        file = folder / "places.json"
        rows = read_json(file)
        try:
            self._best = {str(row["label"]): (float(row.pop("size_px2")), Place(**row)) for row in rows}
        except (TypeError, ValueError, KeyError, AttributeError, InputError) as error:
            raise InputError(f"{file} is damaged ({error}): map the recording again") from error
