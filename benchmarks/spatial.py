"""Benchmark of rooms and relations in dollhouse homes against ground truth; ``objects.py`` prints it.

Rooms: how much they overlap the true ones, their kinds, the share of objects in the right one. Then what things stand
on or in, requests for "the X closest to the Y", and the other relations. Of each relation: how many were told with a
probability of one half or more, which share of them is true, which share of the true ones was told, and how far the
probabilities are off. What touches what is known from the home's triangles: rays from under each thing meet what holds
it. All else is true if it holds between the true boxes.
"""

from __future__ import annotations

import itertools
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from cartier.geometry import box_distance
from cartier.mapping.rooms import find_rooms, rooms_of
from cartier.spatial.relations import (
    Relation,
    between,
    bigger,
    left_of,
    nearest,
    next_to,
    right_of,
    supports,
    under,
)
from cartier.types import Array, MapObject, OccupancyGrid
from cartier_bench.predicates import closest, is_beside
from cartier_bench.true_home import SHOWN_PX, true_objects
from cartier_dollhouse.contacts import Contacts
from cartier_dollhouse.model import Scene

DETECTORS = {"ground_truth": "ground-truth detections", "embedded": "from pixels"}
SAME_M = 0.5  # an object of the map is at most so far from the true thing of its name
ENTERED = 0.3  # of a room's floor that must be known for it to count
CLEAR = 0.2  # from one half is the probability with which one thing is bigger than another of its name, at least
PAIRS = 60  # of things in each home, for "between" and for left and right
KINDS = {"office": "study"}  # the dollhouse's names for kinds of rooms
Told = list[tuple[float, bool]]
"""The probability of each relation that was told, and whether it is true."""


class Mapped:
    """A home as it was mapped, beside the truth; ``is_true`` are the ids of true things by those of the objects that
    are these."""

    def __init__(self, scene: Scene, grid: OccupancyGrid, objects: Sequence[MapObject], pixels: Array) -> None:
        self.scene, self.grid = scene, grid
        sure = [obj for obj in objects if obj.confirmed]
        begin = time.perf_counter()
        self.rooms = find_rooms(grid, sure)
        self.ms = (time.perf_counter() - begin) * 1e3
        self.objects = [replace(o, room=room) for o, room in zip(sure, rooms_of(sure, grid, self.rooms), strict=True)]
        self.by_id = {obj.id: obj for obj in self.objects}
        self.true = {obj.id: obj for obj in true_objects(scene)}
        self.shown = {i for i in self.true if i < len(pixels) and pixels[i] >= SHOWN_PX}
        self.is_true = self._matched([obj for i, obj in self.true.items() if i < len(pixels) and pixels[i] > 0])
        self.real = [obj for obj in self.objects if obj.id in self.is_true]

    def truth(self, obj: MapObject) -> MapObject:
        return self.true[self.is_true[obj.id]]

    def _matched(self, seen: Sequence[MapObject]) -> dict[int, int]:
        """One to one, by name and place."""
        cost = np.full((len(self.objects), len(seen)), 1e6)
        for a, b in itertools.product(range(len(self.objects)), range(len(seen))):
            middle, true = np.array(self.objects[a].position), seen[b]
            far = float(box_distance(middle, np.array(true.box_min), np.array(true.box_max)))
            if self.objects[a].label == true.label and far <= SAME_M:
                cost[a, b] = far + 0.2 * float(np.linalg.norm(middle - true.position))
        pairs = zip(*(k.tolist() for k in linear_sum_assignment(cost)), strict=True)
        return {self.objects[a].id: seen[b].id for a, b in pairs if cost[a, b] < 1e6}


class Figures:
    """What all homes of one detector come to."""

    def __init__(self) -> None:
        self.told: dict[str, Told] = defaultdict(list)
        self.true: dict[str, int] = defaultdict(int)
        self.overlaps: list[float] = []
        self.right: dict[str, list[bool]] = defaultdict(list)
        self.ms: dict[str, list[float]] = defaultdict(list)

    def add(self, home: Mapped, contacts: Contacts) -> None:
        self._rooms(home)
        begin = time.perf_counter()
        found = supports(home.objects)
        self.ms["supports"].append((time.perf_counter() - begin) * 1e3)
        self._supports(home, contacts, found)
        self._closest(home)
        self._pairs(home, contacts)

    def _rooms(self, home: Mapped) -> None:
        self.ms["rooms"].append(home.ms)
        grid, boxes = home.grid, np.array([room.box for room in home.scene.rooms])
        at = grid.centre(np.argwhere(np.ones(grid.cells.shape, bool))).reshape(*grid.cells.shape, 2)
        true = [((at > box[:2]) & (at < box[2:])).all(2) for box in boxes]
        found = [np.zeros(grid.cells.shape, bool) for _ in home.rooms]
        for mask, room in zip(found, home.rooms, strict=True):
            mask[tuple(room.cells.T)] = True
        overlap = np.array([[(a & b).sum() / (a | b).sum() for b in found] for a in true]).reshape(
            len(true), len(found)
        )
        same = dict(zip(*(k.tolist() for k in linear_sum_assignment(-overlap)), strict=True))
        entered = [a for a, mask in enumerate(true) if (grid.cells[mask] != -1).mean() > ENTERED]
        self.overlaps += [float(overlap[a, same[a]]) if a in same else 0.0 for a in entered]
        kinds = [room.kind for room in home.scene.rooms]
        self.right["kind"] += [a in same and home.rooms[same[a]].kind == KINDS.get(kinds[a], kinds[a]) for a in entered]
        self.right["room"] += [same.get(home.truth(t).room, -1) == t.room for t in home.real]
        inside = [max(range(len(true)), key=lambda a: int((true[a] & mask).sum())) for mask in found]
        self.true["split rooms"] += len(inside) - len(set(inside))
        self.true["merged rooms"] += sum(sum((a & mask).sum() > 0.2 * a.sum() for a in true) > 1 for mask in found)

    def _supports(self, home: Mapped, contacts: Contacts, found: Mapping[int, Relation]) -> None:
        mapped = set(home.is_true.values())
        held = {obj.id: contacts.mapped_holder(home.is_true[obj.id], mapped) for obj in home.real}
        right = {
            i: (home.is_true.get(-1 if told.object is None else told.object), told.kind) == held.get(i, (None, None))
            for i, told in found.items()
        }
        told = [(relation.probability, i in held and held[i] is not None and right[i]) for i, relation in found.items()]
        self.told["on or in"] += told
        self.told["  of real things"] += [row for row, i in zip(told, found, strict=True) if i in held]
        for name in ("on or in", "  of real things"):
            self.true[name] += sum(holder is not None for holder in held.values())

    def _closest(self, home: Mapped) -> None:
        """ "The X closest to the Y" where it is true of one thing alone: as the truth has it, and as the map says by
        itself."""
        known, is_of = _by_label(home.objects), {true: mapped for mapped, true in home.is_true.items()}
        for y, xs, first in _statements(list(home.true.values())):
            if {y.id, first} <= home.shown:
                self.true["closest, asked"] += 1
                if {y.id, first} <= is_of.keys():
                    best = nearest(home.by_id[is_of[y.id]], known[xs[0].label])[0]
                    self.told["closest, asked"].append((best.probability, home.is_true.get(best.subject) == first))
        every = _by_label(list(home.true.values()))
        for y, xs, first in _statements(home.objects):
            right = home.is_true.keys() >= {y.id, first}
            right = right and nearest(home.truth(y), every[xs[0].label])[0].subject == home.is_true[first]
            self.told["closest, told"].append((nearest(y, xs)[0].probability, right))
            self.true["closest, told"] += 1

    def _pairs(self, home: Mapped, contacts: Contacts) -> None:
        """Relations between things that are real, against the same ones between their true boxes."""
        real, rng = home.real, np.random.default_rng(0)
        truth = [home.truth(obj) for obj in real]
        for obj, true in zip(real, truth, strict=True):
            beside = {other.id for other in truth if is_beside(true, other)}
            self._judge("next to", home, next_to(obj, real), lambda r, beside=beside: r.subject in beside, len(beside))
            below = {(s, o) for s, o in contacts.covered if o == true.id}
            self._judge(
                "under", home, under(obj, real), lambda r, below=below: (r.subject, r.object) in below, len(below)
            )
        near = [
            (i, j) for i, j in itertools.permutations(range(len(real)), 2)
            if truth[i].room == truth[j].room
            and 0.5 < np.linalg.norm(np.subtract(truth[i].position, truth[j].position)) < 3
        ]  # fmt: skip
        for k in rng.permutation(len(near))[:PAIRS].tolist():
            i, j = near[k]
            self._compare("between", home, between(real[i], real[j], real), between(truth[i], truth[j], truth))
            seen_from = real[i].views[0].camera[:2]
            for name, side in (("left of", left_of), ("right of", right_of)):
                self._compare(name, home, side(real[i], [real[j]], seen_from), side(truth[i], [truth[j]], seen_from))
        for (one, a), (other, b) in itertools.permutations(zip(real, truth, strict=True), 2):
            if one.label == other.label and abs(bigger(a, b).probability - 0.5) > CLEAR:
                self._compare("bigger", home, [bigger(one, other)], [bigger(a, b)])

    def _compare(self, name: str, home: Mapped, told: Sequence[Relation], true: Sequence[Relation]) -> None:
        holds = {relation.subject for relation in true if relation.probability >= 0.5}
        self._judge(name, home, told, lambda relation: relation.subject in holds, len(holds))

    def _judge(
        self, name: str, home: Mapped, told: Sequence[Relation], holds: Callable[[Relation], bool], true: int
    ) -> None:
        for relation in told:
            pair = (home.is_true[i] if i is not None else None for i in (relation.subject, relation.object))
            subject, obj = pair
            self.told[name].append((relation.probability, holds(replace(relation, subject=subject or 0, object=obj))))
        self.true[name] += true

    def print(self, title: str) -> None:
        overlaps, kinds, rooms = np.array(self.overlaps), self.right["kind"], self.right["room"]
        print(f"{title}\n  rooms: {len(overlaps)} entered, overlap {overlaps.mean():.3f} (least {overlaps.min():.2f}), "
              f"{self.true['split rooms']} split, {self.true['merged rooms']} merged; kind right {np.mean(kinds):.3f}; "
              f"{len(rooms)} objects, room right {np.mean(rooms):.3f}")  # fmt: skip
        for name, told in self.told.items():
            likely, right = np.array(told, float).reshape(-1, 2).T
            sure = likely >= 0.5
            hits, bins = float(right[sure].sum()), np.minimum(likely * 5, 4).astype(int)
            off = sum(abs(float((likely - right)[bins == k].sum())) for k in range(5)) / max(1, len(told))
            print(f"  {name:16} {sure.sum():5d} told, {hits / max(1, sure.sum()):.3f} right; {self.true[name]:5d} "
                  f"true, {hits / max(1, self.true[name]):.3f} told; probabilities off by {off:.3f}")  # fmt: skip
        times = ", ".join(f"{name} {np.median(ms):.1f} ms (most {max(ms):.0f})" for name, ms in self.ms.items())
        print(f"  {times}", flush=True)


def _by_label(objs: Sequence[MapObject]) -> dict[str, list[MapObject]]:
    found: dict[str, list[MapObject]] = defaultdict(list)
    for obj in objs:
        found[obj.label].append(obj)
    return found


def _statements(objs: Sequence[MapObject]) -> list[tuple[MapObject, list[MapObject], int]]:
    """The Y, the Xs, and the id of the one that is "the X closest to the Y", of all Y that are alone of their name."""
    found = []
    for ys, xs in itertools.permutations(_by_label(objs).values(), 2):
        first = closest(ys[0], xs) if len(ys) == 1 else None
        if first is not None:
            found.append((ys[0], xs, first))
    return found
