"""Merging and pruning of objects: which turn out to be one, which are fragments of one, and which are forgotten."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cartier.mapping.association import PAD_M, add_label_vote, box_overlaps
from cartier.mapping.columns import Columns, Indices
from cartier.mapping.config import MergingConfig
from cartier.mapping.extent import Geometry
from cartier.types import Array

SAME_LABEL_CONTAINMENT = 0.7  # share of one within the other from which two objects of one label are one
OTHER_LABEL_NESTING = 0.85  # the same for different labels, of those whose IoU is above that for one label
USUAL_SIZE_QUANTILE = 0.6  # of the sizes of all objects of a label, weighted by detections
FLAT_PAD_M = 0.01  # so that flat objects overlap, too
MIN_FITTED = 3  # detections of either, from which the fitted boxes of two objects may keep them apart
MIN_FRAGMENTED_M = 0.4  # nothing smaller is hidden by halves


def merge_and_prune(
    columns: Columns,
    covisible: Mapping[tuple[int, int], int],
    geometry: Geometry,
    config: MergingConfig,
    kept: Collection[int] = (),
) -> tuple[dict[int, int], Indices]:
    """Merge objects that turn out to be one, in place, and find those to prune: none of the ids that are to be kept.

    Only objects that changed since the last pass are compared. ``covisible`` counts the frames that show two touching
    objects, by their ids, side by side: those stay two. Returns the ids that were merged with the ids that they were
    merged into, and the rows to remove.
    """
    seen, changed = columns["n_detected"], np.flatnonzero(columns["changed"])
    alike, fragments = _one_object(columns, changed, config)
    for i, j in np.argwhere(alike & ~fragments).tolist():
        alike[i, j] = changed[i] != j and not _apart(columns, int(changed[i]), j, covisible, geometry, config)
    pairs = [(int(changed[i]), int(j)) for i, j in np.argwhere(alike | fragments)]
    merged, gone = _merge_pairs(columns, pairs, covisible, geometry, config)
    columns["changed"][:] = False
    rare = (seen <= config.prune_max_detected) & (columns["n_observable"] >= config.prune_min_observable)
    for number in kept:
        while number in merged:
            number = merged[number]
        rare &= columns["id"] != number
    return merged, np.array(sorted(gone.union(np.flatnonzero(rare).tolist())), np.intp)


def merge_by_box(
    columns: Columns,
    boxes: Array,
    covisible: Mapping[tuple[int, int], int],
    geometry: Geometry,
    config: MergingConfig,
) -> tuple[dict[int, int], Indices]:
    """Merge objects of one label whose fitted ``boxes`` (n, 2, 3) overlap, in place: halves and duplicates.

    Fitted boxes hold hardly anything but the object, so that a smaller overlap says more than that of extents.
    Returns what ``merge_and_prune`` does.
    """
    names = columns["label_votes"][np.arange(len(boxes)), columns["label_weights"].argmax(1)]
    nested = box_overlaps(boxes[:, 0], boxes[:, 1], boxes[:, 0], boxes[:, 1], FLAT_PAD_M)[1]
    one = np.triu((names[:, None] == names) & (nested > config.fitted_overlap), 1)
    pairs = sorted(np.argwhere(one).tolist(), key=lambda pair: -nested[tuple(pair)])
    merged, gone = _merge_pairs(columns, pairs, covisible, geometry, config)
    return merged, np.array(sorted(gone), np.intp)


def _merge_pairs(
    columns: Columns,
    pairs: Sequence[Sequence[int]],
    covisible: Mapping[tuple[int, int], int],
    geometry: Geometry,
    config: MergingConfig,
) -> tuple[dict[int, int], set[int]]:
    """Merge pairs of rows, unless frames show both: the ids that were merged, and the rows that are gone."""
    seen, ids = columns["n_detected"], columns["id"].tolist()
    merged, gone = dict[int, int](), set[int]()
    for i, j in pairs:
        together = covisible.get((ids[min(i, j)], ids[max(i, j)]), 0)
        if i != j and not {i, j} & gone and together <= config.max_covisible_share * min(seen[i], seen[j]):
            keep, drop = (i, j) if seen[i] >= seen[j] else (j, i)
            merge_pair(columns, keep, drop, geometry)
            merged[ids[drop]] = ids[keep]
            gone.add(drop)
    return merged, gone


def _apart(
    columns: Columns,
    i: int,
    j: int,
    covisible: Mapping[tuple[int, int], int],
    geometry: Geometry,
    config: MergingConfig,
) -> bool:
    """Whether two rows, both seen often enough, have fitted boxes that do not overlap: neighbours whose extents do."""
    least, (one_id, other_id) = min(columns["n_detected"][[i, j]]), sorted(columns["id"][[i, j]].tolist())
    if least < MIN_FITTED or covisible.get((one_id, other_id), 0) > config.max_covisible_share * least:
        return False  # the former says little; the latter are apart anyway
    one, other = (geometry.fitted_box(columns, row) for row in (i, j))
    if one is None or other is None:
        return False
    nested = box_overlaps(one[:1], one[1:], other[:1], other[1:], FLAT_PAD_M)[1]
    return bool(nested[0, 0] <= config.fitted_overlap)


def _one_object(
    columns: Columns, changed: Indices, config: MergingConfig
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which of the ``changed`` objects (k,) look like one object with which of all (n,), and which may be fragments of
    one: (k, n) each."""
    names = columns["label_votes"][np.arange(len(columns["id"])), columns["label_weights"].argmax(1)]
    low, high = columns["extent_min"], columns["extent_max"]
    iou, nested, contained = box_overlaps(low[changed], high[changed], low, high, PAD_M)
    contains = box_overlaps(low, high, low[changed], high[changed], PAD_M)[2].T
    same_label = (iou > config.same_label_iou) | (np.maximum(contained, contains) > SAME_LABEL_CONTAINMENT)
    other_label = (iou > config.other_label_iou) | ((iou > config.same_label_iou) & (nested > OTHER_LABEL_NESTING))
    equal = names[changed][:, None] == names
    alike = np.where(equal, same_label, other_label)
    return alike, equal & merge_fragments(columns, changed, names, config)


def merge_fragments(
    columns: Columns, changed: Indices, names: npt.NDArray[np.integer], config: MergingConfig
) -> npt.NDArray[np.bool_]:
    """Which pairs (k, n) make up one object of their label's usual size: the parts of a chair around a table."""
    low, high, seen = columns["extent_min"], columns["extent_max"], columns["n_detected"]
    usual_m = np.zeros((len(names), 3))
    for name in np.unique(names[changed]):
        of = np.flatnonzero(names == name)
        size_m = _upright((high - low)[of])
        order = np.argsort(size_m, axis=0)
        share = np.cumsum(seen[of][order], axis=0) / max(seen[of].sum(), 1)
        at = (share >= USUAL_SIZE_QUANTILE).argmax(0)[None]
        usual_m[of] = np.take_along_axis(size_m, np.take_along_axis(order, at, 0), 0)
    union_m = _upright(np.maximum(high[changed][:, None], high) - np.minimum(low[changed][:, None], low))
    fits = (union_m <= config.max_fragment_ratio * usual_m).all(2) & (usual_m.max(1) >= MIN_FRAGMENTED_M)
    return np.asarray(fits)


def _upright(size_m: Array) -> Array:
    """Sizes (…, 3) as width, length and height, however objects are turned."""
    return np.stack([size_m[..., :2].min(-1), size_m[..., :2].max(-1), size_m[..., 2]], axis=-1)


def merge_pair(columns: Columns, keep: int, drop: int, geometry: Geometry) -> None:
    """Add the evidence of one row to another, in place."""
    geometry.merge(columns, keep, drop)
    for name, better in (
        ("observable", np.maximum), ("widest_rad", max), ("n_observable", max), ("last_s", max), ("looked_s", max),
        ("first_s", min),
    ):  # fmt: skip
        columns[name][keep] = better(columns[name][keep], columns[name][drop])
    for name, limit in (
        ("detected", "observable"),
        ("n_detected", "n_observable"),
    ):  # a frame's detection was of one of them
        columns[name][keep] = np.minimum(columns[name][keep] + columns[name][drop], columns[limit][keep])
    columns["colours"][keep] += columns["colours"][drop]
    views = np.concatenate([columns["views"][keep], columns["views"][drop]])
    best = np.argsort(-views["worth"], kind="stable")[: columns["views"].shape[1]]
    columns["views"][keep] = views[best]
    sides, others = columns["side_views"][keep], columns["side_views"][drop]
    columns["side_views"][keep] = np.where(others["worth"] > sides["worth"], others, sides)
    if columns["late_view"]["frame"][drop, 0] > columns["late_view"]["frame"][keep, 0]:
        columns["late_view"][keep], columns["late_s"][keep] = columns["late_view"][drop], columns["late_s"][drop]
    votes, weights = columns["label_votes"], columns["label_weights"]
    for label, weight in zip(votes[drop].tolist(), weights[drop].tolist(), strict=True):
        if label >= 0:
            add_label_vote(votes[keep], weights[keep], label, weight)


def keep_rows(columns: Columns, left: Indices) -> None:
    """Move the rows that are left to the front, in place, and clear the others."""
    for column in columns.values():
        column[: len(left)] = column[left]
        column[len(left) :] = np.zeros((), column.dtype)
