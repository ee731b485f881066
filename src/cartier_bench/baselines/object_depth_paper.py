"""ObjectDepth as in the paper: each name's largest box of all frames, mean depth in it; trusts every detection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cartier.errors import MAX_FAR_M, BackendError, InputError
from cartier.geometry import backproject, transform, weak_perspective_size
from cartier.io.files import json_bytes, parse_json, typed
from cartier.types import Array, Detections, Frame, MapObject, Place

KEPT = "places.json"
FAR_M = 2 * MAX_FAR_M  # what is seen lies beyond the camera
FEW = 800  # points enough for a mean to a few millimetres


def make(min_views: int = 1) -> ObjectDepthPaper:
    """``min_views`` frames must show a name before it counts; the paper asks for one."""
    if min_views < 1:
        raise BackendError(f"option min_views must be at least 1, got {min_views}")
    return ObjectDepthPaper(min_views)


class ObjectDepthPaper:
    """Source: CARTIER (arXiv 2307.11865), object detection and spatial language index; sizes are corrected."""

    def __init__(self, min_views: int) -> None:
        self._min_views = min_views
        self._best: dict[str, tuple[float, int, Place]] = {}  # size in px², frames so far, place

    def add(self, frame: Frame, detections: Detections) -> None:
        if frame.depth_m is None:
            return
        sizes = weak_perspective_size(detections.boxes_xyxy, frame.camera)
        counted = set[str]()
        for which in np.argsort(-sizes, kind="stable"):
            label = detections.labels[which]
            if label in counted:
                continue
            size, views, place = self._best.get(label, (0.0, 0, None))
            if sizes[which] > size:
                new = _place(frame, detections, int(which))
                size, place = (float(sizes[which]), new) if new is not None else (size, place)
            if place is not None:
                counted.add(label)
                self._best[label] = size, views + 1, place

    def set_objects(self, objects: Sequence[MapObject]) -> None:
        """It knows no objects."""

    def names(self) -> list[str]:
        return sorted(name for name, (_, views, _) in self._best.items() if views >= self._min_views)

    def locate(self, name: str) -> Place | None:
        _, views, place = self._best.get(name, (0.0, 0, None))
        return place if views >= self._min_views else None

    def state(self) -> dict[str, bytes]:
        rows = [[size, views, asdict(place)] for size, views, place in self._best.values()]
        return {KEPT: json_bytes({"min_views": self._min_views, "places": rows})}

    def restore(self, state: Mapping[str, bytes]) -> None:
        kept: Any = parse_json(state[KEPT], KEPT)
        try:
            self._min_views = typed(kept["min_views"], int)
            places = typed(kept["places"], tuple[tuple[float, int, Place], ...])
            if not all(abs(v) <= FAR_M for _, _, place in places for v in place.position):
                raise ValueError(f"a place lies beyond {FAR_M:g} m")
        except (TypeError, ValueError, KeyError, InputError) as error:
            raise InputError(f"{KEPT} is damaged ({error})") from error
        self._best = {place.label: (size, views, place) for size, views, place in places}


def _place(frame: Frame, detections: Detections, which: int) -> Place | None:
    """The mean of the world points in a box, or in its mask; None where nothing was measured."""
    assert frame.depth_m is not None
    box = detections.boxes_xyxy[which]
    x1, y1 = np.maximum(np.floor(box[:2]), 0).astype(int)
    x2, y2 = np.ceil(box[2:]).astype(int)
    step = int(max(1, (x2 - x1) * (y2 - y1) / FEW) ** 0.5)
    window = np.zeros(frame.depth_m.shape, bool)
    window[y1:y2:step, x1:x2:step] = True
    if detections.masks is not None:
        window &= detections.masks[which]
    points: Array = backproject(frame.depth_m, frame.camera)[window & (frame.depth_m > 0)]
    if not len(points):
        return None
    world = transform(frame.world_from_camera, points.astype(np.float64))
    position, score = tuple(world.mean(0).tolist()), float(detections.scores[which])
    return Place(detections.labels[which], position, score, frame.index, tuple(box.tolist()))
