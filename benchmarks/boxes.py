"""Benchmark of the boxes of mapped objects against ground truth, beside two simple peers; ``objects.py`` prints it.

The measure is the intersection over the union in space (3-D IoU) of axis-aligned boxes and, for "along the walls", of
the oriented ones, which are prisms over a turned rectangle. Shares and recall: confirmed objects and things shown
with 400 px or more, matched one to one within a label. mAP as ScanNet's detection benchmark has it: per label over
all homes, all objects by their probability, greedily, area under the whole curve; things that were shown smaller are
neither asked for nor a fault. Peers, with the detections that our map gave each object: the points of the last view
within the box ("last view"); the points of all views, thinned to 2.5 cm, of which the largest DBSCAN cluster is kept
("DBSCAN", as ConceptGraphs does, Gu et al. 2023; boxes stand in for its masks where the detector gives none).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cartier.labels import display_name
from cartier.types import Array, Detections, Frame, MapObject, OrientedBox, TrueObject

IOUS = (0.25, 0.5)
OURS, ALONG_WALLS, LAST_VIEW, DBSCAN = "ours", "ours, along the walls", "last view", "DBSCAN"
VOXEL_M, EPS_M, MIN_NEIGHBOURS = 0.025, 0.05, 10  # ConceptGraphs' voxel and DBSCAN settings
POINTS_PER_VIEW = 900


class PeerBoxes:
    """The points that detections show, by object, for the two peers."""

    def __init__(self) -> None:
        self._last: dict[int, Array] = {}
        self._all: dict[int, list[Array]] = defaultdict(list)

    def add(self, frame: Frame, detections: Detections, ids: Sequence[int]) -> None:
        for number, key in enumerate(ids):
            if key < 0:
                continue
            mask = None if detections.masks is None else detections.masks[number]
            points = points_in_box(frame, detections.boxes_xyxy[number], mask)
            if len(points):
                self._last[key] = points
                self._all[key].append(thinned(points))
                if len(self._all[key]) > 30:
                    self._all[key] = [thinned(np.concatenate(self._all[key]))]

    def boxes(self, obj: MapObject) -> dict[str, Array]:
        """The boxes (2, 3) of one object by either peer."""
        ids = [key for key in (*obj.aliases, obj.id) if key in self._all]
        if not ids:
            return {}
        last = self._last[ids[-1]]
        cluster = largest_cluster(thinned(np.concatenate([points for key in ids for points in self._all[key]])))
        return {name: np.stack([of.min(0), of.max(0)]) for name, of in ((LAST_VIEW, last), (DBSCAN, cluster))}


def points_in_box(frame: Frame, box_xyxy: Array, mask: Array | None) -> Array:
    """Points (k, 3), in the world, that the depth shows in a box or mask."""
    assert frame.depth_m is not None
    camera, pose = frame.camera, frame.world_from_camera
    x1, y1, x2, y2 = np.clip(np.rint(box_xyxy).astype(int), 0, (camera.width, camera.height) * 2)
    step = max(1, int(np.sqrt((x2 - x1) * (y2 - y1) / POINTS_PER_VIEW)))
    rows, cols = (axis.ravel() for axis in np.mgrid[y1:y2:step, x1:x2:step])
    z = frame.depth_m[rows, cols]
    keep = z > 0 if mask is None else (z > 0) & mask[rows, cols]
    rays = np.stack([(cols - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(z))], axis=1)
    return np.asarray((rays[keep] * z[keep, None]) @ pose[:3, :3].T + pose[:3, 3])


def thinned(points: Array) -> Array:
    return np.asarray(points[np.unique(np.floor(points / VOXEL_M).astype(int), axis=0, return_index=True)[1]])


def largest_cluster(points: Array) -> Array:
    """The largest DBSCAN cluster (Ester et al. 1996) of points (k, 3); all of them where nothing is dense."""
    pairs = cKDTree(points).query_pairs(EPS_M, output_type="ndarray")
    core = np.bincount(pairs.ravel(), minlength=len(points)) + 1 >= MIN_NEIGHBOURS
    if not core.any():
        return points
    both = pairs[core[pairs].all(1)]
    links = coo_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(len(points),) * 2)
    cluster = connected_components(links, directed=False)[1]
    largest = np.flatnonzero(core)[np.bincount(cluster[core])[cluster[core]].argmax()]
    inside = core & (cluster == cluster[largest])
    border = pairs[core[pairs].sum(1) == 1]
    inside[border[inside[border].any(1)].ravel()] = True
    return np.asarray(points[inside])


def iou_3d(boxes: Array, others: Array) -> Array:
    """The 3-D IoU (n, m) of boxes (n, 2, 3) with others (m, 2, 3)."""
    low, high = np.maximum(boxes[:, None, 0], others[None, :, 0]), np.minimum(boxes[:, None, 1], others[None, :, 1])
    shared = np.clip(high - low, 0, None).prod(2)
    return np.asarray(shared / (volumes(boxes)[:, None] + volumes(others) - shared))


def oriented_iou(boxes: Sequence[OrientedBox], others: Array) -> Array:
    """The 3-D IoU (n, m) of oriented boxes with axis-aligned ones (m, 2, 3)."""
    import shapely

    corners = np.array([_footprint(box) for box in boxes]).reshape(-1, 4, 2)
    flat = shapely.polygons(corners)[:, None]
    area = shapely.area(shapely.intersection(flat, shapely.box(*others[:, 0, :2].T, *others[:, 1, :2].T)))
    low = np.array([box.middle[2] - box.size[2] / 2 for box in boxes])[:, None]
    high = low + np.array([box.size[2] for box in boxes])[:, None]
    tall = np.clip(np.minimum(high, others[:, 1, 2]) - np.maximum(low, others[:, 0, 2]), 0, None)
    volume = np.array([np.prod(box.size) for box in boxes])[:, None]
    return np.asarray(area * tall / (volume + volumes(others) - area * tall))


def _footprint(box: OrientedBox) -> Array:
    """The corners (4, 2) of an oriented box, seen from above."""
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    ends = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(box.size[:2]) / 2
    return np.asarray(ends @ np.array([[cos, sin], [-sin, cos]]) + box.middle[:2])


def volumes(boxes: Array) -> Array:
    return np.asarray((boxes[:, 1] - boxes[:, 0]).prod(1))


@dataclass
class BoxCounts:
    """What the boxes of one kind come to over homes."""

    confirmed: list[tuple[str, float, float, float, float]] = field(default_factory=list)
    """Of confirmed objects: label, IoU (0 if unmatched), volume over the true one, errors of centre and size (m)."""
    found: dict[float, int] = field(default_factory=lambda: dict.fromkeys(IOUS, 0))
    shown: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    ranked: dict[tuple[str, float], list[tuple[float, bool]]] = field(default_factory=lambda: defaultdict(list))

    def add(
        self,
        objects: Sequence[MapObject],
        boxes: Array | Sequence[OrientedBox],
        truth: Sequence[TrueObject],
        shown: Sequence[bool],
    ) -> None:
        """Add a home: objects with their n boxes, (n, 2, 3) or oriented, what was in view, and whether large enough."""
        true_boxes = np.array([[obj.box_min, obj.box_max] for obj in truth]).reshape(-1, 2, 3)
        names = [display_name(obj.label) for obj in truth]
        same = np.array([[obj.label == name for name in names] for obj in objects]).reshape(len(objects), len(truth))
        if isinstance(boxes, np.ndarray):
            overlaps = iou_3d(boxes, true_boxes)
        else:
            overlaps = oriented_iou(boxes, true_boxes)
            half = np.array([box.size for box in boxes]).reshape(-1, 3) / 2
            middles = np.array([box.middle for box in boxes]).reshape(-1, 3)
            boxes = np.stack([middles - half, middles + half], axis=1)
        iou = np.where(same, overlaps, 0)
        listed = np.flatnonzero([obj.confirmed for obj in objects])
        of = {int(listed[i]): int(k) for i, k in zip(*linear_sum_assignment(-iou[listed]), strict=True)}
        for i in listed.tolist():
            k = of.get(i, -1)
            if k < 0 or iou[i, k] == 0:
                self.confirmed.append((objects[i].label, 0, np.nan, np.nan, np.nan))
                continue
            size, true_size = (box[1] - box[0] for box in (boxes[i], true_boxes[k]))
            off = np.linalg.norm(boxes[i].mean(0) - true_boxes[k].mean(0))
            ratio, error = float((size / true_size).prod()), float(np.abs(size - true_size).mean())
            self.confirmed.append((objects[i].label, float(iou[i, k]), ratio, float(off), error))
            for least in IOUS:
                self.found[least] += shown[k] and iou[i, k] >= least
        for name, large in zip(names, shown, strict=True):
            self.shown[name] += large
        for least in IOUS:
            self._rank(objects, iou, shown, least)

    def _rank(self, objects: Sequence[MapObject], iou: Array, shown: Sequence[bool], least: float) -> None:
        free = np.ones(iou.shape[1], bool)
        for i in np.argsort([-obj.probability for obj in objects], kind="stable").tolist():
            open_iou = np.where(free, iou[i], 0)
            k = int(open_iou.argmax()) if iou.shape[1] else -1
            hit = k >= 0 and open_iou[k] >= least
            if hit:
                free[k] = False
            if not hit or shown[k]:
                self.ranked[objects[i].label, least].append((objects[i].probability, bool(hit)))

    def mean_average_precision(self, least: float) -> float:
        labels = [label for label, count in self.shown.items() if count]
        return float(np.mean([average_precision(self.ranked[label, least], self.shown[label]) for label in labels]))

    def row(self) -> str:
        iou, ratio, off, size = np.array([values for _, *values in self.confirmed]).T
        share, shown = [f"{(iou >= least).mean():.1%}" for least in IOUS], sum(self.shown.values())
        recall = [f"{self.found[least] / shown:.1%}" for least in IOUS]
        mean_ap = [f"{self.mean_average_precision(least):.3f}" for least in IOUS]
        some = iou > 0
        return (
            f"{' / '.join(share):>17}{' / '.join(recall):>17}{' / '.join(mean_ap):>16}{iou[some].mean():>7.2f}"
            f"{np.median(off[some]) * 100:>5.0f} cm{np.median(size[some]) * 100:>5.0f} cm"
            f"{np.median(ratio[some]):>7.2f} / {np.quantile(ratio[some], 0.9):.2f}"
        )

    def labels(self) -> list[tuple[str, int, float, float, float]]:
        """Each label with its confirmed objects: how many, mean IoU, and the medians of the errors of centre and size
        (m, NaN if none is matched); worst first."""
        by = defaultdict(list)
        for label, *figures in self.confirmed:
            by[label].append(figures)
        rows = []
        for label, figures in by.items():
            iou, _, off, size = np.array(figures).T
            some = iou > 0
            errors = [float(np.median(of[some])) if some.any() else np.nan for of in (off, size)]
            rows.append((label, len(iou), float(iou.mean()), *errors))
        return sorted(rows, key=lambda row: row[2])


def average_precision(ranked: Sequence[tuple[float, bool]], true: int) -> float:
    """Area under the curve of precision over recall, precision made to fall only (PASCAL VOC from 2010)."""
    if not ranked:
        return 0.0
    hits = np.array([hit for _, hit in sorted(ranked, key=lambda row: -row[0])])
    right = np.cumsum(hits)
    precision = np.maximum.accumulate((right / np.arange(1, len(hits) + 1))[::-1])[::-1]
    return float((precision * hits).sum() / true)


def print_boxes(counts: Mapping[str, BoxCounts], by_label: bool) -> None:
    print("boxes                    IoU ≥ .25 / .5   recall .25 / .5     mAP .25 / .5   mean   centre  size   volume")
    for kind, of in counts.items():
        print(f"  {kind:20}{of.row()}")
    labels = counts[OURS].labels()
    if not by_label:
        print(f"  least mean IoU: {', '.join(f'{label} {iou:.2f} of {n}' for label, n, iou, *_ in labels[:12])}")
        return
    print("  label                  confirmed  mean IoU  centre    size")
    for label, n, iou, off, size in labels:
        errors = "none matched" if np.isnan(off) else f"{off * 100:>3.0f} cm{size * 100:>5.0f} cm"
        print(f"  {label:22}{n:>10}{iou:>10.2f}   {errors}")
