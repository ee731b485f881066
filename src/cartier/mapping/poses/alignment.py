"""Alignment of two maps of one home: a turn about z and a shift, from objects that both have, judged by the walls.

Objects propose: two that lie as far from each other in both maps fix a motion, and the one that brings most objects
onto objects of a like label or size is refined. Floor plans judge, and know nothing of objects: walls must come to lie
on walls and free floor stay free, as well as anywhere. Where the two do not agree, there is no alignment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.home import Home
from cartier.mapping.poses.registration import about_z
from cartier.mapping.poses.wall_registration import register_walls
from cartier.types import MapObject

Floats = npt.NDArray[np.float64]
FEWEST = 5  # objects that must lie on each other
NEAR_M, APART_M, ALIKE_M = 0.35, 0.8, 0.25  # an object on another; two that fix a motion; their distances in both maps
LEVEL_M, FLOOR_M = 0.3, 0.05  # how far heights may differ, and floors, which both lie at 0
LIKE, SIZE_ONLY, SIZE_ALIKE = (
    0.3,
    0.3,
    0.35,
)  # least agreement of labels; what size alone is worth; deviation of log sides
MOST_PAIRS, MOST_TRIED = 400, 6000
RIVAL, RIVAL_M, RIVAL_RAD = 0.8, 1.0, float(np.deg2rad(15))  # another motion explains less than this share
AGREE_M, AGREE_RAD = 0.15, float(np.deg2rad(2))  # objects and walls


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where a map lies in another one's world.

    Args:
        old_from_new: (4, 4) a turn about z and a shift.
        objects: How many objects of both lie on each other.
        on_walls: Which share of the walls lies on walls, of those where both maps know the floor plan; the smaller
            one of both ways.
    """

    old_from_new: Floats
    objects: int
    on_walls: float

    def pose(self, index: int, world_from_camera: Floats) -> Floats:
        """The pose (4, 4) of any frame of the new map, in the world of the old one."""
        return np.asarray(self.old_from_new @ world_from_camera)

    def row(self) -> list[float]:
        """The motion as JSON values: the turn about z (rad) and the shift (m)."""
        return [round(each, 5) for each in (_yaw(self.old_from_new), *self.old_from_new[:3, 3].tolist())]

    @classmethod
    def of_row(cls, row: Sequence[float]) -> Alignment:
        """What ``row`` gave, but for what agreed."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = about_z(row[0]), row[1:]
        return cls(matrix, 0, 0.0)

    def note(self, new: str) -> str:
        """What a person should know."""
        return f"{new} was aligned: {self.objects} objects and {self.on_walls:.0%} of the walls lie on those of before"


def align(old: Home, new: Home) -> Alignment:
    """Where the new map lies in the world of the old one.

    Raises:
        InputError: Objects and walls do not agree on one place: the two may be of different homes.
    """
    if old.grid is None or new.grid is None:
        raise _refusal(old, new, "one of them has no floor plan")
    proposed = by_objects(*([obj for obj in home.objects if obj.confirmed] for home in (old, new)))
    if isinstance(proposed, str):
        raise _refusal(old, new, proposed)
    by_walls = register_walls(old.grid, new.grid, proposed[0])
    middle = np.append(np.mean([obj.position for obj in new.objects], axis=0), 1.0)
    off_m = float(np.linalg.norm(((by_walls.old_from_new - proposed[0]) @ middle)[:2]))
    off_rad = float(np.abs(_wrapped(_yaw(by_walls.old_from_new) - _yaw(proposed[0]))))
    if off_m > AGREE_M or off_rad > AGREE_RAD or not by_walls.best:
        raise _refusal(old, new, "walls lie otherwise than objects say")
    if not by_walls.agree:
        told = (
            f"only {by_walls.on_walls:.0%} of the walls come to lie on walls, and {by_walls.on_floor:.0%} of the floor "
        )
        raise _refusal(old, new, f"{told}on floor")
    return Alignment(by_walls.old_from_new, proposed[1], by_walls.on_walls)


def _refusal(old: Home, new: Home, why: str) -> InputError:
    return InputError(f"{new.name} cannot be aligned with {old.name}: {why}; map it apart, into another folder")


def by_objects(old: Sequence[MapObject], new: Sequence[MapObject]) -> tuple[Floats, int] | str:
    """The motion (4, 4) that objects propose, and how many agree; or why there is none."""
    few = f"fewer than {FEWEST} objects of both are in the same places"
    if min(len(old), len(new)) < FEWEST:
        return few
    at_old, at_new = (np.array([obj.position for obj in objs]) for objs in (old, new))
    worth = _worth(old, new)
    worth[np.abs(at_old[:, None, 2] - at_new[None, :, 2]) > LEVEL_M] = 0
    rows, cols = np.nonzero(worth)
    best = np.argsort(-worth[rows, cols], kind="stable")[:MOST_PAIRS]
    best = best[np.argsort(cols[best], kind="stable")]  # by the new object, of which each counts once
    tried = _motions(
        at_old[rows[best], :2], at_new[cols[best], :2], rows[best], cols[best], worth[rows[best], cols[best]]
    )
    if not len(tried):
        return few
    scores = _scores(tried, at_old[rows[best], :2], at_new[cols[best], :2], cols[best], worth[rows[best], cols[best]])
    motion, count = _refined(tried[scores.argmax()], at_old, at_new, worth)
    if count < FEWEST:
        return few
    middle = at_new[:, :2].mean(axis=0)
    far = np.linalg.norm(_moved(tried, middle) - _moved(motion[None], middle), axis=1) > RIVAL_M
    far |= np.abs(_wrapped(tried[:, 0] - motion[0])) > RIVAL_RAD
    if scores[far].max(initial=0.0) > RIVAL * scores.max():
        return "its objects fit in more than one place"
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:2, 3] = about_z(motion[0]), motion[1:3]
    matrix[2, 3] = 0.0 if abs(motion[3]) < FLOOR_M else motion[3]
    return matrix, count


def _worth(old: Sequence[MapObject], new: Sequence[MapObject]) -> Floats:
    """How much it says (n, m) that two objects lie on each other: by labels, else by size; rare ones say more."""
    names = {label: k for k, label in enumerate(sorted({name for obj in (*old, *new) for name, _ in obj.labels}))}
    votes = []
    for objs in (old, new):
        table = np.zeros((len(objs), len(names)))
        for row, obj in zip(table, objs, strict=True):
            for label, weight in obj.labels:
                row[names[label]] = weight
        votes.append(table / np.maximum(np.linalg.norm(table, axis=1, keepdims=True), 1e-9))
    alike = votes[0] @ votes[1].T
    sides = [
        np.log(np.maximum(np.sort([np.subtract(o.box_max, o.box_min) for o in objs]), 0.02)) for objs in (old, new)
    ]
    size = np.exp(-np.square((sides[0][:, None] - sides[1][None]) / SIZE_ALIKE).mean(axis=2) / 2)
    worth = np.where(alike >= LIKE, alike * (1 + size) / 2, np.where(size > 0.7, SIZE_ONLY * size, 0.0))
    likely = np.where(alike >= LIKE, worth, 0)
    common = np.maximum(likely.sum(axis=1)[:, None], likely.sum(axis=0)[None])
    return np.asarray(worth / np.sqrt(np.maximum(common, 1)))


def _motions(one: Floats, two: Floats, rows: npt.NDArray[np.intp], cols: npt.NDArray[np.intp], worth: Floats) -> Floats:
    """Motions (h, 3), turn and shift, that bring two of the new objects ``two`` (k, 2) onto their old ones."""
    a, b = np.triu_indices(len(rows), 1)
    way_old, way_new = one[b] - one[a], two[b] - two[a]
    far = np.linalg.norm(way_old, axis=1), np.linalg.norm(way_new, axis=1)
    fits = (
        (rows[a] != rows[b]) & (cols[a] != cols[b]) & (np.abs(far[0] - far[1]) < ALIKE_M) & (np.minimum(*far) > APART_M)
    )
    a, b, way_old, way_new = (each[fits] for each in (a, b, way_old, way_new))
    first = np.argsort(-worth[a] * worth[b], kind="stable")[:MOST_TRIED]
    a, b, way_old, way_new = (each[first] for each in (a, b, way_old, way_new))
    turn = np.arctan2(way_old[:, 1], way_old[:, 0]) - np.arctan2(way_new[:, 1], way_new[:, 0])
    motions = np.column_stack([turn, np.zeros((len(turn), 2))])
    motions[:, 1:] = (one[a] + one[b]) / 2 - _moved(motions, (two[a] + two[b]) / 2)
    return motions


def _moved(motions: Floats, points: Floats) -> Floats:
    """Points (2,) or (h, 2), each by its motion (h, 3)."""
    c, s = np.cos(motions[:, 0]), np.sin(motions[:, 0])
    x, y = points[..., 0], points[..., 1]
    return np.column_stack([c * x - s * y + motions[:, 1], s * x + c * y + motions[:, 2]])


def _scores(motions: Floats, one: Floats, two: Floats, cols: npt.NDArray[np.intp], worth: Floats) -> Floats:
    """How much lies on each other by each motion (h,); of a new object only the best pair counts."""
    c, s = np.cos(motions[:, :1]), np.sin(motions[:, :1])
    x = c * two[:, 0] - s * two[:, 1] + motions[:, 1:2] - one[:, 0]
    y = s * two[:, 0] + c * two[:, 1] + motions[:, 2:3] - one[:, 1]
    near = np.maximum(1 - np.hypot(x, y) / NEAR_M, 0) * worth
    begins = np.flatnonzero(np.append(True, cols[1:] != cols[:-1]))
    return np.asarray(np.maximum.reduceat(near, begins, axis=1).sum(axis=1))


def _refined(motion: Floats, at_old: Floats, at_new: Floats, worth: Floats) -> tuple[Floats, int]:
    """The motion (turn, x, y, z) that fits all objects on each other best, one to one, and how many they are."""
    from scipy.optimize import linear_sum_assignment

    found, count = np.append(motion, 0.0), 0
    for _ in range(4):
        moved = at_new @ about_z(found[0]).T + found[1:]
        off_m = np.linalg.norm(at_old[:, None, :2] - moved[None, :, :2], axis=2)
        score = worth * np.maximum(1 - off_m / NEAR_M, 0)
        rows, cols = linear_sum_assignment(score, maximize=True)
        on = score[rows, cols] > 0
        rows, cols, count = rows[on], cols[on], int(on.sum())
        if count < 2:
            break
        weight = worth[rows, cols] / worth[rows, cols].sum()
        one, two = at_old[rows], at_new[cols]
        middles = weight @ one, weight @ two
        a, b = one - middles[0], two - middles[1]
        turn = np.arctan2(weight @ (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]), weight @ (a[:, :2] * b[:, :2]).sum(axis=1))
        shift = middles[0] - about_z(float(turn)) @ middles[1]
        found = np.array([turn, *shift[:2], np.median(one[:, 2] - two[:, 2])])
    return found, count


def _yaw(matrix: Floats) -> float:
    return float(np.arctan2(matrix[1, 0], matrix[0, 0]))


def _wrapped(angle: Floats | float) -> Floats:
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
