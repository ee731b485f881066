"""Corrected poses: which frames moved, and objects that keep their ids when the frames are mapped again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.home.detection_log import DetectionLog
from cartier.mapping.object_map import ObjectMap
from cartier.types import Detections, Frame

Matrix = npt.NDArray[np.float64]
MOVED_M, MOVED_RAD = 0.02, float(np.deg2rad(0.5))  # less than a cell of the floor plan at the range of depth


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A keyframe that is in a map and can be read again.

    Args:
        stamp_ns: When it was taken (ns).
        world_from_camera: (4, 4) the pose that the map has of it.
        key: What tells it from other frames.
        read: Reads the frame, numbered as it was when it was added, and its detections.
    """

    stamp_ns: int
    world_from_camera: Matrix
    key: int
    read: Callable[[], tuple[Frame, Detections]]


def frame_key(frame: Frame) -> int:
    """What tells a frame from all others, 64 bits: its time and its pixels. A corrected pose makes no new frame."""
    pixels = np.ascontiguousarray(frame.rgb[::16, ::16]).tobytes()
    content = round(frame.time_s * 1e6).to_bytes(12, "big", signed=True) + pixels
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "little", signed=True)


def moved(one: Matrix, other: Matrix) -> bool:
    """Whether two poses (4, 4) differ by 2 cm or half a degree."""
    cosine = (float(np.sum(one[:3, :3] * other[:3, :3])) - 1) / 2
    turned = float(np.arccos(np.clip(cosine, -1, 1)))
    return bool(np.linalg.norm(one[:3, 3] - other[:3, 3]) >= MOVED_M or turned >= MOVED_RAD)


def blended(one: Matrix, two: Matrix, share: float) -> Matrix:
    """A pose (4, 4) between two, ``share`` of the way from the first to the second."""
    from scipy.spatial.transform import Rotation

    between = Rotation.from_matrix(one[:3, :3].T @ two[:3, :3]).as_rotvec() * share
    pose = np.eye(4)
    pose[:3, :3] = one[:3, :3] @ Rotation.from_rotvec(between).as_matrix()
    pose[:3, 3] = one[:3, 3] + share * (two[:3, 3] - one[:3, 3])
    return pose


def keep_ids(old: tuple[ObjectMap, DetectionLog], new: tuple[ObjectMap, DetectionLog], first: int) -> None:
    """Give the objects of a map the ids that they had in an older map of the same detections.

    Two objects are one if they share most boxes, one to one. An old object that is part of another one now becomes its
    alias.

    Args:
        old: The objects and detections of the older map.
        new: Those of the map that is changed.
        first: Objects below this id were in both before their frames; they keep it.
    """
    shared: dict[tuple[int, int], int] = {}
    for (was, now), count in old[1].co_detected(new[1]).items():
        pair = old[0].alive(was), new[0].alive(now)
        if pair[0] is not None and pair[1] is not None:
            shared[pair[0], pair[1]] = shared.get((pair[0], pair[1]), 0) + count
    new_ids = _one_to_one({pair: n for pair, n in shared.items() if min(pair) >= first})
    next_id = max(old[0].next_id, first)
    for number in new[0].columns()["id"].tolist():
        if number >= first and number not in new_ids:
            new_ids[number], next_id = next_id, next_id + 1
    for number in range(first, new[0].next_id):  # those that were merged or forgotten meanwhile
        alive = new[0].alive(number)
        if number not in new_ids:
            new_ids[number] = next_id if alive is None else new_ids.get(alive, alive)
            next_id += alive is None
    aliases = _parts(old[0], shared, new_ids)
    new[0].renumber(new_ids, aliases, next_id)
    new[1].renumber(new_ids)


def _one_to_one(shared: Mapping[tuple[int, int], int]) -> dict[int, int]:
    """The old id of each new object, such that as many boxes as possible are shared."""
    from scipy.optimize import linear_sum_assignment

    if not shared:
        return {}
    olds, news = (sorted({pair[side] for pair in shared}) for side in (0, 1))
    counts = np.zeros((len(olds), len(news)))
    for (was, now), count in shared.items():
        counts[olds.index(was), news.index(now)] = count
    rows, cols = linear_sum_assignment(counts, maximize=True)
    return {news[col]: olds[row] for row, col in zip(rows, cols, strict=True) if counts[row, col]}


def _parts(old: ObjectMap, shared: Mapping[tuple[int, int], int], new_ids: Mapping[int, int]) -> dict[int, int]:
    """The new id of what each old object that has none is part of now; also for what had become part of it before."""
    taken, into = set(new_ids.values()), dict[int, int]()
    for was in {pair[0] for pair in shared} - taken:
        best = max((pair for pair in shared if pair[0] == was), key=lambda pair: shared[pair])
        into[was] = new_ids.get(best[1], best[1])
    return into | {part: into.get(whole, whole) for part, whole in old.aliases.items()}
