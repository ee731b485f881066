"""Bearing-only geometry: objects of frames without depth, whose distance follows from bearings from several viewpoints.

An object begins as a ray with possible distances along it. Each further view weighs them by where, and how large,
each would show the object. Source: particles along a ray, Davison, Real-time simultaneous localisation and mapping
with a single camera, 2003.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from cartier.mapping.association import assign
from cartier.mapping.columns import ColumnKinds, Columns, Indices
from cartier.mapping.config import MappingConfig
from cartier.mapping.existence import Visibility
from cartier.mapping.observation import SURFACE_POINTS, LiftedDetections, lift
from cartier.types import Array, Frame, OrientedBox

DISTANCES_M = np.geomspace(0.3, 20, SURFACE_POINTS)
USUAL_SIZE_M, SIZE_FACTOR = 0.5, 3.0  # of objects, and how far sizes spread about it
POSITION_SIGMA, LOG_SIZE_SIGMA = 0.35, 0.5  # of a view: in sizes of the box, and of the logarithm of its size
OUTLIER_LIKELIHOOD = 0.05  # one view never excludes a distance
MAX_LOG_SPREAD = 0.25  # standard deviation of log distance below which the distance is known
LABEL_FREE = 0.4  # of a likelihood, that counts whatever the label
LOW_QUANTILE, HIGH_QUANTILE = 0.1, 0.9


class BearingGeometry:
    """Objects from bearings. The box of one whose distance is open covers four fifths of the places where it may be."""

    with_depth: ClassVar[bool] = False
    columns: ClassVar[ColumnKinds] = {"distance_odds": ((SURFACE_POINTS,), "f4"), "size_at_1m": ((2,), "f4")}
    """The weight of each distance, and how wide and high the object is at a distance of one metre."""

    def __init__(self, config: MappingConfig) -> None:
        self.config = config

    def lift(self, frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None) -> LiftedDetections:
        """As if all stood in one plane, a metre away; the points are those along each ray."""
        plane = np.ones(frame.rgb.shape[:2], np.float32)
        lifted = lift(frame, plane, boxes_xyxy, masks)
        camera = frame.world_from_camera[:3, 3]
        points = camera + (lifted.centroid - camera)[:, None] * DISTANCES_M[:, None]
        return lifted._replace(points=points.astype(np.float32))

    def predict(self, columns: Columns, frame: Frame) -> Visibility:
        """Without depth, no object is ever known to be vacated."""
        centres, sizes = _projected(columns, frame)
        each, best = np.arange(len(centres)), columns["distance_odds"].argmax(1)
        centre, half = centres[each, best], sizes[each, best] / 2
        boxes = np.nan_to_num(np.concatenate([centre - half, centre + half], axis=1))
        inside = ((centre > 0) & (centre < (frame.camera.width, frame.camera.height))).all(1)  # NaN compares as False
        wide = half.max(1, initial=0) * 2 / frame.camera.fx > self.config.existence.min_angle_rad
        observable = inside & wide & self.distance_known(columns)
        may_appear = np.flatnonzero(np.isfinite(centres).any((1, 2)))
        return Visibility(observable, np.zeros_like(observable), boxes, may_appear)

    def associate(
        self,
        columns: Columns,
        candidates: Indices,
        frame: Frame,
        boxes_xyxy: Array,
        extents: tuple[Array, Array],
        expected_xyxy: Array,
        agreement: Array,
    ) -> Indices:
        """Matches (k, 2); the distances of matched objects are weighed by how well each fits."""
        centres, sizes = (values[candidates][None] for values in _projected(columns, frame))
        fits = _likelihoods(boxes_xyxy, centres, sizes, frame)
        odds = columns["distance_odds"][candidates]
        best = (fits * np.sqrt(odds / odds.max(1, keepdims=True))).max(2)
        cost = -(best * (LABEL_FREE + (1 - LABEL_FREE) * agreement))
        matches = assign(cost, -self.config.association.bearing_threshold)[0]
        for i, j in matches:
            weighed = odds[j] * (fits[i, j] + OUTLIER_LIKELIHOOD)
            columns["distance_odds"][candidates[j]] = weighed / weighed.sum()
        return matches

    def spawn(self, columns: Columns, row: int, lifted: LiftedDetections, detection: int) -> None:
        columns["points"][row] = lifted.points[detection]
        across, along, up = lifted.extent_max[detection] - lifted.extent_min[detection]
        size = np.maximum((np.hypot(across, along), up), 1e-3)
        log_ratio = np.log(DISTANCES_M * size.max() / USUAL_SIZE_M) / np.log(SIZE_FACTOR)
        prior = np.exp(-0.5 * np.square(log_ratio))
        columns["size_at_1m"][row], columns["distance_odds"][row] = size, prior / prior.sum()

    def update(
        self, columns: Columns, rows: Indices, lifted: LiftedDetections, detections: Indices, shrink: Array
    ) -> None:
        """Boxes as large as objects are at their likeliest distance, over all of the ray where they may well be."""
        known = self.distance_known(columns)
        for row in rows:
            below = np.cumsum(columns["distance_odds"][row])
            quantiles = np.searchsorted(below, (LOW_QUANTILE, 0.5, HIGH_QUANTILE))
            first, middle, last = np.minimum(quantiles, SURFACE_POINTS - 1)
            ends = columns["points"][row, [middle] if known[row] else [first, middle, last]]
            half = columns["size_at_1m"][row, [0, 0, 1]] * DISTANCES_M[middle] / 2
            columns["box_min"][row] = columns["extent_min"][row] = ends.min(0) - half
            columns["box_max"][row] = columns["extent_max"][row] = ends.max(0) + half

    def keep_views(
        self,
        columns: Columns,
        rows: Indices,
        frame: Frame,
        detections: Indices,
        boxes_xyxy: Array,
        worth: Array,
        masks: npt.NDArray[np.bool_] | None,
    ) -> None:
        """Without depth, views show no surface."""

    def fit_boxes(
        self, columns: Columns, walls_yaw: float | None, shapes: npt.NDArray[np.int8]
    ) -> tuple[Array, list[OrientedBox | None]]:
        return np.stack([columns["box_min"], columns["box_max"]], axis=1), [None] * len(columns["id"])

    def fitted_box(self, columns: Columns, row: int) -> Array | None:
        return None

    def merge(self, columns: Columns, keep: int, drop: int) -> None:
        """Rays cannot be joined: that of the object with more detections stays."""

    def distance_known(self, columns: Columns) -> npt.NDArray[np.bool_]:
        """Whether the distances of objects (n,) spread little."""
        odds, log = columns["distance_odds"], np.log(DISTANCES_M)
        mean = odds @ log
        return np.asarray(np.sqrt(np.maximum(odds @ log**2 - mean**2, 0)) < MAX_LOG_SPREAD)


def _projected(columns: Columns, frame: Frame) -> tuple[Array, Array]:
    """Where each distance shows each object: centre and size (n, 48, 2) in pixels, NaN behind the camera."""
    camera, pose = frame.camera, frame.world_from_camera
    xyz = (columns["points"] - pose[:3, 3]) @ pose[:3, :3]
    z = np.where(xyz[..., 2:] > 0.05, xyz[..., 2:], np.nan)
    focal = np.array((camera.fx, camera.fy))
    sizes = columns["size_at_1m"][:, None] * DISTANCES_M[:, None] * focal / z
    return xyz[..., :2] / z * focal + (camera.cx, camera.cy), sizes


def _likelihoods(boxes_xyxy: Array, centres: Array, sizes: Array, frame: Frame) -> Array:
    """Likelihood (n, m, 48), 1 at best, of boxes (n, 4) by ``centres`` and ``sizes`` (1, m, 48, 2) at each distance."""
    middle, size = (boxes_xyxy[:, :2] + boxes_xyxy[:, 2:]) / 2, boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]
    middle, size = middle[:, None, None], size[:, None, None]
    off = np.square((centres - middle) / (POSITION_SIGMA * np.maximum(size, sizes))).sum(3)
    edge = np.array((frame.camera.width, frame.camera.height)) - 1
    cut = np.any((boxes_xyxy[:, :2] < 1) | (boxes_xyxy[:, 2:] > edge - 1), axis=1)[:, None, None]
    scale = np.square(np.log(size / sizes) / LOG_SIZE_SIGMA).mean(3)
    return np.asarray(np.nan_to_num(np.exp(-0.5 * np.where(cut, off / 4, off + scale))))
