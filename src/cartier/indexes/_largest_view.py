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
        anchors = _anchors(frame, detections.boxes_xyxy) if self.min_views > 1 else [None] * len(detections)
        for which in reversed(sizes.argsort()):  # largest first: the rest of a thing's boxes then cost nothing
            size, label, anchor = float(sizes[which]), detections.labels[which], anchors[which]
            if size <= 0:
                continue
            spots = self._spots.setdefault(label, [])
            spot = next((s for s in spots if _agree(s.anchor, anchor)), None)
            if spot is not None and spot.last_frame != frame.index:
                spot.frames, spot.last_frame = spot.frames + 1, frame.index
            better = len(spots) < MOST_SPOTS if spot is None else size > spot.size_px2
            place = self.place(frame, detections, int(which)) if better else None
            if place is not None and spot is not None:
                spot.size_px2, spot.place = size, place
            elif place is not None:
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


def _anchors(frame: Frame, boxes_xyxy: npt.NDArray[np.float32]) -> list[tuple[float, ...] | None]:
    """Roughly where each box's content is: its centre, at the near third of the depths on a grid over its middle."""
    if frame.depth_m is None or not len(boxes_xyxy):
        return [None] * len(boxes_xyxy)
    (height, width), camera = frame.depth_m.shape, frame.camera
    x1, y1, x2, y2 = boxes_xyxy.T[:, :, None]
    grid = np.linspace(0.25, 0.75, 9)
    cols = np.clip(x1 + grid * (x2 - x1), 0, width - 1).astype(np.intp)
    rows = np.clip(y1 + grid * (y2 - y1), 0, height - 1).astype(np.intp)
    depths = frame.depth_m[rows[:, :, None], cols[:, None, :]].reshape(len(boxes_xyxy), -1)
    valid = (depths > 0).sum(1)
    depths = np.sort(np.where(depths > 0, depths, np.inf), axis=1)
    z = depths[np.arange(len(depths)), valid // 3]
    middle = np.stack(
        [((x1 + x2)[:, 0] / 2 - camera.cx) / camera.fx, ((y1 + y2)[:, 0] / 2 - camera.cy) / camera.fy, np.ones(len(z))],
        1,
    )
    world = transform(frame.world_from_camera, middle * np.where(valid > 0, z, 1)[:, None])
    return [tuple(point) if count else None for point, count in zip(world.tolist(), valid, strict=True)]


def _agree(a: tuple[float, ...] | None, b: tuple[float, ...] | None) -> bool:
    """Whether two anchors are of one thing; where there is no depth to tell them apart, all are."""
    if a is None or b is None:
        return a is b
    return sum((p - q) ** 2 for p, q in zip(a, b, strict=True)) <= AGREE_M**2
