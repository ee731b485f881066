"""Extent of objects: how boxes and surfaces follow the views that show them, where frames have depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import compress
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from cartier.mapping.association import assign, cost_matrix
from cartier.mapping.box_fitting import SIDES_SEEN, about_z, agreed_surface, sides_seen, surface_box
from cartier.mapping.columns import ColumnKinds, Columns, Indices
from cartier.mapping.config import ExtentConfig, MappingConfig
from cartier.mapping.existence import Visibility, predict_visibility
from cartier.mapping.observation import (
    PATCH_KIND,
    PATCHES_KEPT,
    SURFACE_POINTS,
    LiftedDetections,
    keep_patches,
    lift,
)  # fmt: skip
from cartier.types import Array, Frame, OrientedBox

SIDES = {"box_min": -1, "box_max": 1, "extent_min": -1, "extent_max": 1}
"""The corners of an object's box, and of all that may belong to it; which way is outwards."""
SURFACE_STRIDE = 8  # a view renews one in so many points of a surface


class Geometry(Protocol):
    """How a map of objects finds out where objects are: from depth, or from bearings alone."""

    with_depth: ClassVar[bool]
    columns: ClassVar[ColumnKinds]
    """Columns besides those that every map has."""

    def lift(self, frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None) -> LiftedDetections:
        """Detections in space."""
        ...

    def predict(self, columns: Columns, frame: Frame) -> Visibility:
        """Which objects (n,) the frame should show, and where."""
        ...

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
        """Matches (k, 2) of n detections with ``candidates`` (m,), rows of objects.

        ``extents`` are the corners (n, 3) of the detections in space, ``agreement`` (n, m) is that of labels.
        """
        ...

    def spawn(self, columns: Columns, row: int, lifted: LiftedDetections, detection: int) -> None:
        """Start a new object from a detection."""
        ...

    def update(
        self, columns: Columns, rows: Indices, lifted: LiftedDetections, detections: Indices, shrink: Array
    ) -> None:
        """Let the extents of detected objects follow a view; ``shrink`` (k,) is how fast each may get smaller."""
        ...

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
        """Keep what views show of objects ``rows`` (k,) if it is worth more (N,) than what is kept.

        ``detections`` (k,) are those of the objects, among the boxes (N, 4) and masks (N, H, W) of a frame.
        """
        ...

    def fit_boxes(
        self, columns: Columns, walls_yaw: float | None, shapes: npt.NDArray[np.int8]
    ) -> tuple[Array, list[OrientedBox | None]]:
        """The boxes (n, 2, 3) of all objects, least and greatest corner, and those in the directions of the walls.

        ``shapes`` (n,) are those of ``furniture.shapes``.
        """
        ...

    def fitted_box(self, columns: Columns, row: int) -> Array | None:
        """The fitted box (2, 3) of one object; None where views show too little of it."""
        ...

    def merge(self, columns: Columns, keep: int, drop: int) -> None:
        """Join the extents of two rows that are one object."""
        ...

    def distance_known(self, columns: Columns) -> npt.NDArray[np.bool_]:
        """Which objects (n,) have a known place; the boxes of the others cover where they may be."""
        ...


NewGeometry = Callable[[MappingConfig], Geometry]


def smooth_box(
    columns: Columns, rows: Indices | int, observed: Mapping[str, Array], shrink: Array | float, config: ExtentConfig
) -> None:
    """Move the sides of boxes towards ``observed`` ones: outwards by the grow rate, inwards by ``shrink``."""
    for side, outwards in SIDES.items():
        current = columns[side][rows]
        way = observed[side] - current
        columns[side][rows] = current + way * np.where(way * outwards > 0, config.grow_rate, shrink)


def update_surface(columns: Columns, rows: Indices, points: Array) -> None:
    """Renew surfaces by the ``points`` (k, K, 3) of a view: the first views fill them, later ones change an eighth."""
    count = columns["n_detected"][rows, None]
    first, each = count % SURFACE_STRIDE, np.arange(SURFACE_POINTS)
    some = (each >= first) & ((each - first) % np.minimum(1 + count, SURFACE_STRIDE) == 0)
    columns["points"][rows] = np.where(some[..., None], points, columns["points"][rows])


class DepthGeometry:
    """Objects from depth: each detection shows a surface."""

    with_depth: ClassVar[bool] = True
    columns: ClassVar[ColumnKinds] = {
        "patches": ((PATCHES_KEPT,), PATCH_KIND), "fit_is_stale": ((), "?"),
        "fitted": ((2, 3), "f8"), "fitted_along_walls": ((2, 3), "f8"), "fit_yaw": ((), "f8"), "seen": ((5,), "?"),
        "fit_shape": ((), "i1"),
    }  # fmt: skip

    def __init__(self, config: MappingConfig) -> None:
        self.config = config

    def lift(self, frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None) -> LiftedDetections:
        assert frame.depth_m is not None
        return lift(frame, frame.depth_m, boxes_xyxy, masks)

    def predict(self, columns: Columns, frame: Frame) -> Visibility:
        extent = columns["extent_min"], columns["extent_max"]
        return predict_visibility(columns["points"], *extent, frame, self.config.existence)

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
        config = self.config.association
        known = columns["extent_min"][candidates], columns["extent_max"][candidates]
        cost = cost_matrix(boxes_xyxy, *extents, expected_xyxy, *known, agreement, config.label_weight)
        return assign(cost, -config.threshold)[0]

    def spawn(self, columns: Columns, row: int, lifted: LiftedDetections, detection: int) -> None:
        columns["points"][row] = lifted.points[detection]
        for side in SIDES:
            columns[side][row] = getattr(lifted, side)[detection]

    def update(
        self, columns: Columns, rows: Indices, lifted: LiftedDetections, detections: Indices, shrink: Array
    ) -> None:
        update_surface(columns, rows, lifted.points[detections])
        observed = {side: getattr(lifted, side)[detections] for side in SIDES}
        smooth_box(columns, rows, observed, shrink[:, None], self.config.extent)

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
        changed = keep_patches(columns["patches"], rows, frame, detections, boxes_xyxy, worth, masks)
        columns["fit_is_stale"][changed] = True

    def fit_boxes(
        self, columns: Columns, walls_yaw: float | None, shapes: npt.NDArray[np.int8]
    ) -> tuple[Array, list[OrientedBox | None]]:
        """Only what changed since the last call is fitted again."""
        yaw = walls_yaw or 0.0
        stale = columns["fit_is_stale"] | (columns["fit_yaw"] != yaw) | (columns["fit_shape"] != shapes)
        for row in np.flatnonzero(stale):
            patches = columns["patches"][row]
            surface, masked = agreed_surface(patches, self.config.extent.min_agreement)
            boxes = [surface_box(surface, masked, turned, int(shapes[row])) for turned in (0.0, yaw)]
            columns["fitted"][row], columns["fitted_along_walls"][row] = (0 if box is None else box for box in boxes)
            columns["seen"][row] = boxes[1] is not None and sides_seen(patches, boxes[1], yaw)
            columns["fit_is_stale"][row], columns["fit_yaw"][row] = False, yaw
            columns["fit_shape"][row] = shapes[row]
        fitted, running = columns["fitted"], np.stack([columns["box_min"], columns["box_max"]], axis=1)
        sound = np.all(fitted[:, 1] > fitted[:, 0], axis=1)
        oriented: list[OrientedBox | None] = [None] * len(sound)
        good = np.flatnonzero(sound if walls_yaw is not None else ())
        turned = _oriented(columns["fitted_along_walls"][good], columns["seen"][good], yaw)
        for at, along_walls in zip(good.tolist(), turned, strict=True):
            oriented[at] = along_walls
        return np.where(sound[:, None, None], fitted, running), oriented

    def fitted_box(self, columns: Columns, row: int) -> Array | None:
        return surface_box(*agreed_surface(columns["patches"][row], self.config.extent.min_agreement))

    def merge(self, columns: Columns, keep: int, drop: int) -> None:
        both = np.concatenate([columns["patches"][keep], columns["patches"][drop]])
        columns["patches"][keep] = both[np.argsort(-both["worth"], kind="stable")[:PATCHES_KEPT]]
        columns["fit_is_stale"][keep] = True
        columns["points"][keep, ::4] = columns["points"][drop, ::4]
        better_of = {-1: np.minimum, 1: np.maximum}
        union = {side: better_of[out](columns[side][keep], columns[side][drop]) for side, out in SIDES.items()}
        smooth_box(columns, keep, union, 0, self.config.extent)

    def distance_known(self, columns: Columns) -> npt.NDArray[np.bool_]:
        return np.ones(len(columns["id"]), bool)


def _oriented(boxes: Array, seen: npt.NDArray[np.bool_], yaw: float) -> list[OrientedBox]:
    """Boxes (n, 2, 3) along axes that are turned by ``yaw``, with the sides (n, 5) that were seen."""
    middles = (boxes.mean(1) @ about_z(yaw).T).round(4).tolist()
    sizes = (boxes[:, 1] - boxes[:, 0]).round(4).tolist()
    sides, yaw = (tuple(compress(SIDES_SEEN, shown)) for shown in seen.tolist()), round(yaw, 6)
    return [OrientedBox(tuple(m), tuple(s), yaw, of) for m, s, of in zip(middles, sizes, sides, strict=True)]
