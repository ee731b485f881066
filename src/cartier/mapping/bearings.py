"""The map of objects where frames have no depth: how far an object is, bearings from several standpoints tell.

An object begins as a ray with possible distances along it. Each further view weighs them by where, and how large, each would show
the object. Source: particles along a ray, Davison, Real-time simultaneous localisation and mapping with a single camera, 2003.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from cartier.mapping.object_map import COLUMNS, LEAST_ANGLE, ObjectMap
from cartier.mapping.observation import POINTS, Lifted, lift
from cartier.types import Array, Frame, MapObject

DISTANCES_M = np.geomspace(0.3, 20, POINTS)
USUAL_M, TIMES = 0.5, 3.0  # the size of things, and how far sizes spread about it
MATCH = 0.4  # what a pair must be worth to be of one object
OFF, SCALE = 0.35, 0.5  # of its box and of its size: how far a view usually lies off
OUTLIER = 0.05  # one view never excludes a distance
TOLD = 0.25  # spread of log distance below which a distance is told
TENTH, NINE_TENTHS = 0.1, 0.9


class BearingMap(ObjectMap):
    """Objects from bearings. The box of one whose distance is open covers four fifths of the places where it may be."""

    columns: ClassVar = {**COLUMNS, "odds": ((POINTS,), "f4"), "extent": ((2,), "f4")}
    """What each distance is worth, and how wide and high the object is at a distance of one metre."""

    def _lift(self, frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None) -> Lifted:
        """As if all stood in one plane, a metre away; the points are those along each ray."""
        plane = np.ones(frame.rgb.shape[:2], np.float32)
        lifted = lift(replace(frame, depth_m=plane), boxes_xyxy, masks)
        camera = frame.world_from_camera[:3, 3]
        points = camera + (lifted.middle - camera)[:, None] * DISTANCES_M[:, None]
        return lifted._replace(points=points.astype(np.float32))

    def _expected(self, frame: Frame) -> tuple[npt.NDArray[np.bool_], Array, npt.NDArray[np.intp]]:
        centres, sizes = self._projected(frame)
        each, best = np.arange(self._count), self._rows["odds"][: self._count].argmax(1)
        centre, half = centres[each, best], sizes[each, best] / 2
        boxes = np.nan_to_num(np.concatenate([centre - half, centre + half], axis=1))
        inside = ((centre > 0) & (centre < (frame.camera.width, frame.camera.height))).all(1)  # NaN compares as False
        wide = half.max(1, initial=0) * 2 / frame.camera.fx > LEAST_ANGLE
        return inside & wide & (self._spread() < TOLD), boxes, np.flatnonzero(np.isfinite(centres).any((1, 2)))

    def _projected(self, frame: Frame) -> tuple[Array, Array]:
        """Where each distance shows each object: centre and size (n, 48, 2) in pixels, NaN behind the camera."""
        rows, n, camera, pose = self._rows, self._count, frame.camera, frame.world_from_camera
        xyz = (rows["points"][:n] - pose[:3, 3]) @ pose[:3, :3]
        z = np.where(xyz[..., 2:] > 0.05, xyz[..., 2:], np.nan)
        focal = np.array((camera.fx, camera.fy))
        sizes = rows["extent"][:n, None] * DISTANCES_M[:, None] * focal / z
        return xyz[..., :2] / z * focal + (camera.cx, camera.cy), sizes

    def _matched(
        self,
        frame: Frame,
        boxes: Array,
        lifted: Lifted,
        labels: npt.NDArray[np.intp],
        leader: npt.NDArray[np.intp],
        found: npt.NDArray[np.intp],
        image_boxes: Array,
        near: npt.NDArray[np.intp],
    ) -> npt.NDArray[np.intp]:
        from scipy.optimize import linear_sum_assignment

        row = np.full(len(found), -1)
        if not len(found) or not len(near):
            return row
        centres, sizes = (values[near][None] for values in self._projected(frame))
        own, size = (boxes[found, :2] + boxes[found, 2:]) / 2, boxes[found, 2:] - boxes[found, :2]
        own, size = own[:, None, None], size[:, None, None]
        off = np.square((centres - own) / (OFF * np.maximum(size, sizes))).sum(3)
        edge = np.array((frame.camera.width, frame.camera.height)) - 1
        cut = np.any((boxes[found, :2] < 1) | (boxes[found, 2:] > edge - 1), axis=1)[:, None, None]
        scale = np.square(np.log(size / sizes) / SCALE).mean(3)
        fits = np.nan_to_num(np.exp(-0.5 * np.where(cut, off / 4, off + scale)))  # (detections, objects, distances)
        odds = self._rows["odds"][near]
        best = (fits * np.sqrt(odds / odds.max(1, keepdims=True))).max(2)
        worth = best * (0.4 + 0.6 * self._agreement(labels, leader, found, near))
        for i, j in zip(*linear_sum_assignment(-np.where(worth >= MATCH, worth, 0)), strict=True):
            if worth[i, j] >= MATCH:
                row[i] = near[j]
                weighed = odds[j] * (fits[i, j] + OUTLIER)
                self._rows["odds"][near[j]] = weighed / weighed.sum()
        return row

    def _begin(self, lifted: Lifted, d: int, time_s: float) -> int:
        o = super()._begin(lifted, d, time_s)
        across, along, up = lifted.reach_high[d] - lifted.reach_low[d]
        extent = np.maximum((np.hypot(across, along), up), 1e-3)
        usual = np.exp(-0.5 * np.square(np.log(DISTANCES_M * extent.max() / USUAL_M) / np.log(TIMES)))
        self._rows["extent"][o], self._rows["odds"][o] = extent, usual / usual.sum()
        return o

    def _follow(self, objects: npt.NDArray[np.intp], lifted: Lifted, seen: npt.NDArray[np.intp], shrink: Array) -> None:
        for o in objects:
            self._stretch(int(o))

    def _stretch(self, o: int) -> None:
        """The box: as large as the object is at its likeliest distance, over all of the ray where it may well be."""
        rows = self._rows
        below = np.cumsum(rows["odds"][o])
        first, middle, last = np.minimum(np.searchsorted(below, (TENTH, 0.5, NINE_TENTHS)), POINTS - 1)
        ends = rows["points"][o, [first, middle, last] if self._spread()[o] > TOLD else [middle]]
        half = rows["extent"][o, [0, 0, 1]] * DISTANCES_M[middle] / 2
        for side in ("low", "reach_low"):
            rows[side][o] = ends.min(0) - half
        for side in ("high", "reach_high"):
            rows[side][o] = ends.max(0) + half

    def _merge(self, keep: int, drop: int) -> None:
        kept = {name: self._rows[name][keep].copy() for name in ("points", "low", "high", "reach_low", "reach_high")}
        super()._merge(keep, drop)
        for name, value in kept.items():
            self._rows[name][keep] = value

    def _spread(self) -> Array:
        """The standard deviation of each object's log distance (n,)."""
        odds, log = self._rows["odds"][: self._count], np.log(DISTANCES_M)
        mean = odds @ log
        return np.asarray(np.sqrt(np.maximum(odds @ log**2 - mean**2, 0)))

    def _object(self, o: int, likely: float, names: Sequence[str], aliases: Mapping[int, Sequence[int]]) -> MapObject:
        obj = super()._object(o, likely, names, aliases)
        place = obj.position if self._spread()[o] < TOLD else None
        return replace(obj, views=tuple(replace(view, surface=place) for view in obj.views))
