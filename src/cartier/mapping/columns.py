"""Columns of the map of objects: what is kept of each object, as one array per property with one row per object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_FAR_M
from cartier.mapping.colours import COLOURS, named_shares
from cartier.mapping.existence import VIEWPOINT_BINS
from cartier.mapping.observation import SURFACE_POINTS, check_patches
from cartier.types import Array, MapObject, OrientedBox, View

Indices = npt.NDArray[np.intp]
Columns = Mapping[str, npt.NDArray[Any]]
"""Arrays by name; functions that change rows do so in place."""
ColumnKinds = Mapping[str, tuple[tuple[int, ...], Any]]
"""The shape of a row and the kind of number of each column."""

LABELS_KEPT, VIEWS_KEPT = 6, 3  # per object
SIDES_KEPT = 4  # of an object, by the quarter of all headings that it is seen in
VIEW_KIND = np.dtype(
    [("frame", "i4"), ("box", "f4", 4), ("score", "f4"), ("label", "i2"), ("size_px2", "f4"), ("camera", "f4", 3),
     ("yaw", "f4"), ("surface", "f4", 3), ("worth", "f4")]
)  # fmt: skip
COLUMNS: ColumnKinds = {
    "id": ((), "i8"), "points": ((SURFACE_POINTS, 3), "f4"), "box_min": ((3,), "f8"), "box_max": ((3,), "f8"),
    "extent_min": ((3,), "f8"), "extent_max": ((3,), "f8"), "label_votes": ((LABELS_KEPT,), "i2"),
    "label_weights": ((LABELS_KEPT,), "f4"), "n_detected": ((), "i4"), "n_observable": ((), "i4"),
    "first_s": ((), "f8"), "last_s": ((), "f8"), "looked_s": ((), "f8"), "widest_rad": ((), "f4"),
    "observable": ((VIEWPOINT_BINS,), "f4"),
    "detected": ((VIEWPOINT_BINS,), "f4"), "views": ((VIEWS_KEPT,), VIEW_KIND),
    "side_views": ((SIDES_KEPT,), VIEW_KIND), "late_view": ((1,), VIEW_KIND), "late_s": ((), "f8"),
    "colours": ((len(COLOURS),), "f4"),
    "changed": ((), "?"),
}  # fmt: skip
LATER = frozenset(["fit_shape", "side_views", "late_view", "late_s"])
"""Columns that maps written before they were kept do not have."""

FAR_M = 2 * MAX_FAR_M  # what is seen lies beyond the camera
MAX_NUMBER, MAX_PX = 1e15, 1e6
LIMITS = dict.fromkeys(("points", "box_min", "box_max", "extent_min", "extent_max", "camera", "surface"), FAR_M)
LIMITS |= {"box": MAX_PX, "size_px2": MAX_PX**2, "pose": MAX_FAR_M, "seed_m": FAR_M, "size_m": FAR_M}
"""The largest absolute number of a column or of a field in it."""
COUNTED = frozenset([
    "id", "label_weights", "n_detected", "n_observable", "widest_rad", "observable", "detected", "colours", "size_px2",
    "distance_odds", "size_at_1m", "worth", "seed_m", "size_m",
])  # fmt: skip
"""Columns and fields without negative numbers."""


def empty_columns(kinds: ColumnKinds, rows: int) -> dict[str, npt.NDArray[Any]]:
    """Columns of so many rows of zeros."""
    return {name: np.zeros((rows, *shape), kind) for name, (shape, kind) in kinds.items()}


def check_columns(columns: Columns, kinds: ColumnKinds, labels: int) -> None:
    """Raises KeyError or ValueError for columns that are not of these kinds, that hold numbers which no map holds, or
    that use more than so many labels."""
    for name, empty in empty_columns(kinds, len(columns["id"])).items():
        if columns[name].shape != empty.shape or columns[name].dtype != empty.dtype:
            raise ValueError(f"{name} is of another kind or length")
    views = np.concatenate([columns[name]["label"] for name in ("views", "side_views", "late_view")], axis=1)
    most = max(int(columns["label_votes"].max(initial=-1)), int(views.max(initial=-1)))
    if most >= labels:
        raise ValueError(f"label {most} has no name")
    if (columns["label_votes"] < 0).all(1).any() or (views < 0).any():
        raise ValueError("an object or a view has no label")
    if len(np.unique(columns["id"])) < len(columns["id"]):
        raise ValueError("two objects have one id")
    for name in kinds:
        column = columns[name]
        parts = {name: column} if column.dtype.names is None else {part: column[part] for part in column.dtype.names}
        for part, numbers in parts.items():
            most_of = LIMITS.get(part, MAX_NUMBER)
            if numbers.dtype.kind in "if" and not (np.abs(numbers.astype(np.float64)) <= most_of).all():  # NaN, too
                raise ValueError(f"{name} holds a number that is no {part}")
            if part in COUNTED and (numbers < 0).any():
                raise ValueError(f"{name} holds a negative {part}")
    if "patches" in kinds:
        check_patches(columns["patches"])


def map_objects(
    columns: Columns,
    names: Sequence[str],
    aliases: Mapping[int, int],
    boxes: tuple[Array, Sequence[OrientedBox | None]],
    likely: Array,
    confirmed: npt.NDArray[np.bool_],
    located: npt.NDArray[np.bool_] | None,
) -> tuple[MapObject, ...]:
    """Rows as objects, with their boxes (n, 2, 3), those along the walls, and probabilities (n,).

    ``aliases`` are merged ids with those of the rows that have them. ``located`` (n,) says which distances are known
    where views show no surface; None where they do.
    """
    old_ids: dict[int, list[int]] = {}
    for old, new in aliases.items():
        old_ids.setdefault(new, []).append(old)
    objects = []
    for o, number in enumerate(columns["id"].tolist()):
        row = {name: column[o] for name, column in columns.items()}
        by_label = zip(row["label_votes"], row["label_weights"], strict=True)
        votes = sorted(((names[k], round(float(w), 4)) for k, w in by_label if k >= 0), key=lambda vote: -vote[1])
        box_min, box_max = boxes[0][o]
        position = _metres((box_min + box_max) / 2)
        place = None if located is None else (position if located[o] else None,)
        views = _views(row["views"], names, place)
        further = {view.frame: view for kept in ("side_views", "late_view") for view in _views(row[kept], names, place)}
        for view in views:
            further.pop(view.frame, None)
        objects.append(MapObject(
            number, votes[0][0], tuple(votes), position, _metres(box_min), _metres(box_max),
            round(float(likely[o]), 4), bool(confirmed[o]), int(row["n_detected"]), int(row["n_observable"]),
            float(row["first_s"]), float(row["last_s"]), float(row["looked_s"]), views, named_shares(row["colours"]),
            aliases=tuple(old_ids.get(number, ())), oriented=boxes[1][o], side_views=tuple(further.values()),
        ))  # fmt: skip
    return tuple(objects)


def _views(
    kept: npt.NDArray[Any], names: Sequence[str], place: tuple[tuple[float, ...] | None] | None
) -> tuple[View, ...]:
    """The views in a row, best first; ``place`` is the surface that they show where depth does not tell it."""
    best = [view for view in np.sort(kept, order="worth")[::-1] if view["frame"] >= 0]
    return tuple(_view(view, names, _metres(view["surface"]) if place is None else place[0]) for view in best)


def _view(view: Any, names: Sequence[str], surface: tuple[float, ...] | None) -> View:
    return View(
        int(view["frame"]), tuple(map(float, view["box"].round(2))), round(float(view["score"]), 4),
        names[view["label"]], round(float(view["size_px2"]), 1), _metres(view["camera"]), float(view["yaw"]), surface,
    )  # fmt: skip


def _metres(values: Array) -> tuple[float, ...]:
    """To a tenth of a millimetre, as written in files."""
    return tuple(round(float(v), 4) for v in values)
