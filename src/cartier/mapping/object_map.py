"""A map of objects, frame by frame: which detection is of which object, and the evidence for and against each.

Each detection is lifted into space by depth (``lifting.py``) and matched one to one with the objects known so far, by overlap in the
image and in space, by distance relative to size, and by label, which is evidence and never a gate. Every frame that would have
shown an object is a chance, every match a sighting (``existence.py``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.geometry import view_yaw, weak_perspective_size
from cartier.io.files import json_bytes, npz_bytes, parse_json, read_npz
from cartier.mapping.colours import COLOURS, colour_shares, named_shares
from cartier.mapping.existence import CONFIRMED, STANDPOINTS, probability, report_weight, standpoints
from cartier.mapping.observation import POINTS, Lifted, lift, overlaps
from cartier.types import Array, Detections, DetectorScoreModel, Frame, MapObject, View

MATCH = 0.6  # what a pair must be worth to be of one object
LABEL = 0.35  # what an equal label adds to that
SAME_BOX = 0.7  # overlap in the image from which two names are for one thing
NESTED, CONTAINED = (
    0.4,
    0.5,
)  # share of the smaller one in space and in the image from which two boxes of a label are of one object: a sofa and half of it
GROW, SHRINK = 0.5, 0.05  # how fast a box follows a view outwards and inwards
LEAST_ANGLE = 0.03  # what appears smaller (rad) gives no chance to be seen
TOGETHER = 0.3  # share of its n_detected in which two objects must be seen side by side to stay two
FEW, MANY = 2, 30  # an object seen at most so often in so many n_observable is forgotten
USUAL = 0.6  # quantile of the sizes of all of a name, by n_detected, that one of them has
WHOLE = 1.1  # how many times that the union of two halves may be
LARGE_M = 0.4  # what is smaller is not hidden by halves
TIDY_EVERY = 10  # frames
LABELS, VIEWS = 6, 3  # kept per object
SIDES = {"low": -1, "high": 1, "reach_low": -1, "reach_high": 1}
"""The corners of an object's box, and of all that may belong to it, by which it is known again; which way is outwards."""
MOST_DETECTIONS = 60  # per frame

_VIEW = np.dtype(
    [("frame", "i4"), ("box", "f4", 4), ("score", "f4"), ("label", "i2"), ("size_px2", "f4"), ("camera", "f4", 3),
     ("yaw", "f4"), ("surface", "f4", 3), ("worth", "f4")]
)  # fmt: skip
COLUMNS: Mapping[str, tuple[tuple[int, ...], Any]] = {
    "id": ((), "i8"), "points": ((POINTS, 3), "f4"), "low": ((3,), "f8"), "high": ((3,), "f8"), "reach_low": ((3,), "f8"), "reach_high": ((3,), "f8"), "label": ((LABELS,), "i2"),
    "weight": ((LABELS,), "f4"), "n_detected": ((), "i4"), "n_observable": ((), "i4"), "first_s": ((), "f8"), "last_s": ((), "f8"),
    "looked_s": ((), "f8"), "widest_rad": ((), "f4"), "tried": ((STANDPOINTS,), "f4"), "hits": ((STANDPOINTS,), "f4"), "views": ((VIEWS,), _VIEW),
    "colours": ((len(COLOURS),), "f4"), "changed": ((), "?"),
}  # fmt: skip
"""One array per property, one row per object, so that a frame is matched with all objects at once."""


OLD_COLUMNS = {"sightings": "n_detected", "chances": "n_observable"}  # of homes that cartier 0.1.0 wrote


class ObjectMap:
    """The objects of one home, of frames with depth. Memory depends on what is there, not on the number of frames."""

    columns: ClassVar = COLUMNS

    def __init__(self, score_model: DetectorScoreModel) -> None:
        self.score_model = score_model
        self._labels: dict[str, int] = {}
        self._rows = {name: np.zeros((64, *shape), kind) for name, (shape, kind) in self.columns.items()}
        self._count = self._next_id = self._frames = 0
        self._together: dict[
            tuple[int, int], int
        ] = {}  # frames that show two touching objects side by side, by their ids
        self._aliases: dict[int, int] = {}  # ids of objects that turned out to be another one

    def __len__(self) -> int:
        return self._count

    def add(self, frame: Frame, detections: Detections) -> npt.NDArray[np.int64]:
        """Take in one frame and everything detected in it; returns each detection's object id (N,), -1 for none."""
        given = np.full(len(detections), -1)
        order = np.argsort(-detections.scores, kind="stable")[:MOST_DETECTIONS]
        detections = detections.keep(order)
        boxes, scores = detections.boxes_xyxy.astype(np.float64), detections.scores
        labels = np.array([self._labels.setdefault(name, len(self._labels)) for name in detections.labels], np.intp)
        lifted = self._lift(frame, boxes, detections.masks)
        leader = _leaders(boxes, lifted, labels, exact=detections.masks is not None)
        found = np.flatnonzero(leader == np.arange(len(leader)))
        known, chance, image_boxes, near = self._count, *self._expected(frame)
        row = np.full(len(leader), -1)
        row[found] = self._matched(frame, boxes, lifted, labels, leader, found, image_boxes, near)
        for d in found:
            if row[d] < 0 and scores[d] >= self.score_model.spawn_threshold:
                row[d] = self._begin(lifted, int(d), frame.time_s)
        sizes, colours = weak_perspective_size(boxes, frame.camera), colour_shares(frame.rgb, lifted.pixels, lifted.own)
        seen = found[row[found] >= 0]
        whole = np.append(chance, np.ones(self._count - known, bool))[row[seen]]
        self._follow(row[seen], lifted, seen, np.where(whole, SHRINK, 0))  # a part must not make it smaller
        self._sight(row[seen], frame.time_s)
        for d in seen:
            o = row[d]
            self._keep_view(o, frame, detections, d, labels[d], float(sizes[d]), lifted.middle[d])
            self._rows["colours"][o] += colours[d] * scores[d]
            for k in np.flatnonzero(leader == d):
                self._vote(o, int(labels[k]), float(scores[k]) ** 2)
        self._weigh(frame, row, scores, np.append(chance, np.zeros(self._count - known, bool)))
        self._note_together(
            row[(row >= 0) & (scores >= (self.score_model.zero_weight_score + self.score_model.full_weight_score) / 2)]
        )
        ids = np.where(row >= 0, self._rows["id"][row], -1)  # before tidying moves the rows
        self._frames += 1
        if self._frames % TIDY_EVERY == 0:
            self.tidy()
        given[order] = np.where(leader >= 0, ids[leader], -1)
        return given

    def _lift(self, frame: Frame, boxes_xyxy: Array, masks: npt.NDArray[np.bool_] | None) -> Lifted:
        return lift(frame, boxes_xyxy, masks)

    def _expected(self, frame: Frame) -> tuple[npt.NDArray[np.bool_], Array, npt.NDArray[np.intp]]:
        """Which objects (n,) this frame gives a chance to be seen, where each would appear (n, 4), and which may appear at all.

        A chance: most of the surface in view, wide enough, and most of it not hidden by what the depth shows before it.
        """
        assert frame.depth_m is not None
        n, rows, camera, pose = self._count, self._rows, frame.camera, frame.world_from_camera.astype(np.float32)
        chance, boxes = np.zeros(n, bool), np.zeros((n, 4))
        low, high = rows["reach_low"][:n], rows["reach_high"][:n]
        radius, ahead = np.linalg.norm(high - low, axis=1) / 2, ((low + high) / 2 - pose[:3, 3]) @ pose[:3, :3]
        tangent = max(camera.width / camera.fx, camera.height / camera.fy)  # generous: twice the half angle
        some = np.flatnonzero(
            (ahead[:, 2] > -radius) & (np.abs(ahead[:, :2]).max(1, initial=0) < tangent * ahead[:, 2] + 2 * radius)
        )
        if not len(some):
            return chance, boxes, some
        x, y, z = ((rows["points"][some].reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]).T
        z = np.where(z > 0.05, z, np.nan)
        u, v = (
            x / z * np.float32(camera.fx) + np.float32(camera.cx),
            y / z * np.float32(camera.fy) + np.float32(camera.cy),
        )
        inside = (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)  # NaN compares as False
        pixels = np.where(inside, v, 0).astype(np.intp) * camera.width + np.where(inside, u, 0).astype(np.intp)
        measured = frame.depth_m.ravel()[pixels]
        inside = inside.reshape(len(some), POINTS)
        measured, z, u, v = (a.reshape(len(some), POINTS) for a in (measured, z, u, v))
        known = inside & (measured > 0)
        size, slack = (high - low)[some].max(1, initial=0)[:, None], 0.1 + 0.03 * np.where(known, z, 1)
        hidden = (known & (measured < z - slack - 0.5 * size)).sum(1)
        behind = (known & (measured > z + slack + 0.15 * size)).sum(1)
        known, share = known.sum(1), inside.mean(1)
        for column, values, least in ((0, u, True), (1, v, True), (2, u, False), (3, v, False)):
            edge = np.where(inside, values, np.inf if least else -np.inf)
            boxes[some, column] = np.where(share > 0, edge.min(1) if least else edge.max(1), 0)
        wide = (boxes[some, 2:] - boxes[some, :2]).max(1) / camera.fx >= LEAST_ANGLE
        chance[some] = wide & (share >= 0.7) & (known >= 4) & (known - hidden - behind >= 0.5 * known)
        return chance, boxes, some[share > 0.1]

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
        """The row of the object that each found detection is of, one to one; -1 for none."""
        from scipy.optimize import linear_sum_assignment

        row = np.full(len(found), -1)
        if len(found) and len(near):
            agree = self._agreement(labels, leader, found, near)
            low, high, o_low, o_high = (
                lifted.reach_low[found],
                lifted.reach_high[found],
                self._rows["reach_low"][near],
                self._rows["reach_high"][near],
            )
            space, part, within = overlaps(low, high, o_low, o_high, 0.02)
            size = (np.linalg.norm(high - low, axis=1)[:, None] + np.linalg.norm(o_high - o_low, axis=1)) / 2
            apart = np.linalg.norm((low + high)[:, None] - (o_low + o_high), axis=2) / 2 / (0.1 + 0.5 * size)
            seen, expected = boxes[found], image_boxes[near]
            image = overlaps(seen[:, :2], seen[:, 2:], expected[:, :2], expected[:, 2:])[0]
            fits = (image + np.maximum(space, 0.6 * part * agree) + np.exp(-2 * apart**2)) / 3
            worth = np.maximum(fits, 0.5 * within * agree) + LABEL * agree  # a sliver of a known sofa is that sofa
            i, j = linear_sum_assignment(-np.where(worth >= MATCH, worth, 0))
            row[i] = np.where(worth[i, j] >= MATCH, near[j], -1)
        return row

    def _agreement(
        self,
        labels: npt.NDArray[np.intp],
        leader: npt.NDArray[np.intp],
        found: npt.NDArray[np.intp],
        near: npt.NDArray[np.intp],
    ) -> Array:
        """How far the names of each detection's box (n, m) agree with the votes of each object, 0 to 1."""
        votes, weights = self._rows["label"][near], self._rows["weight"][near]
        agree = np.zeros((len(leader), len(near)))
        agree[found] = np.einsum("ms,nms->nm", weights, votes == labels[found, None, None])
        led = np.flatnonzero((leader >= 0) & (leader != np.arange(len(leader))))
        np.maximum.at(agree, leader[led], np.einsum("ms,nms->nm", weights, votes == labels[led, None, None]))
        return np.asarray(np.minimum(1, 1.5 * agree[found] / (weights.sum(1) + 1e-9)))

    def _begin(self, lifted: Lifted, d: int, time_s: float) -> int:
        rows, o = self._rows, self._count
        if o == len(rows["id"]):
            self._rows = rows = {name: np.concatenate([column, np.zeros_like(column)]) for name, column in rows.items()}
        rows["id"][o], rows["label"][o], rows["first_s"][o], rows["points"][o] = (
            self._next_id,
            -1,
            time_s,
            lifted.points[d],
        )
        for side in SIDES:
            rows[side][o] = getattr(lifted, side)[d]
        rows["views"]["frame"][o] = -1
        self._next_id, self._count = self._next_id + 1, o + 1
        return o

    def _sight(self, objects: npt.NDArray[np.intp], time_s: float) -> None:
        self._rows["n_detected"][objects] += 1
        self._rows["last_s"][objects], self._rows["changed"][objects] = time_s, True

    def _follow(self, objects: npt.NDArray[np.intp], lifted: Lifted, seen: npt.NDArray[np.intp], shrink: Array) -> None:
        """The first views fill the surface of each object (k,), a later one changes an eighth of it."""
        points, count = self._rows["points"], self._rows["n_detected"][objects, None]
        first, each = count % 8, np.arange(POINTS)
        some = (each >= first) & ((each - first) % np.minimum(1 + count, 8) == 0)
        points[objects] = np.where(some[..., None], lifted.points[seen], points[objects])
        self._settle(objects, {side: getattr(lifted, side)[seen] for side in SIDES}, shrink[:, None])

    def _settle(self, objects: npt.NDArray[np.intp] | int, seen: Mapping[str, Array], shrink: Array | float) -> None:
        """Let objects' boxes, and their reach, follow what a view shows of them."""
        for side, outwards in SIDES.items():
            own = self._rows[side][objects]
            way = seen[side] - own
            self._rows[side][objects] = own + way * np.where(way * outwards > 0, GROW, shrink)

    def _keep_view(
        self, o: int, frame: Frame, detections: Detections, d: int, label: int, size_px2: float, surface: Array
    ) -> None:
        """Of all views the surest and largest are kept."""
        views, score, camera = self._rows["views"][o], float(detections.scores[d]), frame.camera
        self._rows["widest_rad"][o] = max(self._rows["widest_rad"][o], (size_px2 / (camera.fx * camera.fy)) ** 0.5)
        worth = score * size_px2**0.5
        last = int(views["worth"].argmin())
        if worth > views["worth"][last]:
            box, pose = detections.boxes_xyxy[d], frame.world_from_camera
            yaw = view_yaw(pose, camera, float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2)
            views[last] = (frame.index, box, score, label, size_px2, pose[:3, 3], yaw, surface, worth)

    def _vote(self, o: int, label: int, weight: float) -> None:
        labels, weights = self._rows["label"][o], self._rows["weight"][o]
        at = int((labels == label).argmax() if label in labels else weights.argmin())
        labels[at], weights[at] = label, weight + (weights[at] if labels[at] == label else 0)

    def _weigh(self, frame: Frame, row: Array, scores: Array, chance: npt.NDArray[np.bool_]) -> None:
        """One more chance at the standpoint from which each object is seen, and a report as far as its score counts."""
        rows, value = self._rows, np.zeros(self._count)
        value[row[row >= 0]] = report_weight(scores[row >= 0], self.score_model)
        tried = np.flatnonzero(chance | (value > 0))
        at = standpoints((rows["low"][tried] + rows["high"][tried]) / 2, frame.world_from_camera[:3, 3])
        rows["tried"][tried, at] += 1
        rows["hits"][tried, at] += value[tried]
        rows["n_observable"][tried] += 1
        rows["looked_s"][tried] = frame.time_s

    def _note_together(self, here: npt.NDArray[np.intp]) -> None:
        """Touching objects that one frame shows side by side are two, however alike they are."""
        low, high, ids = (
            self._rows[name][np.sort(here)] for name in ("reach_low", "reach_high", "id")
        )  # rows stand in the order of ids
        within = overlaps(low, high, low, high, 0.02)[2]
        for i, j in np.argwhere(np.triu(np.maximum(within, within.T) > 0.1, 1)):
            pair = int(ids[i]), int(ids[j])
            self._together[pair] = self._together.get(pair, 0) + 1

    def tidy(self) -> None:
        """Merge what turned out to be one object, unless frames showed both; forget what was hardly ever seen again."""
        rows, n = self._rows, self._count
        gone, seen, ids = set[int](), rows["n_detected"], rows["id"][:n].tolist()
        names = rows["label"][np.arange(n), rows["weight"][:n].argmax(1)]
        changed = np.flatnonzero(rows["changed"][:n])
        low, high = rows["reach_low"][:n], rows["reach_high"][:n]
        space, part, within = overlaps(low[changed], high[changed], low, high, 0.02)
        back = overlaps(low, high, low[changed], high[changed], 0.02)[2].T
        same = (space > 0.3) | (np.maximum(within, back) > 0.7)
        other = (space > 0.55) | ((space > 0.3) & (part > 0.85))  # another name for it
        equal = names[changed][:, None] == names
        alike = np.where(equal, same, other) | (equal & self._halves(changed, names))
        for i, j in ((int(changed[i]), int(j)) for i, j in np.argwhere(alike)):
            together = self._together.get((ids[min(i, j)], ids[max(i, j)]), 0)
            if i != j and not {i, j} & gone and together <= TOGETHER * min(seen[i], seen[j]):
                keep, drop = (i, j) if seen[i] >= seen[j] else (j, i)
                self._merge(keep, drop)
                gone.add(drop)
        rows["changed"][:n] = False
        gone.update(np.flatnonzero((seen[:n] <= FEW) & (rows["n_observable"][:n] >= MANY)).tolist())
        if gone:
            self._remove(gone)

    def _halves(self, changed: npt.NDArray[np.intp], names: Array) -> npt.NDArray[np.bool_]:
        """Which two (k, n) make up one object as large as others of their name: what shows on either side of a table of a chair."""
        low, high, seen = (self._rows[name][: self._count] for name in ("reach_low", "reach_high", "n_detected"))
        whole = np.zeros((self._count, 3))
        for name in np.unique(names[changed]):
            of = np.flatnonzero(names == name)
            size = (high - low)[of]
            size = np.stack([size[:, :2].min(1), size[:, :2].max(1), size[:, 2]], axis=1)
            order = np.argsort(size, axis=0)
            share = np.cumsum(seen[of][order], axis=0) / max(seen[of].sum(), 1)
            whole[of] = np.take_along_axis(size, np.take_along_axis(order, (share >= USUAL).argmax(0)[None], 0), 0)
        both = np.maximum(high[changed][:, None], high) - np.minimum(low[changed][:, None], low)
        both = np.stack([both[..., :2].min(2), both[..., :2].max(2), both[..., 2]], axis=2)
        fits = (both <= WHOLE * whole).all(2) & (whole.max(1) >= LARGE_M)
        return np.asarray(fits)

    def _merge(self, keep: int, drop: int) -> None:
        rows = self._rows
        rows["points"][keep, ::4] = rows["points"][drop, ::4]
        better_of = {-1: np.minimum, 1: np.maximum}
        self._settle(keep, {side: better_of[out](rows[side][keep], rows[side][drop]) for side, out in SIDES.items()}, 0)
        for name, better in (
            ("tried", np.maximum),
            ("widest_rad", max),
            ("n_observable", max),
            ("last_s", max),
            ("looked_s", max),
            ("first_s", min),
        ):
            rows[name][keep] = better(rows[name][keep], rows[name][drop])
        for name, limit in (
            ("hits", "tried"),
            ("n_detected", "n_observable"),
        ):  # while one had the report, the other had none
            rows[name][keep] = np.minimum(rows[name][keep] + rows[name][drop], rows[limit][keep])
        rows["colours"][keep] += rows["colours"][drop]
        both = np.concatenate([rows["views"][keep], rows["views"][drop]])
        rows["views"][keep] = both[np.argsort(-both["worth"], kind="stable")[:VIEWS]]
        for label, weight in zip(rows["label"][drop].tolist(), rows["weight"][drop].tolist(), strict=True):
            if label >= 0:
                self._vote(keep, label, weight)
        self._aliases[int(rows["id"][drop])] = int(rows["id"][keep])

    def _remove(self, gone: set[int]) -> None:
        left = np.array([o for o in range(self._count) if o not in gone], np.intp)
        for column in self._rows.values():
            column[: len(left)] = column[left]
            column[len(left) : self._count] = np.zeros((), column.dtype)
        self._count = len(left)
        alive = set(self._rows["id"][: self._count].tolist())
        self._together = {pair: k for pair, k in self._together.items() if alive.issuperset(pair)}
        for old, new in self._aliases.items():
            self._aliases[old] = self._aliases.get(new, new)
        self._aliases = {old: new for old, new in self._aliases.items() if new in alive}

    def frames(self) -> set[int]:
        """The frames that show the best views of objects."""
        return set(self._rows["views"]["frame"][: self._count].ravel().tolist()) - {-1}

    def weighed(self) -> tuple[Array, Array, Array]:
        """The evidence for and against each object (see ``existence.probability``)."""
        tried, hits, widest_rad = (self._rows[name][: self._count] for name in ("tried", "hits", "widest_rad"))
        return tried, hits, widest_rad

    def objects(self) -> tuple[MapObject, ...]:
        """Every object, confirmed and tentative, by id."""
        names, likely = list(self._labels), probability(*self.weighed(), self.score_model).tolist()
        aliases: dict[int, list[int]] = {}
        for old, new in self._aliases.items():
            aliases.setdefault(new, []).append(old)
        return tuple(self._object(o, likely[o], names, aliases) for o in range(self._count))

    def _object(self, o: int, likely: float, names: Sequence[str], aliases: Mapping[int, Sequence[int]]) -> MapObject:
        row = {name: column[o] for name, column in self._rows.items()}
        votes = [(names[k], round(float(w), 4)) for k, w in zip(row["label"], row["weight"], strict=True) if k >= 0]
        votes.sort(key=lambda vote: -vote[1])
        best = np.sort(row["views"], order="worth")[::-1]
        return MapObject(
            int(row["id"]), votes[0][0], tuple(votes), _metres((row["low"] + row["high"]) / 2), _metres(row["low"]),
            _metres(row["high"]), round(likely, 4), likely >= CONFIRMED, int(row["n_detected"]), int(row["n_observable"]),
            float(row["first_s"]), float(row["last_s"]), float(row["looked_s"]),
            tuple(_view(view, names) for view in best if view["frame"] >= 0), named_shares(row["colours"]),
            aliases=tuple(aliases.get(int(row["id"]), ())),
        )  # fmt: skip

    def state(self) -> dict[str, bytes]:
        """All of it, as named blobs."""
        about = {
            "labels": list(self._labels), "next_id": self._next_id, "frames": self._frames,
            "together": [[*pair, count] for pair, count in self._together.items()],
            "aliases": [list(pair) for pair in self._aliases.items()],
        }  # fmt: skip
        arrays = {name: column[: self._count] for name, column in self._rows.items()}
        return {"object_map.npz": npz_bytes(**arrays), "object_map.json": json_bytes(about)}

    def restore(self, state: Mapping[str, bytes]) -> None:
        """Take what ``state`` gave into a new map. Raises InputError if it is damaged."""
        about, arrays = (
            parse_json(state["object_map.json"], "object_map.json"),
            read_npz(state["object_map.npz"], where="object_map.npz"),
        )
        arrays = {OLD_COLUMNS.get(name, name): column for name, column in arrays.items()}
        try:
            count = len(arrays["id"])
            for name, (shape, kind) in self.columns.items():
                if arrays[name].shape != (count, *shape) or arrays[name].dtype != np.dtype(kind):
                    raise ValueError(f"{name} is of another kind or length")
            self._rows = {
                name: np.concatenate([arrays[name], np.zeros((64, *arrays[name].shape[1:]), arrays[name].dtype)])
                for name in self.columns
            }
            self._labels = {str(name): number for number, name in enumerate(about["labels"])}
            most = max(int(arrays["label"].max(initial=-1)), int(arrays["views"]["label"].max(initial=-1)))
            if most >= len(self._labels):
                raise ValueError(f"label {most} has no name")
            self._count, self._next_id, self._frames = count, int(about["next_id"]), int(about["frames"])
            self._together = {(int(i), int(j)): int(k) for i, j, k in about["together"]}
            self._aliases = {int(old): int(new) for old, new in about["aliases"]}
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"the map of objects is damaged ({brief(error)})") from error


def _leaders(boxes: Array, lifted: Lifted, labels: npt.NDArray[np.intp], exact: bool) -> npt.NDArray[np.intp]:
    """Each detection's leader, a surer one of the same thing or itself; -1 without depth. Boxes come best first.

    Two names for one box are one thing, and so are a sofa and half of it. ``exact`` detections (masks) are all of other things.
    """
    n = len(boxes)
    if exact:
        return np.where(lifted.shown, np.arange(n), -1)
    image, contained, _ = overlaps(boxes[:, :2], boxes[:, 2:], boxes[:, :2], boxes[:, 2:])
    nested = overlaps(lifted.reach_low, lifted.reach_high, lifted.reach_low, lifted.reach_high, 0.02)[1]
    same = (image > SAME_BOX) | ((labels[:, None] == labels) & (nested > NESTED) & (contained > CONTAINED))
    leader = np.full(n, -1)
    for k in range(n):
        if lifted.shown[k] and leader[k] < 0:
            leader[same[k] & lifted.shown & (leader < 0)] = k
    return leader


def _view(view: Any, names: Sequence[str]) -> View:
    return View(
        int(view["frame"]), tuple(map(float, view["box"].round(2))), round(float(view["score"]), 4), names[view["label"]],
        round(float(view["size_px2"]), 1), _metres(view["camera"]), float(view["yaw"]), _metres(view["surface"]),
    )  # fmt: skip


def _metres(values: Array) -> tuple[float, ...]:
    """To a tenth of a millimetre, as written in files."""
    return tuple(round(float(v), 4) for v in values)
