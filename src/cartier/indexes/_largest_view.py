"""What ObjectDepth and ObjectViewpoint share: per name, the view whose corrected box is the largest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.files import read_json, write_json
from cartier.geometry import transform, weak_perspective_size
from cartier.types import Detections, Frame, Place

AGREE_M = 0.6  # detections of one name this close together are of one thing
MOST_SPOTS = 32  # a name that was seen in more places than this is noise


@dataclass
class _Spot:
    """One thing of a name: its largest view so far, and in how many frames it was seen where it is."""

    size_px2: float
    place: Place
    anchor: tuple[float, ...] | None
    frames: int
    last_frame: int


class LargestView(ABC):
    """One place per name: of the frame with the largest box, corrected for perspective distortion.

    Source: CARTIER (arXiv 2307.11865), object detection and spatial language index. With ``min_views`` above 1 a view counts
    only if so many frames agree, within 0.6 m, that such a thing is there: one lucky false box then changes nothing.
    """

    def __init__(self, min_views: int) -> None:
        self.min_views = min_views
        self._spots: dict[str, list[_Spot]] = {}

    @abstractmethod
    def place(self, frame: Frame, detections: Detections, which: int) -> Place | None:
        """The place that one detection gives, or None if it gives none (no depth, say)."""

    def add(self, frame: Frame, detections: Detections) -> None:
        sizes = weak_perspective_size(detections.boxes_xyxy, frame.camera)
        for which in reversed(sizes.argsort()):  # largest first: the rest of a thing's boxes then cost nothing
            size, label = float(sizes[which]), detections.labels[which]
            if size <= 0:
                continue
            anchor = _anchor(frame, detections.boxes_xyxy[which]) if self.min_views > 1 else None
            spots = self._spots.setdefault(label, [])
            spot = next((s for s in spots if _agree(s.anchor, anchor)), None)
            if spot is not None and spot.last_frame != frame.index:
                spot.frames, spot.last_frame = spot.frames + 1, frame.index
            if spot is None or size > spot.size_px2:
                place = self.place(frame, detections, int(which))
                if place is not None and spot is not None:
                    spot.size_px2, spot.place = size, place
                elif place is not None and len(spots) < MOST_SPOTS:
                    spots.append(_Spot(size, place, anchor, 1, frame.index))

    def names(self) -> list[str]:
        return sorted(name for name in self._spots if self.locate(name) is not None)

    def locate(self, name: str) -> Place | None:
        seen = [spot for spot in self._spots.get(name, []) if spot.frames >= self.min_views]
        return max(seen, key=lambda spot: spot.size_px2).place if seen else None

    def save(self, folder: Path) -> None:
        rows = [asdict(spot) for spots in self._spots.values() for spot in spots]
        write_json(folder / "places.json", {"min_views": self.min_views, "spots": rows})

    def load(self, folder: Path) -> None:
        file = folder / "places.json"
        kept = read_json(file)
        try:
            self.min_views, self._spots = int(kept["min_views"]), {}
            for row in kept["spots"]:
                place = Place(**row["place"])
                spot = _Spot(float(row["size_px2"]), place, row["anchor"], int(row["frames"]), int(row["last_frame"]))
                self._spots.setdefault(str(place.label), []).append(spot)
        except (TypeError, ValueError, KeyError, AttributeError, InputError) as error:
            raise InputError(f"{file} is damaged ({error}): map the recording again") from error


def _anchor(frame: Frame, box: npt.NDArray[np.float32]) -> tuple[float, ...] | None:
    """Roughly where a box's content is: its centre at the near third of the depths on a grid over its middle."""
    if frame.depth_m is None:
        return None
    height, width = frame.depth_m.shape
    grid = np.linspace(0.25, 0.75, 9)
    cols = np.clip(box[0] + grid * (box[2] - box[0]), 0, width - 1).astype(np.intp)
    rows = np.clip(box[1] + grid * (box[3] - box[1]), 0, height - 1).astype(np.intp)
    depths = np.sort(frame.depth_m[rows[:, None], cols], axis=None)  # NaN sorts last
    valid = int(np.count_nonzero(depths > 0))
    if not valid:
        return None
    z, camera = float(depths[depths > 0][valid // 3]), frame.camera
    u, v = float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2
    point = np.array([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z])
    return tuple(transform(frame.world_from_camera, point).tolist())


def _agree(a: tuple[float, ...] | None, b: tuple[float, ...] | None) -> bool:
    """Whether two anchors are of one thing; where there is no depth to tell them apart, all are."""
    if a is None or b is None:
        return a is b
    return sum((p - q) ** 2 for p, q in zip(a, b, strict=True)) <= AGREE_M**2
