"""Ids of objects that outlive mapping the same detections again, by the boxes that old and new objects share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cartier.home.detection_log import DetectionLog
from cartier.mapping.object_map import ObjectMap


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
