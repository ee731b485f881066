"""Map of objects: one row per object, updated frame by frame by data association, with the evidence that each exists.

A frame's detections are lifted into space (``observation.py``), matched with the objects that it may show
(``association.py``), and counted for and against every object that it should have shown (``existence.py``). Now and
then objects that turn out to be one are merged (``merging.py``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.geometry import shorter_side, view_yaw, weak_perspective_size
from cartier.home.old_names import OLD_GROWTH
from cartier.io.files import json_bytes, npz_bytes, parse_json, read_npz, typed
from cartier.mapping.association import add_label_vote, label_agreement, suppress_duplicates, touching_pairs
from cartier.mapping.columns import COLUMNS, LATER, SIDES_KEPT, Indices, check_columns, empty_columns, map_objects
from cartier.mapping.config import DEFAULT_CONFIG, MappingConfig
from cartier.mapping.existence import (
    EarlierFrames,
    Visibility,
    detection_weights,
    mark_detected,
    posterior,
    update_existence,
)
from cartier.mapping.extent import DepthGeometry, NewGeometry
from cartier.mapping.furniture import shapes
from cartier.mapping.merging import keep_rows, merge_and_prune, merge_by_box
from cartier.mapping.observation import LiftedDetections
from cartier.types import Array, Detections, DetectorScoreModel, Frame, MapObject, OrientedBox

MAX_DETECTIONS = 60  # per frame, the most confident ones
VISIT_S = 600.0  # a view that is taken later than that after another is of another visit
KEPT_VIEWS = ("views", "side_views", "late_view")
GROWTH_ROWS = 64  # that are set aside at a time
MAP_ARRAYS, MAP_ABOUT = "object_map.npz", "object_map.json"  # the blobs of ``ObjectMap.state``


class ObjectMap:
    """The objects of one home, by ``DepthGeometry`` or ``BearingGeometry``; memory does not grow with the frames."""

    def __init__(
        self,
        score_model: DetectorScoreModel,
        config: MappingConfig = DEFAULT_CONFIG,
        geometry: NewGeometry = DepthGeometry,
    ) -> None:
        self.score_model, self.config = score_model, config
        self.geometry = geometry(self.config)
        self._labels: dict[str, int] = {}
        self._kinds = {**COLUMNS, **self.geometry.columns}
        self._rows = empty_columns(self._kinds, GROWTH_ROWS)
        self._count = self._next_id = self._frames = 0
        self._earlier = EarlierFrames()
        self._walls_yaw: float | None = None  # of the boxes that were fitted last
        self._covisible: dict[tuple[int, int], int] = {}  # frames that show two touching objects side by side, by ids
        self._aliases: dict[int, int] = {}  # ids of objects that were merged into another one
        self.visit_from = 0  # the number of the first frame of the recording that is being mapped
        self.kept: frozenset[int] = frozenset()  # ids of objects that are never pruned: a person said they are there

    def __len__(self) -> int:
        return self._count

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Views of the arrays, one row per object."""
        return {name: column[: self._count] for name, column in self._rows.items()}

    def add(self, frame: Frame, detections: Detections, visit_from: int = 0) -> npt.NDArray[np.int64]:
        """Add one frame and everything detected in it; returns each detection's object id (N,), -1 for none.

        ``visit_from`` is the number of the first frame of the recording.
        """
        self.visit_from = visit_from
        order = np.argsort(-detections.scores, kind="stable")[:MAX_DETECTIONS]
        boxes_px, scores = detections.boxes_xyxy[order], detections.scores[order]
        boxes = boxes_px.astype(np.float64)
        label_ids = np.array([self._labels.setdefault(detections.labels[k], len(self._labels)) for k in order], np.intp)
        masks = None if detections.masks is None else detections.masks[order]
        lifted = self.geometry.lift(frame, boxes, masks)
        representative = suppress_duplicates(boxes, lifted, label_ids, self.config.association, exact=masks is not None)
        row, visible = self._associate(frame, boxes, lifted, label_ids, representative)
        distinct, n_known = np.flatnonzero(representative == np.arange(len(order))), self._count
        for d in distinct[(row[distinct] < 0) & (scores[distinct] >= self.score_model.spawn_threshold)]:
            row[d] = self._spawn(lifted, int(d), frame.time_s)
        seen, new = distinct[row[distinct] >= 0], self._count - n_known
        self._earlier.count(self.columns(), np.arange(n_known, self._count), self.config.existence)
        whole = np.append(visible.observable, np.ones(new, bool))[row[seen]]  # a part must not make an object smaller
        columns, shrink = self.columns(), np.where(whole, self.config.extent.shrink_rate, 0)
        self.geometry.update(columns, row[seen], lifted, seen, shrink)
        mark_detected(columns, row[seen], frame.time_s)
        sizes_px2 = weak_perspective_size(boxes, frame.camera)
        self.geometry.keep_views(columns, row[seen], frame, seen, boxes, scores * np.sqrt(sizes_px2), masks)
        for d in seen:
            box, score, size_px2 = boxes_px[d], float(scores[d]), float(sizes_px2[d])
            self._keep_view(row[d], frame, box, score, label_ids[d], size_px2, lifted.centroid[d])
            columns["colours"][row[d]] += lifted.colours[d] * scores[d]
            for k in np.flatnonzero(representative == d):
                votes, weights = columns["label_votes"][row[d]], columns["label_weights"][row[d]]
                add_label_vote(votes, weights, int(label_ids[k]), float(scores[k]) ** 2)
        weights = np.zeros(self._count)
        weights[row[row >= 0]] = detection_weights(scores[row >= 0], self.score_model)
        should_show = np.append(visible.observable | visible.vacated, np.zeros(new, bool))
        update_existence(columns, frame, weights, should_show, self.config.existence)
        likely = scores >= (self.score_model.zero_weight_score + self.score_model.full_weight_score) / 2
        here = np.sort(row[(row >= 0) & likely])  # so that ids ascend
        for pair in touching_pairs(columns["extent_min"][here], columns["extent_max"][here], columns["id"][here]):
            self._covisible[pair] = self._covisible.get(pair, 0) + 1
        ids = np.where(row >= 0, self._rows["id"][row], -1)  # before merging moves the rows
        self._frames += 1
        self._earlier.add(frame)
        if self._frames % self.config.merging.interval_frames == 0:
            self.merge_and_prune()
        given = np.full(len(detections.scores), -1)
        given[order] = np.where(representative >= 0, ids[representative], -1)
        return given

    def _associate(
        self, frame: Frame, boxes_xyxy: Array, lifted: LiftedDetections, label_ids: Indices, representative: Indices
    ) -> tuple[Indices, Visibility]:
        """The row of each detection's object (N,), -1 for none or a duplicate; which objects should have shown."""
        columns, row = self.columns(), np.full(len(representative), -1)
        visible = self.geometry.predict(columns, frame)
        expected_xyxy, candidates = visible.boxes_xyxy, visible.candidates
        distinct = np.flatnonzero(representative == np.arange(len(representative)))
        if len(distinct) and len(candidates):
            votes, weights = columns["label_votes"][candidates], columns["label_weights"][candidates]
            agreement = label_agreement(label_ids, representative, distinct, votes, weights)
            extents, expected = (lifted.extent_min[distinct], lifted.extent_max[distinct]), expected_xyxy[candidates]
            boxes = boxes_xyxy[distinct]
            matches = self.geometry.associate(columns, candidates, frame, boxes, extents, expected, agreement)
            row[distinct[matches[:, 0]]] = candidates[matches[:, 1]]
        return row, visible

    def _spawn(self, lifted: LiftedDetections, detection: int, time_s: float) -> int:
        """A new object; returns its row."""
        rows, o = self._rows, self._count
        if o == len(rows["id"]):
            self._rows = rows = {name: np.concatenate([column, np.zeros_like(column)]) for name, column in rows.items()}
        rows["id"][o], rows["first_s"][o] = self._next_id, time_s
        rows["label_votes"][o] = -1
        for kept in KEPT_VIEWS:
            rows[kept]["frame"][o] = -1
        self.geometry.spawn(rows, o, lifted, detection)
        self._next_id, self._count = self._next_id + 1, o + 1
        return o

    def _keep_view(
        self, o: int, frame: Frame, box_xyxy: Array, score: float, label: int, size_px2: float, surface: Array
    ) -> None:
        """Keep the view if it is among the most confident and largest of the object, or the largest of a side or of the
        latest visit."""
        (views, sides, late), camera = (self._rows[kept][o] for kept in KEPT_VIEWS), frame.camera
        self._rows["widest_rad"][o] = max(self._rows["widest_rad"][o], (size_px2 / (camera.fx * camera.fy)) ** 0.5)
        pose = frame.world_from_camera
        yaw = view_yaw(pose, camera, float(box_xyxy[0] + box_xyxy[2]) / 2, float(box_xyxy[1] + box_xyxy[3]) / 2)
        side = round(yaw / (math.tau / SIDES_KEPT)) % SIDES_KEPT
        worth = score * size_px2**0.5
        size = camera.width, camera.height  # how an object looks follows its size more than its score
        side_worth = score**0.5 * shorter_side(box_xyxy, size)
        if late["frame"][0] < self.visit_from or frame.time_s - self._rows["late_s"][o] > VISIT_S:
            late["worth"] = 0.0
        if side_worth > late["worth"][0]:
            self._rows["late_s"][o] = frame.time_s
        slots = (views, int(views["worth"].argmin()), worth), (sides, side, side_worth), (late, 0, side_worth)
        for kept, slot, better in slots:
            if better > kept["worth"][slot]:
                kept[slot] = (frame.index, box_xyxy, score, label, size_px2, pose[:3, 3], yaw, surface, better)

    def merge_and_prune(self) -> None:
        """Merge what turned out to be one object, unless frames showed both; forget what was hardly ever seen again."""
        kept = {self._aliases.get(number, number) for number in self.kept}
        merged, gone = merge_and_prune(self.columns(), self._covisible, self.geometry, self.config.merging, kept)
        self._aliases |= merged
        if len(gone):
            self._remove(gone)

    def consolidate(self, walls_yaw: float | None = None) -> None:
        """Merge and prune as after the last frame: also by the fitted boxes."""
        self.merge_and_prune()
        if self.geometry.with_depth and self._count:
            columns, (boxes, _) = self.columns(), self._fit_boxes(walls_yaw)
            merged, gone = merge_by_box(columns, boxes, self._covisible, self.geometry, self.config.merging)
            self._aliases |= merged
            if len(gone):
                self._remove(gone)

    def _fit_boxes(self, walls_yaw: float | None) -> tuple[Array, list[OrientedBox | None]]:
        columns = self.columns()
        best = columns["label_votes"][np.arange(self._count), columns["label_weights"].argmax(1)]
        return self.geometry.fit_boxes(columns, walls_yaw, shapes(list(self._labels))[best])

    def _remove(self, gone: Indices) -> None:
        left = np.setdiff1d(np.arange(self._count), gone)
        keep_rows(self.columns(), left)
        self._count, alive = len(left), set(self._rows["id"][: len(left)].tolist())
        self._covisible = {pair: k for pair, k in self._covisible.items() if alive.issuperset(pair)}
        for old, new in self._aliases.items():
            self._aliases[old] = self._aliases.get(new, new)
        self._aliases = {old: new for old, new in self._aliases.items() if new in alive}

    @property
    def next_id(self) -> int:
        """The id that the next new object gets."""
        return self._next_id

    @property
    def aliases(self) -> dict[int, int]:
        """The id of the object that each merged one is part of."""
        return dict(self._aliases)

    def alive(self, number: int) -> int | None:
        """The id of the object that one is part of by now, or None if it was forgotten."""
        number = self._aliases.get(number, number)
        return number if number in self._rows["id"][: self._count] else None

    def renumber(self, new_ids: Mapping[int, int], aliases: Mapping[int, int], next_id: int) -> None:
        """Give objects other ids; ``aliases`` are further ids of some, by these new ones."""
        rows = self.columns()
        rows["id"][:] = [new_ids.get(number, number) for number in rows["id"].tolist()]
        keep_rows(rows, np.argsort(rows["id"]))  # rows ascend by id
        pairs = ((new_ids.get(i, i), new_ids.get(j, j), count) for (i, j), count in self._covisible.items())
        self._covisible = {(min(i, j), max(i, j)): count for i, j, count in pairs}
        older = {new_ids.get(old, old): new_ids.get(new, new) for old, new in self._aliases.items()}
        self._aliases = {old: new for old, new in (older | dict(aliases)).items() if old != new}
        self._next_id = next_id

    def best_frames(self) -> set[int]:
        """The frames that show the best views of objects, the largest of their sides, and of the latest visit."""
        kept = (self._rows[name]["frame"][: self._count].ravel().tolist() for name in KEPT_VIEWS)
        return {frame for frames in kept for frame in frames} - {-1}

    def evidence(self) -> tuple[Array, Array, Array]:
        """The evidence for and against each object: the first arguments of ``existence.posterior``."""
        columns = self.columns()
        return columns["observable"], columns["detected"], columns["widest_rad"]

    def fit(self, walls_yaw: float | None) -> None:
        """Fit the boxes of objects whose views changed."""
        self._walls_yaw = walls_yaw
        self._fit_boxes(walls_yaw)

    def objects(self, walls_yaw: float | None = None) -> tuple[MapObject, ...]:
        """Every object, confirmed and tentative, by id; with ``walls_yaw`` (rad) also boxes along the walls."""
        self._walls_yaw = walls_yaw
        columns, names = self.columns(), list(self._labels)
        likely = posterior(*self.evidence(), self.score_model)
        confirmed = likely >= self.config.existence.confirmed_probability
        located = None if self.geometry.with_depth else self.geometry.distance_known(columns)
        return map_objects(columns, names, self._aliases, self._fit_boxes(walls_yaw), likely, confirmed, located)

    def state(self) -> dict[str, bytes]:
        """All of it, as named blobs."""
        self._fit_boxes(self._walls_yaw)  # so that it does not depend on who asked for objects before
        about = {
            "labels": list(self._labels), "next_id": self._next_id, "frames": self._frames,
            "covisible": [[*pair, count] for pair, count in self._covisible.items()],
            "aliases": [list(pair) for pair in self._aliases.items()],
        }  # fmt: skip
        return {MAP_ARRAYS: npz_bytes(**self.columns(), **self._earlier.state()), MAP_ABOUT: json_bytes(about)}

    def restore(self, state: Mapping[str, bytes]) -> None:
        """Take what ``state`` gave into a new map. Raises InputError if it is damaged."""
        about = parse_json(state[MAP_ABOUT], MAP_ABOUT)
        arrays = read_npz(state[MAP_ARRAYS], where=MAP_ARRAYS)
        try:
            arrays, about = ({OLD_GROWTH.get(name, name): part for name, part in of.items()} for of in (arrays, about))
            self._labels = {name: number for number, name in enumerate(typed(about["labels"], tuple[str, ...]))}
            spare = empty_columns(self._kinds, GROWTH_ROWS)
            later = (self._kinds.keys() if "patches" not in arrays else self._kinds.keys() & LATER) - arrays.keys()
            arrays |= empty_columns({name: self._kinds[name] for name in later}, len(arrays["id"]))
            for kept in later & set(KEPT_VIEWS):
                arrays[kept]["frame"] = -1
            check_columns(arrays, self._kinds, len(self._labels))
            self._rows = {name: np.concatenate([arrays[name], spare[name]]) for name in self._kinds}
            self._count, self._next_id, self._frames = len(arrays["id"]), int(about["next_id"]), int(about["frames"])
            if int(arrays["id"].max(initial=-1)) >= self._next_id:
                raise ValueError("an object has the number of the next one")
            self._earlier.restore(arrays)
            self._covisible = {(int(i), int(j)): int(k) for i, j, k in about["covisible"]}
            self._aliases = {int(old): int(new) for old, new in about["aliases"]}
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"the map of objects is damaged ({brief(error)})") from error
