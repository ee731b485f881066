"""What ObjectDepth and ObjectViewpoint share: per name, the view whose corrected box is the largest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.files import json_bytes, parse_json
from cartier.geometry import transform, weak_perspective_size
from cartier.types import Detections, Frame, Place

AGREE_M = 0.6  # detections of one name this close together are of one thing
SAME_PLACE = 0.25  # overlap in space (IoU) from which on two names are for one thing
STRONGER = 1.5  # times the other's support that a name needs to outdo it, or the other's best score to explain a hint
PLACES = "places.json"
MOST_SPOTS = 32  # a name that was seen in more places than this is noise


@dataclass
class _Spot:
    """One thing of a name: the view of it that is kept, in how many frames it was seen where it is, their scores' sum, the best.

    ``box_m`` is roughly the space it fills, as that view shows it: an upright box (x1, y1, z1, x2, y2, z2).
    """

    size_px2: float
    place: Place
    anchor: tuple[float, ...] | None
    frames: int
    last_frame: int
    support: float
    best: float
    box_m: tuple[float, ...] | None


class LargestView(ABC):
    """One place per name: of the frame with the largest box, corrected for perspective distortion.

    Source: CARTIER (arXiv 2307.11865), object detection and spatial language index. With ``min_views`` above 1 a view counts
    only if so many frames agree, within 0.6 m, that such a thing is there: one lucky false box then changes nothing. Of two
    names for one place that with the higher scores in more frames stands (a desk that some frames call a dining table).
    What such a list leaves out is glimpsed, unless something surer was listed where it was: that was its other name.
    """

    def __init__(self, min_views: int) -> None:
        self.min_views = min_views
        self._spots: dict[str, list[_Spot]] = {}
        self._hints: dict[str, list[_Spot]] = {}  # all that was seen, each with its surest view
        self._standing: tuple[int, dict[str, list[_Spot]], dict[str, _Spot]] | None = None  # for so many views

    @abstractmethod
    def place(self, frame: Frame, detections: Detections, which: int) -> Place | None:
        """The place that one detection gives, or None if it gives none (no depth, say)."""

    def add(self, frame: Frame, detections: Detections) -> None:
        self._standing = None
        if self.min_views == 1:
            return self._keep(self._spots, frame, detections, [None] * len(detections))
        for seen in filter(None, (detections, detections.glimpsed)):
            anchors = _anchors(frame, seen.boxes_xyxy)
            if seen is detections:
                self._keep(self._spots, frame, seen, anchors)
            self._keep(self._hints, frame, seen, anchors, surest=True)

    def _keep(
        self,
        kept: dict[str, list[_Spot]],
        frame: Frame,
        seen: Detections,
        anchors: list[tuple[float, ...] | None],
        surest: bool = False,
    ) -> None:
        """Counts what was seen, and keeps of each thing the largest view, or the ``surest`` one."""
        sizes = weak_perspective_size(seen.boxes_xyxy, frame.camera)
        # best first: the rest of a thing's boxes then cost nothing
        for which in reversed((seen.scores if surest else sizes).argsort()):
            size, score = float(sizes[which]), float(seen.scores[which])
            label, anchor = seen.labels[which], anchors[which]
            if size <= 0:
                continue
            spots = kept.setdefault(label, [])
            spot = next((s for s in spots if _agree(s.anchor, anchor)), None)
            if spot is None:
                better = len(spots) < MOST_SPOTS
            else:
                better = score > spot.best if surest else size > spot.size_px2
                if spot.last_frame != frame.index:
                    spot.frames, spot.last_frame = spot.frames + 1, frame.index
                    spot.support, spot.best = spot.support + score, max(spot.best, score)
            place = self.place(frame, seen, int(which)) if better else None
            if place is None:
                continue
            box_m = _box_m(frame, seen.boxes_xyxy[which], anchor)
            if spot is not None:
                spot.size_px2, spot.place, spot.box_m = size, place, box_m
            else:
                spots.append(_Spot(size, place, anchor, 1, frame.index, score, score, box_m))

    def glimpsed(self) -> list[str]:
        """Not among them: what enough frames agreed on and another name outdid."""
        return sorted(self._settled()[1])

    def glimpse(self, name: str) -> Place | None:
        """Of several places that with the most support, as its surest view shows it."""
        spot = self._settled()[1].get(name)
        return None if spot is None else replace(spot.place, sure=False)

    def names(self) -> list[str]:
        return sorted(name for name in self._spots if self.locate(name) is not None)

    def locate(self, name: str) -> Place | None:
        seen = self._settled()[0].get(name)
        return max(seen, key=lambda spot: (spot.best, spot.size_px2)).place if seen else None

    def _settled(self) -> tuple[dict[str, list[_Spot]], dict[str, _Spot]]:
        """Per name the spots that stand, and the spot at which a name that does not was glimpsed."""
        if self._standing is None or self._standing[0] != self.min_views:
            agreed = [spot for spots in self._spots.values() for spot in spots if spot.frames >= self.min_views]
            self._standing = self.min_views, self._not_outdone(agreed), _unexplained(self._hints, agreed)
        return self._standing[1:]

    def _not_outdone(self, seen: list[_Spot]) -> dict[str, list[_Spot]]:
        """Per name the spots that enough frames agree on, without those at whose place another name has more support."""
        outdone = _lost(seen, seen, attrgetter("support")) if self.min_views > 1 else set()
        standing: dict[str, list[_Spot]] = {}
        for spot in seen:
            if id(spot) not in outdone:
                standing.setdefault(spot.place.label, []).append(spot)
        return standing

    def state(self) -> dict[str, bytes]:
        rows = [asdict(spot) for spots in self._spots.values() for spot in spots]
        hints = [asdict(spot) for spots in self._hints.values() for spot in spots]
        return {PLACES: json_bytes({"min_views": self.min_views, "spots": rows, "hints": hints})}

    def restore(self, state: Mapping[str, bytes]) -> None:
        kept = parse_json(state[PLACES], PLACES)
        try:
            self.min_views, self._standing = int(kept["min_views"]), None
            self._spots, self._hints = _read(kept["spots"]), _read(kept.get("hints", []))
        except (TypeError, ValueError, KeyError, AttributeError, InputError) as error:
            raise InputError(f"{PLACES} is damaged ({error})") from error


def _read(rows: list[dict[str, Any]]) -> dict[str, list[_Spot]]:
    """Spots per name from a file's rows. Raises what is raised where they are not what ``save`` wrote."""
    found: dict[str, list[_Spot]] = {}
    for row in rows:
        place, size, frames = Place(**row["place"]), float(row["size_px2"]), int(row["frames"])
        last, support, box = int(row["last_frame"]), float(row.get("support", frames)), row.get("box_m")
        best = float(row.get("best", 0))
        box_m = None if box is None else tuple(float(value) for value in box)
        if box_m is not None and len(box_m) != 6:
            raise ValueError("box_m must be six numbers")
        spot = _Spot(size, place, row["anchor"], frames, last, support, best, box_m)
        found.setdefault(str(place.label), []).append(spot)
    return found


def _unexplained(hints: dict[str, list[_Spot]], agreed: list[_Spot]) -> dict[str, _Spot]:
    """Of each name on which no frames agree the spot with the most support, but none where a surer, agreed spot is."""
    names = {spot.place.label for spot in agreed}
    explained = _lost([spot for spots in hints.values() for spot in spots], agreed, attrgetter("best"))
    left = {n: [s for s in spots if id(s) not in explained] for n, spots in hints.items() if n not in names}
    return {name: max(spots, key=lambda s: (s.support, s.best)) for name, spots in left.items() if spots}


def _lost(some: list[_Spot], others: list[_Spot], strength: Callable[[_Spot], float]) -> set[int]:
    """The ids of those spots at whose place another name among the ``others`` is so much stronger that it is the right one."""
    some, others = ([spot for spot in spots if spot.box_m is not None] for spots in (some, others))
    if not some or not others:
        return set()
    (names, boxes, strengths), (other_names, other_boxes, other_strengths) = (
        tuple(np.array(column) for column in zip(*((s.place.label, s.box_m, strength(s)) for s in spots), strict=True))
        for spots in (some, others)
    )
    rivals = (names[:, None] != other_names) & (_overlaps(boxes, other_boxes) > SAME_PLACE)
    lost = np.any(rivals & (other_strengths > STRONGER * strengths[:, None]), axis=1)
    return {id(spot) for spot, out in zip(some, lost.tolist(), strict=True) if out}


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


def _box_m(
    frame: Frame, box_xyxy: npt.NDArray[np.float32], anchor: tuple[float, ...] | None
) -> tuple[float, ...] | None:
    """An upright box in space round an anchor, as wide both ways and as high as a box in the image is at its distance."""
    if anchor is None:
        return None
    z = float((np.array(anchor) - frame.world_from_camera[:3, 3]) @ frame.world_from_camera[:3, 2])
    half = abs(z) / 2 * (box_xyxy[2:] - box_xyxy[:2]).astype(np.float64) / (frame.camera.fx, frame.camera.fy)
    reach = np.array([half[0], half[0], half[1]])
    return (*(anchor - reach).tolist(), *(anchor + reach).tolist())


def _overlaps(some_m: npt.NDArray[np.float64], others_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Intersection over union (N, M) of upright boxes (N, 6) and (M, 6)."""
    sides = np.minimum(some_m[:, None, 3:], others_m[:, 3:]) - np.maximum(some_m[:, None, :3], others_m[:, :3])
    one, other = ((boxes[:, 3:] - boxes[:, :3]).prod(1) for boxes in (some_m, others_m))
    shared = np.maximum(sides, 0).prod(2)
    union = one[:, None] + other - shared
    return np.asarray(shared / np.where(union > 0, union, 1))


def _agree(a: tuple[float, ...] | None, b: tuple[float, ...] | None) -> bool:
    """Whether two anchors are of one thing; where there is no depth to tell them apart, all are."""
    if a is None or b is None:
        return a is b
    return sum((p - q) ** 2 for p, q in zip(a, b, strict=True)) <= AGREE_M**2
